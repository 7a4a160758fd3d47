"""`report FILE`: a snapshot as one web page for people without accpinn."""

import argparse
from dataclasses import replace
from pathlib import Path

from accpinn.cli.output import complain, show
from accpinn.recordings.openacc import read
from accpinn.results.messages.snapshot import summary
from accpinn.results.snapshot.file import load, writable_path, write_whole
from accpinn.results.snapshot.schema import SUFFIX
from accpinn.results.snapshot.verification import recover, verify


def add_options(parser: argparse.ArgumentParser) -> None:
    """Declare the command's options."""
    parser.add_argument("file", metavar="FILE", help="a snapshot (.accpinn.zip)")
    parser.add_argument("-o", "--out", metavar="HTML", help="where to (beside the snapshot)")
    parser.add_argument(
        "--recording", metavar="CSV", help="draw its data too, where they are not in the snapshot"
    )
    parser.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Write the page, and say where; 1 when the snapshot does not agree with itself."""
    from accpinn.results.report.page import render_report  # plotly's script is read from disk

    place = Path(options.out or options.file.removesuffix(SUFFIX) + ".html")
    real = writable_path(place, "report")
    snapshot = load(options.file)
    recording = read(options.recording) if options.recording else None
    checked = verify(snapshot, recording)
    if recording and snapshot.segment is None:
        snapshot = replace(snapshot, segment=recover(snapshot, recording).segment)
    page = render_report(snapshot, checked)
    write_whole(page.encode(), real, "report")
    show(str(place))
    if checked.ok:
        return 0
    complain(
        "what the snapshot says does not follow from its contents."
        f" {summary(checked, snapshot.info)} The report was written, with a warning at its top."
    )
    return 1
