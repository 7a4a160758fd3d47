"""The page Home: the session so far, the ways to a recording, and examples at one click."""

from functools import partial
from pathlib import Path

import plotly.graph_objects as go
import streamlit as st

from accpinn.methods.pinn.config import CALIBRATED, FAST
from accpinn.model.cthp import Parameters
from accpinn.model.published import PUBLISHED, ParameterSet
from accpinn.results.figures.recording import speeds_thumbnail
from accpinn.results.figures.stability import gains_thumbnail
from accpinn.results.reproduction import ITEMS, PrintedItem, PrintedRun, PrintedVerdicts
from accpinn.results.tables.verification import reproduction_table
from accpinn.segment.cut import cut
from accpinn.study.store import Entry
from pages.ui.components import frame, show
from pages.ui.components.parameter_picker import EXAMPLE
from pages.ui.components.show import escape_markdown
from pages.ui.components.widgets import tabs
from pages.ui.data.sources import ask_for_upload, drop_zone, find_run, open_with
from pages.ui.platoon import open_panels
from pages.ui.session.resources import FIRST_SAMPLE, SAMPLES, sample, sample_title, samples
from pages.ui.session.workspace import Workspace
from pages.ui.snapshots.listing import first_estimate, restore_run, title_of

LAST_RUNS = 3
CARDS = 4
"""In a row."""
_STYLE = """<style>
.st-key-home_drop [data-testid="stFileUploaderDropzone"] { min-height: 7.5rem;
  align-items: center; justify-content: center; }
</style>"""
MARK, NEEDS = ":blue[:material/check_circle:]", ":gray[:material/database:]"
"""Computed here; needs a training."""


def show_page() -> None:
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
    line, button = st.columns((5, 1), vertical_alignment="center")
    line.caption(
        f"{escape_markdown(title_of(entry))} · {escape_markdown(entry.source)} · {entry.window}  \n"
        f"{escape_markdown(first_estimate(entry))}"
    )
    if button.button("Open", key=f"home_run_{entry.id}", help="Show this run on every page again."):
        restore_run(workspace, entry.id)
        frame.go(frame.TRAIN, workspace)


def _ways_in(workspace: Workspace) -> None:
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
            _picture(gains_thumbnail(published), f"home_{published.title}")
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


# The paper's tables and figures: what comes out here, and what leads to it


def show_checklist(workspace: Workspace) -> None:
    """A row for each table and figure: printed beside computed, and the buttons that do it."""
    st.caption(
        "Apostolakis and Ampountolas, IEEE Transactions on Vehicular Technology, 2024. What follows"
        " from printed parameters is computed at once; the rest takes a recording, or a synthetic"
        " sample in its place."
    )
    for item in ITEMS:
        _show_item(workspace, item)
    names = {one.vehicles.title: (item, one) for item in ITEMS for one in item.verdicts}
    chosen = st.selectbox(
        "Printed beside computed",
        list(names),
        index=len(names) - 2,
        key="home_printed",
        width=420,
        help="The verdicts as printed, and those that follow from the printed parameters; beside"
        " them what this session learned from the same window, once it has.",
    )
    item, printed = names[chosen]
    table = reproduction_table(printed, _learned(workspace, item, printed))
    show.table(table)
    show.downloads(table, chosen, "home_printed")


def _show_item(workspace: Workspace, item: PrintedItem) -> None:
    key = item.title.replace(" ", "").replace(",", "")
    with st.container(border=True):
        title, words, buttons = st.columns((1, 3, 2.6), vertical_alignment="center")
        at_once = item.verdicts or item.shown or not (item.run or item.sample)
        computed = at_once or bool(item.run and runs_of(workspace, item.run))
        title.markdown(f"{MARK if computed else NEEDS} **{item.title}**")
        said = [item.subject + ".", item.outcome]
        said += [f"Takes {item.run}."] if item.run else []
        words.caption(escape_markdown(" ".join(filter(None, said))))
        with buttons.container(horizontal=True, horizontal_alignment="right"):
            if item.starts:
                _starts_button(workspace, item, key)
            elif item.sample:
                _sample_button(workspace, item, key)
            if item.run:
                _run_button(workspace, item.run, key)
            for vehicles in item.shown:
                _published_button(workspace, vehicles, key)
            if not (item.run or item.sample or item.shown) and st.button(
                "Four panels", key=f"home_{key}_panels", help="Page Platoon, with the four panels."
            ):
                open_panels(workspace)
                frame.go(frame.PLATOON, workspace)


def _learned(
    workspace: Workspace, item: PrintedItem, printed: PrintedVerdicts
) -> Parameters | None:
    """What this session learned for the rows of a table; None before."""
    if item.run is None or printed is not item.verdicts[0]:
        return None  # the other platoon's run is not known
    if item.starts:
        task, segment = workspace.starts, workspace.segment
        run, recording = item.run, workspace.recording
        is_same = (
            segment is not None
            and recording is not None
            and recording.campaign in (None, run.campaign)
            and (segment.source, segment.window, segment.vehicles)
            == (run.file, run.window, run.vehicles)
        )
        learned = [result.parameters[0] for result in task.results] if task and is_same else []
        return Parameters.stack(learned) if len(learned) == len(printed.vehicles) else None
    runs = runs_of(workspace, item.run)
    return Parameters.of(runs[0].parameters[: len(printed.vehicles)]) if runs else None


def runs_of(workspace: Workspace, run: PrintedRun) -> list[Entry]:
    """The session's finished runs of that recording, window, vehicles and Case, newest first."""
    return [
        entry
        for entry in workspace.runs
        if (entry.source, entry.window, entry.numbers) == (run.file, str(run.window), run.vehicles)
        and entry.campaign in ("", run.campaign)
        and (entry.case == run.case or len(run.vehicles) == 2)
    ]


def _open_sample(workspace: Workspace, item: PrintedItem) -> None:
    open_with(workspace, lambda: sample(SAMPLES / f"{item.sample}.csv"))


def _starts_button(workspace: Workspace, item: PrintedItem, key: str) -> None:
    if st.button(
        "Five starts on the sample", key=f"home_{key}_starts", icon=":material/casino:",
        help="Opens the synthetic study, trains it from five initial values with the fast preset,"
        " and shows page Compare.",
    ):  # fmt: skip
        _open_sample(workspace, item)
        workspace.train_starts(FAST)
        frame.go(frame.COMPARE, workspace)


def _sample_button(workspace: Workspace, item: PrintedItem, key: str) -> None:
    case = item.run.case if item.run else workspace.case
    if st.button(
        "Train the sample", key=f"home_{key}_sample", icon=":material/play_arrow:",
        help="Opens the synthetic recording made from the printed parameters, and trains on it.",
    ):  # fmt: skip
        _open_sample(workspace, item)
        workspace.choose(case=case)
        workspace.train(FAST)
        frame.go(frame.TRAIN, workspace)


def _run_button(workspace: Workspace, run: PrintedRun, key: str) -> None:
    """Open the recording with the paper's window, where it is at hand."""
    load = find_run(workspace, run.campaign, run.file)
    if st.button(
        "Open the recording", key=f"home_{key}_run", disabled=load is None,
        help=f"With {run.window} and these vehicles."
        if load
        else f"{run.file} is not at hand: drop it above, or start the app with a folder that has"
        " it.",
    ) and load:  # fmt: skip
        open_with(workspace, load)
        if not workspace.refusal:
            workspace.choose(run.vehicles, run.window, run.case)
            frame.go(frame.DATA, workspace)


def _published_button(workspace: Workspace, vehicles: ParameterSet, key: str) -> None:
    name = vehicles.title.partition(" (")[0].partition(",")[0]
    if st.button(
        name.removeprefix("Ispra-"), key=f"home_{key}_{name}", icon=":material/vital_signs:",
        help="Page Stability, with these printed parameters.",
    ):  # fmt: skip
        take_published(workspace, vehicles)
        frame.go(frame.STABILITY, workspace)


def take_published(workspace: Workspace, vehicles: ParameterSet) -> None:
    """Let pages Stability and Platoon show a published set."""
    workspace.choose_source("published")
    workspace.choose_parameters(**{EXAMPLE: vehicles.title})


def open_published(workspace: Workspace, vehicles: ParameterSet, key: str) -> None:
    """Buttons to the pages that show a published set."""
    with st.container(horizontal=True):
        for name, page in (("Stability", frame.STABILITY), ("Platoon", frame.PLATOON)):
            if st.button(
                name, key=f"{key}_{vehicles.title}_{name}",
                help=f"Page {name}, with these printed parameters.",
            ):  # fmt: skip
                take_published(workspace, vehicles)
                frame.go(page, workspace)
