"""How much a batch has to do, and how long that takes, from a few of its files.

The files are read that lie at even steps among all of them, sorted by size; the others count by
their bytes.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from accpinn.errors import AccpinnError
from accpinn.methods.method import FURTHER
from accpinn.methods.registry import METHODS
from accpinn.recordings.files import read_all
from accpinn.recordings.recording import Recording
from accpinn.study.batch import files_of
from accpinn.study.batch_progress import INTERVALS_SECONDS
from accpinn.study.plan import plan
from accpinn.units import FloatArray, Seconds

READ = 6
"""Files that are read at most."""
START: Seconds = 5.0
"""Until the workers are ready."""
TYPICAL: Seconds = 300.0
"""Length of the windows that the typical seconds of methods are of."""
WITHOUT_BLOCKS = 1 / 3
"""Share of a method's typical seconds that is left where no blocks are held out."""


@dataclass(frozen=True)
class BatchEstimate:
    """What a batch will come to."""

    files: int
    windows: float
    followers: float
    """Over all windows: followers of each."""
    size: float
    """Windows of one follower over 300 s that would take as long."""
    exact: bool
    """Whether all files were read."""

    def seconds(self, methods: Sequence[str], workers: int) -> Seconds:
        """How long it takes, to within a factor of two or so.

        Args:
            methods: keys of `METHODS`.
            workers: how many at a time.
        """
        each = sum(METHODS[key].typical_seconds for key in methods) + INTERVALS_SECONDS
        return START + WITHOUT_BLOCKS * each * self.size / workers


def estimate_batch(source: Path, window: Seconds) -> BatchEstimate:
    """The estimate for a folder.

    Args:
        source: folder of the recordings.
        window: longest window in s; infinite for whole stretches.

    Raises:
        RecordingError: when the folder does not exist, or holds no CSV file.
    """
    files = sorted(files_of(source), key=lambda path: path.stat().st_size)
    sizes = np.array([path.stat().st_size for path in files], float)
    taken = np.unique(np.linspace(0, len(files) - 1, min(READ, len(files))).round().astype(int))
    found: FloatArray = np.zeros(3)
    for k in taken:
        try:
            for recording in read_all(files[k]):
                if isinstance(recording, Recording):
                    for one in plan(recording, window):
                        followers = len(one.vehicles) - 1
                        size = one.window.duration / TYPICAL * (1 + FURTHER * (followers - 1))
                        found += np.array([1.0, followers, size])
        except AccpinnError:  # a file that cannot be read has no windows
            continue
    found *= sizes.sum() / max(1.0, sizes[taken].sum())
    windows, followers, size = found.tolist()
    return BatchEstimate(len(files), windows, followers, size, len(taken) == len(files))
