"""Durations until the package, a command and the app's first page are ready.

Each is started in a process of its own.
"""

import asyncio
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import psutil

from accpinn.units import Seconds
from bench.browsing import visit
from bench.measurement import Measurement, Spent, timed
from tests.support.server import ROOT, running

SAMPLE = ROOT / "sample_data" / "synthetic_astazero_like.csv"
PART = ("--vehicles", "1,2", "--duration", "300", "--no-cache")
COMMANDS: tuple[tuple[str, tuple[str, ...], Seconds], ...] = (
    ("import accpinn", ("-c", "import accpinn"), 0.2),
    ("info of a recording", ("-m", "accpinn", "info", str(SAMPLE)), 0.4),
    ("fit of one follower, 300 s", ("-m", "accpinn", "fit", str(SAMPLE), *PART), 2.5),
)
"""Name, arguments of the interpreter, and limit."""
FIRST_PAGE: Seconds = 3.0


def measure() -> Iterator[Measurement]:
    """Time all of them."""
    for name, arguments, limit in COMMANDS:
        yield timed(name, partial(command, arguments), limit)
    yield timed("first page of the app", first_page, FIRST_PAGE)


def command(arguments: tuple[str, ...]) -> Spent:
    """Time one call of the interpreter."""
    began, before = time.perf_counter(), sum(os.times()[2:4])  # of children
    subprocess.run([sys.executable, *arguments], cwd=ROOT, check=True, capture_output=True)
    return time.perf_counter() - began, sum(os.times()[2:4]) - before


def first_page() -> Spent:
    """Time the app from its start until its first page stands in a first browser."""
    with tempfile.TemporaryDirectory() as place:
        began = time.perf_counter()
        with running(Path(place) / "cache", Path(place) / "log") as server:
            asyncio.run(visit(server.address))
            taken = time.perf_counter() - began
            times = psutil.Process(server.process.pid).cpu_times()
    return taken, times.user + times.system
