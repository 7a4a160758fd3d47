"""The columns that a mapping names, read from a table in SI units."""

import numpy as np

from accpinn.channels import Quantity
from accpinn.recordings import clocks
from accpinn.recordings.mapping import CsvMapping
from accpinn.recordings.source import SourceFile, excerpt
from accpinn.recordings.table_layout import Layout
from accpinn.recordings.tables import Columns, read_columns
from accpinn.units import FloatArray


def read_mapped_columns(source_file: SourceFile, mapping: CsvMapping, layout: Layout) -> Columns:
    """Read the columns of a table that a mapping names."""
    words = [mode.column for mode in mapping.modes]
    words += [mapping.trajectory] if mapping.trajectory else []
    numbers = [speed.column for speed in mapping.speeds]
    for gap in mapping.gaps:
        named = (gap.column, gap.minus, gap.subtract)
        numbers += [name for name in named if isinstance(name, str) and name]
    if by := mapping.by:
        words += [name for name in (by.vehicle, by.leader, by.lane) if name]
        numbers += [by.position] if by.position else []
    if mapping.time:  # as texts, whose digits are all there
        parts = (mapping.time.column, mapping.time.date, mapping.time.nanoseconds)
        words += filter(None, parts)
    return read_columns(
        source_file, layout, tuple(dict.fromkeys(numbers)), tuple(dict.fromkeys(words))
    )


def time_stamps(columns: Columns, mapping: CsvMapping) -> tuple[str, FloatArray]:
    """The column of time and its values (N,) in s, wraps at midnight not undone yet.

    Raises:
        RecordingError: about the first cell that holds no time.
    """
    time = mapping.time
    if time is None:  # even steps
        step = mapping.sample_time or 0.0
        return mapping.speeds[0].column, step * np.arange(len(columns), dtype=np.float64)
    is_counter = time.unit == clocks.FRAME
    dates = columns.words[time.date] if time.date else None
    at = time.column
    try:
        seconds = clocks.seconds(
            columns.words[at], "s" if is_counter else time.unit, columns.layout.decimal, dates
        )
        if time.nanoseconds:
            at = time.nanoseconds
            seconds = seconds + clocks.seconds(columns.words[at], "ns", columns.layout.decimal)
    except clocks.TimeUnreadable as fault:
        message = f'"{excerpt(fault.cell)}" {fault.fault} as "{time.unit}"'
        cure = "correct it, or name the column's unit"
        at = time.date if fault.is_date else at
        raise columns.refusal(message, cure, at, fault.index) from None
    if is_counter:
        seconds = seconds * (mapping.sample_time or 0.0)
    return time.column, seconds


def measured_channel(
    columns: Columns, quantity: Quantity, column: str, factor: float, is_reversed: bool
) -> FloatArray:
    """A column (N,) in the quantity's unit; one without any value is refused."""
    values = columns.measured(quantity, column, -factor if is_reversed else factor)
    columns.require_some(column, "choose another column")
    return values
