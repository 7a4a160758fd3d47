"""One example after the other, each within bounds of time and memory; what breaks them is kept."""

import signal
import sys
import tempfile
import time
import traceback
import warnings
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import count, cycle
from pathlib import Path
from random import Random
from typing import Any
from unittest.mock import patch

from accpinn.errors import AccpinnError
from tests.fuzz.kinds import Kind

MOST_BYTES = 1e9
"""Memory that one example takes beyond what was taken before, in bytes."""
HANGS_AFTER = 60.0
"""Seconds of processor time after which an example is given up."""
LONGEST_SENTENCE = 1000
TURN = {"large": 1, "link": 20}
"""Examples of a kind before it is the next one's turn; of all others `OTHERS`."""
OTHERS = 40
MOST_FINDINGS = 50
"""After so many the run ends: something is broken."""


@dataclass(frozen=True)
class Outcome:
    """What came of one example."""

    answer: str
    """ "loaded", "refused" or "finding"."""
    seconds: float
    """Processor time."""
    memory: float
    """Bytes beyond what was taken before; 0 where that cannot be measured."""
    why: str
    """What was found; empty for other answers."""


class HangError(BaseException):
    """An example that takes too long; no handler of errors may take it for one."""


def attempt(kind: Kind, content: bytes) -> Outcome:
    """Use an example; whatever is neither a result nor a refusal in a sentence is a finding."""
    answer, why = "finding", ""
    with (
        tempfile.TemporaryDirectory() as folder,
        patch.dict("os.environ", {"ACCPINN_MAPPINGS": folder}),
        _bounded(),
    ):
        (Path(folder) / "example").mkdir()
        taken, started = _peak(reset=True), time.process_time()
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("error")
                warnings.simplefilter("ignore", DeprecationWarning)
                done = kind.use(content, Path(folder) / "example")
            answer = "loaded" if done else "refused"
        except AccpinnError as fault:
            said = str(fault)
            if said.endswith(".") and "\n" not in said and len(said) <= LONGEST_SENTENCE:
                answer = "refused"
            else:
                why = f"a sentence of {len(said)} characters: {said[:300]!r}"
        except (Exception, HangError) as fault:
            why = "".join(traceback.format_exception(fault))
        seconds, memory = time.process_time() - started, _peak() - taken
    if answer != "finding" and (seconds > kind.most_seconds or memory > MOST_BYTES):
        answer, why = "finding", f"{seconds:.1f} s, {memory / 1e6:.0f} MB"
    return Outcome(answer, seconds, memory, why)


@contextmanager
def _bounded() -> Iterator[None]:
    """End what hangs, where the platform has such a clock."""
    if not hasattr(signal, "setitimer"):
        yield
        return

    def end(*_: object) -> None:
        raise HangError(f"not ended after {HANGS_AFTER:g} s of processor time")

    before: Any = signal.signal(signal.SIGPROF, end)
    signal.setitimer(signal.ITIMER_PROF, HANGS_AFTER)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)
        signal.signal(signal.SIGPROF, before)


def _peak(reset: bool = False) -> float:
    """The most memory taken so far, or since it was reset, in bytes; 0 where it is not known."""
    if sys.platform != "linux":
        return 0.0
    if reset:
        try:
            Path("/proc/self/clear_refs").write_text("5")
        except OSError:
            return float("inf")
    status = Path("/proc/self/status").read_text().splitlines()
    return next(1024.0 * int(line.split()[1]) for line in status if line.startswith("VmHWM"))


class Run:
    """Examples of some kinds, one after the other; findings are kept in a folder."""

    def __init__(self, kinds: list[Kind], keep: Path) -> None:
        """Nothing is tried yet."""
        self.kinds, self.keep, self.is_over = kinds, keep, False
        self.outcomes: dict[str, list[Outcome]] = {kind.name: [] for kind in kinds}

    def end(self, *_: object) -> None:
        """End after the example under way; a second time at once."""
        if self.is_over:
            raise KeyboardInterrupt
        self.is_over = True

    @property
    def findings(self) -> int:
        """How many there were."""
        return sum(self.answers(name)["finding"] for name in self.outcomes)

    def answers(self, name: str) -> Counter[str]:
        """What came of the examples of a kind."""
        return Counter(outcome.answer for outcome in self.outcomes[name])

    def go_on(self, first: int, seconds: float) -> None:
        """Try kinds in turn, with seeds from the first on, until time is over or much is found."""
        ends = time.monotonic() + seconds
        seeds = {kind.name: count(first) for kind in self.kinds}
        for kind in cycle(self.kinds):
            for _ in range(TURN.get(kind.name, OTHERS)):
                self.attempt(kind, next(seeds[kind.name]))
                if self.is_over or time.monotonic() > ends or self.findings >= MOST_FINDINGS:
                    return

    def attempt(self, kind: Kind, seed: int) -> None:
        """Try the example of a seed; what is found is printed and kept."""
        content = kind.draw(Random(seed))
        outcome = attempt(kind, content)
        self.outcomes[kind.name].append(outcome)
        if outcome.answer == "finding":
            self.keep.mkdir(parents=True, exist_ok=True)
            place = self.keep / f"{kind.name}_{seed}{kind.ending}"
            place.write_bytes(content)
            place.with_suffix(".txt").write_text(outcome.why, encoding="utf-8")
            last = outcome.why.strip().rpartition("\n")[2][:200]
            print(f"FINDING --kind {kind.name} --seed {seed}: {last} ({place})", flush=True)

    def table(self) -> str:
        """A line a kind: how many of each, the longest time and the most memory."""
        names = ("refused", "loaded", "finding")
        lines = [f"{'kind':<12}{'tried':>8}" + "".join(f"{name:>10}" for name in names)]
        for kind, outcomes in self.outcomes.items():
            counts = "".join(f"{self.answers(kind)[name]:>10}" for name in names)
            slowest = max((outcome.seconds for outcome in outcomes), default=0.0)
            largest = max((outcome.memory for outcome in outcomes), default=0.0)
            lines.append(f"{kind:<12}{len(outcomes):>8}{counts}{slowest:>8.2f} s"
                         f"{largest / 1e6:>7.0f} MB")  # fmt: skip
        return "\n".join(lines)
