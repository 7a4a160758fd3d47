"""The paper's tables and figures: what comes out here beside what is printed, and the way there.

A table of the paper takes two clicks: its button opens recording, window, vehicles, Case and preset
on page Train, and the training's result stands there beside the printed one.
"""

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import streamlit as st

from accpinn.methods.pinn.config import PresetName
from accpinn.model.cthp import Case, Parameters
from accpinn.model.published import ParameterSet
from accpinn.model.registry import PAPER
from accpinn.results import reproduction as paper
from accpinn.study.store import Entry
from pages.ui.components import frame, show
from pages.ui.components.parameter_picker import EXAMPLE
from pages.ui.components.show import escape_markdown, select
from pages.ui.data.sources import find_run, open_file
from pages.ui.platoon import open_panels
from pages.ui.session.resources import SAMPLES
from pages.ui.session.workspace import Workspace

MARK, NEEDS = ":blue[:material/check_circle:]", ":gray[:material/database:]"
"""Computed here; needs a training."""
TABLES = {item: item.run for item in paper.ITEMS if item.run and item.verdicts}
"""Tables I to III, and what each takes."""


# One table, from its recording to its numbers


def open_table(workspace: Workspace, run: paper.PrintedRun) -> None:
    """Choose of the open recording what a table takes, and the preset that gives it."""
    if workspace.recording:
        workspace.choose_all(run.analysis(workspace.recording))
        workspace.choices.pop("train_tabs", None)  # the first has the table


def table_buttons(workspace: Workspace, place: str) -> None:
    """A button for each table whose recording is at hand; it turns to page Train."""
    said = False
    for item, run in TABLES.items():
        opening = find_run(workspace, run.campaign, run.file)
        here = workspace.recording and run.is_of(workspace.recording)
        if opening is None or (place == "data" and not here):
            continue

        if not said:
            st.caption("The paper's", width="content")
            said = True

        def take(run: paper.PrintedRun = run, opening: Callable[[], None] = opening) -> None:
            opening()
            open_table(workspace, run)
            st.session_state[frame.TURN] = frame.TRAIN

        st.button(
            item.title, icon=":material/article:", key=f"{place}_{_key(item)}", on_click=take,
            help=f"Chooses what the paper took: {run}. Start training then gives its table.",
        )  # fmt: skip


def _rows(learned: Parameters, printed: paper.PrintedVerdicts) -> Parameters:
    """What was learned for the rows of a table; one set for all where it has more rows."""
    rows = len(printed.vehicles)
    return learned[: rows if len(learned) >= rows else 1]


# All of them, on page Home


def show_checklist(workspace: Workspace) -> None:
    """A row for each table and figure: printed beside computed, and the buttons that do it."""
    st.caption(
        "Apostolakis and Ampountolas, IEEE Transactions on Vehicular Technology, 2024. What follows"
        " from printed parameters is computed at once; learning takes a recording, or a synthetic"
        " sample in its place."
    )
    for item in paper.ITEMS:
        _show_item(workspace, item)
    st.caption(show.bullets(paper.inconsistencies()))
    names = {one.vehicles.title: (item, one) for item in paper.ITEMS for one in item.verdicts}
    chosen = select(
        "Printed beside computed", {name: name for name in names}, [*names][-2], "home_printed",
        workspace, width=420,
        help="The verdicts as printed, and those that follow from the printed parameters; beside"
        " them what this session learned from the same window, once it has.",
    )  # fmt: skip
    item, printed = names[chosen]
    is_first = printed is item.verdicts[0]  # the other platoon's run is not known
    table = paper.reproduction_table(printed, _learned(workspace, item) if is_first else None)
    show.table(table)
    show.downloads(table, chosen, "home_printed")


def _show_item(workspace: Workspace, item: paper.PrintedItem) -> None:
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
            _show_buttons(workspace, item)


def _deviation(workspace: Workspace, item: paper.PrintedItem) -> str:
    """How far what this session learned from an item's recording lies from what is printed."""
    if item.run is None:
        return "–"
    if item.verdicts and (learned := _learned(workspace, item)):
        return escape_markdown(paper.learned_line(item.verdicts[0], learned))
    if not item.verdicts and runs_of(workspace, item.run):
        return f"{MARK} learned from the recording"
    return f"{NEEDS} parameters not learned yet"


def _show_buttons(workspace: Workspace, item: paper.PrintedItem) -> None:
    """What leads to an item: a sample's training, its recording, its parameters, or the panels."""
    path, run, key = SAMPLES / f"{item.sample}.csv", item.run, _key(item)
    if item.starts:
        button(
            workspace, "Five starts on the sample", frame.COMPARE, f"{key}_starts", icon="casino",
            act=lambda: _train_starts(workspace, path),
            help="Opens the synthetic study, trains it from five initial values with the fast"
            " preset, and shows page Compare.",
        )  # fmt: skip
    elif item.sample:
        button(
            workspace, "Train the sample", frame.TRAIN, f"{key}_sample", icon="play_arrow",
            act=lambda: train_sample(workspace, path, "fast", run.case if run else None),
            help="Opens the synthetic recording made from the printed parameters, and trains on"
            " it.",
        )  # fmt: skip
    if run:
        opening = find_run(workspace, run.campaign, run.file)

        def open_run() -> None:
            if opening:
                opening()
                open_table(workspace, run)

        button(
            workspace, "Open on Train", frame.TRAIN, f"{key}_run", disabled=opening is None,
            act=open_run,
            help=f"With {run} and the preset {run.preset}." if opening else f"{run.file} is not at"
            " hand: drop it above, or start the app with a folder that has it.",
        )  # fmt: skip
    for vehicles in item.shown:
        name = vehicles.title.partition(" (")[0].partition(",")[0]
        button(
            workspace, f"Stability: {name.removeprefix('Ispra-')}", frame.STABILITY,
            f"{key}_{name}", icon="vital_signs", act=partial(take_published, workspace, vehicles),
            help="Page Stability, with these printed parameters.",
        )  # fmt: skip
    if not (run or item.sample or item.shown):
        button(
            workspace, "Platoon: four panels", frame.PLATOON, f"{key}_panels",
            act=lambda: open_panels(workspace), help="Page Platoon, with the four panels.",
        )  # fmt: skip


def button(
    workspace: Workspace, label: str, page: str, key: str, help: str, icon: str = "",
    act: Callable[[], object] = lambda: None, **look: Any,
) -> None:  # fmt: skip
    """A button of page Home that does something and turns to a page; refused, it says why."""
    picture = f":material/{icon}:" if icon else None

    def turn() -> None:
        act()
        frame.go(page, workspace)

    if st.button(label, key=f"home_{key}", help=help, icon=picture, **look):
        show.attempt(turn)


def train_sample(
    workspace: Workspace, path: Path, preset: PresetName, case: Case | None = None
) -> None:
    """Open a sample, and train on it by a preset."""
    open_file(workspace, path)
    workspace.preset = preset
    workspace.choose(case=case or workspace.asked.case)
    workspace.train()


def take_published(workspace: Workspace, vehicles: ParameterSet) -> None:
    """Let pages Stability and Platoon show a published set."""
    workspace.choose_source("published")
    workspace.choices[EXAMPLE] = vehicles.title


def _train_starts(workspace: Workspace, path: Path) -> None:
    open_file(workspace, path)
    workspace.train_starts("fast")


def _learned(workspace: Workspace, item: paper.PrintedItem) -> Parameters | None:
    """What this session learned last for the rows of a table; None before."""
    runs = runs_of(workspace, item.run) if item.run else []
    return _rows(Parameters.of(runs[0].parameters), item.verdicts[0]) if runs else None


def runs_of(workspace: Workspace, run: paper.PrintedRun) -> list[Entry]:
    """The session's finished runs of what a table takes, by the paper's method, newest first."""
    windows = ", ".join(map(str, run.windows))
    return [
        entry
        for entry in workspace.runs
        if (entry.source, entry.window, entry.numbers) == (run.file, windows, run.vehicles)
        and entry.campaign in ("", run.campaign)
        and (entry.case == run.case or len(run.vehicles) == 2)
        and entry.model == PAPER
        and entry.preset in (run.preset, "paper")
    ]


def _key(item: paper.PrintedItem) -> str:
    return item.title.replace(" ", "").replace(",", "")
