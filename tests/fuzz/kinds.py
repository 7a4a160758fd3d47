"""Kinds of hostile input: how an example is drawn, and how it is used.

An example is one file, or a command line or recipe of a table as a JSON text. It is either refused
in the project's own error, or used.
"""

import io
import json
import os
import sqlite3
import zipfile
from collections.abc import Callable
from contextlib import (
    chdir,
    closing,
    nullcontext,
    redirect_stderr,
    redirect_stdout,
    suppress,
)
from csv import reader
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from random import Random
from tempfile import TemporaryDirectory
from typing import Any
from unittest.mock import patch

import numpy as np

from accpinn import cli
from accpinn.errors import AccpinnError, SegmentError
from accpinn.methods.registry import METHODS
from accpinn.recordings import Recording
from accpinn.recordings.files import opened, read, read_all
from accpinn.recordings.mapping import load_mapping
from accpinn.results.database import failure_table, group_table
from accpinn.results.documents import parameter_card
from accpinn.results.export import snapshot_types
from accpinn.results.messages import messages
from accpinn.results.messages import summary as words
from accpinn.results.report import render_report, tables_of
from accpinn.results.reproduction import verification_table
from accpinn.segment.cut import cut
from accpinn.segment.quality import assess_quality, label_regimes, rate
from accpinn.segment.windows import Information, suggest_window
from accpinn.serial import Arrays
from accpinn.study.groups import BY, group, read_study
from accpinn.study.plan import listing_of
from accpinn.study.rows import COLUMNS
from accpinn.study.snapshot import load, prepare_snapshot, to_bytes
from accpinn.study.snapshot_library import Library
from accpinn.study.store import Store
from accpinn.study.studies import FILE, Computed, KnownFile, read_failures, read_request, written
from accpinn.study.verification import PROMPT, verify
from tests.fuzz.mutations import TOKENS, spoil_bytes, spoil_table, spoil_tree, text
from tests.fuzz.tables import draw_table, use_table
from tests.recordings import test_mapping as mappings
from tests.recordings.test_limits import LONG
from tests.support.command import strict
from tests.support.openacc_files import csv, metadata, pair, platoon, table
from tests.support.samples import FOLDER
from tests.support.snapshots import (
    crowded,
    lying,
    members,
    resealed,
    result_for,
    small,
    small_bytes,
    two_windows,
    zipped,
)
from tests.support.studies import REQUEST, analysis

UPLOAD = 50_000_000
"""Bytes of the largest file that the app takes."""


@dataclass(frozen=True)
class Kind:
    """One way in."""

    name: str
    draw: Callable[[Random], bytes]
    """The content of a file."""
    use: Callable[[bytes, Path], bool]
    """Does with it what the app and the command line do, in an empty folder; whether anything came
    of it. A refusal may be an `AccpinnError`, too."""
    ending: str
    """Ending of the file's name."""
    examples: int = 0
    """How many of them are tried with all other tests; `make fuzz` goes on from there."""
    most_seconds: float = 5.0
    """Most processor time for one example, in s."""
    most_bytes: float = 1e9
    """Most memory that an example takes, in bytes."""


# Recordings


@cache
def recordings() -> tuple[tuple[bytes, int], ...]:
    """Sound files, each with the row of its column names.

    OpenACC files made for a test, the first rows of the samples and of real ones; two vehicles
    behind a leader as a table of pairs, and a part of it.
    """
    contents = [csv(platoon(samples=300)), csv(platoon(2, 200), metadata(("A", "B")), "\n")]
    files = sorted(FOLDER.glob("*.csv"))
    folder = os.environ.get("OPENACC_DIR", "")
    files += sorted(Path(folder).glob("*/*.csv"))[::3] if folder else []
    for file in files:
        with file.open("rb") as lines:
            contents.append(b"".join(line for line, _ in zip(lines, range(300), strict=False)))
    pairs = [pair(platoon(samples=200), k, f"t{k}").drop(columns="Extra") for k in (1, 2)]
    return (table(*pairs), 0), (table(pairs[0]), 0), *((data, 5) for data in contents)


def draw_recording(draw: Random) -> bytes:
    """A recording, or a table of several, spoilt as a table or as bytes, or both."""
    sound = recordings()
    data, header = draw.choice(sound[:2] if draw.random() < 0.2 else sound[2:])
    if draw.random() < 0.6:
        with suppress(UnicodeDecodeError):
            data = spoil_table(data, draw, header)
    return spoil_bytes(data, draw) if draw.random() < 0.4 else data


def use_recording(data: bytes, _: Path) -> bool:
    """Read all recordings of a file, and one by name, as page Data does."""
    try:
        runs = [run for run in read_all(data, "run.csv") if isinstance(run, Recording)]
    except AccpinnError as fault:
        if not str(fault).startswith("run.csv"):
            raise ValueError(f"The file is not named: {fault}") from fault
        raise
    for recording in runs[:3]:
        assert (np.diff(recording.time) > 0).all()
        assert not np.isinf(recording.speed).any()
        vehicles = len(recording.vehicles)
        assert vehicles == recording.speed.shape[1] == recording.gap.shape[1] + 1
        look_at(recording)
    if runs and runs[0].trajectory:
        read(data, "run.csv", trajectory=runs[0].trajectory.split(",")[0])
    return bool(runs)


def look_at(recording: Recording) -> None:
    """Everything that is shown of a recording before anyone asks."""
    messages(recording.findings, recording)
    with suppress(SegmentError):
        segment = cut(recording, 0.0, 300.0, allow_missing=True)
        messages(segment.findings, segment)
        quality = assess_quality(segment)
        messages(quality.findings, segment)
        rate(segment, recording, quality)
        whole = cut(recording, 0.0, recording.duration, allow_missing=True)
        information = Information.of(whole, label_regimes(whole, recording))
        suggest_window(recording, whole.vehicles, information)
        if not segment.blocks_missing:
            estimate = METHODS["least-squares"].fit(segment)
            messages(estimate.findings, segment)


MAPPING = json.loads(mappings.MAPPING) | {"trajectory": "Run"}


@cache
def mapped_table() -> bytes:
    """The table that mappings are tried on."""
    return mappings.foreign(platoon(2, 150)).assign(Run="a").to_csv(index=False).encode()


def draw_mapping(draw: Random) -> bytes:
    """A mapping, spoilt as a document or as bytes."""
    spare = ("modes", "trajectory")
    choices = {
        name: part for name, part in MAPPING.items() if name not in spare or draw.random() < 0.5
    }
    if draw.random() < 0.3:
        choices["sample_time"] = 0.1
        del choices["time"]
    data = json.dumps(spoil_tree(choices, draw), ensure_ascii=False).encode("utf-8", "replace")
    return spoil_bytes(data, draw) if draw.random() < 0.3 else data


def use_mapping(data: bytes, folder: Path) -> bool:
    """Read it, and a table by it."""
    (folder / "mapping.json").write_bytes(data)
    mapping = load_mapping(folder / "mapping.json")
    for recording in read_all(mapped_table(), "t.csv", mapping=mapping):
        if isinstance(recording, Recording):
            look_at(recording)
    trajectory = "a" if mapping.trajectory else None
    read(mapped_table(), "t.csv", mapping=mapping, trajectory=trajectory)
    return True


# Snapshots


@cache
def snapshots() -> tuple[bytes, ...]:
    """A small snapshot, one with all that needs no training, and one of several windows."""
    rows = tuple(result_for(small().segments[0], name) for name in ("least-squares", "recursive"))
    facts = {"campaign": "X", "date": "2024-01-01", "acc_flag": 1, "distance_setting": "min",
             "samples": 41, "duration": 20.0, "sample_time": 0.5}  # fmt: skip
    rich = replace(result_for(small().segments[0], "splines"), compared=rows, facts=facts)
    return small_bytes(), to_bytes(prepare_snapshot(rich)), to_bytes(two_windows())


def draw_snapshot(draw: Random) -> bytes:
    """A snapshot with bytes changed, or with document and arrays changed and sealed anew."""
    data = draw.choice(snapshots())
    if draw.random() < 0.2:
        return spoil_bytes(data, draw)
    if draw.random() < 0.1:
        parts = members(data)
        name = draw.choice(sorted(parts))
        return zipped(parts | {name: spoil_bytes(parts[name], draw)})

    def spoil(tree: dict[str, Any], arrays: Arrays) -> None:
        for _ in range(draw.choice((1, 1, 2))):
            if draw.random() < 0.3:
                spoil_arrays(arrays, draw)
                continue
            spoilt = spoil_tree(tree, draw)
            if isinstance(spoilt, dict):
                tree.clear()
                tree.update(spoilt)

    return resealed(spoil, data)


def spoil_arrays(arrays: Arrays, draw: Random) -> None:
    """Change numbers, or the shape, of one of the arrays."""
    name = draw.choice(sorted(arrays))
    values = np.array(arrays[name])
    at, kind = draw.randrange(max(1, values.size)), draw.randrange(5)
    if kind == 0:
        values = values[:at]
    elif kind == 1:
        with np.errstate(over="ignore"):
            values = values * draw.choice((0, -1, 0.5, 1e6, 1e30))
    elif kind == 2:
        values = values.T
    elif values.size and values.dtype.kind == "f":
        values.flat[at] = draw.choice((np.nan, np.inf, -np.inf, 0.0, -1.0, 1e30, 1e-300, 1e300))
    elif values.size:
        values.flat[at] = not values.flat[at]
    arrays[name] = values


def use_snapshot(data: bytes, _: Path) -> bool:
    """Open it, check it, and make of it what the app and the command line make."""
    snapshot = load(data)
    checked = verify(snapshot, refit_within=PROMPT)
    assert checked.sentence
    assert verification_table(checked).to_text()
    if len(data) % 16 == 0:  # it takes most of a second
        render_report(snapshot, checked)
    words.title(snapshot), words.summary(snapshot), words.about_data(snapshot)
    words.cautions(snapshot)
    for rows in tables_of(snapshot).values():
        rows.to_text(), rows.to_csv(), rows.to_latex(), rows.to_html()
    with suppress(AccpinnError):
        parameter_card(snapshot)
        snapshot_types(snapshot, 5)
    return True


# Archives

METHODS_OF_ZIP = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED, zipfile.ZIP_DEFLATED, zipfile.ZIP_BZIP2)
SIZES = (0, 1, 1000, 10**6, 2**32 - 1)


def draw_archive(draw: Random) -> bytes:
    """A zip file of a snapshot or a recording, with members, sizes or entries that are not true."""
    table = recordings()[2][0]
    content = draw.choice(
        (members(small_bytes()), {"run.csv": table}, {"xl/workbook.xml": b"<a/>"})
    )
    name = draw.choice(sorted(content))
    kind = draw.randrange(6)
    if kind == 0:
        return crowded(draw.choice((3, 20_000, 300_000)))
    if kind == 1:
        content = content | {draw.choice(("run.exe", "../a.csv", "a.csv", "é.npy")): table}
    if kind in (2, 3):
        content = content | {name: bytes(draw.choice((1000, 10**6, 150_000_000)))}
    data = zipped(content, draw.choice(METHODS_OF_ZIP))
    return lying(data, name, draw.choice(SIZES)) if kind in (3, 4) else data


def use_archive(data: bytes, _: Path) -> bool:
    """Open it as a snapshot and as a recording."""
    used = False
    with suppress(AccpinnError):
        used = bool(load(data))
    with suppress(AccpinnError):
        used |= any(isinstance(run, Recording) for run in read_all(data, "a.zip"))
    return used


# Folders and faults of the machine


def draw_names(draw: Random) -> bytes:
    """Names of files, of any bytes that a name may have, and which are links out of the folder."""
    letters = b"ab=@-+. \n'\"" + draw.choice((b"", b"\xff\xfe\xc3"))
    names = [
        bytes(draw.choice(letters) for _ in range(draw.randrange(1, 8))).hex() for _ in range(4)
    ]
    return json.dumps([(name, draw.random() < 0.15) for name in {*names}]).encode()


def use_names(data: bytes, folder: Path) -> bool:
    """List them for a batch, keep what is left out, and print it; whether all were taken."""
    (folder / "runs").mkdir()
    (folder / "outside").write_bytes(b"a")
    for name, is_link in json.loads(data):
        path = Path(os.fsdecode(bytes(folder / "runs") + b"/" + bytes.fromhex(name) + b".csv"))
        if is_link:
            path.symlink_to(folder / "outside")
        else:
            path.write_bytes(b"a")
    listing = listing_of(folder / "runs")
    with written(folder / "study", REQUEST) as study:
        for path, reason in listing.refused.items():
            study.refuse(path, [reason])
        for path in listing.files:
            study.refuse(path, ["it is no recording"])
    failure_table(read_failures(folder / "study")).to_csv().encode()
    with (folder / "study" / "failures.csv").open(newline="", encoding="utf-8") as file:
        cells = [cell for row in reader(file) for cell in row]
    assert not any(cell.lstrip().startswith(("=", "@", "+", "-")) for cell in cells)
    return not listing.refused


FAULTS_OF_DISK = (
    "SQLITE_FULL",
    "SQLITE_BUSY",
    "SQLITE_CANTOPEN",
    "SQLITE_IOERR",
    "SQLITE_READONLY",
)


def draw_faults(draw: Random) -> bytes:
    """Requests to the store, each with a fault of the machine or without."""
    requests = [draw.choice(("keep", "list", "session", "owner")) for _ in range(5)]
    faults = FAULTS_OF_DISK if draw.random() < 0.7 else (None,)
    return json.dumps([(request, draw.choice((None, *faults))) for request in requests]).encode()


def use_faults(data: bytes, folder: Path) -> bool:
    """Ask for it all; afterwards nothing of what was kept before is gone. Whether no fault came."""
    store, library = Store(folder), Library(folder)
    store.keep_session("ann", b"open")
    name = library.add(small_bytes(), "ann")
    requests = json.loads(data)
    actions: dict[str, Callable[[], object]] = {
        "keep": lambda: store.keep_session("bob", b"too"), "list": library.entries,
        "session": lambda: store.session("ann"), "owner": lambda: library.owner(name),
    }  # fmt: skip
    for action, fault in requests:
        error = sqlite3.OperationalError("a fault of the machine")
        error.sqlite_errorcode = getattr(sqlite3, fault or "SQLITE_FULL")
        with patch("sqlite3.connect", side_effect=error) if fault else nullcontext():
            actions[action]()
    assert (store.session("ann"), library.owner(name)) == (b"open", "ann")
    assert [entry.id for entry in library.entries()] == [name]
    assert not [*folder.glob("*damaged*")]
    return not any(fault for _, fault in requests)


# Studies


@cache
def study_file() -> bytes:
    """The SQLite file that a batch of three windows leaves."""
    sample = {"string": "a", "bool": True, "int64": 2, "double": 0.2}
    cells = {column.name: sample[column.kind] for column in COLUMNS}
    cells |= {"method": "pinn", "p_l2_stable": 0.3}
    with TemporaryDirectory() as name:
        folder = Path(name)
        with written(folder, REQUEST) as study:
            for k in range(3):
                rows = [cells | {"start": 300.0 * k}]
                study.add("a.csv", Computed(analysis(300.0 * k), rows))
            study.add_file("r", KnownFile(None, 1, 0, (analysis(),)))
            study.refuse(Path("b.csv"), ["no reason"])
        return (folder / FILE).read_bytes()


def draw_study(draw: Random) -> bytes:
    """The SQLite file of a study with a cell forged, or with bytes spoilt."""
    data = study_file()
    if draw.random() < 0.6:
        with closing(sqlite3.connect(":memory:")) as database:
            database.deserialize(data)
            table, column = draw.choice(
                (("answers", "rows"), ("request", "document"), ("files", "document"),
                 ("answers", "file"), ("refused", "reason"), ("answers", "start"))
            )  # fmt: skip
            (cell,) = database.execute(f"select {column} from {table}").fetchone()
            forged: Any = draw.choice((None, 1, -1e300, b"\xff\0", draw.choice(TOKENS)))
            if column in ("rows", "document") and draw.random() < 0.8:
                forged = json.dumps(spoil_tree(json.loads(cell), draw), ensure_ascii=False)
            forged = forged.encode("utf-8", "replace") if isinstance(forged, str) else forged
            database.execute(
                f"update {table} set {column} = cast(? as text) where rowid = 1", (forged,)
            )
            database.commit()
            data = database.serialize()
    if draw.random() < 0.4:
        data = spoil_bytes(data, draw)
    return data


def use_study(data: bytes, folder: Path) -> bool:
    """Group its rows, print all tables, and go on with it."""
    (folder / FILE).write_bytes(data)
    table = group_table(group(read_study(folder), BY))
    table.to_text(), table.to_csv(), table.to_latex()
    failure_table(read_failures(folder)).to_text()
    read_request(folder)
    with written(folder, REQUEST) as study:
        study.known_file("r"), study.rows_of(analysis())
        return True


# Command lines

HARMLESS = {
    "compare": ["--methods", "least-squares"],
    "fit": ["--method", "least-squares", "--no-cache"],
    "starts": ["missing.csv"],
    "batch": ["missing.csv"],
    "judge": ["missing.csv"],
    "dataset": ["missing.csv"],
    "download": ["--list"],
}
"""Put at the end, so that no example trains, starts workers or asks the network."""


@cache
def options_of(command: str) -> tuple[str, ...]:
    """The options that a command declares."""
    parser = cli._parser([command])
    (choices,) = (a.choices for a in parser._actions if a.choices and command in a.choices)
    return tuple(name for action in choices[command]._actions for name in action.option_strings)


def draw_arguments(draw: Random) -> bytes:
    """A command line: a command, some of its options, values sound and odd."""
    command = draw.choice((*cli.COMMANDS, *cli.COMMANDS, text(draw)))
    values = (*TOKENS, "run.csv", "run.csv", "good.accpinn.zip", "good.accpinn.zip", "mapping.json",
              "missing.csv", "folder", "out.html", "0", "10", "30", "0.1", "-1", "1-2", "1,2",
              "II", "0-10,10-20", "all", "least-squares", "make,model")  # fmt: skip
    words = [command]
    if draw.random() < 0.7:
        words.append(draw.choice(("run.csv", "good.accpinn.zip", "folder", "missing.csv")))
    for _ in range(draw.randrange(5)):
        if command in cli.COMMANDS and draw.random() < 0.7:
            words.append(draw.choice(options_of(command)))
        words.append(draw.choice(values))
    words += HARMLESS.get(command, [])
    if draw.random() < 0.3:
        words.append("--json")
    return json.dumps([word for word in words if "\0" not in word]).encode()


def use_arguments(data: bytes, folder: Path) -> bool:
    """Run the command in a folder with sound files; one line says what is wrong."""
    given = json.loads(data)
    (folder / "run.csv").write_bytes(recordings()[2][0])
    (folder / "good.accpinn.zip").write_bytes(small_bytes())
    (folder / "mapping.json").write_text(json.dumps(MAPPING))
    (folder / "folder").mkdir()
    out, err = io.StringIO(), io.StringIO()
    with chdir(folder), redirect_stdout(out), redirect_stderr(err):
        try:
            status = cli.main(given)
        except SystemExit as end:
            status = int(end.code or 0)
    errors = [line for line in err.getvalue().splitlines() if line.startswith("error: ")]
    assert status in (0, 1, 2), status
    assert len(errors) == (1 if status else 0), err.getvalue()
    assert "Traceback" not in err.getvalue(), err.getvalue()
    if status == 0 and "--json" in given and not {"-h", "--help", "--version"} & set(given):
        strict(out.getvalue())
    return status == 0


# Large files

HEADS = (b"", b"a,b\n", b"Time,", b"id,t,v,g,lead\n")
"""Beside the first rows of sound files."""
ROWS = (
    b"1,", b"\n", b"\r", b",", b'"', b"\0", b"a", b"[", b'"a\n', b"9", b"1\n", b"1,2\n", b",\n",
    b",,,,,,,\n", b"Speed1,", b"Speed%d,", b"%d.0,20.1,20.1,20.1,30.1,30.1\n",
    b"%d.x,20.1,20.1,20.1,30.1,30.1\n", b"t1,%d.0,1,0,20.1,1.2,20.1,30.1\n",
    b"t%d,0.1,1,0,20.1,1.2,20.1,30.1\n", b"%d,1,20,30,2\n", b"1,%d,20,30,2\n", b"\x01",
)  # fmt: skip
"""Repeated without end, with a number that counts them."""


def draw_large(draw: Random) -> bytes:
    """A file up to the upload limit: a head, and one row again and again."""
    sound = [data.split(b"\n") for data, _ in recordings()[:4]]
    starts = [b"\n".join(lines[:rows]) + b"\n" for lines in sound for rows in (1, 6)]
    head, row = draw.choice((*HEADS, *starts)), draw.choice(ROWS)
    count = draw.choice((UPLOAD, UPLOAD, UPLOAD // 5)) // len(row)
    many = b"".join(row % k for k in range(count)) if b"%d" in row else row * count
    content = (head + many)[:UPLOAD]
    return content if draw.random() < 0.3 else content.rpartition(b"\n")[0] + b"\n"


def use_large(content: bytes, folder: Path) -> bool:
    """Read it as a recording, as a mapping and as a snapshot."""
    (folder / "large").write_bytes(content)
    with suppress(AccpinnError):
        load(folder / "large")
    with suppress(AccpinnError):
        load_mapping(folder / "large")
    with suppress(AccpinnError):
        _ = opened(content, "large.csv", LONG).runs
    return bool(next(run for run in read_all(content, "large.csv")))


KINDS = {
    kind.name: kind
    for kind in (
        Kind("recording", draw_recording, use_recording, ".csv", 80),
        Kind("table", draw_table, use_table, ".json", 80),
        Kind("mapping", draw_mapping, use_mapping, ".json", 40),
        Kind("snapshot", draw_snapshot, use_snapshot, ".accpinn.zip", 20),
        Kind("study", draw_study, use_study, ".sqlite", 30),
        Kind("arguments", draw_arguments, use_arguments, ".json", 20, 20.0),  # some estimate
        Kind("archive", draw_archive, use_archive, ".zip", 20, 3.0, 400e6),
        Kind("names", draw_names, use_names, ".json", 10),
        Kind("faults", draw_faults, use_faults, ".json", 12),
        Kind("large", draw_large, use_large, ".csv"),
    )
}
