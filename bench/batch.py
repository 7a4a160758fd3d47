"""`python -m bench.batch`: what a batch costs, on this machine.

    throughput   follower-windows a minute with one and with two workers, from the first result to
                 the last, and the peak of the calling process's memory
    overhead     time a task beside its estimation: reading, cutting, sending and writing, measured
                 with tasks that estimate nothing
    memory       the same peak over the number of recordings; it should not grow
    length       processor time of an estimation over the length of its window; it should be linear

The recordings are copies of `sample_data` and, where `OPENACC_DIR` names them, of real ones: each
copy begins a little later, so that no two have the same contents.
"""

import argparse
import json
import os
import sys
import tempfile
import threading
import time
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass
from itertools import cycle, islice
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import psutil

from accpinn.methods.method import TaskContext
from accpinn.methods.registry import METHODS
from accpinn.recordings.openacc import read
from accpinn.segment.cut import cut
from accpinn.study import batch as batches
from accpinn.study.batch_progress import BatchProgress
from accpinn.study.batch_tasks import BatchTask, MethodRows
from accpinn.study.comparison import parse_methods
from accpinn.study.rows import COLUMNS
from accpinn.units import Seconds
from bench.run import positive

SAMPLES = Path(__file__).parents[1] / "sample_data"
LENGTHS = (100.0, 200.0, 400.0, 800.0, 1500.0)
LENGTH_METHODS = ("pinn", "splines", "maximum-likelihood")
SHIFT = 30
"""Samples by which each copy begins later than the one before it."""


@dataclass(frozen=True)
class Throughput:
    """One batch."""

    recordings: int
    workers: int
    windows: int
    followers: int
    seconds: Seconds
    """All of it, the start of the workers included."""
    followers_a_minute: float
    """From the first result to the last."""
    seconds_a_task: Seconds
    """From the first result to the last, by the number of tasks after the first."""
    peak_mb: float
    """Resident memory of the calling process, workers not included."""


@dataclass(frozen=True)
class Length:
    """Processor time of one estimation."""

    method: str
    duration: Seconds
    seconds: Seconds


def originals() -> list[Path]:
    """The recordings to be copied."""
    real = os.environ.get("OPENACC_DIR", "")
    found = sorted(Path(real).glob("[!c]*/*.csv")) if real else []
    return [*sorted(SAMPLES.glob("*.csv")), *found]


def copies(folder: Path, count: int) -> None:
    """So many recordings with contents of their own."""
    folder.mkdir(parents=True)
    for k, source in enumerate(islice(cycle(originals()), count)):
        lines = source.read_bytes().splitlines(keepends=True)
        header = next(i for i, line in enumerate(lines) if line.lower().startswith(b"time,")) + 1
        skipped = SHIFT * (k // len(originals()))
        text = b"".join([*lines[:header], *lines[header + skipped :]])
        (folder / f"{k:04d}_{source.name}").write_bytes(text)


def estimate_nothing(task: BatchTask) -> list[MethodRows]:
    """The answer of a task that has cost nothing."""
    row: dict[str, Any] = dict.fromkeys(column.name for column in COLUMNS)
    return [MethodRows(key, [row] * task.segment.followers) for key in task.methods]


def _run(folder: Path, methods: Sequence[str], workers: int, idle: bool) -> Throughput:
    """One batch, in a process of its own, as its peak of memory is asked for."""
    if idle:
        batches.run_task = estimate_nothing
    process, ended, peak = psutil.Process(), threading.Event(), 0

    def watch() -> None:
        nonlocal peak
        while not ended.wait(0.05):
            peak = max(peak, process.memory_info().rss)

    watcher = threading.Thread(target=watch)
    watcher.start()
    seen: list[tuple[float, BatchProgress]] = []
    with tempfile.TemporaryDirectory() as study:
        found = batches.batch(
            folder,
            study,
            methods=methods,
            workers=workers,
            on_progress=lambda now: seen.append((time.monotonic(), now)),
        )
    ended.set()
    watcher.join()
    steps = [(at, now) for at, now in seen if now.windows and now.workers]
    (start, first), (end, last) = steps[0], steps[-1]
    spent, tasks = end - start, max(1, last.windows - first.windows)
    followers = (last.rows - first.rows) / len(methods)
    return Throughput(
        recordings=found.recordings,
        workers=workers,
        windows=found.windows,
        followers=found.followers,
        seconds=round(found.seconds, 2),
        followers_a_minute=round(60 * followers / spent, 1) if spent else float("nan"),
        seconds_a_task=round(spent / tasks, 4),
        peak_mb=round(peak / 1e6, 1),
    )


def measure(folder: Path, methods: Sequence[str], workers: int, idle: bool = False) -> Throughput:
    """One batch of a folder.

    Args:
        folder: with recordings.
        methods: keys of `METHODS`.
        workers: how many.
        idle: whether tasks estimate nothing, which leaves what is spent beside it.
    """
    with ProcessPoolExecutor(1, get_context("spawn")) as pool:
        return pool.submit(_run, folder, methods, workers, idle).result()


def lengths(path: Path, durations: Sequence[Seconds] = LENGTHS) -> list[Length]:
    """Processor time over the length of the window, on one thread.

    Args:
        path: of a recording of two vehicles.
        durations: in s.
    """
    recording, found = read(path), []
    for method in LENGTH_METHODS:
        METHODS[method].fit(cut(recording, 0, 60, (1, 2)), context=TaskContext(threads=1))
        for duration in durations:
            segment = cut(recording, 0, duration, (1, 2))
            started = time.process_time()
            METHODS[method].fit(segment, context=TaskContext(threads=1))
            found.append(Length(method, duration, round(time.process_time() - started, 3)))
    return found


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure, and print."""
    parser = argparse.ArgumentParser(prog="python -m bench.batch", description=__doc__)
    parser.add_argument("--recordings", type=positive, default=20, help="copies (20)")
    parser.add_argument("--methods", default="pinn", help="all or some (pinn)")
    parser.add_argument("--json", action="store_true", help="one JSON document")
    options = parser.parse_args(arguments)
    methods = parse_methods(options.methods)
    with tempfile.TemporaryDirectory() as name:
        folder, few = Path(name) / "all", Path(name) / "few"
        copies(folder, options.recordings)
        copies(few, max(1, options.recordings // 4))
        one, two = (measure(folder, methods, workers) for workers in (1, 2))
        idle = [measure(place, methods, 1, idle=True) for place in (few, folder)]
    longest = [path for path in originals() if path.name == "part7.csv"]
    sample = SAMPLES / "synthetic_paper_study.csv"
    costs = lengths(longest[0]) if longest else lengths(sample, LENGTHS[:2])
    found = {
        "throughput": [asdict(one), asdict(two)],
        "speedup": round(two.followers_a_minute / one.followers_a_minute, 2),
        "idle": [asdict(run) for run in idle],
        "length": [asdict(cost) for cost in costs],
    }
    if options.json:
        print(json.dumps(found, indent=2))
        return 0
    for run in (one, two):
        print(
            f"{run.workers} workers: {run.followers_a_minute:.0f} follower-windows a minute"
            f" ({run.followers} in {run.seconds:.0f} s), {run.peak_mb:.0f} MB"
        )
    print(f"two workers: {found['speedup']} times the throughput of one")
    for run in idle:
        print(
            f"{run.recordings} recordings, {run.windows} windows, nothing estimated:"
            f" {1000 * run.seconds_a_task:.0f} ms a task, {run.peak_mb:.0f} MB"
        )
    for cost in costs:
        print(f"{cost.method}, {cost.duration:g} s: {cost.seconds:.2f} s")
    return 0


if __name__ == "__main__":
    sys.exit(main())
