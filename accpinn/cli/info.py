"""`info FILE`: what a recording holds and what to know about it."""

import argparse
from typing import Any

from accpinn.cli.output import print_json, show, table
from accpinn.recordings.openacc import read
from accpinn.recordings.recording import Recording


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
        "vehicles": [
            {
                "index": vehicle.index,
                "name": vehicle.name,
                "present": vehicle.present,
                "missing": vehicle.missing,
                "missing_share": vehicle.missing_share,
                "modes": vehicle.modes,
            }
            for vehicle in recording.vehicles
        ],
        "warnings": list(recording.warnings),
    }


def _text(recording: Recording) -> str:
    rows = []
    for vehicle in recording.vehicles:
        modes = vehicle.modes or {}
        rows.append(
            [
                f"{vehicle.index} {vehicle.name}",
                "yes" if vehicle.present else "no",
                f"{100 * vehicle.missing_share:.0f} %",
                ", ".join(f"{name} {count}" for name, count in modes.items()) or "not said",
            ]
        )
    about = (
        f"{recording.source}: {recording.campaign or 'campaign unknown'},"
        f" {recording.date or 'date unknown'}, {recording.duration:g} s in"
        f" {recording.samples} samples of {recording.sample_time:g} s"
    )
    lines = [about, "", table(["vehicle", "present", "missing", "driver"], rows)]
    lines += ["", *(f"Note: {warning}" for warning in recording.warnings)]
    return "\n".join(lines).rstrip()
