"""The page Home: the session so far, the ways to a recording, and examples at one click."""

from functools import cache, partial
from pathlib import Path

import plotly.graph_objects as go
import streamlit as st

from accpinn.methods.pinn.config import CALIBRATED
from accpinn.model.published import PUBLISHED
from accpinn.results.figures.recording import speeds_thumbnail
from accpinn.results.figures.stability import gains_thumbnail
from accpinn.segment.cut import cut
from accpinn.study.store import Entry
from pages.ui.components import frame, show
from pages.ui.components.show import escape_markdown
from pages.ui.components.widgets import tabs
from pages.ui.data.sources import ask_for_upload, drop_zone, open_with
from pages.ui.platoon.page import open_panels
from pages.ui.reproduction import open_published, show_checklist
from pages.ui.runs import restore_run
from pages.ui.session.recordings import FIRST_SAMPLE, sample, sample_title, samples
from pages.ui.session.workspace import Workspace
from pages.ui.snapshots.listing import first_estimate, title_of

LAST_RUNS = 3
CARDS = 4
"""In a row."""
_gains = cache(gains_thumbnail)
_STYLE = """<style>
.st-key-home_drop [data-testid="stFileUploaderDropzone"] { min-height: 7.5rem;
  align-items: center; justify-content: center; }
</style>"""


def show_page() -> None:
    """Draw the page."""
    workspace = frame.begin("")
    st.html(_STYLE)
    st.title("Learn a car's cruise control from a recorded drive", anchor=False)
    entries = workspace.runs
    if workspace.recording or workspace.restored or entries:
        _continue(workspace, entries)
    else:
        st.markdown(
            "accpinn estimates the gains α and β and the time headway τ of a car's **adaptive"
            " cruise control** from a recorded drive, with intervals, and says whether such cars"
            " amplify disturbances."
        )
    _ways_in(workspace)
    drawn = {
        "Samples": lambda: _show_samples(workspace),
        "Published parameters": lambda: _show_published(workspace),
        "Reproduce the paper": lambda: show_checklist(workspace),
    }
    tabs(workspace, "home_tabs", drawn)


def _continue(workspace: Workspace, entries: tuple[Entry, ...]) -> None:
    """What is open, and the last finished runs."""
    with st.container(border=True):
        session, runs = st.columns((1, 1.7), gap="large")
        with session:
            if workspace.recording or workspace.restored:
                st.markdown("**Continue**  \n" + "  \n".join(frame.session_state(workspace)))
                if workspace.training or workspace.restored:
                    frame.link(frame.TRAIN, "Back to the result", workspace)
                else:
                    frame.link(frame.DATA, "Back to the recording", workspace)
            else:
                st.markdown("**Continue** with a finished run of this session.")
        with runs:
            if entries:
                st.markdown("**Last runs**")
            for entry in entries[:LAST_RUNS]:
                _show_run(workspace, entry)


def _show_run(workspace: Workspace, entry: Entry) -> None:
    """A finished run in one line, and the button that shows it on every page again."""
    line, button = st.columns((5, 1), vertical_alignment="center")
    line.caption(
        f"{escape_markdown(title_of(entry))} · {escape_markdown(entry.source)} · {entry.window}  \n"
        f"{escape_markdown(first_estimate(entry))}"
    )
    if button.button("Open", key=f"home_run_{entry.id}", help="Show this run on every page again."):
        restore_run(workspace, entry.id)
        frame.go(frame.TRAIN, workspace)


def _ways_in(workspace: Workspace) -> None:
    """A field for a file of the user's own, and a result without one."""
    left, right = st.columns((2, 1), gap="large")
    with left.container(key="home_drop"):
        if drop_zone(workspace, announce=True):
            frame.go(frame.DATA, workspace)
    with right:
        if st.button(
            "Train a sample now", type="primary", icon=":material/play_arrow:", width="stretch",
            help="Opens the first sample below and trains on its first 300 s by the calibrated"
            " preset, which disturbances do not bias.",
        ):  # fmt: skip
            _train_sample(workspace)
        st.caption("A synthetic platoon of four followers; the result comes within seconds.")
        if st.button(
            "Load your own OpenACC recording", icon=":material/upload_file:", width="stretch",
            help="Page Data, with the field for a file and the server's folder.",
        ):  # fmt: skip
            ask_for_upload()
            frame.go(frame.DATA, workspace)
        if st.button(
            "Compare makes and models", icon=":material/database:",
            width="stretch", key="home_database",
            help="Page Database: every window of a folder of recordings, by make and model.",
        ):  # fmt: skip
            frame.go(frame.DATABASE, workspace)


def _train_sample(workspace: Workspace) -> None:
    open_with(workspace, lambda: sample(FIRST_SAMPLE))
    if not workspace.refusal:
        workspace.preset = CALIBRATED.preset
        workspace.train(CALIBRATED)
        frame.go(frame.TRAIN, workspace)
    show.messages(workspace.refusal, "error")


# What can be opened at one click


def _show_samples(workspace: Workspace) -> None:
    """A card for each sample."""
    st.caption("Synthetic recordings with known true parameters: what is learned can be checked.")
    for column, path in zip(st.columns(CARDS), samples()[:CARDS], strict=False):
        with column.container(border=True, height="stretch"):
            name, _, about = sample_title(path).partition(": ")
            st.markdown(f"**{name}**")
            _picture(_speeds(path), f"home_{path.stem}")
            st.caption(about.capitalize())
            if st.button(
                "Open", key=f"home_open_{path.stem}", width="stretch",
                help="Page Data, with this sample.",
            ):  # fmt: skip
                open_with(workspace, partial(sample, path))
                frame.go(frame.DATA, workspace)


def _show_published(workspace: Workspace) -> None:
    """A card for each set of parameters that the paper prints, and one for its last figure."""
    st.caption(
        "The paper's parameters need no recording. The pictures are Bode magnitudes: above the"
        " line a disturbance grows from car to car."
    )
    columns = [*st.columns(3), *st.columns(3)]
    for column, published in zip(columns, PUBLISHED, strict=False):
        with column.container(border=True, height="stretch"):
            title, _, table = published.title.partition(" (paper, ")
            st.markdown(f"**{table.rstrip(')')}: {title}**")
            _picture(_gains(published), f"home_{published.title}")
            st.caption(", ".join(published.names))
            open_published(workspace, published, "home")
    with columns[len(PUBLISHED)].container(border=True, height="stretch"):
        st.markdown("**Figure 8: four panels**")
        st.caption(
            "Eight followers behind a leader whose speed oscillates at 0.25 and 0.3 rad/s, with the"
            " parameters of the Mercedes and the Tesla."
        )
        if st.button("Platoon", key="home_panels", help="Page Platoon, with the four panels."):
            open_panels(workspace)
            frame.go(frame.PLATOON, workspace)


def _picture(figure: go.Figure, key: str) -> None:
    st.plotly_chart(figure, key=key, config={"staticPlot": True})


@st.cache_resource(max_entries=8, show_spinner=False)
def _speeds(path: Path) -> go.Figure:
    return speeds_thumbnail(cut(sample(path)[0]))
