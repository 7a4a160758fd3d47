"""What a batch costs, by its command.

Each figure is a difference of two batches, one of many recordings and one of few, so that the start
of the workers does not count. The recordings are copies of `sample_data`; each copy begins a little
later than the one before it, so that no two have the same contents.
"""

import json
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import cycle, islice
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import psutil

from accpinn.units import Seconds
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


@dataclass(frozen=True)
class Run:
    """One batch."""

    followers: int
    """Number of follower-windows."""
    seconds: Seconds
    peak: float
    """Largest memory of the calling process, without its workers, in MB."""


def shortened(recording: Path, skipped: int) -> bytes:
    """Return a recording without its first samples."""
    lines = recording.read_bytes().splitlines(keepends=True)
    header = next(i for i, line in enumerate(lines) if line.startswith(b"Time,")) + 1
    return b"".join([*lines[:header], *lines[header + skipped :]])


def copies(folder: Path, count: int) -> None:
    """Write that many recordings with different contents."""
    folder.mkdir(parents=True)
    for k, source in enumerate(islice(cycle(SAMPLES), count)):
        content = shortened(source, SHIFT * (k // len(SAMPLES)))
        (folder / f"{k:04d}_{source.name}").write_bytes(content)


def run(folder: Path, method: str, workers: int) -> Run:
    """Run one batch of a folder by the command line."""
    with TemporaryDirectory() as study:
        command = (
            sys.executable, "-m", "accpinn", "batch", str(folder), "--out", study,
            "--methods", method, "--workers", str(workers), "--json",
        )  # fmt: skip
        with subprocess.Popen(
            command, cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL
        ) as process:
            watched, peak = psutil.Process(process.pid), 0
            while process.poll() is None:
                peak = max(peak, watched.memory_info().rss)
                time.sleep(WATCHED_EVERY)
            assert process.stdout
            summary: dict[str, Any] = json.loads(process.stdout.read())
    return Run(summary["followers"], summary["seconds"], peak / 1e6)


def measure() -> Iterator[Measurement]:
    """Measure throughput and memory."""
    with TemporaryDirectory() as place:
        folders = Path(place) / "few", Path(place) / "many"
        for folder, count in zip(folders, (FEW, MANY), strict=True):
            copies(folder, count)
        for workers in (1, 2):
            few, many = (run(folder, "pinn", workers) for folder in folders)
            rate = 60 * (many.followers - few.followers) / (many.seconds - few.seconds)
            name = f"follower-windows by pinn, workers: {workers}"
            yield Measurement(name=name, value=rate, unit="1/min")
    growth = (many.peak - few.peak) / (MANY - FEW)
    yield Measurement(name="peak memory", value=many.peak, unit="MB")
    yield Measurement(name="memory a recording more", value=growth, unit="MB", at_most=GROWTH_MB)
