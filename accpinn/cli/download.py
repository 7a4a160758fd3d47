"""`download`: runs of the OpenACC database from their publisher."""

import argparse
import sys
from collections import Counter
from pathlib import Path

from tqdm import tqdm

from accpinn.channels import fields
from accpinn.cli.output import complain, interruptible, print_json, show
from accpinn.cli.recording import add_json_option
from accpinn.recordings.catalogue import Run, find
from accpinn.recordings.download import PUBLISHED_AT, DownloadState, download
from accpinn.results.tables.table import Column, Table
from accpinn.storage import folder as folder_of


def add_download_options(parser: argparse.ArgumentParser) -> None:
    """Declare the options of `download`."""
    option = parser.add_argument
    option("names", nargs="*", metavar="CAMPAIGN|FILE", help="runs of the catalogue (all)")
    option("--to", metavar="FOLDER", help="where recordings are kept (ACCPINN_RECORDINGS)")
    option("--list", action="store_true", help="show the catalogue, and what is there already")
    option("--from", dest="base", default=PUBLISHED_AT, metavar="URL", help="of a mirror")
    add_json_option(parser)


def run_download(options: argparse.Namespace) -> int:
    """Download, and say what became of each run; 1 when one failed, 130 when interrupted."""
    runs = find(options.names)
    folder = Path(options.to) if options.to else folder_of("recordings")
    if options.list:
        return _list(runs, folder, options.json)
    with (
        interruptible() as stopped,
        tqdm(total=len(runs), unit="run", file=sys.stderr, disable=options.json or None) as bar,
    ):
        ended = []
        for run in download(runs, folder, options.base, should_stop=stopped.is_set):
            ended.append(run)
            bar.update()
        status = 130 if stopped.is_set() else 0
    failed = [run for run in ended if run.state is DownloadState.FAILED]
    if options.json:
        rows = [
            {**fields(run.run, "campaign", "file"), "path": str(run.path),
             "state": run.state.value, "size": run.size, "reason": run.reason or None}
            for run in ended
        ]  # fmt: skip
        print_json({"folder": str(folder), "runs": rows})
    else:
        counts = Counter(run.state.value for run in ended)
        show(f"{folder}: {', '.join(f'{n} {state}' for state, n in counts.items())}")
    if failed:
        others = f" ({len(failed) - 1} more failed)" if len(failed) > 1 else ""
        complain(f"{failed[0].reason}{others}")
    return status or bool(failed)


def _list(runs: tuple[Run, ...], folder: Path, as_json: bool) -> int:
    there = [run.path(folder).is_file() for run in runs]
    if as_json:
        rows = [
            fields(run, "campaign", "file", "sha256") | {"downloaded": is_there}
            for run, is_there in zip(runs, there, strict=True)
        ]
        print_json({"folder": str(folder), "runs": rows})
        return 0
    table = Table.of(
        f"{len(runs)} runs, {sum(there)} of them in {folder}",
        [
            (Column("Campaign"), [run.campaign for run in runs]),
            (Column("File"), [run.file for run in runs]),
            (Column("Downloaded"), ["yes" if is_there else "no" for is_there in there]),
        ],
    )
    show(table.to_text())
    return 0
