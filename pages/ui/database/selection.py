"""Which study, rows and groups page Database shows, and the address that says so.

What is read and grouped is kept as long as the study does not change.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import urlencode

import pandas as pd
import plotly.graph_objects as go
import streamlit as st

from accpinn.results.figures import database as figures
from accpinn.results.tables.groups import HEADINGS
from accpinn.storage import folder
from accpinn.study.groups import Group, Groups, group, read_study
from accpinn.study.studies import (
    Failure,
    Request,
    read_failures,
    read_request,
    state_of,
    studies,
    study_path,
)
from pages.ui.session.choices import DatabaseChoice

FILTERS: Mapping[str, str] = {
    name: HEADINGS[name] for name in ("make", "model", "distance_setting", "campaign", "mode")
}
"""Columns by which rows are chosen, with their labels."""
GROUPINGS: Mapping[str, tuple[str, tuple[str, ...]]] = {
    "make": ("Make", ("make",)),
    "model": ("Make and model", ("make", "model")),
    "setting": ("Model and setting", ("make", "model", "distance_setting")),
    "campaign": ("Campaign", ("campaign",)),
    "mode": ("Mode", ("mode",)),
}
"""What groups have in common: title and columns, by a short name."""
STUDY, METHOD, BY = "study", "method", "by"
"""Names of query parameters; the others are those of the columns."""
NOT_TOLD = "not stated"
"""Stands for an empty cell."""
WRITTEN = "database_link"
"""The entry in Streamlit's session state with the parameters that this browser was last given."""


@dataclass(frozen=True)
class Stamp:
    """A study in one state."""

    folder: str
    state: tuple[int, ...]
    """As `state_of` gives it; empty where the batch has not begun to write."""

    @classmethod
    def of(cls, folder: Path) -> "Stamp":
        """Its present state."""
        return cls(str(folder), state_of(folder))


@dataclass(frozen=True, eq=False)
class ShownRows:
    """The rows that are chosen, and what they say."""

    stamp: Stamp
    """The study."""
    rows: pd.DataFrame
    """Rows of one method; the index is the place among all rows of the study."""
    groups: Groups
    whole: Group | None
    """All rows as one group; None where there is no row."""
    makes: int
    recordings: int
    forest: go.Figure


@st.cache_resource(max_entries=4, show_spinner="Reading the study …")
def study_rows(stamp: Stamp) -> pd.DataFrame:
    """All rows of a study; empty cells of texts say so.

    Raises:
        RecordingError: where there is no study.
    """
    frame = read_study(stamp.folder)
    for column in (*FILTERS, "method"):
        frame[column] = frame[column].replace("", None).fillna(NOT_TOLD).astype(str)
    return frame


@st.cache_resource(max_entries=32, show_spinner=False)
def shown(
    stamp: Stamp, filters: tuple[tuple[str, tuple[str, ...]], ...], method: str, by: str
) -> ShownRows:
    """The rows of a study that are chosen, and what they say."""
    rows = study_rows(stamp)
    rows = rows[rows["method"] == method]
    for column, values in filters:
        rows = rows[rows[column].isin(values)]
    groups = group(rows, GROUPINGS[by][1], method)
    whole = next(iter(group(rows, (), method).groups), None)
    makes, recordings = rows["make"].nunique(), rows["sha256"].nunique()
    return ShownRows(stamp, rows, groups, whole, makes, recordings, figures.forest(groups))


@st.cache_resource(max_entries=8, show_spinner=False)
def failures_of(stamp: Stamp) -> tuple[Failure, ...]:
    """What has no result."""
    return read_failures(Path(stamp.folder))


@st.cache_resource(max_entries=8, show_spinner=False)
def request_of(stamp: Stamp) -> Request | None:
    """What the study was last asked to do; all its rows share longest window and Case."""
    return read_request(Path(stamp.folder)) if stamp.state else None


# The address


def follow_link(choice: DatabaseChoice) -> None:
    """Take over what the address asks for, unless this browser was given that address here."""
    asked = _asked()
    if not asked or asked == st.session_state.get(WRITTEN):
        return
    choice.study = (asked.get(STUDY) or ("",))[0]
    choice.method = (asked.get(METHOD) or ("",))[0]
    by = (asked.get(BY) or ("",))[0]
    choice.by = by if by in GROUPINGS else "make"
    choice.filters = {name: values for name, values in asked.items() if name in FILTERS}
    choice.row = None
    st.session_state[WRITTEN] = asked


def write_link(choice: DatabaseChoice) -> None:
    """Let the address say what is shown, so that a reload and a bookmark find it again."""
    wanted = parameters_of(choice)
    if wanted != _asked():
        for name in (STUDY, METHOD, BY, *FILTERS):
            if name in wanted:
                st.query_params[name] = list(wanted[name])
            elif name in st.query_params:
                del st.query_params[name]
    st.session_state[WRITTEN] = wanted


def parameters_of(choice: DatabaseChoice) -> dict[str, tuple[str, ...]]:
    """The query parameters of what is shown, with all values of each."""
    chosen = {STUDY: choice.study, METHOD: choice.method, BY: choice.by}
    parameters = {name: (value,) for name, value in chosen.items() if value}
    return parameters | {name: values for name, values in choice.filters.items() if values}


def query(choice: DatabaseChoice) -> str:
    """The same as a part of an address."""
    return urlencode(parameters_of(choice), doseq=True)


def _asked() -> dict[str, tuple[str, ...]]:
    names = (STUDY, METHOD, BY, *FILTERS)
    return {name: tuple(st.query_params.get_all(name)) for name in names if name in st.query_params}


def folder_of(name: str) -> Path:
    """The folder of the study of that name.

    Raises:
        ConfigError: for what is no name.
    """
    return study_path(name, folder("studies"))


def known_studies() -> tuple[str, ...]:
    """The names of the server's studies, the one that was written to last first."""
    return studies(folder("studies"))
