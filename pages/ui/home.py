"""The page Home: the session so far, the ways to a recording, and examples at one click."""

from functools import partial
from pathlib import Path

import plotly.graph_objects as go
import streamlit as st

from accpinn.methods.pinn.config import DEFAULT
from accpinn.model.published import PUBLISHED
from accpinn.recordings import files
from accpinn.results.figures.recording import speeds_thumbnail
from accpinn.results.figures.stability import gains_thumbnail
from accpinn.segment.cut import cut
from pages.ui import reproduction
from pages.ui.components import frame, show
from pages.ui.components.show import escape_markdown, tabs
from pages.ui.data.sources import OPENING, ask, drop_zone, open_file
from pages.ui.reproduction import button
from pages.ui.session.resources import FIRST_SAMPLE, sample_title, samples
from pages.ui.session.saved import results_to_see
from pages.ui.session.sessions import Shown, go_on, recent_sessions
from pages.ui.session.workspace import Workspace
from pages.ui.snapshots.listing import show_runs

CARDS = 5
"""In a row."""
IN_SIDEBAR = ("**Window**", "**Without**")
"""Beginnings of the lines of the session's state that only the sidebar shows."""


def show_page(workspace: Workspace) -> None:
    st.title("Learn a car's cruise control from a recorded drive", anchor=False)
    if workspace.pending:
        ask(workspace, workspace.pending, then=frame.DATA)
        return
    st.markdown(
        "accpinn estimates the time gap that an **adaptive cruise control** keeps, how it reacts,"
        " and whether a line of such cars amplifies disturbances."
    )
    results = results_to_see(workspace)
    is_open = bool(workspace.recording or workspace.restored)
    if results or is_open:
        with st.container(border=True, gap="small", key="home_mine"):
            if is_open:
                _show_open(workspace)
            if results:
                show_runs(workspace, results, "home_runs", title="My results")
    _ways_in(workspace, is_first=not results)
    recent = recent_sessions(workspace)
    drawn = {
        "Earlier sessions": lambda: _show_sessions(recent),
        "Samples": lambda: _show_samples(workspace),
        "Published parameters": lambda: _show_published(workspace),
    }
    if not recent:
        del drawn["Earlier sessions"]
    if results:
        with st.expander("More ways", icon=":material/more_horiz:"):
            _more_ways(workspace)
            tabs(workspace, "home_tabs", drawn)
    else:
        tabs(workspace, "home_tabs", drawn)


def _show_open(workspace: Workspace) -> None:
    """The open recording or result of this session, and the way back to it."""
    has_result = bool(workspace.training or workspace.restored)
    with st.container(horizontal=True, vertical_alignment="center", key="home_open"):
        brief = (line for line in frame.session_state(workspace) if not line.startswith(IN_SIDEBAR))
        line = " · ".join(brief)
        st.markdown(f":material/folder_open: {line}", width="content")
        label = "Back to the result" if has_result else "Back to the recording"
        frame.link(frame.TRAIN if has_result else frame.DATA, label, workspace)


def _show_sessions(recent: list[tuple[str, Shown]]) -> None:
    """The person's other sessions, to go on with."""
    for place, (key, shown) in enumerate(recent):
        # No link: its address would hold the session's secret.
        if st.button(
            escape_markdown(frame.about_analysis(shown.analysis)), key=f"home_session_{place}",
            type="tertiary", icon=":material/history:",
        ):  # fmt: skip
            frame.go(frame.TRAIN if shown.result else frame.DATA, go_on(key))


def _ways_in(workspace: Workspace, is_first: bool) -> None:
    """The field for files and the shortest ways; all of them where nothing was learned yet."""
    left, right = st.columns((2, 1), gap="large")
    with left.container(key="home_drop"):
        drop_zone(workspace, then=frame.DATA)
    with right:
        button(
            workspace, "Train a sample now", frame.TRAIN, "home_train", width="stretch",
            type="primary" if is_first else "secondary", icon="play_arrow",
            act=lambda: reproduction.train_sample(workspace, FIRST_SAMPLE, DEFAULT),
            help="Opens the first sample, three synthetic followers on a motorway, and trains on"
            " its windows in car-following by the recommended method; the result comes within"
            " seconds.",
        )  # fmt: skip
        button(
            workspace, "Reproduce the paper", frame.REPRODUCE, "home_reproduce", width="stretch",
            icon="article",
            help="Page Reproduce: the paper's Bode plots, its four panels and its tables.",
        )  # fmt: skip
    if is_first:
        _more_ways(workspace)


def _more_ways(workspace: Workspace) -> None:
    with st.container(horizontal=True, vertical_alignment="center"):
        button(
            workspace, "Folder and downloads", frame.DATA, "home_own", type="tertiary",
            icon="upload_file", act=lambda: st.session_state.update({OPENING: True}),
            help="Page Data, with the server's folder of recordings and the published runs.",
        )  # fmt: skip
        button(
            workspace, "Makes and models", frame.DATABASE, "home_database", type="tertiary",
            icon="database",
            help="Page Database: every window of a folder of recordings, by make and model.",
        )  # fmt: skip
        reproduction.table_buttons(workspace, "home")


# What can be opened at one click


def _show_samples(workspace: Workspace) -> None:
    st.caption("Synthetic recordings with known true parameters.")
    for column, path in zip(st.columns(CARDS), samples()[:CARDS], strict=False):
        with column.container(border=True, height="stretch", vertical_alignment="distribute"):
            name, _, about = sample_title(path).partition(": ")
            st.markdown(f"**{name}**")
            show.picture(_speeds(path), f"home_{path.stem}")
            st.caption(about.capitalize())
            button(
                workspace, "Open", frame.DATA, f"home_open_{path.stem}", width="stretch",
                help="Page Data, with this sample.", act=partial(open_file, workspace, path),
            )  # fmt: skip


def _show_published(workspace: Workspace) -> None:
    """A card for each set of parameters that the paper prints."""
    st.caption(
        "The paper's parameters need no recording. The pictures are Bode magnitudes: above the"
        " line a disturbance grows from car to car."
    )
    columns = [*st.columns(3), *st.columns(3)]
    for column, published in zip(columns, PUBLISHED, strict=False):
        with column.container(border=True, height="stretch"):
            title, _, table = published.title.partition(" (paper, ")
            st.markdown(f"**{table.rstrip(')')}: {title}**")
            show.picture(gains_thumbnail(published), f"home_{published.title}")
            st.caption(", ".join(published.names))
            with st.container(horizontal=True):
                for name, page in (("Stability", frame.STABILITY), ("Platoon", frame.PLATOON)):
                    button(
                        workspace, name, page, f"home_{published.title}_{name}",
                        help=f"Page {name}, with these printed parameters.",
                        act=partial(reproduction.take_published, workspace, published),
                    )  # fmt: skip


@st.cache_resource(max_entries=8, show_spinner=False)
def _speeds(path: Path) -> go.Figure:
    return speeds_thumbnail(cut(files.read(path)))
