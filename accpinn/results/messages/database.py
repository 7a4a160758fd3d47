"""A batch of estimations in sentences: its results, its progress and its failures."""

import math
from collections.abc import Sequence

from accpinn.findings import percent, probability
from accpinn.inference.answer import SPEEDS
from accpinn.model.registry import TITLES
from accpinn.results.tables.table import between
from accpinn.study.batch import BatchProgress
from accpinn.study.groups import Group
from accpinn.study.plan import BatchEstimate
from accpinn.study.studies import Failure, Request

TYPICAL = (
    "Typical values rest on every window's posterior: the windows of a vehicle, then the vehicles"
    " of a group, each as different as they are found to be."
)
"""What the values of groups are."""


def headline(whole: Group) -> str:
    """The share of vehicles that are string stable, of all rows that are shown."""
    share, count = whole.l2_stable, len(whole.cars)
    if not math.isfinite(share.value):
        return "Nothing is known of string stability."
    if count == 1:
        return f"L₂ string stable with a probability of {probability(share.value)}."
    low, high = (f"{100 * part:.0f}" for part in (share.lower, share.upper))
    said = probability(share.value)
    return (
        f"{said[0].upper()}{said[1:]} of the {count} vehicles are L₂ string stable; of all such"
        f" vehicles {low} to {high} % ({percent(whole.level)} interval)."
    )


def extent(whole: Group, makes: int, recordings: int) -> str:
    """The number of windows, vehicles, makes and recordings that are shown."""
    return (
        f"{counted(whole.windows, 'follower window')} of {counted(whole.vehicles, 'vehicle')},"
        f" {counted(makes, 'make')}, {counted(recordings, 'recording')}."
    )


def typical_line(whole: Group) -> str:
    """The typical time gap of all rows; empty where none is known."""
    speed = SPEEDS[-1]
    gap = whole.time_gap(speed)
    if not math.isfinite(gap.value):
        return ""
    return (
        f"Typical time gap at {speed * 3.6:.0f} km/h: {gap.value:.2f} s"
        f" ({between(gap.lower, gap.upper, 2)} s)."
    )


def batch_line(request: Request | None) -> str:
    """The settings that all rows of a batch share; empty where they are not known."""
    if request is None:
        return ""
    length = f"of up to {request.window:g} s" if request.window else "of any length"
    return f"Windows {length}, Case {request.case}, model {TITLES[request.model]}."


def failures_line(failures: Sequence[Failure]) -> str:
    """The number of files and estimates without a result; empty if there are none."""
    files = len({failure.file for failure in failures if failure.start is None})
    estimates = sum(failure.start is not None for failure in failures)
    parts = [f"{counted(files, 'file')} without a window"] if files else []
    parts += [f"{counted(estimates, 'estimate')} failed"] if estimates else []
    return f"{' and '.join(parts)}; the tab Failures says why." if parts else ""


def progress_line(now: BatchProgress) -> str:
    """The progress of a batch."""
    files = f"{now.done:.0f} of {counted(now.files, 'file')}"
    rows = f"{counted(now.finished, 'window')} and {counted(now.rows, 'row')} so far"
    return f"{files} · {rows}" + (f" · {now.failed} failed" if now.failed else "")


def summary_line(summary: BatchProgress) -> str:
    """The result of a batch."""
    if summary.stopped:
        kept = counted(summary.rows, "row")
        return f"Stopped; what is finished is kept, and the same batch goes on from there: {kept}."
    counts = (
        f"{counted(summary.recordings, 'recording')}, {counted(summary.windows, 'window')},"
        f" {counted(summary.followers, 'follower')}, {counted(summary.rows, 'row')}"
    )
    reused = f", {summary.reused:,} of them known before" if summary.reused else ""
    return f"Done: {counts}{reused}."


def estimate_line(estimate: BatchEstimate) -> str:
    """The expected size of a batch; "about" where not all files were read."""
    about = "" if estimate.exact else "about "
    return (
        f"{counted(estimate.files, 'file')}: {about}{counted(round(estimate.windows), 'window')}"
        f" with {about}{counted(round(estimate.followers), 'follower')}"
    )


def counted(count: int, noun: str) -> str:
    """As "1 file" or "1,200 files"."""
    return f"{count:,} {noun}{'' if count == 1 else 's'}"
