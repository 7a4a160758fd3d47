"""What the studies share: their options, their processes and the folder of real recordings."""

import argparse
import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path
from typing import TypeVar

from accpinn.channels import PARAMETERS

SYMBOLS = tuple(quantity.symbol for quantity in PARAMETERS)
Task = TypeVar("Task")
Result = TypeVar("Result")


def positive(text: str) -> int:
    """A count on the command line."""
    if not text.isdecimal() or int(text) < 1:
        raise argparse.ArgumentTypeError("give at least 1")
    return int(text)


def options(study: str, description: str | None, recordings: int = 100) -> argparse.ArgumentParser:
    """A parser of the options of every study of simulated recordings."""
    parser = argparse.ArgumentParser(prog=f"python -m bench.{study}", description=description)
    parser.add_argument(
        "--recordings", type=positive, default=recordings, help=f"how many ({recordings})"
    )
    parser.add_argument("--workers", type=positive, help="processes (one for each core)")
    return parser


def each(
    study: Callable[[Task], Result], tasks: Sequence[Task], workers: int | None = None
) -> Iterator[Result]:
    """The results in the order of their tasks, from so many processes; one task needs none."""
    if len(tasks) == 1:
        yield study(tasks[0])
        return
    with ProcessPoolExecutor(workers or os.cpu_count(), get_context("spawn")) as pool:
        yield from pool.map(study, tasks)


def openacc(parser: argparse.ArgumentParser) -> Path:
    """The folder of the real recordings; ends the program where it is not there."""
    folder = os.environ.get("OPENACC_DIR", "")
    if not folder or not Path(folder).is_dir():
        parser.error("OPENACC_DIR: name the folder of the OpenACC recordings in this variable")
    return Path(folder)
