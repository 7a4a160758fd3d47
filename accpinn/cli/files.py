"""`verify`, `report` and `export`: what the file of a snapshot holds."""

import argparse
from dataclasses import replace
from pathlib import Path
from typing import Any

from accpinn.cli.options import add_refit_options, chosen_patience
from accpinn.cli.output import complain, print_json, progress, show, show_result
from accpinn.cli.recording import add_json_option
from accpinn.errors import ConfigError, SnapshotError
from accpinn.recordings.files import read
from accpinn.recordings.recording import Recording
from accpinn.results.export import SAMPLES, parameter_card, snapshot_types
from accpinn.results.messages.snapshot import (
    WAYS,
    check_rows,
    refitting,
    rests_on,
    standing_rows,
    unchecked_sentence,
    verification_summary,
)
from accpinn.results.snapshot import SUFFIX, Snapshot
from accpinn.results.snapshot.archive import load
from accpinn.results.snapshot.saved import writable_path, write_whole
from accpinn.results.snapshot.verification import PATIENCE, PROMPT, Verification, recover, verify
from accpinn.results.tables.table import Column, Table
from accpinn.units import Seconds


def add_verify_options(parser: argparse.ArgumentParser) -> None:
    """Declare the options of `verify`."""
    _add_snapshot(
        parser, "run the methods again and check the errors where it has no data", PATIENCE
    )
    add_json_option(parser)


def _add_snapshot(parser: argparse.ArgumentParser, use: str, usual: Seconds) -> None:
    parser.add_argument("file", metavar="FILE", help="a snapshot (.accpinn.zip)")
    parser.add_argument("--recording", metavar="CSV", help=use)
    parser.add_argument(
        "--trajectory", metavar="ID", help="which one of a recording's table that holds several"
    )
    add_refit_options(parser, usual)


def _data_of(options: argparse.Namespace) -> Recording | None:
    """The recording that the options name, if they name one."""
    if not options.recording:
        return None
    return read(options.recording, trajectory=options.trajectory)


def run_verify(options: argparse.Namespace) -> int:
    """Check, and print stored beside recomputed.

    Raises:
        SnapshotError: when something does not match.
    """
    snapshot = load(options.file)
    recording = _data_of(options)
    result = verify(
        snapshot,
        recording,
        refit_within=chosen_patience(options, PATIENCE),
        on_refit=lambda name, seconds: progress(refitting(name, seconds)),
    )
    show_result(options, _describe_verification, _verification_text, snapshot, result)
    if not result.ok:
        raise SnapshotError(f"{options.file}: {verification_summary(result, snapshot.info)}")
    return 0


def _describe_verification(snapshot: Snapshot, result: Verification) -> dict[str, Any]:
    """The verification as the command-line contract has it."""
    return {
        "id": snapshot.id,
        "name": snapshot.name,
        "created": snapshot.created,
        "ok": result.ok,
        "sentence": verification_summary(result, snapshot.info),
        "rests_on": rests_on(result),
        "figures": [row._asdict() for row in standing_rows(result.standings)],
        "checks": [row._asdict() for row in check_rows(result, snapshot.info)],
        "not_checked": [
            {
                "what": unchecked_sentence(one, snapshot.info),
                "cure": one.cure,
                "seconds": one.seconds,
            }
            for one in result.unchecked
        ],
    }


def _verification_text(snapshot: Snapshot, result: Verification) -> str:
    info = snapshot.info
    about = [
        snapshot.name,
        f"{info.source}, {info.window}, {snapshot.fit.method}",
        snapshot.created,
    ]
    checks = check_rows(result, info)
    cells = tuple(
        (c.name, WAYS[c.way], "yes" if c.ok else "NO", c.stored, c.recomputed) for c in checks
    )
    titles = ("What", "How", "Agrees", "Stored", "Found now")
    table = Table("", tuple(map(Column, titles)), cells)
    said = [f"{row.name}: {row.sentence}" for row in checks if not row.ok]
    if not said:
        options = dict.fromkeys(one.cure for one in result.unchecked if one.cure)
        more = [f"More is checked with {' and '.join(options)}."] if options else []
        said = [verification_summary(result, info), *more]
    return "\n".join([", ".join(filter(None, about)), "", table.to_text(), "", *said])


def add_report_options(parser: argparse.ArgumentParser) -> None:
    """Declare the options of `report`."""
    _add_snapshot(parser, "draw its data too, where they are not in the snapshot", PROMPT)
    parser.add_argument("-o", "--out", metavar="HTML", help="where to (beside the snapshot)")


def run_report(options: argparse.Namespace) -> int:
    """Write the page, and say where; 1 when the snapshot does not agree with itself."""
    from accpinn.results.report import render_report  # plotly's script is read from disk

    beside = options.file.removesuffix(SUFFIX) + ".html"
    place = Path(beside if options.out is None else options.out)
    real = writable_path(place, "report")
    snapshot = load(options.file)
    recording = _data_of(options)
    checked = verify(snapshot, recording, refit_within=chosen_patience(options, PROMPT))
    if recording and snapshot.segment is None:
        snapshot = replace(snapshot, segment=recover(snapshot, recording).segment)
    page = render_report(snapshot, checked)
    write_whole(page.encode(), real, "report")
    show(str(place))
    if checked.ok:
        progress(rests_on(checked))
        return 0
    said = verification_summary(checked, snapshot.info)
    complain(
        f"what the snapshot says does not follow from its contents. {said} The report was written,"
        " with a warning at its top."
    )
    return 1


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
    if options.sumo is None and not options.json:
        raise ConfigError("export: give --sumo FILE.xml, --json or both.")
    asked = options.sumo is not None
    place = writable_path(Path(options.sumo), "file for SUMO") if asked else None
    snapshot = load(options.file)
    if place:
        write_whole(snapshot_types(snapshot, options.samples).encode(), place, "file for SUMO")
    if options.json:
        print_json(parameter_card(snapshot))
    else:
        show(str(options.sumo))
    return 0
