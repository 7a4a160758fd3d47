"""The page Home: the session so far, the ways to a recording, and examples at one click."""

from functools import partial
from pathlib import Path

import plotly.graph_objects as go
import streamlit as st

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
from pages.ui.session.sessions import Shown, go_on, recent_sessions, runs_to_see
from pages.ui.session.workspace import Workspace
from pages.ui.snapshots.listing import show_runs

CARDS = 5
"""In a row."""


def show_page(workspace: Workspace) -> None:
    st.title("Learn a car's cruise control from a recorded drive", anchor=False)
    if workspace.pending:
        ask(workspace, workspace.pending, then=frame.DATA)
        return
    recent = recent_sessions(workspace)
    if workspace.recording or workspace.restored or recent:
        _continue(workspace, recent)
    else:
        st.markdown(
            "From a recorded drive accpinn estimates the time gap that a car's **adaptive cruise"
            " control** keeps, and how it reacts: headway τ and gains α and β of a constant"
            " time-headway policy (CTHP), with intervals. It says whether a line of such cars"
            " amplifies disturbances."
        )
    _ways_in(workspace)
    runs = runs_to_see(workspace)
    drawn = {
        "Finished runs": lambda: show_runs(workspace, runs, "home_runs"),
        "Samples": lambda: _show_samples(workspace),
        "Published parameters": lambda: _show_published(workspace),
    }
    if not runs:
        del drawn["Finished runs"]
    tabs(workspace, "home_tabs", drawn)


def _continue(workspace: Workspace, recent: list[tuple[str, Shown]]) -> None:
    """What is open, and the person's other sessions."""
    with st.container(border=True):
        session, others = st.columns((1, 1.7), gap="large")
        if workspace.recording or workspace.restored:
            with session:
                st.markdown("**Continue**  \n" + "  \n".join(frame.session_state(workspace)))
                if workspace.training or workspace.restored:
                    frame.link(frame.TRAIN, "Back to the result", workspace)
                else:
                    frame.link(frame.DATA, "Back to the recording", workspace)
        else:
            session.markdown("**Continue**  \nThis session is new; go on with an earlier one.")
        if recent:
            with others:
                st.markdown("**Earlier sessions**")
                for place, (key, shown) in enumerate(recent):
                    asked = shown.analysis
                    about = f"{asked.source.name}, {frame.in_words(asked.window, asked.windows)}"
                    # No link: its address would hold the session's secret.
                    if st.button(
                        escape_markdown(about), key=f"home_session_{place}", type="tertiary",
                        icon=":material/history:",
                    ):  # fmt: skip
                        frame.go(frame.TRAIN if shown.result else frame.DATA, go_on(key))


def _ways_in(workspace: Workspace) -> None:
    left, right = st.columns((2, 1), gap="large")
    with left.container(key="home_drop"):
        drop_zone(workspace, then=frame.DATA)
    with right:
        button(
            workspace, "Train a sample now", frame.TRAIN, "home_train", width="stretch",
            type="primary", icon="play_arrow",
            act=lambda: reproduction.train_sample(workspace, FIRST_SAMPLE, "calibrated"),
            help="Opens the first sample below and trains on its windows in car-following by the"
            " recommended method.",
        )  # fmt: skip
        st.caption("Motorway cars: three synthetic followers; the result comes within seconds.")
        button(
            workspace, "Other ways to open a recording", frame.DATA, "home_own", width="stretch",
            icon="upload_file", act=lambda: st.session_state.update({OPENING: True}),
            help="Page Data, with the field for a file and the server's folder.",
        )  # fmt: skip
        button(
            workspace, "Database of makes and models", frame.DATABASE, "home_database",
            width="stretch", icon="database",
            help="Page Database: every window of a folder of recordings, by make and model.",
        )  # fmt: skip
        button(
            workspace, "Reproduce the paper", frame.REPRODUCE, "home_reproduce", width="stretch",
            icon="article",
            help="Page Reproduce: the paper's Bode plots, its four panels and its tables.",
        )  # fmt: skip
        with st.container(horizontal=True, vertical_alignment="center"):
            reproduction.table_buttons(workspace, "home")


# What can be opened at one click


def _show_samples(workspace: Workspace) -> None:
    st.caption("Synthetic recordings with known true parameters: what is learned can be checked.")
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
