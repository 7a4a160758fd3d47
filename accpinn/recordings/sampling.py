"""Even rows of a recording from tables with missing rows or channels of several rates.

A table whose time leaps by some steps has rows missing: they are inserted empty, so that they are
handled as empty cells are. A table whose channels are written at different rates has empty cells
between a channel's values: the slowest channel's instants stay, and the others are interpolated
there linearly, never across more than `LONGEST_PART` of their own steps.
"""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from accpinn.channels import GAP
from accpinn.errors import RecordingError
from accpinn.findings import Finding, Labelled, Words, percent
from accpinn.recordings import (
    FEWEST_REPEATS,
    FROZEN,
    MOVING,
    Mode,
    Recording,
    Window,
    listed,
)
from accpinn.recordings.increments import JUMP
from accpinn.units import FloatArray, Mask, Seconds, stretches

Refuse = Callable[[str, str, int], RecordingError]
"""Makes the error of a fault, its cure and the row where it is."""

LONGEST_PAUSE: Seconds = 3600.0
"""Longest leap of the time that is taken for missing rows; a longer one parts two recordings."""
LEAP = 1.5, 3.0
"""Steps from which on rows are missing, in typical ones: where steps are even, and where not."""
EVEN_STEP = 0.02
"""Largest relative deviation of steps from the typical one that are even."""
OF_ITS_OWN = 1.5
"""Least ratio of a channel's step to that of the rows at which the channel has another rate."""
LOST_LEAP = 8.0
"""Least leap to the value of a lost target, in medians of the gap's other changes."""
LONGEST_PART = 2.5
"""Longest distance between two values of a channel that is interpolated, in its typical steps."""


class RowsMissing(Finding, frozen=True):
    """The time leaps, so rows are missing; they were inserted empty."""

    text = "{rows} rows are missing ({part}), at {where}; they count as empty."

    rows: int
    share: float
    """Share of the recording's samples, 0 to 1."""
    windows: tuple[Window, ...]

    def _words(self, about: Labelled) -> Words:
        return {"part": percent(self.share), "where": listed(self.windows)}


class RatesMerged(Finding, frozen=True):
    """Channels are written at rates or instants of their own."""

    text = (
        "The columns have rows of their own ({steps}): all were interpolated at the instants of"
        " {column}."
    )

    fastest: Seconds
    slowest: Seconds
    column: str
    """The slowest."""

    def _words(self, about: Labelled) -> Words:
        slow, fast = f"{self.slowest:.3g} s", f"{self.fastest:.3g}"
        steps = f"steps of {fast} to {slow}" if slow != f"{fast} s" else f"each every {slow}"
        return {"steps": steps}


class TargetLost(Finding, frozen=True):
    """A space-gap stands at one value, to and from which it leaps: no vehicle was seen ahead."""

    text = (
        "{column} is {value:g} m in {samples} samples ({part}), between leaps, at {where}: no"
        " vehicle was seen ahead, so they count as empty."
    )

    vehicle: int
    """The vehicle ahead."""
    value: float
    """Value that the sensor writes without a vehicle ahead, in m."""
    samples: int
    share: float
    """Share of the recording's samples, 0 to 1."""
    windows: tuple[Window, ...]

    def _words(self, about: Labelled) -> Words:
        where = listed(self.windows)
        return {"column": GAP.of(self.vehicle), "part": percent(self.share), "where": where}


def without_lost_targets(
    vehicle: int, time: FloatArray, speed: FloatArray, gap: FloatArray
) -> tuple[FloatArray, TargetLost | None]:
    """A gap (N,) that is nan where its sensor lost the vehicle ahead, and where that is.

    A sensor then repeats its least or its largest value, which the gap leaps to and from. A frozen
    sensor repeats its last value instead, to which nothing leaps.

    Args:
        vehicle: the number of the vehicle ahead.
        time: (N,) in s, increasing.
        speed: (N,) the follower's, in m/s.
        gap: (N,) in m, nan in empty cells.
    """
    at = np.flatnonzero(np.isfinite(gap))
    values = gap[at]
    changes = np.abs(np.diff(values))
    if len(values) < FEWEST_REPEATS or not changes.any():
        return gap, None
    limit = max(JUMP, LOST_LEAP * float(np.median(changes[changes > 0])))
    is_lost = np.zeros(len(gap), bool)
    for value in (values.min(), values.max()):
        runs = [run for run in stretches(values == value) if len(run) >= FEWEST_REPEATS]
        leaps = [
            [changes[k] > limit for k in (run.first - 1, run.last) if 0 <= k < len(changes)]
            for run in runs
        ]
        if not any(len(ends) == 2 and all(ends) for ends in leaps):
            continue
        for run, ends in zip(runs, leaps, strict=True):
            rows = at[run.rows]
            is_moving = bool((np.nan_to_num(speed[rows]) > MOVING).any())
            if all(ends) and is_moving and time[rows[-1]] - time[rows[0]] >= FROZEN:
                is_lost[rows] = True
        if is_lost.any():
            windows = tuple(
                Window(round(float(time[run.first]), 6), round(float(time[run.last]), 6))
                for run in stretches(is_lost)
            )
            count = int(is_lost.sum())
            lost = TargetLost(vehicle, float(value), count, count / len(gap), windows)
            return np.where(is_lost, np.nan, gap), lost
    return gap, None


def merged(
    time: FloatArray, channels: FloatArray, columns: Sequence[str]
) -> tuple[FloatArray, FloatArray, RatesMerged | None]:
    """Put channels of several rates on the instants of the slowest.

    Args:
        time: (N,) in s, increasing.
        channels: (N, C) values, nan in empty cells.
        columns: (C,) names of the channels' columns.

    Returns:
        The time (n,), the channels (n, C) there, and what was done; all unchanged, and None, where
        every channel has a value in nearly every row.
    """
    step = float(np.median(np.diff(time)))
    filled: Mask = np.isfinite(channels)
    typical = np.array([
        np.median(np.diff(time[rows])) if rows.sum() > 2 else step for rows in filled.T
    ])  # fmt: skip
    if not (typical > OF_ITS_OWN * step).any():
        return time, channels, None
    slowest = int(typical.argmax())
    instants = time[filled[:, slowest]]
    values = np.column_stack([
        _interpolated(instants, time[rows], series[rows], LONGEST_PART * channel_step)
        for series, rows, channel_step in zip(channels.T, filled.T, typical, strict=True)
    ])  # fmt: skip
    complete = np.flatnonzero(np.isfinite(values).all(axis=1))
    if len(complete) < 2:
        return time, channels, None
    # Before and after, some channels have no value yet.
    inside = slice(complete[0], complete[-1] + 1)
    finding = RatesMerged(float(typical.min()), float(typical[slowest]), columns[slowest])
    return instants[inside] - instants[complete[0]], values[inside], finding


def _interpolated(
    at: FloatArray, time: FloatArray, values: FloatArray, longest: Seconds
) -> FloatArray:
    """Values (n,) at instants (n,) by straight lines, nan outside and in parts too long."""
    after = np.clip(np.searchsorted(time, at), 1, len(time) - 1)
    result = np.interp(at, time, values, left=np.nan, right=np.nan)
    is_far = time[after] - time[after - 1] > longest
    is_measured = np.isin(at, time)
    return np.asarray(np.where(is_far & ~is_measured, np.nan, result))


def shifted(time: FloatArray, channel: FloatArray, seconds: Seconds) -> FloatArray:
    """A channel (N,) with its clock corrected: the value written at t is moved to t + seconds."""
    if not seconds:
        return channel
    is_filled = np.isfinite(channel)
    step = float(np.median(np.diff(time)))
    return _interpolated(time, time[is_filled] + seconds, channel[is_filled], LONGEST_PART * step)


def with_missing_rows(
    time: FloatArray, refuse: Refuse
) -> tuple[FloatArray, NDArray[np.int64], tuple[Finding, ...]]:
    """The time with the instants of missing rows inserted.

    Args:
        time: (N,) in s, increasing from 0.
        refuse: makes the error of fault, cure and row.

    Returns:
        The time (n,), the rows (N,) of it that the table has, and what is missing.

    Raises:
        RecordingError: for a leap that parts two recordings.
    """
    steps = np.diff(time)
    typical = float(np.median(steps))
    is_even = np.mean(np.abs(steps - typical) <= EVEN_STEP * typical) > 0.8
    leaps = np.flatnonzero(steps > LEAP[0 if is_even else 1] * typical)
    if not len(leaps):
        return time, np.arange(len(time)), ()
    counts = np.rint(steps[leaps] / typical).astype(int) - 1
    long = np.flatnonzero((steps[leaps] > LONGEST_PAUSE) | (counts.cumsum() > len(time)))
    if len(long):
        row = int(leaps[long[0]]) + 1
        fault = f"the recording pauses for {steps[row - 1]:.1f} s before this row"
        raise refuse(fault, "split the file here into two recordings", row)
    counts_by_row = np.zeros(len(time), int)
    counts_by_row[leaps] = counts
    rows = np.arange(len(time)) + np.concatenate(([0], counts_by_row[:-1].cumsum()))
    filled = np.interp(np.arange(rows[-1] + 1), rows, time)
    is_missing = np.ones(len(filled), bool)
    is_missing[rows] = False
    windows = tuple(
        Window(round(float(filled[s.first]), 6), round(float(filled[s.last]), 6))
        for s in stretches(is_missing)
    )
    count = int(is_missing.sum())
    return filled, rows, (RowsMissing(count, count / len(filled), windows),)


def recording_of(
    time: FloatArray,
    speed: FloatArray,
    gap: FloatArray,
    mode: NDArray[np.int8],
    *,
    refuse: Refuse,
    findings: Sequence[Finding],
    **about: Any,
) -> Recording:
    """The recording of a table's rows, with missing rows inserted empty.

    Args:
        time: (N,) in s, increasing from 0.
        speed: (N, V) in m/s.
        gap: (N, V-1) in m.
        mode: (N, V) values of `Mode`.
        refuse: makes the error about one of the rows.
        findings: made while reading.
        about: what else the recording has.

    Raises:
        RecordingError: for a pause that parts two recordings.
    """
    instants, rows, missing = with_missing_rows(time, refuse)
    if missing:
        speed, gap = (_spread(values, rows, len(instants), np.nan) for values in (speed, gap))
        mode = _spread(mode, rows, len(instants), Mode.UNKNOWN)
    notes = (*findings, *missing)
    return Recording(time=instants, speed=speed, gap=gap, mode=mode, notes=notes, **about)


def _spread(values: NDArray[Any], rows: NDArray[np.int64], samples: int, empty: float) -> Any:
    """Values (N, C) in their rows of (samples, C), the others empty."""
    spread = np.full((samples, values.shape[1]), empty, values.dtype)
    spread[rows] = values
    return spread
