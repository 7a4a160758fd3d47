"""`python -m bench.load --users 20`: many users on one server, each with a recording of its own.

Every user uploads a recording, chooses a window and a seed, trains, looks at Stability, Platoon and
Compare, and saves a snapshot; all at the same time, by the messages that a browser sends (without
the work of drawing that a browser does). Printed are how long the pages took, what went wrong,
whether each saved result is the one that the same request gives without the app, to the last digit,
and the server's memory, threads and files: before, which is after another user alone; at the end,
while all are still there; an hour after they have left; and once every limit of time has passed.
The server's clock is advanced for that, nobody waits. What users held is given back by then; what
stays are caches, which have so many entries at most, and the holes of free memory.

With `--journeys 10` each user begins anew so often, with another window each time, and a line is
printed after every round: what is not given back grows from line to line.
"""

import argparse
import asyncio
import json
import signal
import statistics
import sys
import tempfile
import time
from collections import defaultdict
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise
from pathlib import Path

import numpy as np
import psutil
from accpinn.results.snapshot import Snapshot
from accpinn.results.snapshot.saved import Library

from accpinn.inference.intervals import intervals
from accpinn.methods.pinn.config import FAST
from accpinn.methods.registry import METHODS
from accpinn.recordings.openacc import read
from accpinn.segment.cut import cut, default_vehicles
from accpinn.units import Seconds
from bench.advanced import ADVANCE, COUNTED
from bench.browsing import Browser, visit
from bench.run import positive
from pages.ui.session.resources import KEPT
from tests.support.server import ROOT, Server, running

SAMPLES = sorted((ROOT / "sample_data").glob("*.csv"))
STEP = 10
"""Rows by which the recordings of two users of one sample differ."""
LENGTH: Seconds = 60.0
LIGHT: Seconds = 2.0
"""95 % of the page views that neither open a file nor train are to take less."""
HOUR: Seconds = 3600.0
"""After it the server has forgotten browsers that have gone; what their users had open stays."""
SETTLED: Seconds = 40.0
"""After so long without a task the server has collected its garbage."""


PATIENCE: Seconds = 60.0
"""For a busy server to say what it holds."""
FOR_EVER: Seconds = 4 * 24 * HOUR
"""After it no limit of time keeps anything in memory."""
LARGEST_MEGABYTES = 40.0
"""A user may take so much memory."""
KEPT_MEGABYTES = 10.0
"""So much of it may stay for each entry of the caches of what pages show."""
SPARE = 3
"""Threads and files more than before that count for nothing."""


@dataclass(frozen=True)
class Request:
    """What one user asks for."""

    name: str
    """Of the recording, and of the snapshot."""
    content: bytes
    start: Seconds
    seed: int

    @classmethod
    def of(cls, user: int, journey: int = 0) -> "Request":
        """That of a user: a sample without its first rows, as nobody else has it."""
        sample = SAMPLES[user % len(SAMPLES)]
        lines = sample.read_bytes().splitlines(keepends=True)
        first = next(k for k, line in enumerate(lines) if line.startswith(b"Time")) + 1
        content = b"".join(lines[:first] + lines[first + STEP * (user + 1) :])
        return cls(f"user_{user}_{journey}.csv", content, 10.0 * (journey % 5), user)

    def agrees(self, found: Snapshot) -> bool:
        """Whether a snapshot holds what the same request gives without the app."""
        recording = read(self.content, self.name)
        segment = cut(recording, self.start, LENGTH, default_vehicles(recording))
        fit = METHODS["pinn"].fit(segment, "II", replace(FAST, seed=self.seed))
        expected, uncertainty = intervals(segment, fit), found.uncertainty
        return (
            found.info == segment.info
            and found.fit.parameters == fit.parameters
            and uncertainty is not None
            and np.array_equal(uncertainty.lower.values, expected.lower.values, equal_nan=True)
            and np.array_equal(uncertainty.upper.values, expected.upper.values, equal_nan=True)
        )


@dataclass(frozen=True)
class State:
    """What a server holds."""

    megabytes: float
    threads: int
    files: int
    """Open ones, connections included."""
    seconds: Seconds
    """Of processor time so far."""
    temporary: int
    """Files left in the folder for temporary ones."""
    held: dict[str, int]
    """How many connections, sessions and recordings."""

    @classmethod
    def of(cls, server: Server, place: Path, held: dict[str, int]) -> "State":
        """That of a running server."""
        process = psutil.Process(server.process.pid)
        times = process.cpu_times()
        return cls(
            process.memory_info().rss / 1e6, process.num_threads(), process.num_fds(),
            times.user + times.system, sum(1 for path in place.rglob("*") if path.is_file()), held,
        )  # fmt: skip

    def kept_since(self, before: "State", journeys: int) -> list[str]:
        """What was not given back after so many journeys; one sentence each."""
        found = []
        if (each := self.stays(before, journeys)) > KEPT_MEGABYTES:
            found.append(f"memory: {each:.0f} MB for each entry of the caches were not given back")
        for what, now, then in (
            ("threads", self.threads, before.threads + SPARE),
            ("open files", self.files, before.files + SPARE),
            ("temporary files", self.temporary, before.temporary + SPARE),
            *((what, count, before.held[what]) for what, count in self.held.items()),
        ):
            if now > then:
                found.append(f"{what}: {now}, at most {then} were to stay")
        return found

    def stays(self, before: "State", journeys: int) -> float:
        """Megabytes for each entry that the caches can have by then."""
        return (self.megabytes - before.megabytes) / min(journeys, KEPT)

    def __str__(self) -> str:
        """In one line."""
        return (
            f"{self.megabytes:6.0f} MB, {self.threads} threads, {self.files} open files,"
            f" {self.temporary} temporary files, processor {self.seconds:.1f} s; "
            + ", ".join(f"{count} {what}" for what, count in self.held.items())
        )


class Load:
    """Users of one server, and how long its pages took."""

    def __init__(self, server: Server) -> None:
        """Nobody is there yet."""
        self.server = server
        self.taken: dict[str, list[Seconds]] = defaultdict(list)
        """Seconds by page; those of light views begin with a page's name."""
        self.faults: list[str] = []

    async def journeys(
        self, users: int, journey: int = 0, at_the_end: Callable[[], object] = lambda: None
    ) -> None:
        """That of all users at once; all stay until the last is done.

        Args:
            users: how many.
            journey: how many each of them has behind it.
            at_the_end: called while all are still there.
        """
        browsers = [Browser(self.server.address) for _ in range(users)]
        work = (self._journey(one, Request.of(k, journey)) for k, one in enumerate(browsers))
        done = await asyncio.gather(*work, return_exceptions=True)
        self.faults += [f"{type(fault).__name__}: {fault}" for fault in done if fault]
        at_the_end()
        for browser in browsers:
            await browser.close()

    async def _journey(self, browser: Browser, asked: Request) -> None:
        self._note("first page", await browser.open())
        self._note("upload", await browser.upload("data_upload", asked.name, asked.content))
        self._note("window", await browser.set("data_start", asked.start))
        self._note("window", await browser.set("data_length", LENGTH))
        await self._look(browser, "Train")
        await browser.set("train_preset", ("Fast",))
        await browser.set("train_options", True)
        self._note("Train, an option", await browser.set("train_fast_seed", asked.seed))
        began = time.perf_counter()
        await browser.press("train_start")
        for page in ("Data", "Snapshots", "Train"):  # a glance elsewhere meanwhile
            await self._look(browser, page)
        while await browser.poll():
            pass
        self._note("training with its queue", time.perf_counter() - began)
        for page in ("Stability", "Platoon", "Compare", "Data", "Train", "Snapshots"):
            await self._look(browser, page)
        self._note("saving", await browser.press("Save", snapshots_name=asked.name))
        await self._look(browser, "Home")
        self.faults += browser.faults

    async def _look(self, browser: Browser, page: str) -> None:
        self._note(page, await browser.go(page))

    def _note(self, what: str, seconds: Seconds) -> None:
        self.taken[what].append(seconds)

    @property
    def light(self) -> list[Seconds]:
        """Of the views that neither open a file nor train."""
        return [t for what, taken in self.taken.items() if what[0].isupper() for t in taken]


def percentile(values: list[Seconds]) -> Seconds:
    """The 95th."""
    return float(np.percentile(values, 95))


def all_requests(users: int, journeys: int) -> list[Request]:
    """What all users ask for on all their journeys."""
    return [Request.of(user, journey) for journey in range(journeys) for user in range(users)]


def wrong_results(folder: Path, requests: list[Request]) -> list[str]:
    """What is missing among the saved results, twice there, or not what the request gives."""
    library = Library(folder)
    saved = defaultdict(list)
    for entry in library.entries():
        saved[entry.name].append(entry)
    found = []
    for asked in requests:
        entries = saved.pop(asked.name, [])
        if len(entries) != 1:
            found.append(f"{asked.name}: saved {len(entries)} times")
        elif not asked.agrees(library.open(entries[0].id)):
            found.append(f"{asked.name}: not as without the app")
    return found + [f"{name}: nobody asked for it" for name in saved]


class Observed:
    """A server whose clock can be advanced, in a folder of its own."""

    def __init__(self, place: Path) -> None:
        """It does not run yet."""
        self.place, self.temporary = place, place / "tmp"
        self.temporary.mkdir()
        self.log, self._advance = place / "log", place / "advance"
        self._passed: Seconds = 0.0
        self.states: list[State] = []
        """Those that were noted."""

    @contextmanager
    def running(self) -> Iterator[Server]:
        """The app, until the end of the block."""
        extra = {"TMPDIR": str(self.temporary), ADVANCE: str(self._advance)}
        with running(
            self.place / "cache", self.log, program="bench.advanced", extra=extra
        ) as self.server:
            yield self.server

    def note(self, title: str) -> None:
        """Print what it holds, without memory that is free."""
        state = State.of(self.server, self.temporary, self._held())
        print(f"{title:14}{state}", flush=True)
        self.states.append(state)

    def _held(self) -> dict[str, int]:
        """What users have there; its free memory goes back to the system."""
        answer = self._advance.with_suffix(".held")
        answer.unlink(missing_ok=True)
        self.server.process.send_signal(signal.SIGUSR2)
        end = time.monotonic() + PATIENCE
        while not answer.exists():
            if time.monotonic() > end:
                raise AssertionError("the server does not answer")
            time.sleep(0.05)
        counts = json.loads(answer.read_text())
        return {what: counts[name] for name, what in COUNTED.items()}

    def let_pass(self, seconds: Seconds) -> None:
        """So much time, until the next one comes, and until garbage is collected."""
        self._passed += seconds
        self._advance.write_text(str(self._passed))
        self.server.process.send_signal(signal.SIGUSR1)
        asyncio.run(visit(self.server.address))
        time.sleep(SETTLED)


def main(arguments: list[str] | None = None) -> int:
    """Print the figures.

    Returns:
        1 where a result is wrong or lost, pages were too slow, or memory was not given back.
    """
    parser = argparse.ArgumentParser(prog="python -m bench.load", description=__doc__)
    parser.add_argument("--users", type=positive, default=20, help="at the same time (20)")
    parser.add_argument("--journeys", type=positive, default=1, help="of each, in turn (1)")
    options = parser.parse_args(arguments)
    users, journeys = options.users, options.journeys
    with tempfile.TemporaryDirectory() as name:
        observed = Observed(Path(name))
        began = time.perf_counter()
        with observed.running() as server:
            load = Load(server)
            asyncio.run(visit(server.address))
            print(f"first page {time.perf_counter() - began:.1f} s after the start")
            asyncio.run(Load(server).journeys(1, journeys))
            observed.let_pass(FOR_EVER)
            observed.note("before")
            for journey in range(journeys):
                end = partial(observed.note, f"round {journey + 1}")
                asyncio.run(load.journeys(users, journey, end))
            observed.let_pass(HOUR)
            observed.note("an hour later")
            observed.let_pass(FOR_EVER)
            observed.note("4 days later")
        crashes = [line for line in observed.log.read_text().splitlines() if "Error" in line]
        for what, taken in load.taken.items():
            print(f"{what:24} {len(taken):4} times, median {statistics.median(taken):6.2f} s,"
                  f" 95 % {percentile(taken):6.2f} s")  # fmt: skip
        print(f"light page views: 95 % within {percentile(load.light):.2f} s (at most {LIGHT:g})")
        print("Every result is now computed without the app ...", flush=True)
        asked = [*all_requests(users, journeys), Request.of(0, journeys)]
        wrong = wrong_results(observed.place / "snapshots", asked)
    print(f"results: {len(asked) - len(wrong)} of {len(asked)} as without the app")
    before, *rounds, _, last = observed.states
    largest = max(b.megabytes - a.megabytes for a, b in pairwise([before, *rounds])) / users
    stays = last.stays(before, users * journeys)
    print(
        f"memory: {largest:.1f} MB a user (at most {LARGEST_MEGABYTES:g}); {stays:.1f} MB stay for"
        f" each entry of the caches (at most {KEPT_MEGABYTES:g})"
    )
    faults = [*wrong, *load.faults, *crashes, *last.kept_since(before, users * journeys)]
    for fault in faults:
        print(fault)
    slow = percentile(load.light) > LIGHT
    return int(bool(faults) or slow or largest > LARGEST_MEGABYTES)


if __name__ == "__main__":
    sys.exit(main())
