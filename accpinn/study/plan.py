"""The plan of a batch: files, and in each recording complete stretches in ACC car-following.

A follower qualifies at an instant where

    its speed, the speed ahead and the space-gap are known (short blocks bridged, as `cut` does);
    no driver controls it: by its driver mode, or by the file's flag where there are no modes;
    it is in car-following by its time gap (see `segment`).

Departures of up to 10 s from the last of these, as behind a car that cuts in, do not interrupt a
stretch. Stretches in which all followers of a chain qualify are taken together; where only one
follower qualifies, its window holds it and the vehicle ahead. Stretches are cut into windows of the
asked length from their start on; the rest of a stretch is a window where it lasts for a minute.

How long a batch takes is estimated from files at even steps among all of them, sorted by size,
which are read; the others count by their bytes.
"""

import os
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np

from accpinn.channels import GAP, SPEED
from accpinn.errors import AccpinnError, RecordingError, SegmentError
from accpinn.findings import Finding
from accpinn.methods import FURTHER
from accpinn.methods.registry import METHODS, variant_of
from accpinn.recordings import (
    HUMAN_FLAG,
    MOVING,
    Mode,
    Recording,
    ValuesOutOfRange,
    Window,
)
from accpinn.recordings.consistency import AGREEMENT_LIMIT
from accpinn.recordings.files import read_all
from accpinn.recordings.inconsistency import GapContradictsSpeeds, Inconsistency
from accpinn.recordings.increments import agreement
from accpinn.segment import time_gaps
from accpinn.segment.cut import (
    DURATION,
    MAX_FOLLOWERS,
    MINIMUM_DURATION,
    SLACK,
    chains,
    complete_windows,
    longest_in,
)
from accpinn.storage import is_text, printable, reason_of
from accpinn.study import vehicles_of
from accpinn.units import FloatArray, Mask, Seconds, stretches

DEPARTURE: Seconds = 10.0
"""Longest departure from car-following that does not interrupt a stretch."""
LEAST: Seconds = 60.0
"""Shorter stretches say little about three parameters."""
INTERVALS_SECONDS = 2.0
"""Typical time of a window's intervals, as the typical seconds of methods."""
READ = 6
"""Largest number of files that are read for an estimate."""
START: Seconds = 5.0
"""Time until the workers are ready."""
WITHOUT_BLOCKS = 1 / 3
"""Share of a method's typical seconds that is left where no blocks are held out."""
AUTO = "auto"
"""The value of ``windows`` that asks for all windows in car-following."""
ACC_FLAG = 1
ENDINGS = (".csv", ".txt", ".tsv", ".gz", ".xlsx", ".parquet", ".xml")
NO_TEXT = "its name is no UTF-8 text; rename it"
Sources = str | os.PathLike[str] | Sequence[str | os.PathLike[str]]
"""Files and folders of recordings."""


@dataclass(frozen=True)
class PlannedWindow:
    """One task's share of a recording."""

    vehicles: tuple[int, ...]
    """(M+1,) leader first."""
    window: Window
    mode_sources: tuple[str, ...]
    """(M,) what says that ACC drives: "driver" mode or the file's "flag"; else empty."""


def plan(recording: Recording, longest: Seconds) -> tuple[PlannedWindow, ...]:
    """The windows of a recording, in the order of chains and time, none longer than ``longest`` s.

    A follower whose gap contradicts the speeds there has none.
    """
    planned: list[PlannedWindow] = []
    # Chains with no more followers than a segment may have; the last of one leads the next.
    short_chains = (
        chain[first : first + MAX_FOLLOWERS + 1]
        for chain in chains(recording)
        for first in range(0, len(chain) - 1, MAX_FOLLOWERS)
    )
    for chain in short_chains:
        allowed = np.column_stack([_sound(recording, number, longest) for number in chain[1:]])
        together = _windows(recording, np.asarray(allowed.all(axis=1)), longest)
        planned += [_planned(recording, chain, window) for window in together]
        for column, pair in zip(allowed.T, pairwise(chain), strict=True):
            alone = column.copy()
            for window in together:
                alone[recording.rows(window)] = False
            windows = _windows(recording, alone, longest)
            planned += [_planned(recording, pair, window) for window in windows]
    return tuple(planned)


def contradictions(recording: Recording) -> list[Inconsistency]:
    """Contradictions between followers' gaps and speeds."""
    unlike = (finding for finding in recording.findings if isinstance(finding, Inconsistency))
    return [finding for finding in unlike if finding.is_contradiction]


def left_out(recording: Recording, planned: Sequence[PlannedWindow]) -> Iterator[Finding]:
    """Why followers have no window, where it is for their data."""
    followers = {number for place in planned for number in place.vehicles[1:]}
    unlike = contradictions(recording)
    yield from (finding for finding in unlike if finding.follower not in followers)
    if not planned:
        yield from (
            finding
            for finding in recording.findings
            if isinstance(finding, ValuesOutOfRange) and finding.is_above
        )


def _sound(recording: Recording, number: int, longest: Seconds) -> Mask:
    """(N,) where a follower qualifies, without windows in which its gap contradicts the speeds."""
    allowed = qualifies(recording, number)
    for contradiction in contradictions(recording):
        if contradiction.follower != number:
            continue
        if contradiction.is_of_file:
            return np.zeros_like(allowed)
        if isinstance(contradiction, GapContradictsSpeeds):
            for window in _windows(recording, allowed, longest):
                rows = recording.rows(window)
                value = agreement(recording.pair(number - 1, rows))
                allowed[rows] &= value is not None and value >= AGREEMENT_LIMIT
    return allowed


def sound_windows(recording: Recording, number: int, longest: Seconds) -> tuple[Window, ...]:
    """The windows of one follower in car-following under ACC in which its gap fits the speeds."""
    return tuple(_windows(recording, _sound(recording, number, longest), longest))


def car_following(
    recording: Recording, vehicles: str | Sequence[int] | None = None, longest: Seconds = DURATION
) -> tuple[Window, ...]:
    """The windows in which all chosen followers are in car-following under ACC, with all channels.

    Vehicles are consecutive numbers, leader first, also as "1-5"; by default see
    `default_vehicles`. No window is longer than ``longest`` s.

    Raises:
        SegmentError: where there is none.
    """
    _, *followers = vehicles_of(recording, vehicles)
    allowed = np.column_stack([qualifies(recording, number) for number in followers])
    windows = _windows(recording, np.asarray(allowed.all(axis=1)), longest)
    if not windows:
        raise SegmentError(
            f"{recording.source}: no {LEAST:g} s are found in which all followers are in"
            " car-following under ACC; choose fewer vehicles, or a window by --start and"
            " --duration."
        )
    return tuple(windows)


def qualifies(recording: Recording, number: int) -> Mask:
    """(N,) where a follower is in car-following under ACC, with all channels known."""
    modes = recording.mode[:, number - 1]
    by_hand = modes == Mode.HUMAN
    if (modes == Mode.UNKNOWN).all() and recording.acc_flag == HUMAN_FLAG:
        return np.zeros(recording.samples, bool)
    complete = np.zeros(recording.samples, bool)
    for window in complete_windows(recording, (number - 1, number)):
        complete[recording.rows(window)] = True
    allowed: Mask = complete & ~by_hand
    speed, gap = recording.speed_of(number), recording.gap_behind(number - 1)
    # A bridged sample has no time gap of its own and counts as its neighbours do.
    away = allowed & (speed <= MOVING) | (time_gaps(speed, gap) > longest_in(recording, number))
    away |= (speed > SPEED.highest) | (gap > GAP.highest)
    for stretch in stretches(away):
        inside = stretch.first > 0 and stretch.last < recording.samples - 1
        if inside and recording.window(stretch).duration <= DEPARTURE:
            away[stretch.rows] = False
    return allowed & ~away


def _windows(recording: Recording, allowed: Mask, longest: Seconds) -> list[Window]:
    """The windows of all stretches that are long enough."""
    least, windows = max(MINIMUM_DURATION, min(LEAST, longest)), list[Window]()
    for stretch in stretches(allowed):
        whole = recording.window(stretch)
        start = whole.start
        while whole.end - start >= least - SLACK:
            end = min(start + longest, whole.end)
            windows.append(Window(start, round(end, 6)))
            start = round(start + longest, 6)
    return windows


def _planned(recording: Recording, vehicles: Sequence[int], window: Window) -> PlannedWindow:
    rows = recording.rows(window)
    by_flag = "flag" if recording.acc_flag == ACC_FLAG else ""
    followers = np.array(vehicles[1:]) - 1
    is_acc = (recording.mode[rows, followers] == Mode.ACC).any(axis=0)
    sources = tuple("driver" if by_driver else by_flag for by_driver in is_acc)
    return PlannedWindow(tuple(vehicles), window, sources)


@dataclass(frozen=True)
class Listing:
    """The files of a batch's sources, and those it leaves out."""

    files: list[Path]
    """Each once, those of a folder in the order of their names."""
    refused: dict[Path, str]
    """Why a file or folder is left out."""


def files_of(sources: Sources, study: Path | None = None) -> list[Path]:
    """The files of a batch; see `listing_of`."""
    return listing_of(sources, study).files


def listing_of(sources: Sources, study: Path | None = None) -> Listing:
    """The files of a batch, and what is left out of its folders.

    The study's folder may lie among them, and does not count.

    Raises:
        RecordingError: when a source does not exist, or holds no CSV file.
    """
    listed = [sources] if isinstance(sources, str | os.PathLike) else list(sources)
    results = study.resolve() if study else None
    files: dict[Path, None] = {}
    refused: dict[Path, str] = {}
    for source in listed:
        path = Path(source)
        if not is_text(path):
            raise RecordingError(f"{printable(path)}: {NO_TEXT}.")
        if path.is_dir():
            inside = _files_below(path, refused)
            files |= dict.fromkeys(f for f in inside if results not in f.resolve().parents)
        elif path.exists():
            files[path] = None
        else:
            raise RecordingError(
                f"{printable(path)}: there is no such file or folder; check its name."
            )
    if not files:
        first = next(((printable(path), why) for path, why in refused.items()), None)
        source = printable(listed[0]) if listed else "No source"
        where, why = first or (source, "no CSV file is there")
        raise RecordingError(f"{where}: {why}.")
    return Listing(list(files), refused)


def _files_below(folder: Path, refused: dict[Path, str]) -> list[Path]:
    """The files of recordings in a folder and below; what is left out is added to ``refused``."""

    def unread(fault: OSError) -> None:
        reason = reason_of(fault).lower()
        refused[Path(fault.filename)] = f"it cannot be read ({reason}); check who may read it"

    files, root = [], folder.resolve()
    for place, _, names in os.walk(folder, onerror=unread):
        for path in (Path(place, name) for name in names):
            if path.suffix.lower() not in ENDINGS or is_note(path) or not path.is_file():
                continue
            if not is_text(path):
                refused[path] = NO_TEXT
            elif path.is_symlink() and not path.resolve().is_relative_to(root):
                refused[path] = "it is a link out of the folder; name the file itself"
            else:
                files.append(path)
    return sorted(files)


def is_note(path: Path) -> bool:
    """Whether a text accompanies the runs and is none."""
    return path.suffix.lower() == ".txt" and not path.stem.lower().startswith("step")


# How long it takes


@dataclass(frozen=True)
class BatchEstimate:
    """The expected size and duration of a batch."""

    files: int
    windows: float
    followers: float
    """Sum over all windows of each one's followers."""
    size: float
    """Windows of one follower over 300 s that would take as long."""
    exact: bool
    """Whether all files were read."""

    def seconds(self, methods: Sequence[str], workers: int) -> Seconds:
        """The duration with so many workers at a time, to within a factor of about two."""
        window = 0.0
        for key, config in map(variant_of, methods):
            method = METHODS[key]
            has_posterior = method.posterior(config.to_json() if config else {}) is not None
            window += method.typical_seconds + (INTERVALS_SECONDS if has_posterior else 0.0)
        return START + WITHOUT_BLOCKS * window * self.size / workers


def estimate_batch(source: Path, window: Seconds) -> BatchEstimate:
    """The estimate for a folder and windows of at most ``window`` s.

    Raises:
        RecordingError: when the folder does not exist, or holds no CSV file.
    """
    files = sorted(files_of(source), key=lambda path: path.stat().st_size)
    sizes = np.array([path.stat().st_size for path in files], float)
    taken = np.unique(np.linspace(0, len(files) - 1, min(READ, len(files))).round().astype(int))
    sums: FloatArray = np.zeros(3)
    for k in taken:
        with suppress(AccpinnError):  # a file that cannot be read has no windows
            for recording in read_all(files[k]):
                if isinstance(recording, Recording):
                    for planned in plan(recording, window):
                        followers = len(planned.vehicles) - 1
                        lasting = planned.window.duration / DURATION
                        sums += [1.0, followers, lasting * (1 + FURTHER * (followers - 1))]
    sums *= sizes.sum() / max(1.0, sizes[taken].sum())
    windows, followers, size = sums.tolist()
    return BatchEstimate(len(files), windows, followers, size, len(taken) == len(files))
