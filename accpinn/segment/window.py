"""A window of a recording and the vehicles in it: the data every method works on."""

import hashlib
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from accpinn.errors import SegmentError
from accpinn.mask import Run
from accpinn.recordings.recording import Recording
from accpinn.segment.info import SegmentInfo, labels
from accpinn.segment.missing import (
    BRIDGE,
    MINIMUM_DURATION,
    VehicleChannels,
    Window,
    platoon_data,
    refuse_missing,
)
from accpinn.segment.vehicles import check_vehicles, default_vehicles
from accpinn.units import FloatArray, Seconds, frozen

DURATION: Seconds = 300.0
"""Length of a window unless told otherwise; that of the studies this package follows."""
SLACK: Seconds = 1e-6
"""Times closer than this are the same; float noise of time stamps is below 1e-9 s."""


@dataclass(frozen=True, eq=False)
class Segment:
    """Speeds and space-gaps of consecutive vehicles on evenly spaced instants, nothing missing."""

    time: FloatArray
    """(N,) in s from the window's start: 0, dt, 2 dt, ..."""
    speeds: FloatArray
    """(N, M+1) in m/s, leader first."""
    gaps: FloatArray
    """(N, M) in m; column k is the space-gap between vehicles k and k+1 of this segment."""
    vehicles: tuple[int, ...]
    """(M+1,) the vehicles' numbers in the file (1 = first), leader first."""
    names: tuple[str, ...]
    """(M+1,) their names in the file's header."""
    start: Seconds
    """Window start, in s from the recording's first sample."""
    source: str
    """File name of the recording."""
    sha256: str
    """Of the recording's bytes; empty for data made in memory."""
    notes: tuple[str, ...] = ()
    """What was done to the data (resampled, bridged, left out), in plain sentences."""
    left_out: NDArray[np.bool_] | None = None
    """(N, M) where a follower's equation dv/dt = .. does not count; None where all count."""
    excluded_regimes: tuple[str, ...] = ()
    """What was left out, by name (see `segment.regimes`)."""

    def __post_init__(self) -> None:
        """Copy and lock the arrays; refuse shapes and values no method could work on."""
        for name in ("time", "speeds", "gaps"):
            object.__setattr__(self, name, frozen(getattr(self, name)))
        if self.left_out is not None:
            object.__setattr__(self, "left_out", frozen(self.left_out, dtype=np.bool_))
        fault = self._fault()
        if fault:
            raise SegmentError(f"{self.source}: this is no segment, as {fault}.")

    def _fault(self) -> str:
        samples, count = len(self.time), len(self.vehicles)
        if self.time.ndim != 1 or samples < 2:
            return "it needs at least two instants"
        if count < 2 or len(self.names) != count:
            return "it needs a leader, a follower and a name for each"
        if self.speeds.shape != (samples, count) or self.gaps.shape != (samples, count - 1):
            return "speeds, gaps, instants and vehicles differ in number"
        if not all(np.isfinite(values).all() for values in (self.time, self.speeds, self.gaps)):
            return "numbers are missing or infinite"
        if self.left_out is not None and self.left_out.shape != self.gaps.shape:
            return "what is left out and the space-gaps differ in number"
        return ""

    @property
    def samples(self) -> int:
        """N."""
        return len(self.time)

    @property
    def followers(self) -> int:
        """M."""
        return len(self.vehicles) - 1

    @property
    def sample_time(self) -> Seconds:
        """The step between instants."""
        return round(self.duration / (self.samples - 1), 9)

    @property
    def duration(self) -> Seconds:
        """From the first to the last instant."""
        return round(float(self.time[-1] - self.time[0]), 6)

    @property
    def labels(self) -> tuple[str, ...]:
        """(M+1,) number and name of each vehicle, for legends and tables."""
        return labels(self.vehicles, self.names)

    @property
    def left_out_share(self) -> tuple[float, ...]:
        """(M,) share of each follower's instants left out, 0 to 1; empty where all count."""
        if self.left_out is None:
            return ()
        return tuple(float(share) for share in self.left_out.mean(axis=0))

    def digest(self) -> str:
        """SHA-256 of what determines an estimate: instants, speeds, gaps, vehicles, start, mask."""
        content = hashlib.sha256(repr((self.vehicles, float(self.start))).encode())
        for values in (self.time, self.speeds, self.gaps):
            content.update(repr(values.shape).encode())
            content.update(np.ascontiguousarray(values, dtype="<f8").tobytes())
        if self.left_out is not None:
            content.update(b"left out" + np.ascontiguousarray(self.left_out).tobytes())
        return content.hexdigest()

    def info(self) -> SegmentInfo:
        """All but the data."""
        return SegmentInfo(
            vehicles=self.vehicles,
            names=self.names,
            start=self.start,
            duration=self.duration,
            samples=self.samples,
            sample_time=self.sample_time,
            source=self.source,
            sha256=self.sha256,
            notes=self.notes,
            digest=self.digest(),
            left_out=self.excluded_regimes,
            left_out_share=self.left_out_share,
        )


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
