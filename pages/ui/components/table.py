"""A table on a page, and its downloads."""

import re
from collections.abc import Sequence
from pathlib import Path

import streamlit as st

from accpinn.results.figures.style import vehicle_colour
from accpinn.results.tables.table import STYLE, Table
from accpinn.segment.segment import Segment, SegmentInfo


def show_table(table: Table, colours: Sequence[str] = ()) -> None:
    """Draw it, with a mark of colour before each row if ``colours`` are given."""
    st.html(STYLE + (table.coloured(colours) if colours else table).to_html())


def vehicle_colours(segment: Segment | SegmentInfo) -> list[str]:
    """The colour of each vehicle, leader first."""
    return [vehicle_colour(number, segment.vehicles[0]) for number in segment.vehicles]


def show_downloads(table: Table, name: str, key: str) -> None:
    """Buttons that save the table as CSV and LaTeX.

    Args:
        table: what is saved.
        name: of the files; a file name loses its ending, other marks become underscores.
        key: of the buttons.
    """
    stem = re.sub(r"[^\w-]+", "_", name).strip("_")
    kinds = (("CSV", table.to_csv(), "csv", "text/csv"),
             ("LaTeX", table.to_latex(), "tex", "application/x-tex"))  # fmt: skip
    with st.container(horizontal=True):
        for label, text, ending, mime in kinds:
            st.download_button(
                label, text, f"{stem}.{ending}", mime, key=f"{key}_{ending}", on_click="ignore",
                icon=":material/download:",
            )  # fmt: skip


def stem_of(segment: Segment | SegmentInfo) -> str:
    """The recording's file name without its ending."""
    return Path(segment.source).stem
