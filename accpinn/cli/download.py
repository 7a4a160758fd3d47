"""`download`: runs of the OpenACC database from their publisher."""

import argparse
import sys
from pathlib import Path
from typing import Any

from tqdm import tqdm

from accpinn.cli.estimation import interruptible
from accpinn.cli.output import complain, print_json, show
from accpinn.cli.recording import add_json_option
from accpinn.recordings.catalogue import Run, find
from accpinn.recordings.download import PUBLISHED_AT, Download, DownloadState, download
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
        found = []
        for one in download(runs, folder, options.base, should_stop=stopped.is_set):
            found.append(one)
            bar.update()
        ended = 130 if stopped.is_set() else 0
    failed = [one for one in found if one.state is DownloadState.FAILED]
    if options.json:
        print_json(_describe(folder, found))
    else:
        counts = {state: sum(one.state is state for one in found) for state in DownloadState}
        listed = ", ".join(f"{n} {state.value}" for state, n in counts.items() if n)
        show(f"{folder}: {listed}")
    for one in failed[:1]:
        others = f" ({len(failed) - 1} more failed)" if len(failed) > 1 else ""
        complain(f"{one.reason}{others}")
    return ended or (1 if failed else 0)


def _list(runs: tuple[Run, ...], folder: Path, as_json: bool) -> int:
    there = [run.path(folder).is_file() for run in runs]
    if as_json:
        rows = [
            {"campaign": r.campaign, "file": r.file, "sha256": r.sha256, "downloaded": t}
            for r, t in zip(runs, there, strict=True)
        ]
        print_json({"folder": str(folder), "runs": rows})
        return 0
    table = Table.of(
        f"{len(runs)} runs, {sum(there)} of them in {folder}",
        [
            (Column("Campaign"), [run.campaign for run in runs]),
            (Column("File"), [run.file for run in runs]),
            (Column("Downloaded"), ["yes" if one else "no" for one in there]),
        ],
    )
    show(table.to_text())
    return 0


def _describe(folder: Path, found: list[Download]) -> dict[str, Any]:
    return {
        "folder": str(folder),
        "runs": [
            {
                "campaign": one.run.campaign,
                "file": one.run.file,
                "path": str(one.path),
                "state": one.state.value,
                "size": one.size,
                "reason": one.reason or None,
            }
            for one in found
        ],
    }
