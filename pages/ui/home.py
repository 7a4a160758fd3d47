"""The page Home: the session so far, the ways to a recording, and examples at one click."""

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import plotly.graph_objects as go
import streamlit as st

from accpinn.channels import PARAMETERS
from accpinn.methods.pinn.config import CALIBRATED, FAST, PinnConfig
from accpinn.model.cthp import Case, Parameters
from accpinn.model.published import PUBLISHED, ParameterSet
from accpinn.recordings import files
from accpinn.results import reproduction as paper
from accpinn.results.figures.recording import speeds_thumbnail
from accpinn.results.figures.stability import gains_thumbnail
from accpinn.segment.cut import cut
from accpinn.study.store import Entry
from pages.ui.components import frame, show
from pages.ui.components.parameter_picker import EXAMPLE
from pages.ui.components.show import escape_markdown, select, tabs
from pages.ui.data.sources import OPENING, drop_zone, find_run, open_file
from pages.ui.platoon import open_panels
from pages.ui.session.resources import FIRST_SAMPLE, SAMPLES, sample_title, samples
from pages.ui.session.sessions import SESSION, Shown, recent_sessions, runs_to_see
from pages.ui.session.workspace import Workspace
from pages.ui.snapshots.listing import show_runs

CARDS = 5
"""In a row."""
MARK, NEEDS = ":blue[:material/check_circle:]", ":gray[:material/database:]"
"""Computed here; needs a training."""


def show_page(workspace: Workspace) -> None:
    st.title("Learn a car's cruise control from a recorded drive", anchor=False)
    recent = recent_sessions(workspace.id)
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
        "Reproduce the paper": lambda: show_checklist(workspace),
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
                for name, shown in recent:
                    asked = shown.analysis
                    about = f"{asked.source.name}, {frame.in_words(asked.window, asked.windows)}"
                    st.page_link(
                        frame.TRAIN if shown.result else frame.DATA, label=escape_markdown(about),
                        icon=":material/history:", query_params={SESSION: name},
                    )  # fmt: skip


def _button(
    workspace: Workspace, label: str, page: str, key: str, help: str, icon: str = "",
    act: Callable[[], object] = lambda: None, **look: Any,
) -> None:  # fmt: skip
    """A button that does something and turns to a page; where that is refused, it says why."""
    picture = f":material/{icon}:" if icon else None

    def turn() -> None:
        act()
        frame.go(page, workspace)

    if st.button(label, key=f"home_{key}", help=help, icon=picture, **look):
        show.attempt(turn)


def _ways_in(workspace: Workspace) -> None:
    left, right = st.columns((2, 1), gap="large")
    with left.container(key="home_drop"):
        drop_zone(workspace, then=frame.DATA)
    with right:
        _button(
            workspace, "Train a sample now", frame.TRAIN, "train", width="stretch", type="primary",
            icon="play_arrow", act=lambda: _train_sample(workspace, FIRST_SAMPLE, CALIBRATED),
            help="Opens the first sample below and trains on its windows in car-following by the"
            " calibrated preset, which disturbances do not bias.",
        )  # fmt: skip
        st.caption("Motorway cars: three synthetic followers; the result comes within seconds.")
        _button(
            workspace, "Other ways to open a recording", frame.DATA, "own", width="stretch",
            icon="upload_file", act=lambda: st.session_state.update({OPENING: True}),
            help="Page Data, with the field for a file and the server's folder.",
        )  # fmt: skip
        _button(
            workspace, "Database of makes and models", frame.DATABASE, "database", width="stretch",
            icon="database",
            help="Page Database: every window of a folder of recordings, by make and model.",
        )  # fmt: skip


def _train_sample(
    workspace: Workspace, path: Path, config: PinnConfig, case: Case | None = None
) -> None:
    open_file(workspace, path)
    workspace.preset = config.preset
    workspace.choose(case=case or workspace.asked.case)
    workspace.train(config)


# What can be opened at one click


def _show_samples(workspace: Workspace) -> None:
    st.caption("Synthetic recordings with known true parameters: what is learned can be checked.")
    for column, path in zip(st.columns(CARDS), samples()[:CARDS], strict=False):
        with column.container(border=True, height="stretch", vertical_alignment="distribute"):
            name, _, about = sample_title(path).partition(": ")
            st.markdown(f"**{name}**")
            _picture(_speeds(path), f"home_{path.stem}")
            st.caption(about.capitalize())
            _button(
                workspace, "Open", frame.DATA, f"open_{path.stem}", width="stretch",
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
            _picture(gains_thumbnail(published), f"home_{published.title}")
            st.caption(", ".join(published.names))
            with st.container(horizontal=True):
                for name, page in (("Stability", frame.STABILITY), ("Platoon", frame.PLATOON)):
                    _button(
                        workspace, name, page, f"{published.title}_{name}",
                        help=f"Page {name}, with these printed parameters.",
                        act=partial(_take_published, workspace, published),
                    )  # fmt: skip


def _picture(figure: go.Figure, key: str) -> None:
    st.plotly_chart(figure, key=key, config={"staticPlot": True})


@st.cache_resource(max_entries=8, show_spinner=False)
def _speeds(path: Path) -> go.Figure:
    return speeds_thumbnail(cut(files.read(path)))


# The paper's tables and figures: what comes out here, and what leads to it


def show_checklist(workspace: Workspace) -> None:
    """A row for each table and figure: printed beside computed, and the buttons that do it."""
    st.caption(
        "Apostolakis and Ampountolas, IEEE Transactions on Vehicular Technology, 2024. What follows"
        " from printed parameters is computed at once; learning takes a recording, or a synthetic"
        " sample in its place."
    )
    for item in paper.ITEMS:
        _show_item(workspace, item)
    names = {one.vehicles.title: (item, one) for item in paper.ITEMS for one in item.verdicts}
    chosen = select(
        "Printed beside computed", {name: name for name in names}, [*names][-2], "home_printed",
        workspace, width=420,
        help="The verdicts as printed, and those that follow from the printed parameters; beside"
        " them what this session learned from the same window, once it has.",
    )  # fmt: skip
    item, printed = names[chosen]
    table = paper.reproduction_table(printed, _learned(workspace, item, printed))
    show.table(table)
    show.downloads(table, chosen, "home_printed")


def _show_item(workspace: Workspace, item: paper.PrintedItem) -> None:
    key = item.title.replace(" ", "").replace(",", "")
    with st.container(border=True):
        widths = (0.9, 2.3, 0.9, 1, 3.3)
        title, words, criteria, learned, buttons = st.columns(widths, vertical_alignment="center")
        title.markdown(f"**{item.title}**")
        at_once = item.verdicts or item.shown or not (item.run or item.sample)
        criteria.caption(f"{MARK} criteria recomputed" if at_once else "–")
        learned.caption(_deviation(workspace, item))
        said = [item.subject + ".", item.outcome]
        said += [f"Needs the recording {item.run}."] if item.run else []
        words.caption(escape_markdown(" ".join(filter(None, said))))
        with buttons.container(horizontal=True, horizontal_alignment="right"):
            _show_buttons(workspace, item, f"{key}_")


def _deviation(workspace: Workspace, item: paper.PrintedItem) -> str:
    """How far what this session learned from an item's recording lies from what is printed."""
    if item.run is None:
        return "–"
    printed = item.verdicts[0] if item.verdicts else None
    if printed and (learned := _learned(workspace, item, printed)):
        most = 100 * np.abs(learned.values / printed.vehicles.parameters.values - 1).max(axis=0)
        off = (f"{q.symbol} {value:.0f} %" for q, value in zip(PARAMETERS, most, strict=True))
        return f"{MARK} learned; deviation at most {', '.join(off)}"
    if not printed and runs_of(workspace, item.run):
        return f"{MARK} learned from the recording"
    return f"{NEEDS} parameters not learned yet"


def _show_buttons(workspace: Workspace, item: paper.PrintedItem, key: str) -> None:
    """What leads to an item: a sample's training, its recording, its parameters, or the panels."""
    path, run = SAMPLES / f"{item.sample}.csv", item.run
    if item.starts:
        _button(
            workspace, "Five starts on the sample", frame.COMPARE, f"{key}starts", icon="casino",
            act=lambda: _train_starts(workspace, path),
            help="Opens the synthetic study, trains it from five initial values with the fast"
            " preset, and shows page Compare.",
        )  # fmt: skip
    elif item.sample:
        _button(
            workspace, "Train the sample", frame.TRAIN, f"{key}sample", icon="play_arrow",
            act=lambda: _train_sample(workspace, path, FAST, run.case if run else None),
            help="Opens the synthetic recording made from the printed parameters, and trains on"
            " it.",
        )  # fmt: skip
    if run:
        opening = find_run(workspace, run.campaign, run.file)
        _button(
            workspace, "Open the recording", frame.DATA, f"{key}run", disabled=opening is None,
            act=lambda: _open_run(workspace, run, opening),
            help=f"With {run.window} and these vehicles." if opening else f"{run.file} is not at"
            " hand: drop it above, or start the app with a folder that has it.",
        )  # fmt: skip
    for vehicles in item.shown:
        name = vehicles.title.partition(" (")[0].partition(",")[0]
        _button(
            workspace, f"Stability: {name.removeprefix('Ispra-')}", frame.STABILITY, f"{key}{name}",
            icon="vital_signs", act=partial(_take_published, workspace, vehicles),
            help="Page Stability, with these printed parameters.",
        )  # fmt: skip
    if not (run or item.sample or item.shown):
        _button(
            workspace, "Platoon: four panels", frame.PLATOON, f"{key}panels",
            act=lambda: open_panels(workspace), help="Page Platoon, with the four panels.",
        )  # fmt: skip


def _train_starts(workspace: Workspace, path: Path) -> None:
    open_file(workspace, path)
    workspace.train_starts(FAST)


def _open_run(
    workspace: Workspace, run: paper.PrintedRun, opening: Callable[[], None] | None
) -> None:
    """Open the paper's recording with its window."""
    if opening:
        opening()
        workspace.choose(run.window, vehicles=run.vehicles, case=run.case)


def _take_published(workspace: Workspace, vehicles: ParameterSet) -> None:
    """Let pages Stability and Platoon show a published set."""
    workspace.choose_source("published")
    workspace.choices[EXAMPLE] = vehicles.title


def _learned(
    workspace: Workspace, item: paper.PrintedItem, printed: paper.PrintedVerdicts
) -> Parameters | None:
    """What this session learned for the rows of a table; None before."""
    if item.run is None or printed is not item.verdicts[0]:
        return None  # the other platoon's run is not known
    if item.starts:
        task, recording, run = workspace.starts, workspace.recording, item.run
        chosen = (workspace.asked.window, workspace.asked.vehicles) == (run.window, run.vehicles)
        is_same = recording is not None and run.is_of(recording) and chosen
        learned = [result.parameters[0] for result in task.results] if task and is_same else []
        return Parameters.stack(learned) if len(learned) == len(printed.vehicles) else None
    runs = runs_of(workspace, item.run)
    return Parameters.of(runs[0].parameters[: len(printed.vehicles)]) if runs else None


def runs_of(workspace: Workspace, run: paper.PrintedRun) -> list[Entry]:
    """The session's finished runs of that recording, window, vehicles and Case, newest first."""
    return [
        entry
        for entry in workspace.runs
        if (entry.source, entry.window, entry.numbers) == (run.file, str(run.window), run.vehicles)
        and entry.campaign in ("", run.campaign)
        and (entry.case == run.case or len(run.vehicles) == 2)
    ]
