"""How much a batch has to do, how far it has got, and how long the rest takes.

Before a batch, files at even steps among all of them, sorted by size, are read; the others count by
their bytes. While it runs, each file is a share of the work by its bytes, split among its windows
by their size. The time left is what the rest would take at the finished windows' pace, less what
has been spent on those in work, over the number in work at a time.
"""

import time
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from accpinn.errors import AccpinnError
from accpinn.methods.method import FURTHER
from accpinn.methods.registry import METHODS
from accpinn.recordings.files import read_all
from accpinn.recordings.recording import Recording
from accpinn.study.plan import files_of, plan
from accpinn.units import FloatArray, Seconds

INTERVALS_SECONDS = 2.0
"""Typical time of a window's intervals, as the typical seconds of methods."""
READ = 6
"""Largest number of files that are read for an estimate."""
START: Seconds = 5.0
"""Time until the workers are ready."""
TYPICAL: Seconds = 300.0
"""Length of the windows that the typical seconds of methods are of."""
WITHOUT_BLOCKS = 1 / 3
"""Share of a method's typical seconds that is left where no blocks are held out."""


def size_of(duration: Seconds, followers: int) -> float:
    """How many windows of one follower over 300 s take as long as one of ``duration`` s."""
    return duration / TYPICAL * (1 + FURTHER * (followers - 1))


@dataclass(frozen=True)
class BatchEstimate:
    """What a batch will come to."""

    files: int
    windows: float
    followers: float
    """Sum over all windows of each one's followers."""
    size: float
    """Windows of one follower over 300 s that would take as long."""
    exact: bool
    """Whether all files were read."""

    def seconds(self, methods: Sequence[str], workers: int) -> Seconds:
        """How long it takes, to within a factor of two or so, with so many workers at a time."""
        window = sum(METHODS[key].typical_seconds for key in methods) + INTERVALS_SECONDS
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
        try:
            for recording in read_all(files[k]):
                if isinstance(recording, Recording):
                    for planned in plan(recording, window):
                        followers = len(planned.vehicles) - 1
                        size = size_of(planned.window.duration, followers)
                        sums += np.array([1.0, followers, size])
        except AccpinnError:  # a file that cannot be read has no windows
            continue
    sums *= sizes.sum() / max(1.0, sizes[taken].sum())
    windows, followers, size = sums.tolist()
    return BatchEstimate(len(files), windows, followers, size, len(taken) == len(files))


@dataclass(frozen=True)
class BatchSummary:
    """What a batch has come to."""

    recordings: int
    """Recordings that could be read."""
    refused: int
    """Files, and trajectories of tables, that could not be read."""
    windows: int
    followers: int
    """Sum over all windows of each one's followers."""
    rows: int
    """One a window, follower and method."""
    failed: int
    """Methods on windows that have no result."""
    reused: int
    """Rows that were there already."""
    seconds: Seconds
    stopped: bool
    """Whether it ended early because the caller said so."""
    unknown_names: tuple[str, ...] = ()
    """Names of followers whose make and model the package does not know in one spelling."""


@dataclass(frozen=True)
class BatchProgress:
    """How far a batch has got."""

    files: int
    done: float
    """Finished files, those in work as fractions."""
    windows: int
    """Finished windows."""
    rows: int
    """Rows known so far, those reused included."""
    failed: int
    workers: int
    seconds: Seconds
    seconds_left: Seconds | None
    """None as long as nothing is known."""
    share: float = 0.0
    """Share of all the work that is done, 0 to 1."""


class Tally:
    """What a running batch has counted so far."""

    def __init__(self, files: Sequence[Path]) -> None:
        """Nothing is done."""
        self.counts: Counter[str] = Counter()
        """The counts of `BatchSummary` by name, and of windows finished."""
        sizes = {file: 1.0 + (file.stat().st_size if file.is_file() else 0.0) for file in files}
        self._weights = {file: size / sum(sizes.values()) for file, size in sizes.items()}
        self._done = self._share = self._computed = self._spent = 0.0
        self._started, self._in_work, self._at_a_time = time.monotonic(), list[float](), 1

    def skip(self, file: Path) -> None:
        """Nothing of a file is left to do."""
        self._done += 1.0
        self._share += self._weights[file]

    def begin(self) -> float:
        """A worker has begun with a window; when it did."""
        began = time.monotonic()
        self._in_work.append(began)
        self._at_a_time = max(self._at_a_time, len(self._in_work))
        return began

    def finish(self, file: Path, fraction: float, began: float) -> None:
        """A worker has ended with a window, which is a fraction of what was left of its file."""
        share = fraction * self._weights[file]
        self._in_work.remove(began)
        self._spent += time.monotonic() - began
        self._computed += share
        self._share += share
        self._done += fraction
        self.counts["finished"] += 1

    @property
    def seconds(self) -> Seconds:
        """Time since the batch began."""
        return round(time.monotonic() - self._started, 3)

    def progress(self, workers: int, is_done: bool = False) -> BatchProgress:
        """How far it has got, with so many workers."""
        counts = self.counts
        share = 1.0 if is_done else min(1.0, self._share)
        left: Seconds | None = 0.0 if is_done else None
        if self._computed > 0 and not is_done:
            now = time.monotonic()
            needed = self._spent / self._computed * (1.0 - share)
            spent = sum(now - began for began in self._in_work)
            left = max(0.0, needed - spent) / self._at_a_time
        return BatchProgress(
            files=len(self._weights),
            done=min(self._done, len(self._weights)),
            windows=counts["finished"],
            rows=counts["rows"],
            failed=counts["failed"],
            workers=workers,
            seconds=self.seconds,
            seconds_left=left,
            share=share,
        )
