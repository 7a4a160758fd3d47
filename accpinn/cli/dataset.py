"""`dataset`: the parameters of all cars in many recordings, with the sheet that describes them."""

import argparse
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from textwrap import fill
from typing import Any

from tqdm import tqdm

from accpinn.cli.options import DASK
from accpinn.cli.output import interruptible, note, print_json, show, show_result
from accpinn.cli.recordings import JSON, option
from accpinn.inference.intervals import LEVEL
from accpinn.recordings.mapping import load_mapping
from accpinn.results.datasheet import SHEET, overview, write_dataset
from accpinn.study.cluster import plain_scheduler
from accpinn.study.dataset import MODELS, Dataset, DatasetProgress, make_dataset

DATASET_OPTIONS = (
    option("sources", nargs="+", metavar="FOLDER|FILE", help="recordings; folders with all below"),
    option("--out", required=True, metavar="FOLDER", help="of the data set; is continued"),
    option("--level", type=float, default=LEVEL, metavar="P", help=f"of intervals ({LEVEL:g})"),
    *DASK,
    JSON,
)  # fmt: skip
DATASET_HELP = fill(
    f"Models: {', '.join(MODELS)}. The folder has tables as CSV and Parquet, vehicle types of SUMO"
    f" and {SHEET}, which says what they are, how they were made and how to cite them."
)


def run_dataset(options: argparse.Namespace) -> int:
    """Compute what is missing, and write the data set; 130 when interrupted."""
    if options.scheduler and (warning := plain_scheduler(options.scheduler)):
        note(f"Warning: {warning}")
    folder = Path(options.out)
    with interruptible() as stopped, _progress_bar() as show_progress:
        dataset = make_dataset(
            options.sources,
            folder,
            mapping=load_mapping(options.mapping) if options.mapping else None,
            workers=options.workers,
            scheduler=options.scheduler,
            command=options.command_line,
            level=options.level,
            on_progress=show_progress,
            should_stop=stopped.is_set,
        )
    if dataset is None:
        stop = "Stopped; what is finished is kept, and the same call goes on from there."
        if options.json:
            print_json({"out": options.out, "stopped": True})
        else:
            show(stop)
        return 130
    files = write_dataset(dataset, folder)
    show_result(
        options, lambda: _document(dataset, options.out, files), lambda: _text(dataset, folder)
    )
    return 0


def _document(dataset: Dataset, out: str, files: tuple[str, ...]) -> dict[str, Any]:
    return {
        "out": out,
        "files": list(files),
        "models": list(MODELS),
        "groups": {model: len(grouped.groups) for model, grouped in dataset.groups.items()},
        "recordings": len(dataset.recordings),
        "windows": len(dataset.rows[["sha256", "start"]].drop_duplicates()),
        "rows": len(dataset.rows),
        "held_out_windows": dataset.judgements.windows,
        "failed": len(dataset.failures) + len(dataset.judgements.failures),
        "stopped": False,
    }


def _text(dataset: Dataset, folder: Path) -> str:
    return f"{overview(dataset).to_text()}\n\n{folder}: see {SHEET} there."


@contextmanager
def _progress_bar() -> Iterator[Any]:
    """A bar on standard error: the step, and the share of all work."""
    form = "{l_bar}{bar}|{postfix}"
    with tqdm(total=1.0, file=sys.stderr, bar_format=form, mininterval=0.2, disable=None) as bar:

        def show_progress(now: DatasetProgress) -> None:
            bar.n = now.share
            left = now.seconds_left
            more = f", {tqdm.format_interval(left)} left of this step" if left else ""
            bar.set_postfix_str(f"{now.step}{more}", refresh=True)

        yield show_progress
