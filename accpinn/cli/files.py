"""`verify`, `report`, `export` and `runs`: snapshots, and the results in the cache."""

import argparse
from collections.abc import Sequence, Set
from pathlib import Path
from typing import Any

from accpinn.channels import PARAMETERS, by_key, fields
from accpinn.cli.output import note, print_error, print_json, progress, show, show_result
from accpinn.cli.recordings import JSON, Option, option
from accpinn.errors import ConfigError, RecordingError, SnapshotError
from accpinn.recordings import Recording
from accpinn.recordings.files import read
from accpinn.results.documents import parameter_card
from accpinn.results.export import SAMPLES, snapshot_types
from accpinn.results.reproduction import verification_table
from accpinn.results.tables import Column, Table
from accpinn.study.result import Result
from accpinn.study.snapshot import SUFFIX, load, writable_path, write_file
from accpinn.study.store import Entry, Store
from accpinn.study.vehicles import where
from accpinn.study.verification import HOWEVER_LONG, PATIENCE, PROMPT, Verification, verify
from accpinn.units import Seconds

ID_DIGITS = 12
"""Digits of a result's key that the table shows."""


def _of_snapshot(use: str, usual: Seconds) -> tuple[Option, ...]:
    """The options of a snapshot that is checked, with the ``use`` of a recording."""
    refit = f"run the methods again however long that takes (else those of up to {usual:g} s)"

    def add_patience(parser: argparse.ArgumentParser) -> None:
        which = parser.add_mutually_exclusive_group()
        which.add_argument("--refit", action="store_true", help=refit)
        which.add_argument("--quick", action="store_true", help="run no method again")

    return (
        option("file", metavar="FILE", help="a snapshot (.accpinn.zip)"),
        option("--recording", metavar="CSV", help=use),
        option("--trajectory", metavar="ID",
               help="which one of a recording's table that holds several"),
        add_patience,
    )  # fmt: skip


VERIFY_OPTIONS = (
    *_of_snapshot("compare its data, too", PATIENCE),
    JSON,
)
REPORT_OPTIONS = (
    *_of_snapshot("compare its data, and simulate outside its windows", PROMPT),
    option("--no-curves", dest="curves", action="store_false",
           help="neither measured nor fitted series, from which the data could be read again"),
    option("-o", "--out", metavar="HTML", help="the page to write (beside the snapshot)"),
)  # fmt: skip
EXPORT_HELP = "With --json: a parameter card, with intervals, provenance and attribution."
EXPORT_OPTIONS = (
    option("file", metavar="SNAPSHOT", help="a snapshot (.accpinn.zip)"),
    option("--sumo", metavar="XML",
           help="write vehicle types for SUMO's model ACC or IDM, one a follower, and a"
           " distribution over samples of the posterior"),
    option("--samples", type=int, default=SAMPLES, metavar="N",
           help=f"samples in that distribution; 0 for none ({SAMPLES})"),
    JSON,
)  # fmt: skip
RUNS_OPTIONS = (
    option("words", nargs="*", metavar="WORDS",
           help="each must stand in recording, vehicles, window, method, preset, name, note or"
           " date (all results)"),
    JSON,
)  # fmt: skip


def _patience(options: argparse.Namespace, usual: Seconds) -> Seconds:
    """Longest time, in s, that running the methods of a snapshot again may take."""
    return HOWEVER_LONG if options.refit else 0.0 if options.quick else usual


def _data_of(options: argparse.Namespace, snapshot: Result) -> Recording | None:
    """The recording that the options name, read by the mapping of the snapshot; None without."""
    if not options.recording:
        if options.trajectory is not None:
            raise ConfigError("trajectory: it is of a --recording; give both, or neither.")
        return None
    source = snapshot.analysis.source
    return read(
        options.recording,
        trajectory=options.trajectory or source.trajectory,
        mapping=source.mapping,
    )


def run_verify(options: argparse.Namespace) -> int:
    """Check a snapshot, and print stored numbers beside those computed again.

    Raises:
        SnapshotError: when something does not match.
    """
    snapshot = load(options.file)
    verification = verify(
        snapshot,
        _data_of(options, snapshot),
        refit_within=_patience(options, PATIENCE),
        on_refit=lambda name, seconds: progress(f"Running {name} again, about {seconds:.0f} s …"),
    )
    given = {"--recording"} if options.recording else set[str]()
    show_result(
        options,
        lambda: _describe_verification(snapshot, verification),
        lambda: _verification_text(snapshot, verification, given),
    )
    if verification.ok is False:
        raise SnapshotError(f"{options.file}: {verification.sentence}")
    return 0


def _describe_verification(snapshot: Result, verification: Verification) -> dict[str, Any]:
    """The verification as the command-line contract has it."""
    return {
        **fields(snapshot, "id", "name", "created"),
        **fields(verification, "ok", "sentence"),
        "checks": [
            {"name": check.title, "sentence": check.sentence}
            | {"ok": None if check.state == "not checked" else check.ok}
            | fields(check, "part", "state", "numbers", "differing", "stored", "computed", "cure")
            for check in verification.checks
        ],
        "not_checked": [
            {"what": check.title, "cure": check.cure, "seconds": check.seconds}
            for check in verification.unchecked
        ],
    }


def _verification_text(snapshot: Result, verification: Verification, given: Set[str]) -> str:
    place = where(snapshot.info, windows=snapshot.infos)
    about = [snapshot.name, f"{place}, {snapshot.estimate.method}", snapshot.created]
    cures = {check.cure: None for check in verification.unchecked if check.cure}
    options = [cure for cure in cures if cure not in given]
    more = [f"More is checked with {' and '.join(options)}."] if options else []
    table = verification_table(verification).to_text()
    return "\n".join([", ".join(filter(None, about)), "", table, "", verification.mark, *more])


def run_report(options: argparse.Namespace) -> int:
    """Write the page, and print its path; 1 when the snapshot contradicts its contents."""
    from accpinn.results.report import render_report  # plotly's script is read from disk

    beside = options.file.removesuffix(SUFFIX) + ".html"
    place = Path(beside if options.out is None else options.out)
    real = writable_path(place, "report")
    snapshot = load(options.file)
    recording = _data_of(options, snapshot)
    if recording and recording.sha256 != snapshot.info.sha256:
        raise RecordingError(
            f"{options.recording}: not the recording of this snapshot; give"
            f" {snapshot.info.source}, whose SHA-256 begins with {snapshot.info.sha256[:8]}."
        )
    checked = verify(snapshot, recording, refit_within=_patience(options, PROMPT))
    page = render_report(snapshot.found_in(recording), checked, with_curves=options.curves)
    write_file(page.encode(), real, "report")
    show(str(place))
    if checked.ok is not False:
        note(checked.sentence)
        return 0
    print_error(
        f"what the snapshot says does not follow from its contents. {checked.sentence} The report"
        " was written, with a warning at its top."
    )
    return 1


def run_export(options: argparse.Namespace) -> int:
    """Write vehicle types for SUMO and print their path, or print the parameter card."""
    if options.sumo is None and not options.json:
        raise ConfigError("export: give --sumo FILE.xml, --json or both.")
    place = None if options.sumo is None else writable_path(Path(options.sumo), "file for SUMO")
    snapshot = load(options.file)
    if place:
        content = snapshot_types(snapshot, options.samples).encode()
        write_file(content, place, "file for SUMO")
    if options.json:
        print_json(parameter_card(snapshot))
    else:
        show(str(options.sumo))
    return 0


def run_runs(options: argparse.Namespace) -> int:
    """Print the results, the newest first."""
    entries = Store().entries(" ".join(options.words))
    readable = [entry for entry in entries if not entry.fault]
    names = ("id", "created", "source", "sha256", "campaign", "window", "vehicles", "method",
             "preset", "case", "name", "note")  # fmt: skip
    rows = [
        fields(entry, *names) | {"parameters": [by_key(row) for row in entry.parameters]}
        for entry in readable  # parameters have a row a follower
    ]
    show_result(options, lambda: {"runs": rows}, lambda: _runs_text(readable))
    return 0


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
