"""The page Database: parameters of many vehicles by make, model and setting, with intervals.

A study is the folder of one batch of estimations on the server. The batch that fills it is in
`pages.ui.database.running`. What is read and grouped is kept as long as the study does not change.
"""

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any
from urllib.parse import urlencode

import pandas as pd
import plotly.graph_objects as go
import streamlit as st
from streamlit.delta_generator import DeltaGenerator

from accpinn.errors import ConfigError
from accpinn.methods.estimate import SPEEDS
from accpinn.methods.registry import COMPARED
from accpinn.recordings import Window
from accpinn.results import database as results
from accpinn.results.figures import database as figures
from accpinn.results.figures.stability import EXACT, L2
from accpinn.results.tables import Table
from accpinn.study import studies as on_disk
from accpinn.study.groups import BY, POSTERIOR, Group, Groups, group, read_study
from accpinn.study.studies import Failure
from accpinn.study.supplied import read_about, supplied_study
from pages.ui.components import frame, show
from pages.ui.components.show import bound, escape_markdown, select, tabs
from pages.ui.database import running, study_folders
from pages.ui.session.resources import find_recording, title_of_variant
from pages.ui.session.workspace import Workspace

FEW_GROUPS = 6
"""Rows of a table of groups before all are asked for."""
LISTED = 100
"""Failures that are shown; the file has all of them."""
TOOLS = ("zoom2d", "pan2d", "resetScale2d")
_number = st.column_config.NumberColumn
COLUMNS: dict[str, Any] = {
    **{name: results.HEADINGS[name] for name in (*BY, "campaign", "file")},
    "start": _number("From [s]", format="%.0f"),
    "tau": _number("τ [s]", format="%.2f"),
    "tau_low": _number("τ from", format="%.2f"),
    "tau_high": _number("τ to", format="%.2f"),
    "alpha": _number("α [1/s²]", format="%.3f"),
    "beta": _number("β [1/s]", format="%.3f"),
    "mean_time_gap": _number("Mean time gap [s]", format="%.2f"),
    "mean_speed": _number("Speed [m/s]", format="%.1f"),
    "p_l2_stable": _number("P(L₂)", format="percent"),
}
"""The columns of the list of rows, with headings and formats, by their names in the results."""
FILTERS: Mapping[str, str] = {name: results.HEADINGS[name] for name in (*BY, "campaign", "mode")}
"""Columns by which rows are chosen, with their labels."""
GROUPINGS: Mapping[str, tuple[str, tuple[str, ...]]] = {
    "make": ("Make", ("make",)),
    "model": ("Make and model", ("make", "model")),
    "setting": ("Model and setting", BY),
    "campaign": ("Campaign", ("campaign",)),
    "mode": ("Mode", ("mode",)),
}
"""Title and columns of each grouping, by a short name."""
ADDRESSED = ("study", "method", "by", *FILTERS)
"""Query parameters. What is chosen has the same names, which begin with "database_" there."""
NOT_TOLD = "not stated"
"""Stands for an empty cell."""
WRITTEN = "database_link"
"""The entry in Streamlit's session state with the parameters that this browser was last given."""
State = tuple[int, ...]
"""The state of a study by `state_of`; empty before its batch writes."""


@dataclass(frozen=True, eq=False)
class ShownRows:
    """The chosen rows of a study, grouped, with their picture."""

    rows: pd.DataFrame
    """Rows of one method; the index is the place among all rows of the study."""
    groups: Groups
    whole: Group | None
    """All rows as one group; None where there is no row."""
    makes: int
    recordings: int
    forest: go.Figure


def show_page(workspace: Workspace) -> None:
    _follow_link(workspace)
    names = study_folders.listed_studies(workspace.id)
    is_first = not names
    wanted = workspace.choices.get("database_study", "")
    if "@" in wanted:
        with suppress(ConfigError):
            study_folders.path_of(workspace.id, wanted)
            names = (wanted, *names)
    if supplied_study():
        names = (*names, study_folders.SUPPLIED)
    refused = wanted not in names and running.show_refusal(workspace, wanted)
    if not names:
        show.messages(
            "There is no study here yet. A study holds the estimates from every window in"
            " car-following under ACC of many recordings: choose these, then start."
        )
        with st.container(border=True):
            running.show_form(workspace)
        return
    study = wanted if wanted in names else names[0]
    if study != wanted and not refused:  # why a batch was refused stands until another is chosen
        if wanted:
            show.messages(
                f"There is no study {study_folders.title_of(wanted)[:60]} here.", "warning"
            )
        choose(workspace, study=study)
    with st.container(horizontal=True, vertical_alignment="bottom", key="database_head"):
        titles = dict[str, str]()
        for name in names:
            owner = name.rpartition("/")[0][1:7]
            whose = f" (of {owner})" if owner else " (by a link)" if "@" in name else ""
            titles[name] = study_folders.title_of(name) + whose
        select(
            "Study", titles, study, "database_study",
            lambda name: choose(workspace, study=name, method="", **dict.fromkeys(FILTERS, ())),
            width=280,
            help="The estimates from many recordings; your own come first, the one written to last"
            " on top.",
        )  # fmt: skip
        place = st.container(horizontal=True, vertical_alignment="bottom", width="content")
        _show_actions(workspace, study, is_first)
    show.attempt(lambda: _show_body(workspace, study, place))
    _write_link(workspace)


def choose(workspace: Workspace, **chosen: Any) -> None:
    """Choose other rows; the one row that was chosen is none of them."""
    changes = {f"database_{name}": value for name, value in chosen.items()}
    workspace.choices.update(changes, database_row=None)


def _show_body(workspace: Workspace, study: str, place: DeltaGenerator) -> None:
    """A study's batch and rows; their filters stand in ``place``."""
    folder = study_folders.path_of(workspace.id, study)
    state = on_disk.state_of(folder)
    running.show_batch(workspace, study, on_disk.read_request(folder) if state else None)
    rows = study_rows(str(folder), state) if state else pd.DataFrame()
    if len(rows):
        _show_study(workspace, study, state, rows, place)
        return
    show.messages(
        "The picture appears here within seconds of the first window that is done."
        if running.is_active(workspace, study) else "The study has no rows yet."
    )  # fmt: skip
    if state:
        _show_failures(on_disk.read_failures(folder), study)


def _show_actions(workspace: Workspace, study: str, is_first: bool) -> None:
    """The button for a study of one's own, and the link to the shown rows."""
    popover = st.popover(
        "Start your own" if is_first else "New study", icon=":material/playlist_add:",
        key="database_new", type="primary" if is_first else "secondary", on_change="rerun",
        help="Estimate the parameters from all windows of many recordings: dropped here, or in a"
        " folder of the server.",
    )  # fmt: skip
    if popover.open:
        with popover:
            running.show_form(workspace)
    with st.popover("Link", icon=":material/share:"):
        st.caption("It opens this study with these filters, without your session.")
        shared = study_folders.link_to(workspace.id, study)
        parameters = _parameters(workspace) | {"study": (shared,)}
        show.address(f"Database?{urlencode(parameters, doseq=True)}")


def _show_study(
    workspace: Workspace, study: str, state: State, rows: pd.DataFrame, place: DeltaGenerator
) -> None:
    folder, is_supplied = (
        study_folders.path_of(workspace.id, study),
        study == study_folders.SUPPLIED,
    )
    study = folder.name
    with place:
        filters, method, by = _show_filters(workspace, rows)
    selected = shown(str(folder), state, tuple(filters.items()), method, by)
    failures = on_disk.read_failures(folder)
    whole = selected.whole
    if whole is None:
        show.messages("No row has these properties; take a filter back.")
        return
    st.markdown(
        f"**{escape_markdown(results.headline(whole))}**",
        help=escape_markdown(results.further_vehicles(whole)) or None,
    )
    parts = (
        results.extent(whole, selected.makes, selected.recordings),
        results.typical_line(whole),
        results.batch_line(on_disk.read_request(folder)),
        results.failures_line(failures),
    )
    show.caption(" · ".join(filter(None, parts)))
    if is_supplied:
        show.caption(results.supplied_line(read_about(folder)), results.OPENACC)
    show.chart(selected.forest, "database_forest")
    _show_key(selected)
    tabs(workspace, "database_tabs", {
        "Time gap over speed": lambda: _show_gaps(workspace, rows, selected),
        "α–β plane": lambda: _show_plane(workspace, rows, selected),
        "Numbers": lambda: _show_groups(workspace, selected, f"{study}_by_{by}"),
        "Parameters": lambda: _show_few(
            workspace, results.group_parameters_table(selected.groups)
        ),
        "Spread": lambda: _show_spread(workspace, selected, f"{study}_spread_by_{by}"),
        "All rows": lambda: _show_rows(workspace, rows, selected, study),
        "Failures": lambda: _show_failures(failures, study),
    })  # fmt: skip


def _show_filters(
    workspace: Workspace, rows: pd.DataFrame
) -> tuple[dict[str, tuple[str, ...]], str, str]:
    """The controls; by column the values that are shown where not all are, method and grouping."""
    choices, filters = workspace.choices, dict[str, tuple[str, ...]]()
    values = {name: sorted(rows[name].unique()) for name in FILTERS}
    for name, offered in values.items():
        selected = choices[f"database_{name}"] = tuple(
            value for value in choices.get(f"database_{name}", ()) if value in offered
        )
        if selected:
            filters[name] = selected
    method = str(choices.get("database_method"))
    if method not in (methods := list(dict.fromkeys(rows["method"]))):
        method = COMPARED[0] if COMPARED[0] in methods else methods[0]
    choices["database_method"] = method
    by = choices["database_by"] = select(
        "Grouped by", {key: title for key, (title, _) in GROUPINGS.items()}, "setting",
        "database_by", workspace, width=180,
        help="What the rows of a group have in common.",
    )  # fmt: skip
    count = f" ({len(filters)})" if filters else ""
    with st.popover(f"Filter{count}", icon=":material/filter_alt:", key="database_filter"):
        for name, offered in values.items():

            def chosen(values: list[str], name: str = name) -> None:
                choose(workspace, **{name: tuple(values)})

            st.multiselect(
                FILTERS[name], offered, placeholder="All",
                **bound(f"database_{name}", list(filters.get(name, ())), chosen, default=""),
                help=f"Only rows with one of these; all where none is chosen. {len(offered)} are"
                " there.",
            )  # fmt: skip
    return filters, method, by


def _show_key(selected: ShownRows) -> None:
    """The meaning of the picture's marks, in short, and in full on hovering."""
    speed = SPEEDS[-1]
    hidden, level = len(selected.groups.groups) - figures.MOST_GROUPS, 100 * selected.groups.level
    more = f" {hidden} groups with fewer windows are in the table only." if hidden > 0 else ""
    rings = not all(group.is_driven(speed) for group in selected.groups.groups)
    ring = f" Ring: extrapolated, as no window reaches {3.6 * speed:.0f} km/h." if rings else ""
    show.caption(f"Bars: {level:.0f} % intervals.{ring}{more}", results.TYPICAL)


# What is read of a study


@st.cache_resource(max_entries=4, show_spinner="Reading the study …")
def study_rows(folder: str, state: State) -> pd.DataFrame:
    """All rows of a study in one state, with empty texts replaced.

    Raises:
        RecordingError: where there is no study.
    """
    frame = read_study(folder)
    for column in (*FILTERS, "method"):
        frame[column] = frame[column].replace("", None).fillna(NOT_TOLD).astype(str)
    return frame


@st.cache_resource(max_entries=32, show_spinner=False)
def shown(
    folder: str, state: State, filters: tuple[tuple[str, tuple[str, ...]], ...], method: str,
    by: str,
) -> ShownRows:  # fmt: skip
    """The chosen rows of a study, grouped, with their picture."""
    rows = study_rows(folder, state)
    for column, values in filters:
        rows = rows[rows[column].isin(values)]
    groups = group(rows, GROUPINGS[by][1])
    whole = next(iter(group(rows, ()).groups), None)
    makes, recordings = rows["make"].nunique(), rows["sha256"].nunique()
    rows = rows[rows["method"] == method]
    return ShownRows(rows, groups, whole, makes, recordings, figures.forest(groups))


# The address


def _follow_link(workspace: Workspace) -> None:
    """Apply the query parameters, unless this page has written them itself."""
    parameters = _asked()
    if parameters and parameters != st.session_state.get(WRITTEN):
        single = {name: (parameters.get(name) or ("",))[0] for name in ("study", "method", "by")}
        choose(workspace, **{name: parameters.get(name, ()) for name in FILTERS}, **single)
        st.session_state[WRITTEN] = parameters


def _write_link(workspace: Workspace) -> None:
    """Write the choices into the address, so that a reload and a bookmark find them again."""
    wanted, address = _parameters(workspace), st.query_params
    if wanted != _asked():
        others = {name: tuple(address.get_all(name)) for name in address}
        address.from_dict({n: v for n, v in others.items() if n not in ADDRESSED} | wanted)
    st.session_state[WRITTEN] = wanted


def _parameters(workspace: Workspace) -> dict[str, tuple[str, ...]]:
    """The query parameters of the present choices, with all values of each."""
    chosen = {name: workspace.choices.get(f"database_{name}") for name in ADDRESSED}
    return {
        name: (value,) if isinstance(value, str) else value
        for name, value in chosen.items()
        if value
    }


def _asked() -> dict[str, tuple[str, ...]]:
    address = st.query_params
    return {name: tuple(address.get_all(name)) for name in ADDRESSED if name in address}


# Tabs


def _show_few(workspace: Workspace, table: Table) -> None:
    """Draw the first rows of a table of groups, and all once they are asked for."""
    count, key = len(table.rows), "database_all_groups"
    is_short = count > FEW_GROUPS and not workspace.choices.get(key)
    show.table(replace(table, rows=table.rows[:FEW_GROUPS]) if is_short else table)
    if is_short:
        st.button(
            f"Show all {count} groups", key=f"{key}_more", type="tertiary",
            icon=":material/expand_more:", on_click=workspace.keep(key), args=(True,),
        )  # fmt: skip


def _show_groups(workspace: Workspace, selected: ShownRows, name: str) -> None:
    _show_few(workspace, results.ranking_table(selected.groups))
    show.caption(
        "Of several vehicles: their share, and in brackets that of all such vehicles.",
        "In brackets: intervals of the typical value. With one vehicle that is its own; with"
        " several it is that of all such vehicles, so it is wide where they are few. String stable:"
        " of one vehicle the probability. Measured: the median of the windows' mean time gaps, at"
        " whatever speed was driven.",
    )
    show.downloads(results.group_table(selected.groups), name, "database_groups")


def _show_spread(workspace: Workspace, selected: ShownRows, name: str) -> None:
    """How far the windows and the vehicles of each group differ."""
    table = results.spread_table(selected.groups)
    _show_few(workspace, table)
    st.caption(
        "Standard deviations beyond the sampling error of each window: two thirds of the windows,"
        " or of the vehicles, lie within them. Those of α, β and the time gap are relative. With"
        " few windows or vehicles they are mostly those of cars in general."
    )
    show.downloads(table, name, "database_spread")


def _choose_method(workspace: Workspace, rows: pd.DataFrame) -> str:
    """Choose whose rows are shown, window by window."""
    titles = {method: title_of_variant(method) for method in dict.fromkeys(rows["method"])}
    method = workspace.choices["database_method"]
    if len(titles) > 1:
        select(
            "Method", titles, method, "database_method",
            lambda method: choose(workspace, method=method),
            help="Of the rows; groups rest on the windows' posteriors.",
        )  # fmt: skip
    return f"Each window alone, {titles[method]}."


def _show_plane(workspace: Workspace, rows: pd.DataFrame, selected: ShownRows) -> None:
    """α and β of each row, and where string stability begins."""
    whose = _choose_method(workspace, rows)
    has_lines = figures.has_common_boundaries(selected.rows)
    lines = [("L₂ boundary", L2), ("L∞ boundary, exact (dashed)", EXACT)] if has_lines else []
    present = [look for look, part in figures.classified(selected.rows) if part.any()]
    show.key([*((name, colour) for name, colour, _ in present), *lines])
    figure = figures.plane(selected.rows)
    _chart(figure, "database_plane", workspace)
    boundary = "" if has_lines else (
        " No boundary is drawn: with a lag or a delay each vehicle has its own."
    )  # fmt: skip
    away = figures.beyond(figure)
    out = f" {away:,} of {len(selected.rows):,} rows lie beyond the axes." if away else ""
    st.caption(f"{whose}{boundary}{out} Click on a point to open its window.")
    _show_chosen(workspace, rows, selected)


def _show_gaps(workspace: Workspace, rows: pd.DataFrame, selected: ShownRows) -> None:
    parts = selected.rows[list(selected.groups.by)].itertuples(index=False, name=None)
    labels = tuple(map(results.label_of, parts))
    show.key([(name, colour) for name, (colour, _) in figures.colours(labels).items()])
    _chart(figures.gap_against_speed(selected.rows, labels), "database_gaps", workspace)
    st.caption(
        "Each point is a follower of one window. A constant time headway is a horizontal row of"
        " points. Click on a point to open its window."
    )
    _show_chosen(workspace, rows, selected)


def _chart(figure: go.Figure, key: str, workspace: Workspace) -> None:
    def clicked() -> None:
        place = show.clicked_data(st.session_state[key]["selection"]["points"])
        if place is not None:
            workspace.choices["database_row"] = int(place)

    show.chart(figure, key, TOOLS, on_select=clicked, selection_mode="points")


def _show_rows(workspace: Workspace, rows: pd.DataFrame, selected: ShownRows, study: str) -> None:
    """All rows that the filters leave; one of them can be chosen."""
    whose = _choose_method(workspace, rows)

    def picked() -> None:
        if chosen := st.session_state["database_rows"]["selection"]["rows"]:
            workspace.choices["database_row"] = int(chosen[0])

    # By a callback, as the browser goes on to report the row when other rows have taken its place.
    st.dataframe(
        results.guarded(selected.rows[list(COLUMNS)]), hide_index=True, height=420,
        on_select=picked, selection_mode="single-row", key="database_rows", column_config=COLUMNS,
    )  # fmt: skip
    st.caption(
        f"{len(selected.rows):,} rows. {whose} P(L₂): probability of L₂ string stability under the"
        " method's model. Click on a heading to sort, on the magnifier to search, on the left edge"
        " of a row to open its window."
    )
    _show_chosen(workspace, rows, selected)
    st.download_button(
        "CSV, all columns",
        lambda: results.guarded(selected.rows.drop(columns=POSTERIOR)).to_csv(index=False),
        f"{study}_rows.csv", "text/csv",
        on_click="ignore", icon=":material/download:", key="database_rows_csv",
        help="The rows shown, with intervals, stability and errors; results.parquet in the study's"
        " folder has all of them.",
    )  # fmt: skip


# One row


def _show_chosen(workspace: Workspace, rows: pd.DataFrame, selected: ShownRows) -> None:
    """The row that is chosen, and the way to its window."""
    place = workspace.choices.get("database_row")
    if place is None or place >= len(selected.rows):
        return
    row = selected.rows.iloc[place]
    with st.container(border=True, horizontal=True, vertical_alignment="center"):
        end = row["start"] + row["duration"]
        who = " ".join(part for part in (row["make"], row["model"]) if part != NOT_TOLD)
        numbers = (
            f"{row['campaign']}, {row['file']}, {row['start']:.0f}–{end:.0f} s, vehicle"
            f" {row['vehicle']}: α {row['alpha']:.3f} 1/s², β {row['beta']:.3f} 1/s, τ"
            f" {row['tau']:.2f} s"
        )
        st.markdown(f"**{escape_markdown(who)}**  \n{escape_markdown(numbers)}", width="stretch")
        if st.button(
            "Open this window", icon=":material/timeline:", type="primary", key="database_open",
            help="Page Data, with this recording, window and vehicles, ready to train.",
        ):  # fmt: skip
            _open(workspace, rows, row)


def _open(workspace: Workspace, rows: pd.DataFrame, row: "pd.Series[Any]") -> None:
    """Turn to page Data with a row's window."""
    trajectory = row["trajectory"] if isinstance(row["trajectory"], str) else None  # else nan
    recording = find_recording(row["file"], row["sha256"], trajectory)
    # All that the study has of the window, whatever the filters leave of it.
    window = rows[["sha256", "start", "duration", "leader"]].eq(
        row[["sha256", "start", "duration", "leader"]]
    )
    last = int(rows[window.all(axis=1)]["vehicle"].max())
    workspace.open(recording)
    workspace.choose(
        vehicles=tuple(range(int(row["leader"]), last + 1)),
        window=Window(float(row["start"]), float(row["start"] + row["duration"])),
        case=row["case"],
    )
    frame.go(frame.DATA, workspace)


# Failures


def _show_failures(failures: Sequence[Failure], study: str) -> None:
    if not failures:
        st.caption("No failure so far.")
        return
    show.table(results.failure_table(failures[:LISTED]))
    if len(failures) > LISTED:
        st.caption(f"{len(failures) - LISTED} more are in the file.")
    show.downloads(results.failure_table(failures), f"{study}_failures", "database_failures")
