"""`python -m bench.start`: how long one waits for the package, a command, and the app's first page.

Each is started in a process of its own, several times; the median counts. The processor's time is
printed beside the clock's, as a busy machine lengthens only the latter much.
"""

import asyncio
import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import psutil

from accpinn.units import Seconds
from bench.browsing import Browser
from tests.support.server import ROOT, running

ROUNDS = 5
SAMPLE = str(ROOT / "sample_data" / "synthetic_astazero_like.csv")
COMMANDS: tuple[tuple[str, tuple[str, ...], Seconds], ...] = (
    ("import accpinn", ("-c", "import accpinn"), 0.2),
    ("info of a recording", ("-m", "accpinn", "info", SAMPLE), 0.4),
    ("fit of a recording", ("-m", "accpinn", "fit", SAMPLE, "--no-cache"), 2.0),
)
FIRST_PAGE: Seconds = 3.0


@dataclass(frozen=True)
class Timing:
    """What was measured, and what it may take on two quiet processors."""

    name: str
    seconds: Seconds
    processor: Seconds
    goal: Seconds

    @property
    def fast_enough(self) -> bool:
        """Whether it took no longer."""
        return self.seconds <= self.goal


def command(name: str, arguments: tuple[str, ...], goal: Seconds, rounds: int = ROUNDS) -> Timing:
    """The median of some calls of the interpreter."""

    def once() -> tuple[Seconds, Seconds]:
        began, spent = time.perf_counter(), _processor_of_children()
        subprocess.run([sys.executable, *arguments], cwd=ROOT, check=True, capture_output=True)
        return time.perf_counter() - began, _processor_of_children() - spent

    return _median(name, once, goal, rounds)


def first_page(rounds: int = ROUNDS) -> Timing:
    """From the start of the app until its first page stands in a first browser."""

    def once() -> tuple[Seconds, Seconds]:
        with tempfile.TemporaryDirectory() as place:
            began = time.perf_counter()
            with running(Path(place) / "cache", Path(place) / "log") as server:
                asyncio.run(_visit(server.address))
                taken = time.perf_counter() - began
                times = psutil.Process(server.process.pid).cpu_times()
        return taken, times.user + times.system

    return _median("first page of the app", once, FIRST_PAGE, rounds)


def measure(rounds: int = ROUNDS) -> list[Timing]:
    """All of them."""
    return [*(command(*one, rounds=rounds) for one in COMMANDS), first_page(rounds)]


def text(timings: list[Timing]) -> str:
    """A line each."""
    return "\n".join(
        f"{one.name:24} {one.seconds:5.2f} s (at most {one.goal:g});"
        f" processor {one.processor:.2f} s"
        for one in timings
    )


async def _visit(address: str) -> None:
    browser = Browser(address)
    await browser.open()
    await browser.close()


def _median(
    name: str, once: Callable[[], tuple[Seconds, Seconds]], goal: Seconds, rounds: int
) -> Timing:
    walls, own = zip(*(once() for _ in range(rounds)), strict=True)
    return Timing(name, statistics.median(walls), statistics.median(own), goal)


def _processor_of_children() -> Seconds:
    times = os.times()
    return times.children_user + times.children_system


def main() -> int:
    """Print them; exit status 1 where one takes longer than it may."""
    timings = measure()
    print(text(timings))
    return int(not all(timing.fast_enough for timing in timings))


if __name__ == "__main__":
    sys.exit(main())
