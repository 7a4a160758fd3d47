"""A recording: metadata, vehicles, speeds, gaps and modes over time, and findings about them.

files.py makes recordings of files, arrays.py of arrays and frames, synthetic.py by simulation.
"""

import datetime
import hashlib
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from enum import IntEnum
from functools import cached_property
from typing import TypedDict, cast

import numpy as np
from numpy.typing import NDArray

from accpinn.channels import GAP, RECORDED, SPEED
from accpinn.display import Displayed
from accpinn.errors import RecordingError
from accpinn.findings import Finding, Labelled, Words, percent
from accpinn.recordings.consistency import inconsistencies
from accpinn.recordings.inconsistency import GapJumps
from accpinn.recordings.increments import Pair
from accpinn.recordings.mapping import CsvMapping
from accpinn.recordings.summary import summary
from accpinn.units import FloatArray, Mask, MetresPerSecond, Seconds, Stretch, frozen, stretches

EVEN_TOLERANCE: Seconds = 1e-6
"""Largest distance of even time stamps from a regular grid; float noise is below 1e-9 s."""
ANOTHER_UNIT = 0.01
"""Share of samples that are too large above which their unit is probably another one."""
OTHER_SIGN = 0.5
"""Share of samples that are negative above which their sign is probably the other one."""
FROZEN: Seconds = 0.5
"""Longest repetition of a value in motion that is no fault of the receiver."""
FEWEST_REPEATS = 3
"""Fewest repetitions of a value that are a fault; once or twice coarse samples agree by chance."""
MOVING: MetresPerSecond = 1.0
"""Speed up to which a vehicle stands: values may repeat, and a time gap has no meaning."""
LITTLE_LEADER_MOTION: MetresPerSecond = 0.5
"""Least deviation of a leader's speed that excites its followers."""
BLOCKS_LISTED = 3
"""Missing blocks that a finding lists."""
_JOINED = re.compile(r"(.*\w)(\([^()]*\))")
"""Make and model joined, as "Mercedes(AClass)"."""
HUMAN_FLAG = 0
"""The file's ACC flag of a run with human drivers."""
FLAGS = {HUMAN_FLAG: "human drivers", 1: "ACC", 2: "mixed"}
"""Meaning of the file's ACC flag, which describes the recording as a whole."""


class Mode(IntEnum):
    """Driver of a vehicle at one instant: ACC, or a person."""

    UNKNOWN = -1
    HUMAN = 0
    ACC = 1


@dataclass(frozen=True)
class Window:
    """An interval of a recording, in s from its first sample, both ends included."""

    start: Seconds
    end: Seconds

    @property
    def duration(self) -> Seconds:
        """The window's length in s."""
        return round(self.end - self.start, 9)

    def __str__(self) -> str:
        """The window as tables and sentences name it: "0–300 s"."""
        return f"{self.start:g} s" if self.end == self.start else f"{self.start:g}–{self.end:g} s"


def listed(windows: Sequence[Window]) -> str:
    """The longest windows in order of time, and how many shorter ones there are."""
    longest = sorted(windows, key=lambda window: -window.duration)[:BLOCKS_LISTED]
    text = ", ".join(str(window) for window in sorted(longest, key=lambda window: window.start))
    others = len(windows) - len(longest)
    return text + (f" and in {others} shorter block{'s' * (others > 1)}" if others else "")


class SamplesMissing(Finding, frozen=True):
    """A channel of a vehicle has no value; for gaps, only where both speeds are known."""

    text = "{column} is missing in {part} of the samples{note}, at {where}."

    channel: str
    """Stem of the column's name in the file, as Speed or IVS; also in the findings below."""
    vehicle: int
    share: float
    """Share of all samples, 0 to 1."""
    windows: tuple[Window, ...]
    """Its blocks."""

    def _words(self, about: Labelled) -> Words:
        column, is_gap = RECORDED[self.channel].of(self.vehicle), self.channel == GAP.column
        return {
            "column": column if is_gap else f"{column} ({about.label(self.vehicle)})",
            "part": percent(self.share),
            "note": " although both speeds are known" if is_gap else "",
            "where": listed(self.windows),
        }


class ValuesOutOfRange(Finding, frozen=True):
    """A channel of a vehicle leaves its plausible range on one side."""

    text = (
        "{column} exceeds {limit:g} {unit} in {samples} samples ({part}), up to {extreme:.4g};"
        " check its unit."
    )
    text_below = "{column} is negative in {samples} samples ({part}), down to {extreme:.2g} {unit}."

    channel: str
    vehicle: int
    samples: int
    extreme: float
    """The value furthest outside."""
    share: float
    """Share of the recording's samples that lie outside, 0 to 1."""

    @property
    def is_above(self) -> bool:
        """Whether the values are too large; a little below zero is noise."""
        return self.extreme > RECORDED[self.channel].highest

    def outside(self, values: FloatArray) -> Mask:
        """True where values (..) of the channel lie outside on that side."""
        channel = RECORDED[self.channel]
        return np.asarray(values > channel.highest if self.is_above else values < channel.lowest)

    @property
    def is_in_another_unit(self) -> bool:
        """Whether so many values are too large that the unit is probably another one."""
        return self.is_above and self.share > ANOTHER_UNIT

    @property
    def is_of_other_sign(self) -> bool:
        """Whether most values are negative, so that their sign is probably the other one."""
        return not self.is_above and self.share > OTHER_SIGN

    @property
    def followers(self) -> tuple[int, ...]:
        """Vehicles whose equation contains the values."""
        ahead = (self.vehicle,) if self.channel == SPEED.column else ()
        return (*ahead, self.vehicle + 1)

    def sentence(self, about: Labelled) -> str:
        """The sentence of the side on which the values lie outside."""
        return self.filled(self.text if self.is_above else self.text_below, about)

    def _words(self, about: Labelled) -> Words:
        channel = RECORDED[self.channel]
        column = channel.of(self.vehicle)
        part = percent(self.share)
        return {"column": column, "limit": channel.highest, "unit": channel.unit, "part": part}


class ValuesFrozen(Finding, frozen=True):
    """A channel repeats its values while the vehicle behind the sensor moves."""

    text = "The {name} of {vehicle} is frozen in {count} while it moves, at {where}."

    channel: str
    vehicle: int
    """The one whose speed, or whose gap to the vehicle ahead, it is."""
    samples: int
    """Samples that repeat the value before them, for too long to be motion."""
    windows: tuple[Window, ...]
    """These repetitions, each with the value that is repeated."""

    def _words(self, about: Labelled) -> Words:
        count = "1 sample" if self.samples == 1 else f"{self.samples} samples"
        name = RECORDED[self.channel].name.lower()
        return {"name": name, "count": count, "where": listed(self.windows)}


class LittleLeaderMotion(Finding, frozen=True):
    """The leader's speed varies so little that it hardly excites its followers."""

    text = (
        "The speed of the leader, {vehicle}, varies by only {deviation:.2f} m/s (standard"
        " deviation); this excitation may be too small to identify the parameters."
    )

    vehicle: int
    deviation: MetresPerSecond
    """Standard deviation."""


@dataclass(frozen=True)
class Vehicle:
    """One vehicle of the platoon, numbered as in the file."""

    index: int
    """1 = first."""
    name: str
    present: bool
    """Whether the file has at least one speed of it."""
    missing: int
    """Number of its speed samples that are missing."""
    missing_share: float
    """Share of its speed samples that are missing, 0 to 1."""
    modes: dict[str, int] | None
    """Numbers of samples under "ACC" and under "Human"; None where the file has no modes."""


def vehicle_label(number: int, name: str) -> str:
    """Number and name of a vehicle, as "4 Mercedes (AClass)"; without a name "Vehicle 4"."""
    if name == unnamed(number):
        return name
    joined = _JOINED.fullmatch(name)
    return f"{number} {' '.join(joined.groups()) if joined else name}"


def unnamed(number: int) -> str:
    """The name of a vehicle to which the file gives none."""
    return f"Vehicle {number}"


@dataclass(frozen=True, eq=False, kw_only=True)
class Recording(Displayed):
    """A run of V vehicles over N samples. Arrays are read-only."""

    source: str
    """File name; with the trajectory's name where the file holds several."""
    sha256: str
    """SHA-256 of the file's bytes, and of the trajectory's name where the file holds several."""
    campaign: str | None = None
    """Campaign; None where folder, file name and date do not determine it."""
    date: datetime.date | None = None
    acc_flag: int | None = None
    """The file's flag: 0 human, 1 ACC, 2 mixed. It does not give a vehicle's mode."""
    distance_setting: str | None = None
    names: Mapping[int, str]
    """Names by vehicle number; a vehicle without one goes by its number."""
    time: FloatArray
    """(N,) in s from the first sample."""
    speed: FloatArray
    """(N, V) in m/s; NaN where missing, column i - 1 is vehicle i."""
    gap: FloatArray
    """(N, V-1) in m; NaN where missing, column i - 1 is IVS<i>, between vehicles i and i+1."""
    mode: NDArray[np.int8]
    """(N, V) values of `Mode`."""
    notes: tuple[Finding, ...] = ()
    """Findings that were made while reading."""
    trajectory: str | None = None
    """Name of the table's trajectory; None where the file holds one run."""
    mapping: CsvMapping | None = None
    """Mapping by which the table was read; None for an OpenACC run, a table of pairs and arrays."""

    def __post_init__(self) -> None:
        """Copy the arrays and lock them.

        Raises:
            RecordingError: where their shapes do not fit, or the time does not increase.
        """
        try:
            for name in ("time", "speed", "gap"):
                object.__setattr__(self, name, frozen(getattr(self, name)))
            object.__setattr__(self, "mode", frozen(self.mode, dtype=np.int8))
        except (TypeError, ValueError, OverflowError):
            raise RecordingError("Recording: an array holds no numbers; give numbers.") from None
        samples, vehicles = self.speed.shape if self.speed.ndim == 2 else (0, 0)
        shapes = {"time": (samples,), "speed": (samples, vehicles),
                  "gap": (samples, vehicles - 1), "mode": (samples, vehicles)}  # fmt: skip
        for name, shape in shapes.items():
            now = getattr(self, name).shape
            if now != shape or samples < 2 or vehicles < 2:
                fault = f"{name} has the shape {now}"
                wanted = "N instants, (N, V) speeds and modes, (N, V-1) gaps of V vehicles"
                raise RecordingError(f"Recording: {fault}; give {wanted}.")
        if not (np.diff(self.time) > 0).all():
            raise RecordingError("Recording: time does not increase; sort the samples.")

    __str__ = summary

    @cached_property
    def vehicles(self) -> tuple[Vehicle, ...]:
        """(V,) vehicles, also those that the header names but the columns lack."""
        vehicles = []
        for number, (speed, mode) in enumerate(zip(self.speed.T, self.mode.T, strict=True), 1):
            absent = np.isnan(speed)
            counts = {name: int((mode == Mode[name.upper()]).sum()) for name in ("ACC", "Human")}
            vehicle = Vehicle(
                index=number,
                name=self.names.get(number) or unnamed(number),
                present=not absent.all(),
                missing=int(absent.sum()),
                missing_share=float(absent.mean()),
                modes=counts if any(counts.values()) else None,
            )
            vehicles.append(vehicle)
        return tuple(vehicles)

    @cached_property
    def findings(self) -> tuple[Finding, ...]:
        """All findings: those made while reading, then those about the data."""
        return (*self.notes, *check(self))

    @cached_property
    def data_digest(self) -> str:
        """SHA-256 of times, speeds, space-gaps and driver modes."""
        content = hashlib.sha256()
        for values in (self.time, self.speed, self.gap, self.mode):
            content.update(repr(values.shape).encode() + values.tobytes())
        return content.hexdigest()

    @cached_property
    def digest(self) -> str:
        """SHA-256 of data and findings, as several mappings make several recordings of a file."""
        read = (self.data_digest, self.source, self.vehicles, self.findings)
        return hashlib.sha256(repr(read).encode()).hexdigest()

    @property
    def samples(self) -> int:
        """The number of samples, N."""
        return len(self.time)

    @property
    def duration(self) -> Seconds:
        """Time from the first to the last sample."""
        return round(float(self.time[-1]), 6)

    @property
    def nbytes(self) -> int:
        """Bytes that the arrays take in memory."""
        return self.time.nbytes + self.speed.nbytes + self.gap.nbytes + self.mode.nbytes

    @property
    def is_even(self) -> bool:
        """Whether the samples lie on a regular grid."""
        grid = np.arange(self.samples) * self._mean_step
        return bool(np.abs(self.time - grid).max() <= EVEN_TOLERANCE)

    @property
    def sample_time(self) -> Seconds:
        """The regular step, or the most typical one where steps are uneven.

        Float noise is rounded off; a step with endless digits, as 1/15 s, is not.
        """
        if not self.is_even:
            return round(float(np.median(np.diff(self.time))), 9)
        step, rounded = self._mean_step, round(self._mean_step, 9)
        return rounded if abs(rounded - step) * self.samples < EVEN_TOLERANCE / 2 else step

    @property
    def _mean_step(self) -> Seconds:
        return float(self.time[-1]) / (self.samples - 1)

    @property
    def present(self) -> tuple[int, ...]:
        """Numbers of the vehicles that have data."""
        return tuple(vehicle.index for vehicle in self.vehicles if vehicle.present)

    @cached_property
    def followed(self) -> tuple[int, ...]:
        """Numbers of the vehicles to which the next one has a space-gap; both have speeds."""
        has_gap: Mask = np.asarray(np.isfinite(self.gap).any(axis=0))
        return tuple(k for k in self.present if k + 1 in self.present and has_gap[k - 1])

    def label(self, number: int) -> str:
        """Number and name of vehicle ``number``."""
        return vehicle_label(number, self.vehicles[number - 1].name)

    def speed_of(self, number: int) -> FloatArray:
        """(N,) speed of vehicle ``number`` in m/s."""
        return self.speed[:, number - 1]

    def gap_behind(self, number: int) -> FloatArray:
        """(N,) IVS<number>: space-gap between vehicles ``number`` and ``number`` + 1, in m."""
        return self.gap[:, number - 1]

    def pair(self, number: int, rows: slice = slice(None)) -> Pair:
        """Vehicle ``number``, the next one and the space-gap between them, to be compared."""
        ahead, behind = self.speed_of(number), self.speed_of(number + 1)
        return Pair(
            number, self.time[rows], ahead[rows], behind[rows], self.gap_behind(number)[rows]
        )

    @property
    def jumps(self) -> tuple[GapJumps, ...]:
        """The jumps of space-gaps that speeds do not explain, by the vehicle ahead."""
        return tuple(finding for finding in self.findings if isinstance(finding, GapJumps))

    def window(self, stretch: Stretch) -> Window:
        """The time that a stretch of samples covers, to the microsecond."""
        first, last = (round(float(self.time[at]), 6) for at in (stretch.first, stretch.last))
        return Window(first, last)

    def rows(self, window: Window) -> slice:
        """The samples inside of a window."""
        ends = window.start - EVEN_TOLERANCE, window.end + EVEN_TOLERANCE
        return slice(*np.searchsorted(self.time, ends).tolist())


class Facts(TypedDict, total=False):
    """Facts that a recording states of itself; None where it does not."""

    campaign: str | None
    date: str | None
    """Date by ISO 8601."""
    acc_flag: int | None
    """Flag of the file: 0 human, 1 ACC, 2 mixed."""
    distance_setting: str | None
    samples: int | None
    duration: float | None
    """Duration in s."""
    sample_time: float | None
    """Typical step between samples in s."""


def facts_of(recording: Recording | None) -> Facts:
    """The facts of a recording; none without one."""
    if recording is None:
        return {}
    facts = {name: getattr(recording, name) for name in Facts.__annotations__}
    return cast("Facts", facts | {"date": recording.date and recording.date.isoformat()})


def check(recording: Recording) -> Iterator[Finding]:
    """All findings about the data of a recording."""
    gaps = recording.followed
    channels = [(SPEED, number, recording.speed_of(number)) for number in recording.present]
    channels += [(GAP, number, recording.gap_behind(number)) for number in gaps]
    for channel, number, values in channels:
        missing = np.isnan(values)
        if channel is GAP:  # a gap vanishes along with a speed; only further samples are reported
            missing &= np.isfinite(recording.speed[:, number - 1 : number + 1]).all(axis=1)
        if blocks := tuple(map(recording.window, stretches(missing))):
            yield SamplesMissing(channel.column, number, float(missing.mean()), blocks)
    for number in gaps:
        yield from inconsistencies(recording.pair(number))
    for is_below, end in ((True, np.nanmin), (False, np.nanmax)):
        for channel, number, values in channels:
            outside = values < channel.lowest if is_below else values > channel.highest
            if count := int(outside.sum()):
                far = float(end(values))
                yield ValuesOutOfRange(channel.column, number, count, far, count / len(values))
    yield from frozen_values(recording)[0]
    leader = recording.present[0]
    deviation = float(np.nanstd(recording.speed_of(leader)))
    if deviation < LITTLE_LEADER_MOTION:
        yield LittleLeaderMotion(leader, deviation)


def frozen_values(
    recording: Recording, vehicles: Sequence[int] = (), rows: slice = slice(None)
) -> tuple[list[ValuesFrozen], Mask]:
    """The frozen values of some vehicles, by default of all, among some samples.

    Returns:
        The findings, and a mask (N,) of the chosen samples that is True where a speed or a gap to
        the vehicle ahead repeats the one before it for too long to be motion.
    """
    chosen = vehicles or recording.present
    channels = [(SPEED, number, recording.speed_of(number)) for number in chosen]
    channels += [
        (GAP, number, recording.gap_behind(number - 1))
        for number in chosen
        if number - 1 in chosen and number - 1 in recording.followed
    ]
    shortest = max(FROZEN, (FEWEST_REPEATS - 1) * recording.sample_time)
    here = np.zeros(recording.samples, bool)
    here[rows] = True
    findings, is_frozen = list[ValuesFrozen](), np.zeros(recording.samples, bool)
    for channel, follower, values in channels:
        moving = recording.speed_of(follower)[1:] > MOVING
        repeated, windows = np.zeros(recording.samples, bool), list[Window]()
        for part in stretches((values[1:] == values[:-1]) & moving):
            # k repeats are k + 1 equal samples, of which the first was measured.
            inside = here[part.first + 1 : part.last + 2]
            if len(part) * recording.sample_time > shortest and inside.any():
                repeated[part.first + 1 : part.last + 2] = inside
                windows.append(recording.window(Stretch(part.first, part.last + 1)))
        if windows:
            count = int(repeated.sum())
            findings.append(ValuesFrozen(channel.column, follower, count, tuple(windows)))
        is_frozen |= repeated
    return findings, is_frozen[rows]
