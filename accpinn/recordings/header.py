"""The rows above the numbers: five of metadata, one of column names."""

import csv
import re
from collections.abc import Iterator
from dataclasses import dataclass
from datetime import date

from accpinn.channels import DRIVER, GAP, MAX_VEHICLES, METADATA, SPEED, TIME
from accpinn.recordings.source import SourceFile, excerpt, refusal

LONGEST_NAME = 80
"""Characters of a vehicle's name that are kept; the longest of the database has 22."""
_READ_BYTES = 100_000
_NUMBERED = re.compile(r"([A-Za-z]+)([1-9]\d?)")
_CHOOSE_RUN = "choose the CSV file of a run"
_TABLE_NAMES = re.compile(r"veh_specifications|^Long setting vehs", re.IGNORECASE)


@dataclass(frozen=True)
class Columns:
    """Where the needed columns stand, as position by vehicle number; 0 = leftmost."""

    names: tuple[str, ...]
    """Of all columns, also those not read."""
    time: int
    speed: dict[int, int]
    gap: dict[int, int]
    driver: dict[int, int]

    @property
    def count(self) -> int:
        """How many cells a row has."""
        return len(self.names)

    @property
    def numbers(self) -> list[int]:
        """Positions of the columns that hold numbers."""
        return sorted([self.time, *self.speed.values(), *self.gap.values()])


@dataclass(frozen=True)
class Header:
    """Everything a file says before its first sample."""

    date: date | None
    names: tuple[str, ...]
    """As listed, trailing empty ones dropped."""
    number: int | None
    """Number_of_vehicles."""
    acc_flag: int | None
    distance_setting: str | None
    columns: Columns
    rows: int
    """How many rows precede the first sample."""
    size: int
    """How many bytes they take."""
    warnings: tuple[str, ...]


@dataclass(frozen=True)
class _Row:
    number: int
    cells: tuple[str, ...]
    end: int
    """Offset of the byte behind the row."""


def read_header(source_file: SourceFile) -> Header:
    """Metadata and columns of a file, or the sentence why it is no OpenACC run."""
    metadata: dict[str, tuple[str, ...]] = {}
    keys = {key.lower(): key for key in METADATA}
    for row in _rows(source_file.text):
        first = row.cells[0].lower()
        if first == TIME.column.lower():
            return _assemble(source_file.name, metadata, row)
        if first not in keys:
            raise _unexpected(source_file, row)
        if keys[first] in metadata:
            fault = f'"{keys[first]}" is given a second time'
            raise refusal(
                source_file.name, fault, "delete one of the two rows", f"row {row.number}"
            )
        metadata[keys[first]] = row.cells[1:]
    fault = f'no row of column names that starts with "{TIME.column}" is found'
    raise refusal(source_file.name, fault, _CHOOSE_RUN)


def _rows(text: bytes) -> Iterator[_Row]:
    """The first rows with content, cell by cell."""
    end = 0
    for number, line in enumerate(text[:_READ_BYTES].splitlines(keepends=True), start=1):
        end += len(line)
        try:
            decoded = line.decode("utf-8")
        except UnicodeDecodeError:
            decoded = line.decode("cp1252", errors="replace")
        cells = tuple(cell.strip() for cell in next(csv.reader([decoded.strip()]), []))
        if any(cells):
            yield _Row(number, cells, end)


def _unexpected(source_file: SourceFile, row: _Row) -> Exception:
    if _TABLE_NAMES.search(source_file.name):
        return refusal(source_file.name, "this table accompanies the runs and is none", _CHOOSE_RUN)
    if ";" in row.cells[0]:
        cure = "save it with commas between cells and points in numbers"
        return refusal(
            source_file.name, "cells are separated by semicolons", cure, f"row {row.number}"
        )
    expected = ", ".join((*METADATA[:-1], f"{METADATA[-1]} or {TIME.column}"))
    fault = f'the row starts with "{excerpt(row.cells[0])}" where {expected} is expected'
    return refusal(source_file.name, fault, _CHOOSE_RUN, f"row {row.number}")


def _assemble(name: str, metadata: dict[str, tuple[str, ...]], row: _Row) -> Header:
    columns = _columns(name, row)
    if not metadata:
        listed = ", ".join(METADATA)
        fault = f"the metadata rows ({listed}) above the column names are missing"
        raise refusal(name, fault, "add them, or download the file again", "row 1")
    warnings = [f"The metadata row {key} is missing." for key in METADATA if key not in metadata]
    names = _names(metadata.get("Vehicle_order", ()))
    if len(names) > MAX_VEHICLES:
        fault = f"{len(names)} vehicles are listed and at most {MAX_VEHICLES} can be read"
        raise refusal(name, fault, "check the row Vehicle_order")
    return Header(
        date=_date(metadata.get("Date", ()), warnings),
        names=names,
        number=_integer("Number_of_vehicles", metadata, range(1, 1000), warnings),
        acc_flag=_integer("ACC", metadata, range(3), warnings),
        distance_setting=excerpt(next(iter(metadata.get("Distance_setting", ())), "")) or None,
        columns=columns,
        rows=row.number,
        size=row.end,
        warnings=tuple(warnings),
    )


def _columns(name: str, row: _Row) -> Columns:
    place = f"row {row.number}"
    found: dict[str, dict[int, int]] = {c.column: {} for c in (SPEED, GAP, DRIVER)}
    positions: dict[str, int] = {}
    for position, cell in enumerate(row.cells):
        if cell in positions:
            both = f"columns {positions[cell] + 1} and {position + 1}"
            fault = f'"{excerpt(cell)}" names {both}'
            raise refusal(name, fault, "delete or rename one of them", place)
        if cell:
            positions[cell] = position
        numbered = _NUMBERED.fullmatch(cell)
        if numbered and numbered[1] in found:
            found[numbered[1]][int(numbered[2])] = position
    if not found[SPEED.column]:
        fault = f"no numbered speed column (as {SPEED.of(1)}) is among the column names"
        raise refusal(name, fault, f"this is no run of several vehicles, {_CHOOSE_RUN}", place)
    if not found[GAP.column]:
        fault = f"no space-gap column (as {GAP.of(1)}) is among the column names"
        raise refusal(name, fault, "without space-gaps nothing can be learned from it", place)
    return Columns(row.cells, 0, *(found[c.column] for c in (SPEED, GAP, DRIVER)))


def _names(cells: tuple[str, ...]) -> tuple[str, ...]:
    last = max((i for i, cell in enumerate(cells) if cell), default=-1)
    return tuple(excerpt(cell, LONGEST_NAME) for cell in cells[: last + 1])


def _date(cells: tuple[str, ...], warnings: list[str]) -> date | None:
    if not any(cells):
        return None
    try:
        day, month, year = (int(cell) for cell in cells[:3])
        return date(year, month, day)
    except (ValueError, OverflowError):
        warnings.append(f'The date "{excerpt(", ".join(filter(None, cells)))}" is not a date.')
        return None


def _integer(
    key: str, metadata: dict[str, tuple[str, ...]], allowed: range, warnings: list[str]
) -> int | None:
    cell = next(iter(metadata.get(key, ())), "")
    if not cell:
        return None
    try:
        value = float(cell)
    except ValueError:
        value = float("nan")
    if value not in allowed:
        warnings.append(f'{key} is "{excerpt(cell)}", which has no known meaning; it is ignored.')
        return None
    return int(value)
