"""`report FILE`: a snapshot as one web page for people without accpinn."""

import argparse
from pathlib import Path
from typing import Any

from accpinn.snapshot import SUFFIX, load, write_whole


def add_parser(subparsers: Any) -> None:
    """Declare the command."""
    parser = subparsers.add_parser("report", help="a snapshot as one self-contained web page")
    parser.add_argument("file", metavar="FILE", help="a snapshot (.accpinn.zip)")
    parser.add_argument("-o", "--out", metavar="HTML", help="where to (beside the snapshot)")
    parser.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Write the page, and say where."""
    from accpinn.report import report  # plotly's script is read from disk

    page = report(load(options.file))
    place = Path(options.out or options.file.removesuffix(SUFFIX) + ".html")
    write_whole(page.encode(), place, "the report")
    print(place)
    return 0
