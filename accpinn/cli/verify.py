"""`verify FILE`: whether a snapshot is whole, and its figures follow from its contents."""

import argparse
from typing import Any

from accpinn.cli.output import print_json, show
from accpinn.recordings.openacc import read
from accpinn.results.messages import message
from accpinn.results.messages.snapshot import check_rows, summary
from accpinn.results.snapshot.file import load
from accpinn.results.snapshot.schema import Snapshot
from accpinn.results.snapshot.verification import Verification, verify
from accpinn.results.tables.table import Column, Table


def add_options(parser: argparse.ArgumentParser) -> None:
    """Declare the command's options."""
    parser.add_argument("file", metavar="FILE", help="a snapshot (.accpinn.zip)")
    parser.add_argument(
        "--recording", metavar="CSV", help="check the errors too, where the data are not in it"
    )
    parser.add_argument(
        "--refit",
        action="store_true",
        help="run every method again on the data, as long as that took the first time",
    )
    parser.add_argument("--json", action="store_true", help="one JSON document")
    parser.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Check, and print stored beside recomputed; 1 when something does not match."""
    snapshot = load(options.file)
    recording = read(options.recording) if options.recording else None
    result = verify(snapshot, recording, refit=options.refit)
    if options.json:
        print_json(describe(snapshot, result))
    else:
        show(_text(snapshot, result))
    return 0 if result.ok else 1


def describe(snapshot: Snapshot, result: Verification) -> dict[str, Any]:
    """The verification as the command-line contract has it."""
    return {
        "id": snapshot.id,
        "name": snapshot.name,
        "created": snapshot.created,
        "ok": result.ok,
        "sentence": summary(result, snapshot.info),
        "checks": [row._asdict() for row in check_rows(result, snapshot.info)],
        "not_checked": [
            {"what": message(one, snapshot.info), "cure": one.cure} for one in result.unchecked
        ],
    }


def _text(snapshot: Snapshot, result: Verification) -> str:
    info = snapshot.info
    window = f"{info.window}"
    about = [snapshot.name, f"{info.source}, {window}, {snapshot.fit.method}", snapshot.created]
    titles = ("What", "Agrees", "Stored", "Recomputed")
    checks = check_rows(result, info)
    cells = tuple((c.name, "yes" if c.ok else "NO", c.stored, c.recomputed) for c in checks)
    table = Table("", tuple(map(Column, titles)), cells)
    faults = [f"{row.name}: {row.sentence}" for row in checks if not row.ok]
    lines = [", ".join(filter(None, about)), ""]
    lines += [table.to_text(), ""]
    options = dict.fromkeys(one.cure for one in result.unchecked if one.cure)
    more = [f"More is checked with {' and '.join(options)}."] if options else []
    return "\n".join([*lines, *(faults or [summary(result, info), *more])])
