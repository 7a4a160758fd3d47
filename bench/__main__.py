"""How fast everyday things are, beside the figures of the last release: `python -m bench`.

Each part runs in a fresh process, so that memory and first calls are its own. The exit status is 1
if a limit is not kept. OPENACC_DIR names the real recordings; page switches need Chromium, too.
"""

import argparse
import os
import sys
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from multiprocessing import get_context
from pathlib import Path

from bench import batch, pages, results, speed, start
from bench.measurement import Figures, Measurement, Part, measured
from tests.browser.running import installed

PARTS = ("start", "results", "batch", "methods", "training", "pages")
RECORDED = PARTS[3:]
"""Parts that need real recordings."""
ITERATIONS, FEW = 20, 5
"""Iterations of the paper's protocol in each round."""
Job = tuple[str, Callable[[], Iterable[Measurement]]]


def main(arguments: list[str] | None = None) -> int:
    """Measure the chosen parts and print them."""
    parser = argparse.ArgumentParser(prog="python -m bench", description=__doc__)
    parser.add_argument("--only", action="append", choices=PARTS, help="this part (all)")
    parser.add_argument("--without", action="append", choices=PARTS, default=[], help="this part")
    parser.add_argument("--quick", action="store_true", help="fewer of the paper's iterations")
    parser.add_argument("--json", action="store_true", help="one JSON document")
    parser.add_argument(
        "--release", action="store_true", help="keep all figures as those of the release"
    )
    options = parser.parse_args(arguments)
    chosen = [name for name in options.only or PARTS if name not in options.without]
    missing = {name: why for name, why in _missing().items() if name in chosen}
    if options.release and (options.quick or missing or set(chosen) != set(PARTS)):
        parser.error("--release: it takes all parts, OPENACC_DIR and Chromium")
    for name, why in missing.items():
        print(f"{name}: left out, as {why}", file=sys.stderr)
    parts = []
    for name, measure in _jobs(set(chosen) - set(missing), FEW if options.quick else ITERATIONS):
        print(f"{name} ...", file=sys.stderr, flush=True)
        parts.append(_in_a_fresh_process(name, measure))
    figures = Figures.now(parts)
    if options.release:
        figures.release()
    return figures.show(options.json)


def _missing() -> dict[str, str]:
    """Return why parts cannot be measured, by part."""
    reasons = {}
    if not installed():
        reasons["pages"] = "Chromium was not found (CHROMIUM)"
    if not os.environ.get("OPENACC_DIR"):
        reasons |= dict.fromkeys(RECORDED, "OPENACC_DIR does not name the recordings")
    return reasons


def _jobs(parts: set[str], iterations: int) -> Iterator[Job]:
    folder = Path(os.environ.get("OPENACC_DIR", ""))
    if "start" in parts:
        yield "start", start.measure
    if "results" in parts:
        yield "results", results.measure
    if "batch" in parts:
        yield "batch", batch.measure
    if "methods" in parts:
        for case in speed.CASES:
            if case.method_limits:
                yield f"methods, {case.name}", partial(speed.methods, case, folder)
    if "training" in parts:
        for case in speed.CASES:
            yield f"training, {case.name}", partial(speed.training, case, folder, iterations)
    if "pages" in parts:
        yield "switches of pages", partial(pages.measure, folder, installed())


def _in_a_fresh_process(name: str, measure: Callable[[], Iterable[Measurement]]) -> Part:
    with ProcessPoolExecutor(1, get_context("spawn")) as process:
        return process.submit(measured, name, measure).result()


if __name__ == "__main__":
    raise SystemExit(main())
