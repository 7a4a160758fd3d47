"""A long run: `make fuzz`, `MINUTES=60 make fuzz`, or `make fuzz ARGS="--kind snapshot --seed 7"`.

Prints what was tried by kind, also where Ctrl+C or SIGTERM ends the run, a second one without; a
finding is printed with its seed, and its file is kept. The exit status is 1 where there is one.
"""

import argparse
import secrets
import signal
from pathlib import Path

from tests.fuzz.campaign import Run
from tests.fuzz.kinds import KINDS
from tests.support import draws


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
    for ending in (signal.SIGINT, signal.SIGTERM):
        signal.signal(ending, run.end)
    if options.seed is None:
        run.go_on(first, 60 * options.minutes)
    else:
        for kind in run.kinds:
            run.attempt(kind, first)
    print(run.table())
    return 1 if run.findings else 0


if __name__ == "__main__":
    raise SystemExit(main())
