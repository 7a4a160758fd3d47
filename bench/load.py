"""`python -m bench.load --users 20`: many users on one server, each with a recording of its own.

All users upload a recording at the same time, choose a window and a seed, train, look at the pages
that show the result, and save a snapshot, by the messages that a browser sends. Measured are the
times of the pages and the server's memory, threads and open files. Each saved result is compared
with that of the same request without the app, to the last digit.
"""

import argparse
import asyncio
import random
import sys
import tempfile
import time
from collections import Counter, defaultdict
from collections.abc import Awaitable, Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np
import psutil

from accpinn.methods.pinn.config import FAST
from accpinn.recordings.openacc import read
from accpinn.study import Analysis, single_window
from accpinn.study.result import Result
from accpinn.study.run import run
from accpinn.study.snapshot_library import Library
from accpinn.units import Seconds
from bench.batch import SAMPLES, shortened
from bench.browsing import Browser, visit
from bench.measurement import Measurement, measured, show
from tests.support.server import Server, running

STEP = 10
"""Samples by which the recordings of two users differ."""
LENGTH: Seconds = 60.0
"""Length of the window."""
LIGHT: Seconds = 1.5
"""Most time for 95 % of the page views that neither open a file nor train."""
LARGEST_MEGABYTES = 40.0
"""Most memory a user takes."""


@dataclass(frozen=True)
class Request:
    """The analysis that one user asks for."""

    name: str
    """Name of the recording and of the snapshot."""
    content: bytes
    start: Seconds
    seed: int

    @classmethod
    def of(cls, user: int, journey: int = 0) -> "Request":
        """Return the request of a user, whose recording nobody else has."""
        content = shortened(SAMPLES[user % len(SAMPLES)], STEP * (user + 1))
        return cls(f"user_{user}_{journey}.csv", content, 10.0 * (journey % 5), user)

    def agrees(self, saved: Result) -> bool:
        """Whether a snapshot holds the result of the same request without the app."""
        recording = read(self.content, self.name)
        analysis = Analysis.of(
            recording, single_window(self.start, LENGTH), settings=replace(FAST, seed=self.seed)
        )
        pairs = [(result.infos, result.parameters) for result in (saved, run(analysis, recording))]
        return pairs[0] == pairs[1]


class Load:
    """Users of one server, and how long its pages took."""

    def __init__(self, server: Server, pause: Seconds = 0.0) -> None:
        """Begin with an empty record; users look at pages for the ``pause``, more or less."""
        self.server, self.pause, self.random = server, pause, random.Random(0)
        self.taken: dict[str, list[Seconds]] = defaultdict(list)
        """Seconds by page; the names of light views begin with a capital letter."""
        self.memory = 0.0
        """Memory of the server while all users of the last round are still there, in MB."""
        self.faults: list[str] = []

    async def journeys(self, users: int, journey: int = 0) -> None:
        """Send all users at once, with so many journeys behind them; all stay to the end."""
        browsers = [Browser(self.server.address) for _ in range(users)]
        work = (
            self._journey(browser, Request.of(k, journey)) for k, browser in enumerate(browsers)
        )
        outcomes = await asyncio.gather(*work, return_exceptions=True)
        self.faults += [f"{type(fault).__name__}: {fault}" for fault in outcomes if fault]
        self.memory = psutil.Process(self.server.process.pid).memory_info().rss / 1e6
        for browser in browsers:
            await browser.close()

    async def _journey(self, browser: Browser, request: Request) -> None:
        await self._wait("first page", browser.open())
        await self._wait("upload", browser.upload("data_upload", request.name, request.content))
        with suppress(LookupError):  # of one window alone there is nothing to choose
            await browser.set("data_which", ("One window",))
        await self._wait("window", browser.set("data_start", request.start))
        await self._wait("window", browser.set("data_length", LENGTH))
        await self._wait("Train", browser.go("Train"))
        await browser.set("train_preset", ("Fast",))
        await browser.set("train_options", True)
        await self._wait("Train, an option", browser.set("train_fast_seed", request.seed))
        began = time.perf_counter()
        await browser.press("train_start")
        for page in ("Data", "Snapshots", "Train"):  # a glance elsewhere meanwhile
            await self._wait(page, browser.go(page))
        while await browser.poll():
            pass
        self.taken["training with its queue"].append(time.perf_counter() - began)
        for page in ("Stability", "Platoon", "Compare", "Data", "Train", "Snapshots"):
            await self._wait(page, browser.go(page))
        await self._wait("saving", browser.press("Save", snapshots_name=request.name))
        await self._wait("Home", browser.go("Home"))
        self.faults += browser.faults

    async def _wait(self, what: str, action: Awaitable[Seconds]) -> None:
        self.taken[what].append(await action)
        await asyncio.sleep(self.random.uniform(0.0, 2.0 * self.pause))

    def times(self) -> Iterator[Measurement]:
        """Return how long pages took."""
        light = [t for what, taken in self.taken.items() if what[0].isupper() for t in taken]
        for what, taken, most in [
            *((what, taken, None) for what, taken in self.taken.items()),
            ("light page views", light, LIGHT),
        ]:
            middle, slow = np.percentile(taken, (50, 95)).tolist()
            yield Measurement(name=f"{what}, median", value=middle)
            yield Measurement(name=f"{what}, 95 %", value=slow, at_most=most)


def wrong_results(folder: Path, requests: list[Request]) -> list[str]:
    """Return which saved results are missing, there twice, or different from the request's."""
    library = Library(folder)
    saved = {entry.name: entry.id for entry in library.entries()}
    counts = Counter(entry.name for entry in library.entries())
    counts.subtract(request.name for request in requests)
    faults = [f"{name}: {n:+d} snapshots too many" for name, n in counts.items() if n]
    for request in requests:
        if request.name in saved and not request.agrees(library.read(saved[request.name])):
            faults.append(f"{request.name}: not as without the app")
    return faults


def measure(place: Path, users: int, pause: Seconds) -> Iterator[Measurement]:
    """Run a server in a folder, send the users through it and check what they saved."""
    log = place / "log"
    with running(place / "cache", log) as server:
        first, load = Load(server), Load(server, pause)
        asyncio.run(visit(server.address))
        asyncio.run(first.journeys(1, 1))
        asyncio.run(load.journeys(users))
        yield from load.times()
        megabytes = (load.memory - first.memory) / users
        yield Measurement(
            name="memory a user", value=megabytes, unit="MB", at_most=LARGEST_MEGABYTES
        )
        process = psutil.Process(server.process.pid)
        yield Measurement(name="threads", value=process.num_threads(), unit="")
        yield Measurement(name="open files", value=process.num_fds(), unit="")
    requests = [*map(Request.of, range(users)), Request.of(0, 1)]
    crashes = [line for line in log.read_text().splitlines() if "Error" in line]
    wrong = wrong_results(place / "snapshots", requests)
    faults = [*wrong, *first.faults, *load.faults, *crashes]
    print(*faults, sep="\n", end="\n" if faults else "", file=sys.stderr)
    yield Measurement(name="results as without the app", value=len(requests) - len(wrong), unit="")
    yield Measurement(name="faults", value=len(faults), unit="", at_most=0)


def main(arguments: list[str] | None = None) -> int:
    """Print the figures.

    Returns:
        1 if a result is wrong or missing, pages were too slow, or users took too much memory.
    """
    parser = argparse.ArgumentParser(prog="python -m bench.load", description=__doc__)
    parser.add_argument("--users", type=int, default=20, help="at the same time (20)")
    parser.add_argument("--pause", type=float, default=0.0, help="s at a page in the mean (0)")
    given = parser.parse_args(arguments)
    with tempfile.TemporaryDirectory() as place:
        work = partial(measure, Path(place), given.users, given.pause)
        part = measured(work)
    return show({f"users: {given.users}, {given.pause:g} s at a page in the mean": part})


if __name__ == "__main__":
    sys.exit(main())
