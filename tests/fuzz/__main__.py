"""A long run: `make fuzz`, `MINUTES=60 make fuzz`, or `make fuzz ARGS="--kind snapshot --seed 7"`.

Prints what was tried by kind, also where Ctrl+C or SIGTERM ends the run, a second one without; a
finding is printed with its seed, and its file is kept. The exit status is 1 where there is one.
"""

import argparse
import secrets
import signal
import time
from collections import Counter
from collections.abc import Iterator
from itertools import count, cycle
from pathlib import Path

from tests.fuzz.campaign import Outcome, attempt, example
from tests.fuzz.kinds import KINDS, Kind
from tests.support import draws

TURN = {"large": 1, "link": 20}
"""Examples of a kind before it is the next one's turn; of all others `OTHERS`."""
OTHERS = 40
MOST_FINDINGS = 50
"""After so many the run ends: something is broken."""
ENDING = (signal.SIGINT, signal.SIGTERM)
PROGRESS = 300.0
"""Seconds from one line that tells how far the run is to the next."""


class Run:
    """Examples of some kinds, one after the other."""

    def __init__(self, kinds: list[Kind], keep: Path) -> None:
        """Nothing is tried yet; findings are kept in a folder."""
        self.kinds, self.keep = kinds, keep
        self.outcomes: dict[str, list[Outcome]] = {kind.name: [] for kind in kinds}
        self.is_over = False

    def end(self, *_: object) -> None:
        """After the example under way, whose own handling of an interruption thus stays out."""
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

    def examples(self, first: int) -> Iterator[tuple[Kind, int]]:
        """Kinds in turn and seeds from the first on, for ever."""
        seeds = {kind.name: count(first) for kind in self.kinds}
        for kind in cycle(self.kinds):
            for _ in range(TURN.get(kind.name, OTHERS)):
                yield kind, next(seeds[kind.name])

    def go_on(self, first: int, seconds: float) -> None:
        """Until the time is over, or too much was found."""
        begun = told = time.monotonic()
        for kind, seed in self.examples(first):
            self.attempt(kind, seed)
            now = time.monotonic()
            if now - told > PROGRESS:
                told = now
                print(f"after {(now - begun) / 60:.0f} min: {self}", flush=True)
            if self.is_over or now - begun > seconds or self.findings >= MOST_FINDINGS:
                return

    def attempt(self, kind: Kind, seed: int) -> None:
        """One example; what is found is printed and kept."""
        content = example(kind, seed)
        found = attempt(kind, content)
        self.outcomes[kind.name].append(found)
        if found.answer == "finding":
            self.keep.mkdir(parents=True, exist_ok=True)
            place = self.keep / f"{kind.name}_{seed}{kind.ending}"
            place.write_bytes(content)
            place.with_suffix(".txt").write_text(found.why, encoding="utf-8")
            said = found.why.strip().splitlines() or [""]
            print(f"FINDING --kind {kind.name} --seed {seed}: {said[-1][:200]} ({place})",
                  flush=True)  # fmt: skip

    def __str__(self) -> str:
        """How much, in a line."""
        tried = sum(map(len, self.outcomes.values()))
        return f"{tried:,} tried, {self.findings} findings"

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


def main(arguments: list[str] | None = None) -> int:
    """Run until the time is over, or somebody ends it."""
    parser = argparse.ArgumentParser(prog="python -m tests.fuzz", description=__doc__)
    parser.add_argument("--minutes", type=float, default=2.0)
    parser.add_argument("--kind", action="append", choices=[*KINDS], help="only this one (all)")
    parser.add_argument("--seed", type=int, help="only this example, of each kind")
    parser.add_argument("--keep", type=Path, default=Path("fuzz_findings"), metavar="FOLDER")
    options = parser.parse_args(arguments)
    draws.take_few()
    run = Run([KINDS[name] for name in options.kind or KINDS], options.keep)
    first = secrets.randbelow(2**32) if options.seed is None else options.seed
    print(f"Seeds from {first} on; findings are kept in {options.keep.resolve()}.", flush=True)
    for one in ENDING:
        signal.signal(one, run.end)
    if options.seed is None:
        run.go_on(first, 60 * options.minutes)
    else:
        for kind in run.kinds:
            run.attempt(kind, first)
    print(run.table())
    return 1 if run.findings else 0


if __name__ == "__main__":
    raise SystemExit(main())
