"""A long run: `make fuzz`, `MINUTES=60 make fuzz`, or `make fuzz ARGS="--kind snapshot --seed 7"`.

Prints what was tried by kind; a finding is printed with its seed, and its file is kept. The exit
status is 1 where there is one.
"""

import argparse
import secrets
import time
from collections import Counter
from itertools import cycle
from pathlib import Path

from tests.fuzz.campaign import attempt, example
from tests.fuzz.kinds import KINDS
from tests.support import draws

TURN = {"large": 1, "link": 20}
"""Examples of a kind before it is the next one's turn; of all others `OTHERS`."""
OTHERS = 40
MOST_FINDINGS = 50
"""After so many the run ends: something is broken."""


def main() -> int:
    """Run until the time is over."""
    parser = argparse.ArgumentParser(prog="python -m tests.fuzz", description=__doc__)
    parser.add_argument("--minutes", type=float, default=2.0)
    parser.add_argument("--kind", action="append", choices=[*KINDS], help="only this one (all)")
    parser.add_argument("--seed", type=int, help="only this example, of each kind")
    parser.add_argument("--keep", type=Path, default=Path("fuzz_findings"), metavar="FOLDER")
    options = parser.parse_args()
    draws.take_few()
    kinds = [KINDS[name] for name in options.kind or KINDS]
    tried: dict[str, Counter[str]] = {kind.name: Counter() for kind in kinds}
    slowest, largest = dict.fromkeys(tried, 0.0), dict.fromkeys(tried, 0.0)
    findings: list[str] = []
    first = secrets.randbelow(2**32) if options.seed is None else options.seed
    end = time.monotonic() + 60 * options.minutes
    print(f"Seeds from {first} on; findings are kept in {options.keep.resolve()}.", flush=True)
    seeds = Counter(dict.fromkeys(tried, first))
    for kind in cycle(kinds) if options.seed is None else kinds:
        for _ in range(TURN.get(kind.name, OTHERS) if options.seed is None else 1):
            seed = seeds[kind.name]
            seeds[kind.name] += 1
            content = example(kind, seed)
            found = attempt(kind, content)
            tried[kind.name][found.answer] += 1
            slowest[kind.name] = max(slowest[kind.name], found.seconds)
            largest[kind.name] = max(largest[kind.name], found.memory)
            if found.answer == "finding":
                options.keep.mkdir(parents=True, exist_ok=True)
                place = options.keep / f"{kind.name}_{seed}{kind.ending}"
                place.write_bytes(content)
                place.with_suffix(".txt").write_text(found.why, encoding="utf-8")
                again = f"--kind {kind.name} --seed {seed}"
                said = found.why.strip().splitlines() or [""]
                print(f"FINDING {again}: {said[-1][:200]} ({place})", flush=True)
                findings.append(again)
        if time.monotonic() > end or len(findings) >= MOST_FINDINGS:
            break
    print(f"{'kind':<12}{'tried':>8}{'refused':>9}{'loaded':>8}{'findings':>10}"
          f"{'slowest':>10}{'memory':>10}")  # fmt: skip
    for name, counts in tried.items():
        print(
            f"{name:<12}{counts.total():>8}{counts['refused']:>9}{counts['loaded']:>8}"
            f"{counts['finding']:>10}{slowest[name]:>8.2f} s{largest[name] / 1e6:>7.0f} MB"
        )
    return 1 if findings else 0


if __name__ == "__main__":
    raise SystemExit(main())
