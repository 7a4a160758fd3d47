"""What a batch of estimations says, in sentences."""

import math
from collections.abc import Mapping, Sequence

from accpinn.findings import percent
from accpinn.results.tables.table import between
from accpinn.study.batch_progress import BatchProgress, BatchSummary
from accpinn.study.estimate import BatchEstimate
from accpinn.study.groups import Group, Groups
from accpinn.study.journal import Failure


def headline(whole: Group, level: float) -> str:
    """How many are string stable.

    Args:
        whole: all rows that are shown, as one group.
        level: of intervals.
    """
    share = whole.l2_stable
    if not math.isfinite(share.value):
        return "Nothing is known of string stability."
    value, low, high = (f"{100 * one:.0f}" for one in (share.value, share.low, share.high))
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
    known = [one for one in found.groups if math.isfinite(one.tau.median)]
    if len(known) > 1:
        first, last = (pick(known, key=lambda one: one.tau.median) for pick in (min, max))
        parts.append(
            f"Shortest τ: {_name(first)}, {_headway(first)}; longest: {_name(last)},"
            f" {_headway(last)}."
        )
    return " ".join(parts)


def _headway(one: Group) -> str:
    """The median and its interval."""
    return f"{one.tau.median:.2f} s ({between(one.tau.low, one.tau.high, 2)} s)"


def _name(one: Group) -> str:
    return " ".join(value for value in one.values if value) or "not named"


def trust_line(found: Groups) -> str:
    """How far groups can be trusted: those with one window or one vehicle."""
    count = _counted(len(found.groups), "group")
    few = sum(one.windows == 1 for one in found.groups)
    alone = sum(one.vehicles == 1 for one in found.groups)
    said = ""
    if few:
        said = f"{few} of {count} with one window" + (f", {alone} with one vehicle" * bool(alone))
    elif alone:
        said = f"{alone} of {count} with one vehicle"
    said += ". " if said else ""
    return f"{said}Windows of one recording are not independent, so intervals may be too narrow."


def batch_line(settings: Mapping[str, object]) -> str:
    """What all rows of a batch share; empty where that is not known."""
    window, case = settings.get("window"), settings.get("case")
    if window is None or case is None:
        return ""
    lasting = f"of up to {window:g} s" if isinstance(window, float | int) else "of any length"
    return f"Windows {lasting}, Case {case}."


def failures_line(failures: Sequence[Failure]) -> str:
    """How much has no result; empty where everything has one."""
    files = len({one.file for one in failures if one.start is None and one.file})
    rest = sum(one.start is not None or not one.file for one in failures)
    parts = [f"{_counted(files, 'file')} without a window"] if files else []
    parts += [f"{_counted(rest, 'estimate')} failed"] if rest else []
    return f"{' and '.join(parts)}; the tab Failures says why." if parts else ""


def progress_line(now: BatchProgress) -> str:
    """How far a batch is."""
    files = f"{now.done:.0f} of {_counted(now.files, 'file')}"
    rows = f"{_counted(now.windows, 'window')} and {_counted(now.rows, 'row')} so far"
    if now.vehicles:
        return (
            f"{files} · {rows} · windows of one vehicle taken together: {now.pooled} of"
            f" {now.vehicles}"
        )
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
