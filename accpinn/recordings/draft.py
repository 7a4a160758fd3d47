"""A proposal in the making: the columns of a table, the role of each, and the time."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from accpinn.recordings import clocks, time_forms
from accpinn.recordings.mapping import (
    CsvMapping,
    TimeColumn,
)
from accpinn.recordings.names import ColumnName
from accpinn.recordings.tables import numbers_of
from accpinn.units import FloatArray, Mask

NO_TIMES = frozenset(("ignored", "speed", "gap", "relative", "acceleration", "position", "length"))
"""Quantities that columns of time do not hold."""


@dataclass(frozen=True)
class Choice:
    """The proposed role of one column."""

    column: str
    cells: tuple[str, ...]
    """Its first cells."""
    role: str = ""
    """Role as "time" or "gap of vehicle 2"; empty for a column that is not used."""
    unit: str = ""
    reason: str = ""
    """Why, in a few words."""
    is_supported: bool = True
    """Whether name, unit, layout or data support the role."""
    is_by_values: bool = False
    """Whether the role rests on the column's values alone, so that a person has to confirm it."""


@dataclass(frozen=True)
class Proposal:
    """The proposed roles of all columns, and the mapping that they make."""

    choices: tuple[Choice, ...]
    """One a column, in the table's order."""
    mapping: CsvMapping
    """The mapping; a column that could not be found has an empty name in it."""
    undecided: tuple[str, ...] = ()
    """Sentences about what a person has to decide."""

    @property
    def is_supported(self) -> bool:
        """Whether every choice is supported, so that the table may be read without confirmation."""
        return not self.undecided

    @property
    def summary(self) -> str:
        """The choices as one sentence has them."""
        used = [choice for choice in self.choices if choice.role]
        return ", ".join(
            f'"{choice.column}" {choice.role}' + (f" [{choice.unit}]" if choice.unit else "")
            for choice in used
        )


@dataclass(frozen=True, eq=False)
class Column:
    """A column and its first cells."""

    name: ColumnName
    cells: Sequence[str]
    decimal: str

    @property
    def text(self) -> str:
        """The name as written."""
        return self.name.name

    @cached_property
    def numbers(self) -> FloatArray | None:
        """(N,) the numbers, nan where a cell is missing; None where there is none or a word."""
        return numbers_of(self.cells, self.decimal)

    @cached_property
    def words(self) -> frozenset[str]:
        """The different cells that are not empty."""
        return frozenset(cell for cell in self.cells if cell)

    @cached_property
    def varies(self) -> bool:
        """Whether two cells differ."""
        first = next((cell for cell in self.cells if cell), "")
        return any(cell and cell != first for cell in self.cells)

    def is_copy(self, other: "Column") -> bool:
        """Whether both hold the same cells."""
        return list(self.cells) == list(other.cells)


@dataclass
class Draft:
    """The choices made so far."""

    columns: Sequence[Column]
    choices: dict[str, Choice] = field(default_factory=dict)
    undecided: list[str] = field(default_factory=list)

    def choose(
        self, column: Column, role: str, unit: str, reason: str, is_supported: bool = True,
        is_by_values: bool = False,
    ) -> None:  # fmt: skip
        """Give a column a role; an empty one leaves it unused."""
        self.choices[column.text] = Choice(
            column.text, tuple(column.cells[:3]), role, unit, reason, is_supported, is_by_values
        )

    def pass_over(self, column: Column, reason: str) -> None:
        """Leave a column unused."""
        self.choose(column, "", "", reason)

    def of(self, quantity: str) -> list[Column]:
        """Columns of numbers without a choice whose names give the quantity.

        Constant columns count only where at most one other varies.
        """
        columns = [
            column
            for column in self.columns
            if column.text not in self.choices
            and column.name.quantity == quantity
            and column.numbers is not None
        ]
        varying = [column for column in columns if column.varies]
        return varying if len(varying) > 1 or len(columns) > 2 else columns

    def finished(self, mapping: CsvMapping) -> Proposal:
        """The proposal; columns without a choice are not used."""
        unused = [column for column in self.columns if column.text not in self.choices]
        for column in unused:
            quantity = column.name.quantity
            reason = f"{quantity}, not needed" if quantity not in ("", "ignored") else "not needed"
            self.pass_over(column, reason if column.varies else "the same in every row")
        choices = tuple(self.choices[column.text] for column in self.columns)
        return Proposal(choices, mapping, tuple(dict.fromkeys(self.undecided)))


def roles_of(mapping: CsvMapping) -> list[tuple[str, str, str]]:
    """Column, role and unit of all that a mapping names."""
    roles = []
    time, by = mapping.time, mapping.by
    if time:
        roles.append((time.column, "time", time.unit))
        roles += [(time.date, "date", "")] if time.date else []
        roles += [(time.nanoseconds, "nanoseconds", "ns")] if time.nanoseconds else []
    if by:
        roles.append((by.vehicle, "vehicle", ""))
        roles += [(by.leader, "vehicle ahead", "")] if by.leader else []
        roles += [(by.lane, "lane", "")] if by.lane else []
        roles += [(by.position, "position", "m")] if by.position else []
    roles += [(mapping.trajectory, "run", "")] if mapping.trajectory else []
    for k, speed in enumerate(mapping.speeds, 1):
        role = "speed" if by else f"speed of vehicle {k}"
        if speed.relative_to:
            role = f"speed of vehicle {k} less that of vehicle {speed.relative_to}"
        roles.append((speed.column, role, speed.unit))
    for k, gap in enumerate(mapping.gaps, 2):
        if not gap.minus:
            roles.append((gap.column, "gap" if by else f"gap of vehicle {k}", gap.unit))
        else:
            roles.append(
                (gap.column, "position" if by else f"position of vehicle {k - 1}", gap.unit)
            )
            roles.append((gap.minus, "position" if by else f"position of vehicle {k}", gap.unit))
        if isinstance(gap.subtract, str):
            roles.append((gap.subtract, "length", gap.unit))
    roles += [(m.column, f"driver mode of vehicle {m.vehicle}", "") for m in mapping.modes]
    return list(dict.fromkeys(roles))


def time_of(draft: Draft, rows: Mask | None = None) -> tuple[TimeColumn | None, float | None]:
    """The column of time, and its step where it counts frames; of some rows alone if given."""
    candidates = []
    for column in draft.columns:
        if column.text in draft.choices or not column.varies or column.name.quantity in NO_TIMES:
            continue
        cells = column.cells
        if rows is not None:
            cells = [cell for cell, is_of in zip(cells, rows, strict=True) if is_of]
        name = column.text if not column.name.unit_cell else f"{column.text} [{column.name.unit}]"
        recognised = time_forms.recognised(name, cells, column.decimal)
        if recognised:
            candidates.append((column, recognised))
    if not candidates:
        draft.undecided.append("Choose the column of time, or even steps.")
        return None, None
    candidates.sort(key=lambda candidate: (
        not candidate[1].supported, candidate[1].form == clocks.FRAME, not candidate[1].by_name,
    ))  # fmt: skip
    column, recognised = candidates[0]
    nanoseconds = _nanoseconds(draft, column) if recognised.form == "s" else ""
    for other, _ in candidates[1:]:
        if other.text == nanoseconds:
            continue
        draft.pass_over(other, f'"{column.text}" is the time')
    step = None
    if recognised.form == clocks.FRAME:
        draft.undecided.append(f'Give the time between two frames of "{column.text}".')
        step = 0.1
    draft.choose(column, "time", recognised.form, recognised.reason, recognised.supported)
    if not recognised.supported:
        draft.undecided.append(f'Confirm the unit of time "{column.text}": {recognised.reason}.')
    date = ""
    if recognised.form == "clock":
        for day in draft.columns:
            is_date = day.name.quantity == "date" and all(":" not in cell for cell in day.words)
            if is_date and day.text not in draft.choices:
                draft.choose(day, "date", "", "dates beside a clock")
                date = day.text
                break
    return TimeColumn(column.text, recognised.form, date, nanoseconds), step


def _nanoseconds(draft: Draft, seconds: Column) -> str:
    """The column of nanoseconds beside whole seconds; empty where there is none."""
    values = seconds.numbers
    if values is None or not (values == np.rint(values)).all():
        return ""
    for column in draft.columns:
        numbers = column.numbers
        if column is seconds or column.text in draft.choices or numbers is None:
            continue
        if time_forms.is_fraction(column.text, numbers):
            draft.choose(column, "nanoseconds", "ns", "nanoseconds beside whole seconds")
            return column.text
    return ""


def seconds_of(draft: Draft, time: TimeColumn | None) -> FloatArray | None:
    """Times of the first rows in s; None where they do not increase."""
    if time is None or time.unit == clocks.FRAME:
        return None
    columns = {column.text: column for column in draft.columns}
    column = columns[time.column]
    dates = columns[time.date].cells if time.date else None
    try:
        seconds = clocks.seconds(column.cells, time.unit, column.decimal, dates)
        if time.nanoseconds:
            seconds += clocks.seconds(columns[time.nanoseconds].cells, "ns", column.decimal)
    except clocks.TimeUnreadable:
        return None
    seconds, _ = clocks.unwrapped(seconds)
    is_sound = len(seconds) > 2 and bool((np.diff(seconds) > 0).all())
    return seconds if is_sound else None
