"""The paper's tables and figures as a checklist: what comes out here, and what leads to it."""

import streamlit as st

from accpinn.methods.pinn.config import FAST
from accpinn.model.cthp import Parameters
from accpinn.model.published import ParameterSet
from accpinn.results.reproduction import ITEMS, PrintedItem, PrintedRun, PrintedVerdicts
from accpinn.results.tables.verification import reproduction_table
from accpinn.study.store import Entry
from pages.ui.components import frame, show
from pages.ui.components.show import escape_markdown
from pages.ui.data.sources import find_run, open_with
from pages.ui.platoon.page import open_panels
from pages.ui.session.recordings import SAMPLES, sample
from pages.ui.session.workspace import Workspace

MARK, NEEDS = ":blue[:material/check_circle:]", ":gray[:material/database:]"
"""Computed here; needs a training."""


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
    workspace.parameter_choice.example = vehicles.title
    workspace.platoon_choice.reset()


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
