"""Durations of everyday things beside those of the last release: `python -m bench`.

Each part runs in a fresh process, so that memory and first calls are its own. The exit status is 1
if a limit is not kept. OPENACC_DIR names the real recordings; page switches need Chromium, too.
"""

import argparse
import os
import sys
from collections.abc import Callable, Iterable
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from multiprocessing import get_context
from pathlib import Path

from bench import batch, pages, results, speed, start
from bench.measurement import Measurement, Released, measured, show
from tests.browser.running import installed

PARTS = "start", "results", "batch", "methods", "training", "pages"
RECORDED = PARTS[3:]
"""Parts that need real recordings."""
Measure = Callable[[], Iterable[Measurement]]


def main(arguments: list[str] | None = None) -> int:
    """Measure the chosen parts and print them."""
    parser = argparse.ArgumentParser(prog="python -m bench", description=__doc__)
    parser.add_argument("--only", action="append", choices=PARTS, help="this part (all)")
    parser.add_argument(
        "--release", action="store_true", help="keep all figures as those of the release"
    )
    options = parser.parse_args(arguments)
    folder, chromium = os.environ.get("OPENACC_DIR", ""), installed()
    missing = [*(() if folder else RECORDED), *(() if chromium else PARTS[-1:])]
    if options.release and (options.only or missing):
        parser.error("--release: it takes all parts, OPENACC_DIR and Chromium")
    done = {}
    with ProcessPoolExecutor(1, get_context("spawn"), max_tasks_per_child=1) as fresh:
        for name, measure in jobs(Path(folder), chromium).items():
            part = name.partition(",")[0]
            if part in missing:
                print(f"{name}: left out without OPENACC_DIR or Chromium", file=sys.stderr)
            elif part in (options.only or PARTS):
                print(f"{name} ...", file=sys.stderr, flush=True)
                done[name] = fresh.submit(measured, measure).result()
    if options.release:
        Released.now(done).keep()
    return show(done)


def jobs(folder: Path, chromium: str) -> dict[str, Measure]:
    """Return what is measured by name, a part or its name and what it is measured on."""
    everyday: dict[str, Measure] = {
        "start": start.measure,
        "results": results.measure,
        "batch": batch.measure,
    }
    methods = {
        f"methods, {case.name}": partial(speed.methods, case, folder)
        for case in speed.CASES
        if case.method_limits
    }
    training = {
        f"training, {case.name}": partial(speed.training, case, folder) for case in speed.CASES
    }
    methods["methods, AstaZero, five windows"] = partial(speed.several_windows, folder)
    return everyday | methods | training | {"pages": partial(pages.measure, folder, chromium)}


if __name__ == "__main__":
    raise SystemExit(main())
