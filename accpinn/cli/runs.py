"""`runs`: the results that the cache keeps, searched by words."""

import argparse
from collections.abc import Sequence
from typing import Any

from accpinn.channels import PARAMETERS, by_key
from accpinn.cli.options import fields
from accpinn.cli.output import show_result
from accpinn.cli.recording import add_json_option
from accpinn.results.tables.table import Column, Table
from accpinn.study.store import Entry, Store

ID_DIGITS = 12
"""Digits of a result's key that the table shows."""


def add_runs_options(parser: argparse.ArgumentParser) -> None:
    """Declare the options of `runs`."""
    words = "each must stand in recording, vehicles, window, method, preset, name, note or date"
    parser.add_argument("words", nargs="*", metavar="WORDS", help=f"{words} (all results)")
    add_json_option(parser)


def run_runs(options: argparse.Namespace) -> int:
    """Print the results, the newest first."""
    entries = Store().entries(" ".join(options.words))
    readable = [entry for entry in entries if not entry.fault]
    show_result(options, _describe_runs, _runs_text, readable)
    return 0


def _describe_runs(entries: Sequence[Entry]) -> dict[str, Any]:
    """The list as one document; parameters have a row a follower."""
    names = ("id", "created", "source", "sha256", "campaign", "window", "vehicles", "method",
             "preset", "case", "name", "note")  # fmt: skip
    return {
        "runs": [
            fields(entry, *names) | {"parameters": [by_key(row) for row in entry.parameters]}
            for entry in entries
        ]
    }


def _runs_text(entries: Sequence[Entry]) -> str:
    if not entries:
        return "No result is kept that has all of these words."
    first = zip(*(entry.parameters[0] for entry in entries), strict=True)
    columns = [
        (Column("Result"), [entry.id[:ID_DIGITS] for entry in entries]),
        (Column("Created"), [entry.created for entry in entries]),
        (Column("Recording"), [entry.source for entry in entries]),
        (Column("Window"), [entry.window for entry in entries]),
        (Column("Vehicles"), ["–".join(map(str, entry.numbers[::len(entry.numbers) - 1]))
                              for entry in entries]),
        (Column("Method"), [" ".join(filter(None, (entry.method, entry.preset)))
                            for entry in entries]),
        *((Column.of(quantity, "First follower"), values)
          for quantity, values in zip(PARAMETERS, first, strict=True)),
    ]  # fmt: skip
    return Table.of(f"Results: {len(entries)}", columns).to_text()
