"""`dataset`: the parameters of all cars in many recordings, with the sheet that describes them."""

import argparse
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
from accpinn.results.progress import share_bar
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
    with interruptible() as stopped, share_bar() as show_share:

        def show_progress(now: DatasetProgress) -> None:
            left = now.seconds_left
            more = f", {tqdm.format_interval(left)} left of this step" if left else ""
            show_share(now.share, f"{now.step}{more}")

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
