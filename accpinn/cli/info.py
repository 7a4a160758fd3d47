"""`info FILE`: what a recording holds and what to know about it."""

import argparse
from dataclasses import asdict
from typing import Any

import msgspec

from accpinn.cli.output import print_json, show
from accpinn.recordings.openacc import read
from accpinn.recordings.recording import Recording
from accpinn.results.messages import messages
from accpinn.results.tables.table import Column, Table


def add_options(parser: argparse.ArgumentParser) -> None:
    """Declare the command's options."""
    parser.add_argument("file", metavar="FILE", help="an OpenACC recording (CSV)")
    parser.add_argument("--json", action="store_true", help="one JSON document")
    parser.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Print it."""
    recording = read(options.file)
    if options.json:
        print_json(describe(recording))
    else:
        show(_text(recording))
    return 0


def describe(recording: Recording) -> dict[str, Any]:
    """The recording as the command-line contract has it."""
    return {
        "source": recording.source,
        "sha256": recording.sha256,
        "campaign": recording.campaign,
        "date": recording.date.isoformat() if recording.date else None,
        "acc_flag": recording.acc_flag,
        "distance_setting": recording.distance_setting,
        "samples": recording.samples,
        "duration": recording.duration,
        "sample_time": recording.sample_time,
        "vehicles": [asdict(vehicle) for vehicle in recording.vehicles],
        "warnings": messages(recording.findings, recording),
        "findings": msgspec.to_builtins(recording.findings),
    }


def _text(recording: Recording) -> str:
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
