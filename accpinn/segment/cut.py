"""Cutting a segment: a platoon and a window of a recording, on even instants.

A platoon consists of consecutive vehicles with a space-gap between them. Windows that are found for
it are complete: no sample is missing for long, and no gap jumps as where another vehicle cuts in.

Missing blocks of samples that are short enough are bridged by straight lines and reported. A window
with longer ones is refused, unless the caller can use one; they are then filled alike, so that the
numbers stay finite. The segment marks every sample that was not measured.
"""

import math
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import compress, pairwise
from typing import cast

import numpy as np

from accpinn.channels import GAP, SPEED
from accpinn.errors import SegmentError
from accpinn.recordings import HUMAN_FLAG, Mode, Recording, ValuesOutOfRange, Window
from accpinn.recordings.consistency import AGREEMENT_LIMIT
from accpinn.recordings.inconsistency import GapContradictsSpeeds, GapJumps, Inconsistency
from accpinn.recordings.increments import agreement
from accpinn.recordings.jumps import JUMP_TIME
from accpinn.recordings.mapped import UnitContradictsHeader
from accpinn.recordings.mapping import MappingRemembered
from accpinn.segment import (
    BlocksMissing,
    Bridged,
    DrivenByHand,
    Resampled,
    Segment,
    SegmentFinding,
    WindowMoved,
    WindowShortened,
    longest_time_gap,
    time_gaps,
)
from accpinn.units import FloatArray, Mask, Seconds, Stretch, stretches

DURATION: Seconds = 300.0
"""Default length of a window, that of the studies this package follows."""
MINIMUM_DURATION: Seconds = 10.0
"""Shortest window; a shorter one hardly identifies three parameters."""
BRIDGE: Seconds = 1.0
"""Longest missing block that a straight line bridges, as the database's makers did."""
SLACK: Seconds = 1e-6
"""Largest difference of equal times; float noise of time stamps is below 1e-9 s."""
DECIMALS = 9
"""Decimals of speeds in m/s and space-gaps in m; further ones are float noise, in which copies of
one run by different programs differ, and which searches amplify."""
NOT_ACC = 0.1
"""Largest share of the window under a driver's control of a follower that is called ACC."""
WINDOWS_LISTED = 3
"""Complete windows that a sentence names."""
MAX_FOLLOWERS = 10
"""Most followers of a segment."""


class IncompleteWindow(SegmentError):
    """A window in which samples are missing for too long."""


_PART = re.compile(r"(\d{1,3})(?:-(\d{1,3}))?")
_INTERVAL = re.compile(r"(\d{1,7}(?:\.\d{1,6})?)-(\d{1,7}(?:\.\d{1,6})?)")


def cut(
    recording: Recording,
    start: Seconds = 0.0,
    duration: Seconds = DURATION,
    vehicles: Sequence[int] | None = None,
    allow_missing: bool = False,
) -> Segment:
    """Cut the window [start, start + duration] of the chosen vehicles.

    Args:
        recording: what to cut from.
        start: seconds from the recording's first sample.
        duration: seconds; 300 s at 0.1 s are 3001 samples, as both ends are in. A window that
            reaches past the end is shortened, which is among the findings.
        vehicles: consecutive numbers, leader first; by default see `default_vehicles`.
        allow_missing: whether blocks may be missing that are too long to bridge, which is among
            the findings.

    Raises:
        IncompleteWindow: where they are missing and may not be.
        SegmentError: one sentence of what is wrong and what would be possible.

    Examples:
        >>> import accpinn
        >>> segment = accpinn.cut(accpinn.sample("motorway"), start=60, duration=120)
        >>> segment.samples, segment.vehicles
        (1201, (1, 2, 3, 4))
    """
    chosen = (
        default_vehicles(recording) if vehicles is None else check_vehicles(recording, vehicles)
    )
    findings: list[SegmentFinding] = []
    window = _fit_window(recording, start, duration, findings)
    platoon = platoon_of(recording, chosen)
    source = _source_rows(recording, window)
    findings.extend(_unsound(recording, chosen, source))
    missing_blocks = platoon.missing_among(source)
    if missing_blocks and not allow_missing:
        raise _incomplete(platoon, source, missing_blocks[0])
    time, values, missing = _on_grid(platoon, source, window, findings)
    findings.extend(platoon.bridged_among(source))
    findings.extend(missing_blocks)
    findings.extend(_driven_by_hand(recording, source, chosen[1:]))
    return Segment(
        time=time,
        speeds=values[:, : len(chosen)],
        gaps=values[:, len(chosen) :],
        vehicles=chosen,
        names=tuple(recording.vehicles[number - 1].name for number in chosen),
        start=window.start,
        source=recording.source,
        sha256=recording.sha256,
        findings=tuple(findings),
        missing=missing,
        longest_time_gaps=tuple(longest_in(recording, number) for number in chosen[1:]),
    )


def _unsound(
    recording: Recording, chosen: Sequence[int], source: Stretch
) -> Iterator[SegmentFinding]:
    """Findings of the recording that concern the chosen vehicles in a window."""
    rows = source.rows
    for finding in recording.findings:
        if isinstance(finding, MappingRemembered | UnitContradictsHeader):
            yield finding
        elif isinstance(finding, Inconsistency):
            if finding.vehicle in chosen[:-1]:
                yield from _in_window(recording, finding, source)
        elif isinstance(finding, ValuesOutOfRange):
            is_gap = finding.channel == GAP.column
            if finding.vehicle in (chosen[:-1] if is_gap else chosen):
                every = recording.gap_behind if is_gap else recording.speed_of
                if finding.outside(every(finding.vehicle)[rows]).any():
                    yield finding


def _in_window(
    recording: Recording, finding: Inconsistency, source: Stretch
) -> Iterator[SegmentFinding]:
    """The part of a recording's finding that holds in one of its windows."""
    if isinstance(finding, GapJumps):
        window = recording.window(source)
        if jumps := finding.within(window.start, window.end):
            yield jumps
    elif isinstance(finding, GapContradictsSpeeds):
        value = agreement(recording.pair(finding.vehicle, source.rows))
        if value is not None and value < AGREEMENT_LIMIT:
            yield GapContradictsSpeeds(finding.vehicle, value)
    else:  # the cause is that of the whole file
        yield cast("SegmentFinding", finding)


def longest_in(recording: Recording, number: int) -> Seconds:
    """The longest time gap in car-following of a follower, from all that it drives by itself."""
    gaps = time_gaps(recording.speed_of(number), recording.gap_behind(number - 1))
    return longest_time_gap(gaps[recording.mode[:, number - 1] != Mode.HUMAN])


def _driven_by_hand(
    recording: Recording, source: Stretch, followers: tuple[int, ...]
) -> Iterator[DrivenByHand]:
    """Followers under manual control, by their modes or, without any, by the run's flag."""
    modes = recording.mode[source.rows, np.array(followers) - 1]
    if (modes == Mode.UNKNOWN).all():
        if recording.acc_flag == HUMAN_FLAG:
            yield DrivenByHand(followers, (1.0,) * len(followers), by_flag=True)
        return
    shares = (modes == Mode.HUMAN).mean(axis=0)
    manual = shares >= NOT_ACC
    if manual.any():
        yield DrivenByHand(tuple(compress(followers, manual)), tuple(shares[manual].tolist()))


@dataclass(frozen=True, eq=False)
class Platoon:
    """The channels of consecutive vehicles over a whole recording."""

    recording: Recording
    columns: tuple[str, ...]
    """(2M+1,) their names in the file: speeds, leader first, then gaps."""
    values: FloatArray
    """(N, 2M+1) in m/s and m; straight lines where nothing was measured."""
    missing: Mask
    """(N, 2M+1) True where nothing was measured, bridged or not."""
    unbridged: Mask
    """(N, 2M+1) True where that is so for too long."""

    def bridged_among(self, rows: Stretch) -> list[Bridged]:
        """The finding of each column that has bridged samples among ``rows``."""
        findings, is_bridged = [], self.missing & ~self.unbridged
        for column, bridged in zip(self.columns, is_bridged.T, strict=True):
            spans = stretches(bridged)
            blocks = [b for b in spans if b.last >= rows.first and b.first <= rows.last]
            if blocks:
                windows = tuple(map(self.recording.window, blocks))
                findings.append(Bridged(column, sum(map(len, blocks)), windows))
        return findings

    def missing_among(self, rows: Stretch) -> list[BlocksMissing]:
        """The unbridged samples among ``rows``; columns that miss the same ones are together."""
        together: dict[tuple[Stretch, ...], list[str]] = {}
        for column, unbridged in zip(self.columns, self.unbridged.T, strict=True):
            if blocks := stretches(unbridged[rows.rows]):
                together.setdefault(blocks, []).append(column)
        findings = []
        for blocks, columns in together.items():
            moved = (Stretch(rows.first + b.first, rows.first + b.last) for b in blocks)
            windows = tuple(map(self.recording.window, moved))
            share = sum(map(len, blocks)) / len(rows)
            findings.append(BlocksMissing(tuple(columns), share, windows))
        return findings

    def complete(self) -> tuple[Window, ...]:
        """The windows of at least `MINIMUM_DURATION` without a missing value and without a jump."""
        time, jumping = self.recording.time, np.zeros(self.recording.samples, bool)
        for jumps in self.recording.jumps:
            if GAP.of(jumps.vehicle) in self.columns:
                for instant in jumps.times:
                    jumping |= np.abs(time - instant) < JUMP_TIME
        complete = stretches(~(self.unbridged.any(axis=1) | jumping))
        windows = (self.recording.window(stretch) for stretch in complete)
        return tuple(window for window in windows if window.duration >= MINIMUM_DURATION - SLACK)


def platoon_of(recording: Recording, vehicles: tuple[int, ...]) -> Platoon:
    """Speeds and gaps of the vehicles, missing ones on straight lines."""
    channels = {SPEED.of(number): recording.speed_of(number) for number in vehicles}
    channels |= {GAP.of(number): recording.gap_behind(number) for number in vehicles[:-1]}
    values = np.column_stack(list(channels.values()))
    missing: Mask = np.isnan(values)
    time, unbridged = recording.time, missing.copy()
    for series, absent, long in zip(values.T, missing.T, unbridged.T, strict=True):
        for block in stretches(absent):
            enclosed = block.first > 0 and block.last < recording.samples - 1
            length = recording.window(block).duration + recording.sample_time
            long[block.rows] = not enclosed or length > BRIDGE + SLACK
        series[:] = np.interp(time, time[~absent], series[~absent])
    return Platoon(recording, tuple(channels), values, missing, unbridged)


def _incomplete(platoon: Platoon, rows: Stretch, missing: BlocksMissing) -> IncompleteWindow:
    """The error about samples that are missing among ``rows``, with complete windows nearby."""
    recording = platoon.recording
    block = max(missing.windows, key=lambda window: window.duration)
    reason = f"too long to bridge (limit {BRIDGE:g} s)"
    if block.start == 0.0:
        reason = "where no earlier sample helps"
    elif block.end == recording.duration:
        reason = "where no later sample helps"
    middle = float(recording.time[(rows.first + rows.last) // 2])
    nearest = sorted(
        platoon.complete(), key=lambda window: max(window.start - middle, middle - window.end, 0.0)
    )
    listed = sorted(nearest[:WINDOWS_LISTED], key=lambda window: window.start)
    where = ", ".join(map(str, listed))
    return IncompleteWindow(
        f"{recording.source}: {missing.columns[0]} is missing at {block}, {reason};"
        f" {f'complete nearby: {where}' if where else 'choose other vehicles'}."
    )


def _fit_window(
    recording: Recording, start: Seconds, duration: Seconds, findings: list[SegmentFinding]
) -> Window:
    """The nearest possible window: inside the recording, on its samples where these are even."""
    end = recording.duration
    if not 0 <= start < math.inf:
        raise SegmentError(
            f"{recording.source}: no window can start at {start:g} s; start at 0 s or later."
        )
    if not MINIMUM_DURATION <= duration:
        short = f"a window of {duration:g} s is too short to estimate parameters from"
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
            findings.append(WindowMoved(asked=start, start=nearest))
        start = nearest
    if end + SLACK < start + duration < math.inf:
        findings.append(WindowShortened(asked=duration, window=Window(start, end)))
    return Window(start, min(start + duration, end))


def _source_rows(recording: Recording, window: Window) -> Stretch:
    """The samples that a window draws on, including those just outside an uneven one's ends."""
    first = int(np.searchsorted(recording.time, window.start + SLACK, side="right")) - 1
    last = int(np.searchsorted(recording.time, window.end - SLACK, side="left"))
    if recording.is_even:
        last = first + math.floor((window.duration + SLACK) / recording.sample_time)
    return Stretch(first, last)


def _on_grid(
    platoon: Platoon, source: Stretch, window: Window, findings: list[SegmentFinding]
) -> tuple[FloatArray, FloatArray, Mask]:
    """Even instants from 0 (N,), the values there (N, 2M+1), and which of them are missing."""
    recording = platoon.recording
    step = recording.sample_time
    count = math.floor((window.duration + SLACK) / step) + 1
    time: FloatArray = np.arange(count, dtype=np.float64) * step
    values: FloatArray = platoon.values[source.rows].round(DECIMALS)
    missing = platoon.missing[source.rows]
    if recording.is_even:
        return time, values, missing
    findings.append(Resampled(step=step))
    stamps, instants = recording.time[source.rows], window.start + time
    resampled = [np.interp(instants, stamps, series) for series in values.T]
    # An instant between two samples is missing if one of them is.
    between = [np.interp(instants, stamps, series) > SLACK for series in missing.T.astype(float)]
    return time, np.column_stack(resampled), np.column_stack(between)


def parse_vehicles(text: str) -> tuple[int, ...]:
    """The vehicles of a text as 1-5, 1,2 or 4, which a recording need not have.

    Raises:
        SegmentError: for a text that names none.
    """
    numbers: list[int] = []
    for part in re.split(r"\s*,\s*|\s+", re.sub(r"\s*[-–]\s*", "-", text.strip(" ,"))):
        match = _PART.fullmatch(part)
        if not match:
            raise SegmentError(f'"{text[:40]}" names no vehicles; write them as 1-5 or as 1,2.')
        first, last = int(match[1]), int(match[2] or match[1])
        numbers.extend(range(first, last + 1) if first <= last else range(first, last - 1, -1))
    return tuple(numbers)


def parse_windows(text: str) -> tuple[Window, ...]:
    """The windows of a text as 0-300,600-900, in s from the recording's first sample.

    Raises:
        SegmentError: for a text that names none, and for a window that ends before it starts.
    """
    windows = []
    for part in text.replace(" ", "").split(","):
        match = _INTERVAL.fullmatch(part)
        if not match:
            raise SegmentError(f'"{text[:40]}" names no windows; write them as 0-300,600-900.')
        window = Window(float(match[1]), float(match[2]))
        if not window.duration > 0:
            raise SegmentError(f'"{part[:40]}" ends before it starts; write the start first.')
        windows.append(window)
    return tuple(windows)


def chains(recording: Recording) -> tuple[tuple[int, ...], ...]:
    """The longest possible platoons: every maximal run of linked vehicles, in order."""
    platoons: list[tuple[int, ...]] = []
    for number in recording.present:
        if number - 1 in recording.followed:
            platoons[-1] = (*platoons[-1], number)
        else:
            platoons.append((number,))
    return tuple(platoon for platoon in platoons if len(platoon) > 1)


def default_vehicles(recording: Recording) -> tuple[int, ...]:
    """The run that starts at vehicle 1; without one, the longest, and the first of equals."""
    possible = chains(recording)
    if not possible:
        raise SegmentError(
            f"{recording.source}: no two consecutive vehicles have speeds and a space-gap between"
            " them; choose another recording."
        )
    chosen = possible[0] if possible[0][0] == 1 else max(possible, key=len)
    return chosen[: MAX_FOLLOWERS + 1]


def check_vehicles(recording: Recording, vehicles: Sequence[int]) -> tuple[int, ...]:
    """The vehicles as given, if they form a platoon in this recording."""
    chosen = tuple(int(number) for number in vehicles)
    fault = _fault(recording, chosen)
    if fault:
        possible = " or ".join(f"{c[0]}-{c[-1]}" for c in chains(recording)) or "none"
        raise SegmentError(f"{recording.source}: {fault}; possible platoons: {possible}.")
    return chosen


def _fault(recording: Recording, chosen: tuple[int, ...]) -> str:
    if len(chosen) < 2:
        return "a leader and at least one follower are needed"
    if len(chosen) > MAX_FOLLOWERS + 1:
        return f"{len(chosen) - 1} followers are chosen and at most {MAX_FOLLOWERS} can be handled"
    present = recording.present
    for number in chosen:
        if number not in present:
            is_in_file = 1 <= number <= len(recording.vehicles)
            name = f" ({recording.vehicles[number - 1].name})" if is_in_file else ""
            return f"vehicle {number}{name} has no speed in this recording"
    for ahead, behind in pairwise(chosen):
        if behind != ahead + 1:
            return f"vehicle {behind} does not follow vehicle {ahead}"
        if ahead not in recording.followed:
            return (
                f"{GAP.of(ahead)}, the space-gap between vehicles {ahead} and {behind}, is missing"
            )
    return ""
