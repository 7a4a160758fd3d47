"""The page Reproduce: the paper's figures, and each table printed, recomputed and learned.

What follows from printed parameters is drawn at once. One button trains what the tables take, one
after the other, from the recordings at hand; the recording that is open stays open. The button of
a table, on pages Home and Data too, opens its recording, window, vehicles, Case and preset on page
Train.
"""

import html
import re
from collections.abc import Callable
from functools import cache, partial
from pathlib import Path
from typing import Any

import plotly.graph_objects as go
import streamlit as st

from accpinn.channels import PARAMETERS
from accpinn.findings import joined
from accpinn.methods.pinn.config import PAPER_PRESETS, QUICK, PresetName
from accpinn.model.cthp import Case, Parameters
from accpinn.model.published import ASTAZERO, VICOLUNGO, ParameterSet
from accpinn.model.registry import PAPER
from accpinn.recordings import Recording, files
from accpinn.recordings.openacc import catalogue
from accpinn.results import reproduction as paper
from accpinn.results.figures.platoon import panels_thumbnail, paper_panels
from accpinn.results.figures.stability import colours, gains_thumbnail, paper_bode
from accpinn.results.figures.style import LEADER, MODEL, in_height
from accpinn.study import Analysis
from accpinn.study.store import Entry
from accpinn.tasks import Part
from accpinn.units import Seconds
from pages.ui.components import frame, show
from pages.ui.components.monitor import monitor, stop_button
from pages.ui.components.parameter_picker import EXAMPLE
from pages.ui.components.show import escape_markdown, select, tabs
from pages.ui.data.sources import OPENING, RUN, find_run, open_file, place_of_run
from pages.ui.platoon import open_eight
from pages.ui.session.resources import SAMPLES
from pages.ui.session.workspace import Workspace

TABLES = {item: item.run for item in paper.ITEMS if item.run and item.verdicts}
"""Tables I to III, with the run of each."""
TABLE_III = [*TABLES][-1]
"""The paper's figures are drawn from its parameters."""
CITATION = "Apostolakis and Ampountolas, IEEE Transactions on Vehicular Technology, 2024."
SECONDS: Seconds = 1.5
"""Typical time of a training by the preset fast, for each follower."""
BODE_HEIGHT, PANEL_HEIGHT, THUMBNAIL_HEIGHT = 250, 142, 56
"""Heights in pixels, with which figures and tables stand above the fold."""
PRINTED_PARAMETERS = f"{paper.PRINTED}: {', '.join(q.symbol for q in PARAMETERS)}"
"""Heading of the printed parameters."""
ROW_WIDTHS = (0.75, 1.1, 4.5)
"""Widths of a row's picture, name and cells."""
_LETTER = re.compile(r"\b([a-d]) (?=[\d+−a-z])")
"""A panel's letter before its value."""


# The page


def show_page(workspace: Workspace) -> None:
    learned = {item: _learned(workspace, item) for item in TABLES}
    figures = learned[TABLE_III]
    _show_task(workspace, paper.verdict(learned))
    _show_figures(figures)
    _show_headings()
    for item in TABLES:
        picture = gains_thumbnail(item.verdicts[0].vehicles, learned[item])
        _show_row(item, item.compared(learned[item]), picture)
    peaks, panels = paper.compared_peaks(figures), paper.compared_panels(figures)
    _show_row(paper.BODE, peaks, gains_thumbnail(ASTAZERO, figures))
    _show_row(paper.EIGHT, panels, panels_thumbnail(figures))
    tabs(workspace, "paper_tabs", {
        "Numbers": lambda: _show_numbers(workspace),
        "Text and tables": _show_inconsistencies,
        "One at a time": lambda: _show_items(workspace),
    })  # fmt: skip


def _show_task(workspace: Workspace, verdict: str) -> None:
    """The button that trains for all tables, the state so far, and missing recordings."""
    task = workspace.reproduction
    parts, missing = _trainings(workspace)
    with st.container(horizontal=True, vertical_alignment="center"):
        if task and task.is_active:
            stop_button(task, "Stop", "paper_stop")
        else:
            lacking = [title for titles in missing.values() for title in titles]
            titles = [item.title for item in TABLES if item.title not in lacking]
            seconds = show.format_duration(sum(part.seconds for part in parts))
            label = f"Reproduce {joined(titles) if missing and titles else 'all'}"
            st.button(
                f"{label} (about {seconds})" if parts else label, type="primary",
                icon=":material/play_arrow:", key="paper_all", disabled=not parts,
                on_click=workspace.reproduce, args=(parts,),
                help="Trains by the preset fast on the paper's windows. What is open stays open.",
            )  # fmt: skip
        st.markdown(f"**{escape_markdown(verdict)}**", width="stretch")
    if task:
        count = len(task.results)
        monitor(task, is_stale=lambda: len(task.results) != count)
    if not missing:
        return
    with st.container(gap="xxsmall"):
        for (campaign, file), titles in missing.items():
            _show_missing(campaign, file, titles)


def _trainings(workspace: Workspace) -> tuple[list[Part], dict[tuple[str, str], list[str]]]:
    """Trainings that the recordings at hand allow, and the tables of each missing recording."""
    parts, missing = list[Part](), dict[tuple[str, str], list[str]]()
    for item, run in TABLES.items():
        place = place_of_run(workspace, *run.place)
        if place is None:
            missing.setdefault(run.place, []).append(item.title)
            continue
        analyses = cache(partial(_asked, item, place))
        for k in range(item.trainings):
            parts.append(
                Part(
                    f"{item.title}, start {k + 1}" if item.starts else item.title,
                    partial(_nth, analyses, k),
                    SECONDS * (len(run.vehicles) - 1),
                    is_listed=not k,
                )
            )
    return parts, missing


def _asked(item: paper.PrintedItem, place: Recording | Path) -> list[tuple[Analysis, Recording]]:
    """The analyses of a table with their recording.

    Raises:
        RecordingError: where the file cannot be read, or is not the paper's.
    """
    recording = place if isinstance(place, Recording) else files.opened(place).read()
    return [(analysis, recording) for analysis in item.analyses(recording)]


def _nth(
    analyses: Callable[[], list[tuple[Analysis, Recording]]], k: int
) -> tuple[Analysis, Recording]:
    """One analysis of several; the recording is read when its turn comes."""
    return analyses()[k]


def _show_missing(campaign: str, file: str, titles: list[str]) -> None:
    """Which recording is not at hand, and the way to it."""

    def choose() -> None:
        runs = (run for run in catalogue() if (run.campaign, run.file) == (campaign, file))
        st.session_state.update({OPENING: True, RUN: next(runs, None)})
        st.session_state[frame.TURN] = frame.DATA

    with st.container(horizontal=True, vertical_alignment="center"):
        need = f"{_tables(titles)} {campaign}/{file}, which is not on this server."
        st.markdown(f":orange[:material/database:] {escape_markdown(need)}", width="content")
        st.button(
            "Download it on Data", key=f"paper_get_{show.stem_of(file)}", type="tertiary",
            icon=":material/download:", on_click=choose,
            help="Page Data, with this run chosen. A file of yours can be dropped there, too.",
        )  # fmt: skip


def _tables(titles: list[str]) -> str:
    """Tables as the subject of a sentence, with its verb."""
    if len(titles) == 1:
        return f"{titles[0]} needs"
    return f"Tables {joined([title.removeprefix('Table ') for title in titles])} need"


def _show_figures(learned: Parameters | None) -> None:
    """Both Bode plots with the text's values, and the four panels on one scale."""
    left, right = st.columns(2, gap="medium")
    with left:
        with st.container(horizontal=True, vertical_alignment="center"):
            st.markdown("**Figure 7: Bode magnitude**", width="content")
            dashed = "" if learned is None else "learned"
            show.key([("text's peak", MODEL)], dashed=dashed, dotted="frequencies of Figure 8")
        for vehicles, cell in zip((ASTAZERO, VICOLUNGO), st.columns(2), strict=True):
            with cell:
                dashes = learned if vehicles is ASTAZERO else None
                figure = paper_bode(vehicles, dashes, BODE_HEIGHT)
                show.chart(figure, f"paper_bode_{show.stem_of(vehicles.title)}")
                show.key([*zip(vehicles.labels, colours(vehicles), strict=True)])
    with right:
        with st.container(horizontal=True, vertical_alignment="center"):
            st.markdown("**Figure 8: eight behind a sinusoid of 1 m/s**", width="content")
            show.key([("Leader", LEADER)])
        panels = zip(paper.PANELS, paper_panels(PANEL_HEIGHT), strict=True)
        for _ in range(2):
            for cell in st.columns(2):
                panel, figure = next(panels)
                with cell:
                    show.chart(figure, f"paper_panel_{panel.letter}")


def _show_headings() -> None:
    """The headings of the rows; on a narrow screen each cell has its own."""
    headings = (PRINTED_PARAMETERS, paper.RECOMPUTED, paper.LEARNED, paper.DEVIATION)
    with st.container(key="paper_headings"):
        *_, cells = st.columns(ROW_WIDTHS)
        written = (f"<div>{what}</div>" for what in headings)
        cells.html(f'<div class="paper-row paper-headings">{"".join(written)}</div>')


def _show_row(item: paper.PrintedItem, comparison: paper.Comparison, picture: go.Figure) -> None:
    """A row of an item: picture, name, printed, recomputed and learned values, deviation."""
    with st.container(key=f"paper_{_key(item)}"):
        thumbnail, name, cells = st.columns(ROW_WIDTHS, vertical_alignment="center")
        with thumbnail:
            show.picture(in_height(picture, THUMBNAIL_HEIGHT), f"paper_{_key(item)}_picture")
        brief = item.subject.partition(":")[0]
        name.markdown(f"**{item.title}**  \n:small[{escape_markdown(brief)}]")
        parts = {
            PRINTED_PARAMETERS if item in TABLES else paper.PRINTED: comparison.printed,
            paper.RECOMPUTED: comparison.recomputed,
            paper.LEARNED: comparison.learned or "–",
            paper.DEVIATION: comparison.deviation or "–",
        }
        written = (f"<div><b>{what}</b>{_unbroken(text)}</div>" for what, text in parts.items())
        cells.html(f'<div class="paper-row">{"".join(written)}</div>')


def _unbroken(text: str) -> str:
    """A cell for a web page, in which no line breaks behind a letter or within a range."""
    unbroken = _LETTER.sub("\\1\N{NO-BREAK SPACE}", html.escape(text))
    return unbroken.replace("–", "\N{WORD JOINER}–\N{WORD JOINER}")


def _learned(workspace: Workspace, item: paper.PrintedItem) -> Parameters | None:
    """The latest estimate of this session for the first rows of a table; None before one."""
    task = workspace.reproduction
    learned = item.learned(task.results) if task else None
    runs = runs_of(workspace, item.run) if item.run and learned is None else []
    if runs:
        count = len(item.verdicts[0].vehicles)
        return paper.rows_of(Parameters.of(runs[0].parameters), count)
    return learned


# Details


def _show_numbers(workspace: Workspace) -> None:
    """Each row of a table: printed beside recomputed and learned."""
    names = {part.vehicles.title: (item, part) for item in paper.ITEMS for part in item.verdicts}
    chosen = select(
        "Printed beside computed", {name: name for name in names}, [*names][-2], "paper_printed",
        workspace, width=420,
        help="The verdicts as printed, and those that follow from the printed parameters; beside"
        " them what this session learned from the same window, once it has.",
    )  # fmt: skip
    item, printed = names[chosen]
    is_first = printed is item.verdicts[0]  # the other platoon's run is not known
    table = paper.reproduction_table(printed, _learned(workspace, item) if is_first else None)
    show.table(table)
    show.downloads(table, chosen, "paper_printed")


def _show_inconsistencies() -> None:
    st.caption(CITATION)
    st.caption(show.bullets(paper.inconsistencies()))


def _show_items(workspace: Workspace) -> None:
    """Every table and figure, with the buttons that lead to it."""
    for item in paper.ITEMS:
        with st.container(border=True):
            words, buttons = st.columns((1.4, 2), vertical_alignment="center")
            subject = "" if item in (*TABLES, paper.BODE, paper.EIGHT) else item.subject
            words.markdown(f"**{item.title}** {escape_markdown(subject)}")
            with buttons.container(horizontal=True, horizontal_alignment="right"):
                _show_buttons(workspace, item)


# One table, from its recording to its numbers


def open_table(workspace: Workspace, run: paper.PrintedRun) -> None:
    """Select a table's windows, vehicles and preset in the open recording."""
    if workspace.recording:
        workspace.choose_all(run.analysis(workspace.recording))
        workspace.choices.pop("train_tabs", None)  # the first has the table


def table_buttons(workspace: Workspace, place: str) -> None:
    """A button for each table whose recording is at hand; it turns to page Train."""
    is_titled = False
    for item, run in TABLES.items():
        opening = find_run(workspace, run.campaign, run.file)
        here = workspace.recording and run.is_of(workspace.recording)
        if opening is None or (place == "data" and not here):
            continue

        if not is_titled:
            st.caption("The paper's", width="content")
            is_titled = True

        def take(run: paper.PrintedRun = run, opening: Callable[[], None] = opening) -> None:
            opening()
            open_table(workspace, run)
            st.session_state[frame.TURN] = frame.TRAIN

        st.button(
            item.title, icon=":material/article:", key=f"{place}_{_key(item)}", on_click=take,
            help=f"Chooses what the paper took: {run}. Start training then gives its table.",
        )  # fmt: skip


def _show_buttons(workspace: Workspace, item: paper.PrintedItem) -> None:
    """The buttons of an item: train a sample, open its recording, its parameters, or the panels."""
    path, run, key = SAMPLES / f"{item.sample}.csv", item.run, _key(item)
    if item.starts:
        button(
            workspace, "Five starts on the sample", frame.COMPARE, f"paper_{key}_starts",
            icon="casino", act=lambda: _train_restarts(workspace, path),
            help="Opens the synthetic study, trains it from five initial values with the fast"
            " preset, and shows page Compare.",
        )  # fmt: skip
    elif item.sample:
        button(
            workspace, "Train the sample", frame.TRAIN, f"paper_{key}_sample", icon="play_arrow",
            act=lambda: train_sample(workspace, path, QUICK, run.case if run else None),
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
            workspace, "Open on Train", frame.TRAIN, f"paper_{key}_run", act=open_run,
            disabled=opening is None,
            help=f"With {run} and the preset {run.preset}." if opening
            else f"{run.file} is not at hand.",
        )  # fmt: skip
    for vehicles in item.shown:
        name = vehicles.title.partition(" (")[0].partition(",")[0]
        button(
            workspace, f"Stability: {name.removeprefix('Ispra-')}", frame.STABILITY,
            f"paper_{key}_{name}", icon="vital_signs",
            act=partial(take_published, workspace, vehicles),
            help="Page Stability, with these printed parameters.",
        )  # fmt: skip
    if not (run or item.sample or item.shown):
        for panel in sorted(paper.PANELS, key=lambda panel: panel.letter):
            button(
                workspace, f"Platoon: ({panel.letter})", frame.PLATOON,
                f"paper_{key}_{panel.letter}", help="Page Platoon, with this panel.",
                act=partial(open_eight, workspace, ASTAZERO, panel.vehicle, panel.frequency),
            )  # fmt: skip


def button(
    workspace: Workspace, label: str, page: str, key: str, help: str, icon: str = "",
    act: Callable[[], object] = lambda: None, **look: Any,
) -> None:  # fmt: skip
    """A button that acts and turns to a page, or reports why it was refused."""
    picture = f":material/{icon}:" if icon else None

    def turn() -> None:
        act()
        frame.go(page, workspace)

    if st.button(label, key=key, help=help, icon=picture, **look):
        show.attempt(turn)


def train_sample(
    workspace: Workspace, path: Path, preset: PresetName, case: Case | None = None
) -> None:
    """Open a sample, and train on it by a preset."""
    open_file(workspace, path)
    workspace.preset = preset
    workspace.choose(case=case or workspace.selection.case)
    workspace.train()


def take_published(workspace: Workspace, vehicles: ParameterSet) -> None:
    """Let pages Stability and Platoon show a published set."""
    workspace.choose_source("published")
    workspace.choices[EXAMPLE] = vehicles.title


def _train_restarts(workspace: Workspace, path: Path) -> None:
    open_file(workspace, path)
    workspace.train_restarts(QUICK)


def runs_of(workspace: Workspace, run: paper.PrintedRun) -> list[Entry]:
    """The session's finished runs for a table by the paper's method, newest first."""
    windows = ", ".join(map(str, run.windows))
    return [
        entry
        for entry in workspace.runs
        if (entry.source, entry.window, entry.numbers) == (run.file, windows, run.vehicles)
        and entry.campaign in ("", run.campaign)
        and (entry.case == run.case or len(run.vehicles) == 2)
        and entry.model == PAPER
        and entry.preset in PAPER_PRESETS
    ]


def _key(item: paper.PrintedItem) -> str:
    return item.title.replace(" ", "").replace(",", "")
