"""The OpenACC database: the runs it publishes, and how a file becomes a `Recording`.

Five metadata rows, a row of column names, then one row every 0.1 s, all in SI units. Columns are
chosen by name, as their set and order vary between campaigns: Time, Speed<i>, IVS<i> (space-gap
between vehicles i and i+1), Driver<i>. Positions are not read. A file that cannot be read ends in
one clear sentence.

Data format: Makridis et al., Transportation Research Part C 125, 2021, 103047.
"""

import re
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import date
from functools import cache
from pathlib import Path

import numpy as np

from accpinn.channels import DRIVER, GAP, MAX_VEHICLES, METADATA, SPEED, TIME, Quantity
from accpinn.errors import ConfigError, RecordingError
from accpinn.findings import Finding, Labelled, Words
from accpinn.recordings import Mode, Recording
from accpinn.recordings.sampling import recording_of
from accpinn.recordings.source import Source, SourceFile, excerpt, read_bytes
from accpinn.recordings.table_layout import HEADER_BYTES, Layout, cells_of
from accpinn.recordings.tables import Columns, read_columns
from accpinn.storage import packaged_rows
from accpinn.units import FloatArray

PUBLISHED_AT = "https://jeodpp.jrc.ec.europa.eu/ftp/jrc-opendata/TransportExpData/JRCDBT0001/LATEST"
_PARTS = re.compile(r"\s*([^()_]+?)\s*(?:\(([^()]*)\)|_(.+))\s*")
"""Make and model apart, as "Audi(A8)" and "AUDI_A8"."""


@dataclass(frozen=True)
class Run:
    """A published file."""

    campaign: str
    """Campaign, which is also the name of its folder."""
    file: str
    sha256: str | None
    """SHA-256 of its bytes; None where it is not known."""

    @property
    def key(self) -> str:
        """The folder and file, as "Casale/part7.csv"."""
        return f"{self.campaign}/{self.file}"

    def path(self, folder: Path) -> Path:
        """The run's path below a folder of recordings."""
        return folder / self.campaign / self.file


@cache
def catalogue() -> tuple[Run, ...]:
    """All runs, by campaign and name; part10 follows part9.

    Examples:
        >>> import accpinn
        >>> run = accpinn.catalogue()[0]
        >>> run.campaign, run.file
        ('AstaZero', 'ASta_040719_platoon3.csv')
    """
    rows = packaged_rows("recordings", "catalogue.csv")
    runs = [Run(row["campaign"], row["file"], row["sha256"] or None) for row in rows]

    def order(run: Run) -> tuple[str, list[str | int]]:
        parts = re.split(r"(\d+)", run.file)
        return run.campaign, [int(part) if part.isdigit() else part for part in parts]

    return tuple(sorted(runs, key=order))


def find(names: Sequence[str]) -> tuple[Run, ...]:
    """The runs that campaigns, files, or both as "Casale/part7.csv" name; all runs without a name.

    Raises:
        ConfigError: for a name that is not in the catalogue, or a file that two campaigns have.
    """
    if not names:
        return catalogue()
    chosen: dict[Run, None] = {}
    for name in names:
        wanted = name.strip().strip("/").lower()
        runs = [run for run in catalogue() if wanted == run.campaign.lower()]
        runs = runs or [run for run in catalogue() if wanted in (run.key.lower(), run.file.lower())]
        if not runs:
            listed = ", ".join(dict.fromkeys(run.campaign for run in catalogue()))
            raise ConfigError(
                f'"{name[:60]}" is not in the catalogue; choose a campaign ({listed}) or a file.'
            )
        if len({run.campaign for run in runs}) > 1:
            choices = " or ".join(run.key for run in runs)
            raise ConfigError(f'"{name[:60]}" is the name of several runs; choose {choices}.')
        chosen |= dict.fromkeys(runs)
    return tuple(chosen)


def make_and_model(name: str) -> tuple[str, str]:
    """Make and model by the name in a header; the model is empty where the name has none."""
    listed = _makes().get(_key(name))
    if listed:
        return listed
    parts = _PARTS.fullmatch(name)
    if not parts:
        return name.strip(), ""
    make, model = parts[1], (parts[2] or parts[3]).strip()
    return _makes().get(_key(make), (make, ""))[0], model


def is_listed_name(name: str) -> bool:
    """Whether the table of makes has a name."""
    return _key(name) in _makes()


def _key(name: str) -> str:
    return re.sub(r"[^0-9a-z]+", "", name.lower())


@cache
def _makes() -> dict[str, tuple[str, str]]:
    rows = packaged_rows("recordings", "makes.csv")
    return {row["spelling"]: (row["make"], row["model"]) for row in rows}


LONGEST_NAME = 80
"""Characters of a vehicle's name that are kept; the longest of the database has 22."""

_NUMBERED = re.compile(r"([A-Za-z]+)([1-9]\d?)")
_CHOOSE_RUN = "choose the CSV file of a run"
_NEEDED = (SPEED, "numbered speed", "of several vehicles"), (GAP, "space-gap", "with gaps")
"""Channels that a run must have, with the words of the error about a missing one."""
_TABLE_NAMES = re.compile(r"veh_specifications|^Long setting vehs", re.IGNORECASE)


class MetadataMissing(Finding, frozen=True):
    """Rows above the column names are missing."""

    text = "Metadata are missing above the column names: {keys}."

    keys: tuple[str, ...]


class MetadataUnreadable(Finding, frozen=True):
    """A row above the column names holds something that its key does not allow; it is ignored."""

    text = 'The metadata row {key} cannot be read and is ignored: "{content}".'

    key: str
    content: str


class NamesWithoutData(Finding, frozen=True):
    """The header names vehicles that have no speed column."""

    text = "The header names vehicles without data: {vehicles}."

    vehicles: tuple[int, ...]


class VehiclesWithoutName(Finding, frozen=True):
    """Vehicles with a speed column have no name in the header."""

    text = "The header gives no name for {vehicles}."

    vehicles: tuple[int, ...]


class VehicleCountMismatch(Finding, frozen=True):
    """Number_of_vehicles, the list of names and the speed columns disagree."""

    text = (
        "The header states {stated} vehicles and names {named}, and the columns hold {recorded}; a"
        " name may belong to another vehicle."
    )

    stated: int
    named: int
    recorded: int


class GapsUnused(Finding, frozen=True):
    """Space-gaps (numbered by the vehicle ahead) beside a vehicle without a speed column."""

    text = "{columns} cannot be used: one of the two vehicles has no speed column."

    gaps: tuple[int, ...]

    def _words(self, about: Labelled) -> Words:
        return {"columns": tuple(map(GAP.of, self.gaps))}


class LineEndMissing(Finding, frozen=True):
    """The last row has no line end, so its last number may be cut short."""

    text = "The last row has no line end; if the file was cut short, its last number is wrong."


def read(source: Source | SourceFile, name: str | None = None) -> Recording:
    """Read an OpenACC CSV file.

    Args:
        source: path of the file, the bytes of an upload, or what was read of either.
        name: file name to show; needed for bytes only.

    Raises:
        RecordingError: one sentence of file, place, fault and cure.
    """
    source_file = source if isinstance(source, SourceFile) else read_bytes(source, name)
    metadata, layout = _read_header(source_file)
    speeds, gaps, drivers = (numbered(layout, channel) for channel in (SPEED, GAP, DRIVER))
    names = _names(source_file, metadata.get("Vehicle_order", ()))
    absent = tuple(key for key in METADATA if key not in metadata)
    findings: list[Finding] = [MetadataMissing(keys=absent)] if absent else []
    day = _date(metadata.get("Date", ()), findings)
    stated = _integer("Number_of_vehicles", metadata, range(1, 1000), findings)
    acc_flag = _integer("ACC", metadata, range(3), findings)
    distance_setting = excerpt(next(iter(metadata.get("Distance_setting", ())), "")) or None
    findings += _check_names(names, stated, speeds, gaps)
    vehicles = max(len(names), *speeds, 2)
    first = layout.names[0]
    columns = read_columns(
        source_file, layout, [first, *speeds.values(), *gaps.values()], [*drivers.values()]
    )
    columns.measured(TIME, first)
    speed = _measured(columns, SPEED, vehicles)
    gap = _measured(columns, GAP, vehicles - 1)
    time = columns.time(first)
    if not source_file.is_complete and layout.names[-1] not in drivers.values():
        findings.append(LineEndMissing())
    modes = {k: columns.modes(name, ["ACC"], ["Human"], findings) for k, name in drivers.items()}
    unknown = np.full(len(columns), Mode.UNKNOWN, np.int8)
    return recording_of(
        time, speed, gap,
        np.stack([modes.get(k, unknown) for k in range(1, vehicles + 1)], axis=1),
        refuse=lambda fault, cure, row: columns.refusal(fault, cure, first, row),
        findings=findings,
        source=source_file.name,
        sha256=source_file.sha256(),
        campaign=_campaign(source_file),
        date=day,
        acc_flag=acc_flag,
        distance_setting=distance_setting,
        names=names,
    )  # fmt: skip


def _measured(columns: Columns, channel: Quantity, count: int) -> FloatArray:
    """(N, count) a channel by vehicle number, nan for vehicles without it; refused if all are."""
    by_vehicle = {
        k: columns.measured(channel, n) for k, n in numbered(columns.layout, channel).items()
    }
    absent = np.full(len(columns), np.nan)
    values = np.stack([by_vehicle.get(k, absent) for k in range(1, count + 1)], axis=1)
    if np.isnan(values).all():
        fault = f"all {channel.name.lower()} columns are empty"
        raise columns.source_file.refusal(fault, "choose another recording")
    return values


def _check_names(
    names: Mapping[int, str], stated: int | None, speeds: Collection[int], gaps: Collection[int]
) -> Iterator[Finding]:
    """Findings where names, number of vehicles and numbers of columns disagree."""
    if absent := tuple(number for number in names if number not in speeds):
        yield NamesWithoutData(vehicles=absent)
    nameless = tuple(number for number in sorted(speeds) if not names.get(number))
    if names and nameless:  # without any, the row is among the metadata that are missing
        yield VehiclesWithoutName(vehicles=nameless)
    if stated is not None and (stated not in {len(names), max(speeds)} or stated < len(names)):
        yield VehicleCountMismatch(stated=stated, named=len(names), recorded=len(speeds))
    if orphans := tuple(n for n in sorted(gaps) if not {n, n + 1} <= set(speeds)):
        yield GapsUnused(gaps=orphans)


def _campaign(source_file: SourceFile) -> str | None:
    """The campaign of a published run, by its content, folder and name, or its name alone.

    None where these leave it open, as for part7.csv, which two campaigns have.
    """
    sha256, folder = source_file.sha256(), (source_file.folder or "").strip().lower()
    named = [run for run in catalogue() if run.file == source_file.name]
    for runs in (
        [run for run in catalogue() if run.sha256 == sha256],
        [run for run in named if run.campaign.lower() == folder],
        named,
    ):
        if len(runs) == 1:
            return runs[0].campaign
    return None


Metadata = dict[str, tuple[str, ...]]
"""The cells behind each key."""


def _read_header(source_file: SourceFile) -> tuple[Metadata, Layout]:
    """Metadata and layout of a file, or the error that it is no OpenACC run."""
    metadata: Metadata = {}
    keys = {key.lower(): key for key in METADATA}
    for number, line in enumerate(source_file.lines(HEADER_BYTES), start=1):
        cells = cells_of(line.strip())
        if not any(cells):
            continue
        first, place = cells[0].lower(), f"row {number}"
        if first == TIME.column.lower():
            layout = Layout(cells, (), ",", ".", number, number + 1)
            for channel, kind, whose in _NEEDED:
                if not numbered(layout, channel):
                    fault = f"no {kind} column (as {channel.of(1)}) is among the column names"
                    raise source_file.refusal(fault, f"{_CHOOSE_RUN} {whose}", place)
            return metadata, layout
        if first not in keys:
            raise _unexpected(source_file, cells[0], place)
        if keys[first] in metadata:
            fault = f'"{keys[first]}" is given a second time'
            raise source_file.refusal(fault, "delete one of the two rows", place)
        metadata[keys[first]] = cells[1:]
    fault = f'no row of column names that starts with "{TIME.column}" is found'
    raise source_file.refusal(fault, _CHOOSE_RUN)


def is_run(layout: Layout) -> bool:
    """Whether a table without metadata has the columns of a run, in a run's format."""
    has_channels = bool(numbered(layout, SPEED)) and bool(numbered(layout, GAP))
    is_plain = (layout.separator, layout.decimal, layout.units) == (",", ".", ())
    if not has_channels or not is_plain or layout.names[0].lower() != TIME.column.lower():
        return False
    return all(_is_number(row[0]) for row in layout.rows if row)


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True


def accompanies_runs(source_file: SourceFile) -> bool:
    """Whether a file is one of the tables that the database has beside its runs."""
    return bool(_TABLE_NAMES.search(source_file.name))


def _unexpected(source_file: SourceFile, cell: str, place: str) -> RecordingError:
    """The error about a row above the data whose first cell is neither a key nor Time."""
    if accompanies_runs(source_file):
        return source_file.refusal("this table accompanies the runs and is none", _CHOOSE_RUN)
    for separator, named in ((";", "semicolons"), ("\t", "tabs")):
        if separator in cell:
            cure = "save it with commas between cells and points in numbers"
            return source_file.refusal(f"cells are separated by {named}", cure, place)
    expected = ", ".join((*METADATA[:-1], f"{METADATA[-1]} or {TIME.column}"))
    fault = f'the row starts with "{excerpt(cell)}" where {expected} is expected'
    return source_file.refusal(fault, _CHOOSE_RUN, place)


def numbered(layout: Layout, channel: Quantity) -> dict[int, str]:
    """The columns of a channel by vehicle number."""
    matches = filter(None, map(_NUMBERED.fullmatch, layout.names))
    return {int(match[2]): match[0] for match in matches if match[1] == channel.column}


def _names(source_file: SourceFile, cells: tuple[str, ...]) -> dict[int, str]:
    """Names by vehicle number, as listed; trailing empty ones are dropped."""
    last = max((number for number, cell in enumerate(cells, 1) if cell), default=0)
    if last > MAX_VEHICLES:
        fault = f"{last} vehicles are listed and at most {MAX_VEHICLES} can be read"
        raise source_file.refusal(fault, "check the row Vehicle_order")
    return {number: excerpt(cell, LONGEST_NAME) for number, cell in enumerate(cells[:last], 1)}


def _date(cells: tuple[str, ...], findings: list[Finding]) -> date | None:
    if not any(cells):
        return None
    try:
        day, month, year = (int(cell) for cell in cells[:3])
        return date(year, month, day)
    except (ValueError, OverflowError):
        text = excerpt(", ".join(filter(None, cells)))
        findings.append(MetadataUnreadable(key="Date", content=text))
        return None


def _integer(
    key: str,
    metadata: Metadata,
    allowed: range,
    findings: list[Finding],
) -> int | None:
    cell = next(iter(metadata.get(key, ())), "")
    if not cell:
        return None
    try:
        value = float(cell)
    except ValueError:
        value = float("nan")
    if value not in allowed:
        findings.append(MetadataUnreadable(key=key, content=excerpt(cell)))
        return None
    return int(value)
