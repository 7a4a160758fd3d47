"""Any table of numbers with a row of column names: its layout, a preview, and columns by name."""

import csv
import io
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from accpinn.recordings.samples import (
    AS_WRITTEN,
    MINIMUM_SAMPLES,
    SourceFile,
    cells_per_row,
    excerpt,
)

if TYPE_CHECKING:
    import pandas as pd  # takes most of a second to import, which few files need

SEPARATORS = (",", ";", "\t", "|")
HEADER_ROWS = 50
"""The row of column names is looked for among so many."""
PREVIEWED = 5
"""Rows of a preview."""
_READ_BYTES = 100_000
LONGEST_NAME = 60


@dataclass(frozen=True)
class Layout:
    """How a table is written, and its first rows."""

    names: tuple[str, ...]
    """Of the columns, in their order; empty where a column has none."""
    rows: tuple[tuple[str, ...], ...]
    """The first rows of cells, as they are written."""
    separator: str
    decimal: str
    """What stands before the fraction of a number: a point or a comma."""
    header_row: int
    """Which row has the column names, 1 = first."""


def layout_of(source_file: SourceFile) -> Layout:
    """The layout of a table.

    Args:
        source_file: any text.

    Raises:
        RecordingError: where no row of column names is found.
    """
    text = source_file.text[:_READ_BYTES].decode("utf-8", "replace")
    lines = text.splitlines()[: HEADER_ROWS + PREVIEWED + 1]
    for number, line in enumerate(lines[:HEADER_ROWS]):
        for separator in sorted(SEPARATORS, key=line.count, reverse=True):
            names = _cells(line, separator)
            below = [_cells(row, separator) for row in lines[number + 1 :] if row.strip()]
            is_header = len(names) > 1 and any(names) and not any(map(_is_number, names))
            if is_header and below and len(below[0]) == len(names):
                return _layout(names, below[:PREVIEWED], separator, number + 1)
    fault = "no row of column names above rows of numbers is found"
    raise source_file.refusal(fault, "give each column a name in the first row")


def _layout(
    names: tuple[str, ...], rows: Sequence[tuple[str, ...]], separator: str, header_row: int
) -> Layout:
    cells = [cell for row in rows for cell in row]
    commas = separator != "," and any(_is_number(cell.replace(",", ".")) for cell in cells)
    points = any("." in cell and _is_number(cell) for cell in cells)
    decimal = "," if commas and not points and any("," in cell for cell in cells) else "."
    shown = tuple(tuple(excerpt(cell) for cell in row) for row in rows)
    return Layout(names, shown, separator, decimal, header_row)


def _cells(line: str, separator: str) -> tuple[str, ...]:
    return tuple(cell.strip() for cell in next(csv.reader([line], delimiter=separator), []))


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True


def _position(source_file: SourceFile, layout: Layout, column: str) -> int:
    """Where a column stands, 0 = leftmost; one that is missing or there twice is refused."""
    count = layout.names.count(column)
    if count == 1:
        return layout.names.index(column)
    shown = excerpt(column, LONGEST_NAME)
    if count:
        fault = f'"{shown}" names {count} columns'
        raise source_file.refusal(fault, "rename all but one", f"row {layout.header_row}")
    listed = excerpt(", ".join(filter(None, layout.names)), 200)
    fault = f'there is no column "{shown}"'
    raise source_file.refusal(fault, f"choose among {listed}", f"row {layout.header_row}")


def read_columns(
    source_file: SourceFile, layout: Layout, numbers: Sequence[str], words: Sequence[str] = ()
) -> "pd.DataFrame":
    """Some columns of a table, by name.

    Args:
        source_file: the file.
        layout: its own.
        numbers: columns of numbers; empty cells become nan.
        words: columns of texts, without white space around them; empty cells become "".

    Raises:
        RecordingError: which cell or column is wrong.
    """
    import pandas as pd

    for name in words:
        if name in numbers:
            fault = f'column "{excerpt(name, LONGEST_NAME)}" is asked for as numbers and as words'
            raise source_file.refusal(fault, "choose another column for one of them")
    positions = {name: _position(source_file, layout, name) for name in (*numbers, *words)}
    _require_whole(source_file, layout)
    try:
        frame = _frame(source_file, layout, positions, dict.fromkeys(numbers, "float64"))
    except (ValueError, OverflowError) as error:
        if "Calling read" in str(error):  # memory always reads: pandas has hidden a Ctrl+C
            raise KeyboardInterrupt from None
        cure = "download the file again, or re-save it"
        refusal = source_file.refusal("the rows cannot be read as numbers", cure)
        try:
            frame = _frame(source_file, layout, positions, {})
        except ValueError:  # not even as texts
            raise refusal from error
        for name in numbers:
            cells = frame[name].str.replace(layout.decimal, ".", regex=False)
            wrong = (frame[name].notna() & pd.to_numeric(cells, errors="coerce").isna()).to_numpy()
            if wrong.any():
                row = int(wrong.argmax())
                fault = f'"{excerpt(str(frame[name].iloc[row]))}" is not a number'
                place = f"row {layout.header_row + row + 1}, column {excerpt(name, LONGEST_NAME)}"
                cure = "correct it, or leave the cell empty"
                raise source_file.refusal(fault, cure, place) from error
        raise refusal from error
    if len(frame) < MINIMUM_SAMPLES:
        fault = f"only {len(frame)} rows of numbers follow the column names"
        raise source_file.refusal(fault, f"a recording needs at least {MINIMUM_SAMPLES}")
    for name in words:
        frame[name] = frame[name].fillna("").str.strip()
    return frame


def _frame(
    source_file: SourceFile, layout: Layout, positions: dict[str, int], dtypes: dict[str, str]
) -> "pd.DataFrame":
    import pandas as pd

    given = {at: dtypes.get(name, "str") for name, at in positions.items()}
    frame: pd.DataFrame = pd.read_csv(
        io.BytesIO(source_file.text.rstrip()),
        sep=layout.separator,
        decimal=layout.decimal,
        header=None,
        skiprows=layout.header_row,
        usecols=sorted(set(positions.values())),
        dtype=given,
        encoding="utf-8",
        encoding_errors="replace",
        **AS_WRITTEN,
    )
    return pd.DataFrame({name: frame[at] for name, at in positions.items()})


def _require_whole(source_file: SourceFile, layout: Layout) -> None:
    """Every row has as many cells as there are columns, where that can be counted."""
    text = source_file.text.rstrip()
    if b'"' in text:
        return
    counts = cells_per_row(text, layout.separator)[layout.header_row :]
    expected = len(layout.names)
    ragged = np.flatnonzero(counts != expected)
    if len(ragged):
        row = int(ragged[0])
        fault = f"the row has {counts[row]} cells where the column names ask for {expected}"
        cure = "correct or delete it, or download the file again"
        raise source_file.refusal(fault, cure, f"row {layout.header_row + row + 1}")
