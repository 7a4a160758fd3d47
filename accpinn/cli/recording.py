"""The options that name a recording, and `info`, which says what it holds.

`info` is asked of one file after the other: nothing here imports what estimates.
"""

import argparse
from dataclasses import asdict
from typing import Any

import msgspec

from accpinn.cli.output import show_result
from accpinn.recordings.files import read
from accpinn.recordings.mapping import load_mapping
from accpinn.recordings.recording import Recording, facts_of
from accpinn.results.messages import messages
from accpinn.results.tables.table import Column, Table


def add_recording(parser: argparse.ArgumentParser) -> None:
    """Declare the file of a recording, and what of it to take."""
    parser.add_argument("file", metavar="FILE", help="an OpenACC run or a table of pairs (CSV)")
    parser.add_argument(
        "--trajectory", metavar="ID", help="which one of a table that holds several"
    )
    parser.add_argument(
        "--mapping",
        metavar="JSON",
        help="columns, units and sample time of any other table; remembered for its like",
    )


def chosen_recording(options: argparse.Namespace) -> Recording:
    """The recording that the options name."""
    mapping = load_mapping(options.mapping) if options.mapping else None
    return read(options.file, trajectory=options.trajectory, mapping=mapping)


def add_json_option(parser: argparse.ArgumentParser) -> None:
    """Declare that the result may be asked for as a document."""
    parser.add_argument("--json", action="store_true", help="one JSON document")


def add_info_options(parser: argparse.ArgumentParser) -> None:
    """Declare the options of `info`."""
    add_recording(parser)
    add_json_option(parser)


def run_info(options: argparse.Namespace) -> int:
    """Print what a recording holds, and what to know about it."""
    show_result(options, _describe_recording, _recording_text, chosen_recording(options))
    return 0


def _describe_recording(recording: Recording) -> dict[str, Any]:
    """The recording as the command-line contract has it."""
    return {
        "source": recording.source,
        "sha256": recording.sha256,
        **facts_of(recording),
        "vehicles": [asdict(vehicle) for vehicle in recording.vehicles],
        "warnings": messages(recording.findings, recording),
        "findings": msgspec.to_builtins(recording.findings),
    }


def _recording_text(recording: Recording) -> str:
    vehicles = recording.vehicles
    modes = [", ".join(f"{name} {n}" for name, n in (v.modes or {}).items()) for v in vehicles]
    table = Table.of(
        f"{recording.source}: {recording.campaign or 'campaign unknown'},"
        f" {recording.date or 'date unknown'}, {recording.duration:g} s in"
        f" {recording.samples} samples of {recording.sample_time:g} s",
        [
            (Column("Vehicle"), [recording.label(vehicle.index) for vehicle in vehicles]),
            (Column("Present"), ["yes" if vehicle.present else "no" for vehicle in vehicles]),
            (Column("Missing", "%", 0), [100 * vehicle.missing_share for vehicle in vehicles]),
            (Column("Driver mode"), [mode or "not recorded" for mode in modes]),
        ],
    )
    notes = [f"Note: {warning}" for warning in messages(recording.findings, recording)]
    return "\n".join([table.to_text(), "", *notes]).rstrip()
