"""Time and memory of a batch, by its command.

Each figure is a difference of two batches, one of many recordings and one of few, so that the start
of the workers does not count. The recordings are copies of `sample_data`; each copy begins a little
later than the one before it, so that no two have the same contents.
"""

import json
import sys
import time
from collections.abc import Iterator
from itertools import cycle
from pathlib import Path
from subprocess import DEVNULL, PIPE
from tempfile import TemporaryDirectory

import numpy as np
import psutil

from accpinn.units import FloatArray, Seconds
from bench.measurement import Measurement
from tests.support.server import ROOT

SAMPLES = sorted((ROOT / "sample_data").glob("*.csv"))
FEW, MANY = 4, 20
"""Numbers of recordings."""
SHIFT = 30
"""Samples by which each copy begins later than the one before it."""
GROWTH_MB = 3.0
"""Most memory of the calling process a recording more, in MB."""
WATCHED_EVERY: Seconds = 0.05


def shortened(recording: Path, skipped: int) -> bytes:
    """Return a recording without its first samples."""
    lines = recording.read_bytes().splitlines(keepends=True)
    header = next(i for i, line in enumerate(lines) if line.startswith(b"Time,")) + 1
    return b"".join([*lines[:header], *lines[header + skipped :]])


def copies(folder: Path) -> list[str]:
    """Write `MANY` recordings with different contents, and return their paths."""
    paths = [folder / f"{k:04d}.csv" for k in range(MANY)]
    for k, (path, source) in enumerate(zip(paths, cycle(SAMPLES), strict=False)):
        path.write_bytes(shortened(source, SHIFT * (k // len(SAMPLES))))
    return [str(path) for path in paths]


def run(recordings: list[str], workers: int) -> FloatArray:
    """Run one batch by the command line.

    Returns:
        Number of follower-windows, seconds, and the largest memory of the calling process, without
        its workers, in MB.
    """
    with TemporaryDirectory() as study:
        command = (
            sys.executable, "-m", "accpinn", "batch", *recordings, "--out", study,
            "--methods", "pinn", "--workers", str(workers), "--json",
        )  # fmt: skip
        with psutil.Popen(command, cwd=ROOT, stdout=PIPE, stderr=DEVNULL) as process:
            peak = 0
            while process.poll() is None:
                peak = max(peak, process.memory_info().rss)
                time.sleep(WATCHED_EVERY)
            summary = json.load(process.stdout)
    return np.array([summary["followers"], summary["seconds"], peak / 1e6])


def measure() -> Iterator[Measurement]:
    """Measure throughput and memory."""
    with TemporaryDirectory() as folder:
        recordings = copies(Path(folder))
        for workers in (1, 2):
            few, many = (run(recordings[:count], workers) for count in (FEW, MANY))
            followers, seconds, megabytes = (many - few).tolist()
            name = f"follower-windows by pinn, workers: {workers}"
            yield Measurement(name=name, value=60 * followers / seconds, unit="1/min")
    growth = megabytes / (MANY - FEW)
    yield Measurement(name="peak memory", value=float(many[2]), unit="MB")
    yield Measurement(name="memory a recording more", value=growth, unit="MB", at_most=GROWTH_MB)
