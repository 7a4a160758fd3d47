"""The files of a batch, and how long it takes.

The time is estimated from files at even steps among all of them, sorted by size, which are read;
the others count by their bytes.
"""

import os
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from accpinn.errors import AccpinnError, RecordingError
from accpinn.methods import FURTHER
from accpinn.methods.registry import METHODS, variant_of
from accpinn.recordings import Recording
from accpinn.recordings.files import read_all
from accpinn.segment.cut import DURATION
from accpinn.segment.windows import plan
from accpinn.storage import is_text, printable, reason_of
from accpinn.units import FloatArray, Seconds

INTERVALS_SECONDS = 2.0
"""Typical time of a window's intervals, as the typical seconds of methods."""
READ = 6
"""Largest number of files that are read for an estimate."""
START: Seconds = 5.0
"""Time until the workers are ready."""
WITHOUT_BLOCKS = 1 / 3
"""Share of a method's typical seconds that is left where no blocks are held out."""
ENDINGS = (".csv", ".txt", ".tsv", ".gz", ".xlsx", ".parquet", ".xml")
NO_TEXT = "its name is no UTF-8 text; rename it"
Sources = str | os.PathLike[str] | Sequence[str | os.PathLike[str]]
"""Files and folders of recordings."""


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
