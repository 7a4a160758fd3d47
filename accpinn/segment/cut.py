"""Cutting a segment: the window that can be had, on even instants, with short holes bridged."""

import math
from collections.abc import Sequence

import numpy as np

from accpinn.errors import SegmentError
from accpinn.mask import Run
from accpinn.recordings.recording import Recording
from accpinn.segment.missing import (
    BRIDGE,
    MINIMUM_DURATION,
    VehicleChannels,
    platoon_data,
    refuse_missing,
)
from accpinn.segment.segment import Segment, Window
from accpinn.segment.vehicles import check_vehicles, default_vehicles
from accpinn.units import FloatArray, Seconds

DURATION: Seconds = 300.0
"""Length of a window unless told otherwise; that of the studies this package follows."""
SLACK: Seconds = 1e-6
"""Times closer than this are the same; float noise of time stamps is below 1e-9 s."""


def cut(
    recording: Recording,
    start: Seconds = 0.0,
    duration: Seconds = DURATION,
    vehicles: Sequence[int] | None = None,
    bridge: Seconds = BRIDGE,
) -> Segment:
    """The window [start, start + duration] of the chosen vehicles.

    Args:
        recording: what to cut from.
        start: seconds from the recording's first sample.
        duration: seconds; 300 s at 0.1 s are 3001 samples, as both ends are in. A window that
            reaches past the end is shortened, and the notes say so.
        vehicles: consecutive numbers, leader first; by default see `default_vehicles`.
        bridge: missing blocks up to this many seconds are bridged linearly, and the notes say so.

    Raises:
        SegmentError: one sentence of what is wrong and what would be possible.
    """
    chosen = (
        default_vehicles(recording) if vehicles is None else check_vehicles(recording, vehicles)
    )
    notes: list[str] = []
    window = _fit_window(recording, start, duration, notes)
    platoon = platoon_data(recording, chosen, bridge)
    source = _source_rows(recording, window)
    refuse_missing(platoon, source)
    time, values = _on_grid(platoon, source, window, notes)
    notes.extend(platoon.bridge_notes(source))
    return Segment(
        time=time,
        speeds=values[:, : len(chosen)],
        gaps=values[:, len(chosen) :],
        vehicles=chosen,
        names=tuple(recording.vehicles[number - 1].name for number in chosen),
        start=window.start,
        source=recording.source,
        sha256=recording.sha256,
        notes=tuple(notes),
    )


def _fit_window(
    recording: Recording, start: Seconds, duration: Seconds, notes: list[str]
) -> Window:
    """The window as it can be had: inside the recording, on its samples where these are even."""
    end = recording.duration
    if not 0 <= start < math.inf:
        raise SegmentError(
            f"{recording.source}: no window can start at {start:g} s; start at 0 s or later."
        )
    if not MINIMUM_DURATION <= duration:
        short = f"a window of {duration:g} s is too short to learn from"
        fault = short if duration < MINIMUM_DURATION else "the window's length is no number"
        raise SegmentError(f"{recording.source}: {fault}; take at least {MINIMUM_DURATION:g} s.")
    if end - start < MINIMUM_DURATION:
        latest = f"start at {end - MINIMUM_DURATION:.1f} s or earlier"
        cure = latest if end >= MINIMUM_DURATION else "choose a longer one"
        raise SegmentError(
            f"{recording.source}: less than {MINIMUM_DURATION:g} s remain from {start:g} s to the"
            f" end of the recording at {end:.1f} s; {cure}."
        )
    if recording.is_even:
        nearest = round(round(start / recording.sample_time) * recording.sample_time, 9)
        if abs(nearest - start) > SLACK:
            notes.append(f"The window starts at {nearest:g} s, the sample nearest to {start:g} s.")
        start = nearest
    if end + SLACK < start + duration < math.inf:
        notes.append(
            f"The window ends with the recording at {end:.1f} s: {end - start:.1f} s instead of"
            f" {duration:g} s."
        )
    return Window(start, min(start + duration, end))


def _source_rows(recording: Recording, window: Window) -> Run:
    """The samples that a window draws on, including those just outside an uneven one's ends."""
    first = int(np.searchsorted(recording.time, window.start + SLACK, side="right")) - 1
    last = int(np.searchsorted(recording.time, window.end - SLACK, side="left"))
    if recording.is_even:
        last = first + math.floor((window.duration + SLACK) / recording.sample_time)
    return Run(first, last)


def _on_grid(
    platoon: VehicleChannels, source: Run, window: Window, notes: list[str]
) -> tuple[FloatArray, FloatArray]:
    """Even instants from 0 (N,) and the values there (N, 2M+1)."""
    recording = platoon.recording
    step = recording.sample_time
    count = math.floor((window.duration + SLACK) / step) + 1
    time: FloatArray = np.arange(count, dtype=np.float64) * step
    rows = slice(source.first, source.last + 1)
    values: FloatArray = platoon.values[rows]
    if recording.is_even:
        return time, values
    notes.append(f"Resampled linearly to even steps of {step:g} s, as the file's steps vary.")
    stamps, instants = recording.time[rows], window.start + time
    resampled: FloatArray = np.empty((len(time), values.shape[1]))
    for column, series in enumerate(values.T):
        resampled[:, column] = np.interp(instants, stamps, series)
    return time, resampled
