"""`export`: the parameters of a snapshot as a file for SUMO, and as a parameter card."""

import argparse
from pathlib import Path

from accpinn.cli.output import print_json, show
from accpinn.cli.recording import add_json_option
from accpinn.errors import ConfigError
from accpinn.results.export import SAMPLES, parameter_card, snapshot_types
from accpinn.results.snapshot.archive import load
from accpinn.results.snapshot.saved import writable_path, write_whole

KIND = "file for SUMO"


def add_export_options(parser: argparse.ArgumentParser) -> None:
    """Declare the options of `export`."""
    parser.add_argument("file", metavar="SNAPSHOT", help="a snapshot (.accpinn.zip)")
    parser.add_argument(
        "--sumo",
        metavar="XML",
        help="write vehicle types for SUMO's car-following model ACC, one a follower, and a"
        " distribution over samples of the posterior",
    )
    parser.add_argument(
        "--samples", type=int, default=SAMPLES, metavar="N", help=f"in it; 0 for none ({SAMPLES})"
    )
    add_json_option(parser)
    card = "With --json: a parameter card, with intervals, provenance and attribution."
    parser.epilog = f"{card}\n\n{parser.epilog}"


def run_export(options: argparse.Namespace) -> int:
    """Write what was asked for; say where, or print the card."""
    if not options.sumo and not options.json:
        raise ConfigError("export: give --sumo FILE.xml, --json or both.")
    place = writable_path(Path(options.sumo), KIND) if options.sumo else None
    snapshot = load(options.file)
    if place:
        write_whole(snapshot_types(snapshot, options.samples).encode(), place, KIND)
    if options.json:
        print_json(parameter_card(snapshot))
    else:
        show(str(options.sumo))
    return 0
