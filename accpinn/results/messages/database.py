"""What a batch of estimations says, in sentences."""

import math
from collections.abc import Sequence

from accpinn.results.messages import percent
from accpinn.results.tables.table import between
from accpinn.study.groups import Group, Groups
from accpinn.study.progress import BatchEstimate, BatchProgress, BatchSummary
from accpinn.study.studies import Failure, Request


def headline(whole: Group, level: float) -> str:
    """How many are string stable.

    Args:
        whole: all rows that are shown, as one group.
        level: coverage of the intervals, 0 to 1.
    """
    share = whole.l2_stable
    if not math.isfinite(share.value):
        return "Nothing is known of string stability."
    value, low, high = (f"{100 * x:.0f}" for x in (share.value, share.low, share.high))
    return (
        f"{value} % of the followers are L₂ string stable ({percent(level)} interval {low} to"
        f" {high} %)."
    )


def extent(whole: Group, makes: int, recordings: int) -> str:
    """How much the rows that are shown hold.

    Args:
        whole: all of them, as one group.
        makes: different ones.
        recordings: different ones.
    """
    return (
        f"{_counted(whole.windows, 'follower window')} of {_counted(whole.vehicles, 'vehicle')},"
        f" {_counted(makes, 'make')}, {_counted(recordings, 'recording')}."
    )


def typical_line(whole: Group, found: Groups) -> str:
    """The typical time headway of all, and which groups have the shortest and the longest."""
    parts = []
    if math.isfinite(whole.tau.median):
        parts.append(
            f"Median time headway τ {_headway(whole)},"
            f" mean time gap {whole.mean_time_gap.value:.2f} s."
        )
    known = [group for group in found.groups if math.isfinite(group.tau.median)]
    if len(known) > 1:
        first, last = (pick(known, key=lambda group: group.tau.median) for pick in (min, max))
        parts.append(
            f"Shortest τ: {_name(first)}, {_headway(first)}; longest: {_name(last)},"
            f" {_headway(last)}."
        )
    return " ".join(parts)


def _headway(group: Group) -> str:
    """The median and its interval."""
    return f"{group.tau.median:.2f} s ({between(group.tau.low, group.tau.high, 2)} s)"


def _name(group: Group) -> str:
    return " ".join(value for value in group.values if value) or "not named"


def trust_line(found: Groups) -> str:
    """How far groups can be trusted: those with one window or one vehicle."""
    count = _counted(len(found.groups), "group")
    few = sum(group.windows == 1 for group in found.groups)
    alone = sum(group.vehicles == 1 for group in found.groups)
    said = ""
    if few:
        said = f"{few} of {count} with one window" + (f", {alone} with one vehicle" * bool(alone))
    elif alone:
        said = f"{alone} of {count} with one vehicle"
    said += ". " if said else ""
    return f"{said}Windows of one recording are not independent, so intervals may be too narrow."


def batch_line(request: Request | None) -> str:
    """What all rows of a batch share; empty where that is not known."""
    if request is None:
        return ""
    lasting = f"of up to {request.window:g} s" if request.window else "of any length"
    return f"Windows {lasting}, Case {request.case}."


def failures_line(failures: Sequence[Failure]) -> str:
    """How much has no result; empty where everything has one."""
    files = len({failure.file for failure in failures if failure.start is None})
    estimates = sum(failure.start is not None for failure in failures)
    parts = [f"{_counted(files, 'file')} without a window"] if files else []
    parts += [f"{_counted(estimates, 'estimate')} failed"] if estimates else []
    return f"{' and '.join(parts)}; the tab Failures says why." if parts else ""


def progress_line(now: BatchProgress) -> str:
    """How far a batch is."""
    files = f"{now.done:.0f} of {_counted(now.files, 'file')}"
    rows = f"{_counted(now.windows, 'window')} and {_counted(now.rows, 'row')} so far"
    return f"{files} · {rows}" + (f" · {now.failed} failed" if now.failed else "")


def summary_line(found: BatchSummary) -> str:
    """What a batch has come to."""
    if found.stopped:
        return f"Stopped; what is finished is kept: {_counted(found.rows, 'row')}."
    said = (
        f"{_counted(found.recordings, 'recording')}, {_counted(found.windows, 'window')},"
        f" {_counted(found.rows, 'row')}"
    )
    return f"Done: {said}" + (f", {found.reused:,} of them known before." if found.reused else ".")


def estimate_line(found: BatchEstimate) -> str:
    """What a batch will come to; "about" where not all files were read."""
    about = "" if found.exact else "about "
    return (
        f"{_counted(found.files, 'file')}: {about}{_counted(round(found.windows), 'window')} with"
        f" {about}{_counted(round(found.followers), 'follower')}"
    )


def _counted(count: int, noun: str) -> str:
    return f"{count:,} {noun}{'' if count == 1 else 's'}"
