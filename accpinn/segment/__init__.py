"""A segment: a window of a recording and the vehicles in it, the data every method works on.

A follower is in car-following while it moves with a time gap p/v of at most

    1.3 times its median in the recording, but at least 2 s and at most 3.5 s

so that a long distance setting counts as car-following and catching up does not. The windows that
are suggested, planned for a batch and graded, and the regimes, all use this limit.
"""

import hashlib
from collections.abc import Collection, Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from accpinn.errors import SegmentError
from accpinn.findings import Finding, Labelled, Words
from accpinn.model.cthp import Case, Trajectories
from accpinn.recordings import MOVING, ValuesOutOfRange, Window, listed, vehicle_label
from accpinn.recordings.inconsistency import (
    ClocksDiffer,
    ColumnsCopied,
    GapComputed,
    GapContradictsSpeeds,
    GapJumps,
    SignReversed,
    SpeedsApart,
    UnitsDiffer,
)
from accpinn.recordings.mapped import UnitContradictsHeader
from accpinn.recordings.mapping import MappingRemembered
from accpinn.units import FloatArray, Mask, Seconds, frozen

USUAL = 1.3
"""Longest time gap of car-following, as a multiple of the follower's median."""
LONGEST_TIME_GAP: tuple[Seconds, Seconds] = (2.0, 3.5)
"""Least and largest limit of the time gap; the settings of cruise controls end near 3 s."""


def time_gaps(speeds: FloatArray, gaps: FloatArray) -> FloatArray:
    """(..) p/v in s of speeds and gaps (..), nan where a follower stands or a sample is missing."""
    ratio = np.full(gaps.shape, np.nan)
    np.divide(gaps, speeds, out=ratio, where=speeds > MOVING)
    return ratio


def longest_time_gap(gaps: FloatArray) -> Seconds:
    """The longest time gap in car-following of one follower, from all of its time gaps (N,)."""
    finite = gaps[np.isfinite(gaps)]
    least, most = LONGEST_TIME_GAP
    return float(np.clip(USUAL * np.median(finite), least, most)) if len(finite) else least


class WindowMoved(Finding, frozen=True):
    """The window starts at the sample nearest to the start requested."""

    text = "The window starts at {start:g} s, the sample nearest to {asked:g} s."

    asked: Seconds
    start: Seconds


class WindowShortened(Finding, frozen=True):
    """The window ends with the recording, so that it is shorter than requested."""

    text = (
        "The window ends with the recording at {window.end:.1f} s: {window.duration:.1f} s instead"
        " of {asked:g} s."
    )

    asked: Seconds
    window: Window


class Resampled(Finding, frozen=True):
    """The file's steps vary, so the data were resampled linearly to even ones."""

    text = "Resampled linearly to even steps of {step:g} s, as the file's steps vary."

    step: Seconds


class Bridged(Finding, frozen=True):
    """Missing samples were bridged by straight lines."""

    text = "Bridged {samples} of {column} at {where}."

    column: str
    """Its name in the file, as Speed2."""
    samples: int
    windows: tuple[Window, ...]
    """Where, in the recording's time."""

    def _words(self, about: Labelled) -> Words:
        samples = "1 sample" if self.samples == 1 else f"{self.samples} samples"
        where = ", ".join(map(str, self.windows))
        return {"samples": samples, "where": where}


class BlocksMissing(Finding, frozen=True):
    """Samples are missing for longer than a straight line may bridge."""

    text = (
        "{columns} {are} missing in {share:percent} of the window, at {where}; the likelihood"
        " leaves these samples out."
    )

    columns: tuple[str, ...]
    """Names in the file of all channels that are missing at the same time, as Speed2 and IVS1."""
    share: float
    """Share of the window's samples, 0 to 1; bridged ones do not count."""
    windows: tuple[Window, ...]
    """Where, in the recording's time."""

    def _words(self, about: Labelled) -> Words:
        are = "is" if len(self.columns) == 1 else "are"
        return {"are": are, "where": listed(self.windows)}


class RegimesExcluded(Finding, frozen=True):
    """Instants of some regimes do not count in the equations of the model."""

    text = "Excluded from the equations of the model: {regimes} ({listed} of the instants)."
    item_text = "{vehicle}: {shares:percent}"

    regimes: tuple[str, ...]
    vehicles: tuple[int, ...]
    """The followers."""
    shares: tuple[float, ...]
    """The share of each one's instants that is excluded, 0 to 1."""


class NothingToExclude(Finding, frozen=True):
    """No instant has one of the regimes to exclude."""

    text = "Nothing to exclude: in this window there is no {regimes}."

    regimes: tuple[str, ...]

    def _words(self, about: Labelled) -> Words:
        return {"regimes": " or ".join(self.regimes)}


class DrivenByHand(Finding, frozen=True):
    """Followers that a driver, not ACC, controls, so that their parameters are not those of ACC."""

    text = (
        "These are not ACC parameters: by the file's {evidence}, a driver controls {listed}."
        " α, β and τ then describe the driver."
    )
    partly = (
        "By the file's {evidence}, a driver, not ACC, controls {listed}. α, β and τ rest on that"
        " time as well."
    )
    item_text = "{vehicle} ({shares:percent} of the time)"

    vehicles: tuple[int, ...]
    shares: tuple[float, ...]
    """The share of the window's samples of each, 0 to 1."""
    by_flag: bool = False
    """Whether only the flag of the whole run shows it, as the file has no modes."""

    def sentence(self, about: Labelled) -> str:
        """The finding, weaker where ACC controls each of them for most of the time."""
        return self.filled(self.text if max(self.shares) > 0.5 else self.partly, about)

    def among(self, vehicles: Collection[int]) -> "DrivenByHand | None":
        """The finding about some of the vehicles, by their numbers; None where it concerns none."""
        pairs = [
            pair for pair in zip(self.vehicles, self.shares, strict=True) if pair[0] in vehicles
        ]
        numbers, shares = [number for number, _ in pairs], [share for _, share in pairs]
        return DrivenByHand(tuple(numbers), tuple(shares), self.by_flag) if pairs else None

    def _words(self, about: Labelled) -> Words:
        modes = "flag (it gives no driver modes)" if self.by_flag else "driver modes"
        return {"evidence": modes}


SegmentFinding = (
    WindowMoved
    | WindowShortened
    | Resampled
    | Bridged
    | BlocksMissing
    | RegimesExcluded
    | NothingToExclude
    | DrivenByHand
    | GapContradictsSpeeds
    | SignReversed
    | UnitsDiffer
    | SpeedsApart
    | ClocksDiffer
    | ColumnsCopied
    | GapJumps
    | GapComputed
    | ValuesOutOfRange
    | MappingRemembered
    | UnitContradictsHeader
)


@dataclass(frozen=True, eq=False, kw_only=True)
class _Platoon:
    """Vehicles and origin of a segment."""

    vehicles: tuple[int, ...]
    """(M+1,) the vehicles' numbers in the file (1 = first), leader first."""
    names: tuple[str, ...]
    """(M+1,) their names in the file's header."""
    source: str
    """File name of the recording."""
    sha256: str
    """SHA-256 of the recording's bytes; empty for data made in memory."""
    findings: tuple[SegmentFinding, ...] = ()
    """Findings: data that were moved, resampled, bridged or excluded, that are missing, and that
    the whole recording shows to be unsound."""
    excluded_regimes: tuple[str, ...] = ()
    """Regimes whose instants do not count in the model's equation (see `segment.quality`)."""

    def __post_init__(self) -> None:
        """Drop the finding of manual driving where that is excluded, as no estimate rests on it."""
        if "manual" in self.excluded_regimes:
            findings = (f for f in self.findings if not isinstance(f, DrivenByHand) or f.by_flag)
            object.__setattr__(self, "findings", tuple(findings))

    @property
    def driven_by_hand(self) -> DrivenByHand | None:
        """The followers without ACC; None where all have it or manual driving is excluded."""
        return next((f for f in self.findings if isinstance(f, DrivenByHand)), None)

    @property
    def followers(self) -> int:
        """The number of followers, M."""
        return len(self.vehicles) - 1

    def shares(self, case: Case) -> bool:
        """Whether several followers share one parameter set, as in Case I."""
        return case == "I" and self.followers > 1

    @property
    def labels(self) -> tuple[str, ...]:
        """(M+1,) number and name of each vehicle, for legends and tables."""
        return tuple(map(vehicle_label, self.vehicles, self.names))

    def label(self, number: int) -> str:
        """The label of the vehicle with that number in the file; 0 stands for all followers."""
        return self.labels[self.vehicles.index(number)] if number else "All followers together"


@dataclass(frozen=True, kw_only=True)
class SegmentInfo(_Platoon):
    """A segment's window, vehicles and origin without its data: enough for tables and a report."""

    window: Window
    samples: int
    """N, both ends of the window included."""
    sample_time: Seconds
    digest: str
    """SHA-256 of the segment's data: equal digests mean equal data."""
    excluded_share: tuple[float, ...] = ()
    """(M,) share of each follower's instants excluded, 0 to 1; empty where all count."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Segment(_Platoon):
    """Speeds and space-gaps of consecutive vehicles on evenly spaced instants.

    Where a sample is missing, ``speeds`` and ``gaps`` hold a straight line between its neighbours;
    `measured_speeds`, `measured_gaps` and `counts` leave it out.

    Segments with the same data are equal, so that results are cached by them.
    """

    time: FloatArray
    """(N,) in s from the window's start: 0, dt, 2 dt, ..."""
    speeds: FloatArray
    """(N, M+1) in m/s, leader first."""
    gaps: FloatArray
    """(N, M) in m; column k is the space-gap between vehicles k and k+1 of this segment."""
    start: Seconds
    """Start of the window, in s from the recording's first sample."""
    mask: Mask | None = None
    """(N, M) True where the model's equation of dv/dt counts; None where it does throughout."""
    missing: Mask | None = None
    """(N, 2M+1) True where a speed (the first M+1 columns) or a space-gap was not measured; None
    where all were."""
    longest_time_gaps: tuple[Seconds, ...] = ()
    """(M,) longest time gap of each follower in car-following, from the whole recording; by default
    from the segment itself."""

    def __post_init__(self) -> None:
        """Copy and lock the arrays; refuse shapes and values no method could work on."""
        super().__post_init__()
        for name in ("time", "speeds", "gaps"):
            object.__setattr__(self, name, frozen(getattr(self, name)))
        if self.mask is not None:
            object.__setattr__(self, "mask", frozen(self.mask, dtype=np.bool_))
        if self.missing is not None:
            missing = frozen(self.missing, dtype=np.bool_) if np.any(self.missing) else None
            object.__setattr__(self, "missing", missing)
        fault = self._fault()
        if fault:
            raise SegmentError(f"{self.source}: this is no segment, as {fault}.")
        if not self.longest_time_gaps:
            limits = tuple(map(longest_time_gap, self.time_gaps.T))
            object.__setattr__(self, "longest_time_gaps", limits)

    def __eq__(self, other: object) -> bool:
        """Whether both hold the same data of the same vehicles."""
        return isinstance(other, Segment) and self.info.digest == other.info.digest

    def __hash__(self) -> int:
        """Hash of the data."""
        return hash(self.info.digest)

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
        if self.mask is not None and self.mask.shape != self.gaps.shape:
            return "the mask and the space-gaps differ in number"
        if self.missing is not None and self.missing.shape != (samples, 2 * count - 1):
            return "the missing samples and the channels differ in number"
        if len(self.longest_time_gaps) not in (0, count - 1):
            return "the limits of time gaps and the followers differ in number"
        return ""

    @property
    def samples(self) -> int:
        """The number of instants, N."""
        return len(self.time)

    @property
    def window(self) -> Window:
        """The interval of the recording, to the microsecond."""
        duration = round(float(self.time[-1] - self.time[0]), 6)
        return Window(self.start, round(self.start + duration, 9))

    @property
    def sample_time(self) -> Seconds:
        """The step between instants in s."""
        return round(self.window.duration / (self.samples - 1), 9)

    @cached_property
    def measured_speeds(self) -> FloatArray:
        """(N, M+1) measured speeds in m/s; nan where missing."""
        return self._measured(self.speeds, slice(len(self.vehicles)))

    @cached_property
    def measured_gaps(self) -> FloatArray:
        """(N, M) measured space-gaps in m; nan where missing."""
        return self._measured(self.gaps, slice(len(self.vehicles), None))

    @property
    def measured(self) -> Trajectories:
        """Measured speeds and space-gaps over the window's time."""
        return Trajectories(self.time, self.measured_speeds, self.measured_gaps)

    def _measured(self, values: FloatArray, columns: slice) -> FloatArray:
        if self.missing is None:
            return values
        return frozen(np.where(self.missing[:, columns], np.nan, values))

    @cached_property
    def time_gaps(self) -> FloatArray:
        """(N, M) measured time gaps in s, nan where a follower stands or a sample is missing."""
        return time_gaps(self.measured_speeds[:, 1:], self.measured_gaps)

    @property
    def car_following(self) -> Mask:
        """(N, M) True where a follower is in car-following; False where a sample is missing."""
        return np.asarray(self.time_gaps <= self.longest_time_gaps)

    @cached_property
    def counts(self) -> Mask:
        """(N, M) True where a follower's equation of dv/dt counts and all in it was measured."""
        counts = np.ones(self.gaps.shape, bool) if self.mask is None else self.mask.copy()
        if self.missing is not None:
            speeds, gaps = np.split(self.missing, [len(self.vehicles)], axis=1)
            counts &= ~(speeds[:, 1:] | speeds[:, :-1] | gaps)
        counts.setflags(write=False)
        return counts

    def pair(self, follower: int) -> "Segment":
        """One follower, 0 for the first, behind the measured vehicle ahead of it."""
        ahead, count = slice(follower, follower + 2), len(self.vehicles)
        missing, columns = self.missing, [follower, follower + 1, count + follower]
        return replace(
            self,
            speeds=self.speeds[:, ahead],
            gaps=self.gaps[:, [follower]],
            vehicles=self.vehicles[ahead],
            names=self.names[ahead],
            mask=None if self.mask is None else self.mask[:, [follower]],
            missing=None if missing is None else missing[:, columns],
            longest_time_gaps=self.longest_time_gaps[follower : follower + 1],
        )

    def part(self, first: int, end: int) -> "Segment":
        """Samples ``first`` to ``end`` - 1."""
        rows = slice(first, end)
        return replace(
            self,
            time=self.time[rows] - self.time[first],
            speeds=self.speeds[rows],
            gaps=self.gaps[rows],
            mask=None if self.mask is None else self.mask[rows],
            missing=None if self.missing is None else self.missing[rows],
            start=self.start + float(self.time[first]),
        )

    @property
    def blocks_missing(self) -> tuple[BlocksMissing, ...]:
        """The findings of samples that are missing for long; most methods cannot use such data."""
        return tuple(f for f in self.findings if isinstance(f, BlocksMissing))

    @cached_property
    def info(self) -> SegmentInfo:
        """The segment without its data."""
        share = () if self.mask is None else tuple((~self.mask).mean(axis=0).tolist())
        return SegmentInfo(
            **{field.name: getattr(self, field.name) for field in fields(_Platoon)},
            window=self.window,
            samples=self.samples,
            sample_time=self.sample_time,
            digest=self._digest(),
            excluded_share=share,
        )

    def _digest(self) -> str:
        """SHA-256 of all that determines a result: instants, speeds, gaps, masks and vehicles."""
        whose = (self.vehicles, float(self.start), *map(float, self.longest_time_gaps))
        content = hashlib.sha256(repr(whose).encode())
        for values in (self.time, self.speeds, self.gaps):
            content.update(repr(values.shape).encode())
            content.update(np.ascontiguousarray(values, dtype="<f8").tobytes())
        if self.mask is not None:
            content.update(b"mask" + np.ascontiguousarray(self.mask).tobytes())
        if self.missing is not None:
            content.update(b"missing" + np.ascontiguousarray(self.missing).tobytes())
        return content.hexdigest()


def median_speeds(segments: Sequence[Segment]) -> FloatArray:
    """(M,) each follower's median speed over some windows, in m/s; see `median_by_duration`."""
    medians = np.array([np.median(segment.speeds[:, 1:], axis=0) for segment in segments])
    return median_by_duration(medians, [segment.window.duration for segment in segments])


def median_by_duration(medians: FloatArray, durations: ArrayLike) -> FloatArray:
    """(M,) the medians of windows' medians (K, M), where each window counts by its duration."""
    order, weights = np.argsort(medians, axis=0), np.asarray(durations, float)
    reached = np.cumsum(weights[order], axis=0) >= (0.5 - 1e-9) * weights.sum()
    chosen = np.take_along_axis(order, reached.argmax(axis=0)[None], axis=0)
    return np.asarray(np.take_along_axis(medians, chosen, axis=0)[0])
