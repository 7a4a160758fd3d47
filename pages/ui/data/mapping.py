"""What the columns of a table of one's own hold: a form that begins with likely answers.

A guess takes both a column's name and its first numbers, and no column is guessed twice; where none
is likely, the field asks.
"""

import re
from collections.abc import Sequence
from contextlib import suppress
from typing import Any

import numpy as np
import streamlit as st
from msgspec.structs import replace

from accpinn.recordings.mapping import (
    GAP_UNITS,
    SPEED_UNITS,
    TIME_UNITS,
    CsvMapping,
    GapColumn,
    ModeColumn,
    SpeedColumn,
    TimeColumn,
    parse_mapping,
    recall,
)
from accpinn.recordings.tables import Layout
from accpinn.results.tables import Column, Table
from pages.ui.components import show
from pages.ui.components.show import escape_markdown

CHOOSE = "choose…"
NONE = "(none)"
EVEN = "(even steps)"
MOST_VEHICLES = 11
PREVIEWED = 12
"""Columns of a preview."""
FASTEST = 45.0
"""m/s; a larger value is likely to be in km/h."""
EVEN_WITHIN = 0.01
"""Largest spread of the steps of time, as a share, in a column whose name does not say time."""
LIKELY = {
    "time": ("time", "t", "timestamp", "stamp"),
    "speed": ("speed", "velocity", "vel", "v"),
    "gap": ("gap", "ivs", "spacing", "distance", "dist", "range", "headway", "ahead"),
}
"""Words that the names of columns hold."""
LARGEST = {"speed": 300.0, "gap": 1000.0}
"""Values beyond which a column holds something else, in any unit of speed, and in m."""


def ask_for_columns(name: str, table: Layout) -> CsvMapping | None:
    """The table's beginning, and what its columns hold: by a form, or by a file in its place.

    Returns:
        None, with a sentence on the page, while a column is to be chosen or is chosen twice.
    """
    st.markdown(
        f"**Which columns of {escape_markdown(name)} hold what?** The answer is remembered for"
        " files with the same columns."
    )
    _show_preview(table)
    return _uploaded() or _form(tuple(name for name in table.names if name), table)


def _show_preview(layout: Layout) -> None:
    columns = [
        (Column(name or f"column {k + 1}"), [row[k] if k < len(row) else "" for row in layout.rows])
        for k, name in enumerate(layout.names[:PREVIEWED])
    ]
    show.table(Table.of("", columns))
    if hidden := layout.names[PREVIEWED:]:
        st.caption(f"{len(hidden)} more columns: {escape_markdown(', '.join(hidden))}")


def _uploaded() -> CsvMapping | None:
    """The mapping of a JSON file that was given in place of the form."""
    with st.popover("Use a mapping file", icon=":material/upload_file:"):
        upload = st.file_uploader(
            "A mapping as JSON, as the command line takes it.", type="json",
            key="data_mapping_upload", max_upload_size=1,
        )  # fmt: skip
    if upload is None:
        return None
    return show.attempt(lambda: parse_mapping(upload.getvalue(), upload.name))


def _form(names: Sequence[str], table: Layout) -> CsvMapping | None:
    """A row of fields for each vehicle; they begin with what is remembered, else with guesses."""
    asked = (CHOOSE, *names)
    begin = _guessed(names, table)
    if known := recall(table.names):
        speeds = (*known.speeds, *begin.speeds[len(known.speeds) :])
        gaps = (*known.gaps, *begin.gaps[len(known.gaps) :])
        begin = replace(known, speeds=speeds, gaps=gaps)
    guesses = sum(speed.column != CHOOSE for speed in begin.speeds)
    usual = len(known.speeds) if known else max(2, guesses)
    columns = st.columns((1, 1.2, 0.8, 1.2), vertical_alignment="bottom")
    count = columns[0].number_input(
        "Vehicles", 2, MOST_VEHICLES, usual, key="data_map_vehicles",
        help="Leader and followers, in their order on the road.",
    )  # fmt: skip
    time, sample_time = _time(names, table, begin, columns[1:3])
    trajectory = _pick(
        "Runs told apart by", (NONE, *names), begin.trajectory or NONE, columns[3],
        "data_map_runs", "Of a table with several runs: the column that names them.",
    )  # fmt: skip
    chosen_speeds, chosen_gaps = list[SpeedColumn](), list[GapColumn]()
    for k, speed in enumerate(begin.speeds[: int(count)]):
        cells = st.columns((1.3, 0.7, 1, 1.3, 0.7, 0.8), vertical_alignment="bottom")
        column = _pick(
            "Leader's speed" if k == 0 else f"Speed of vehicle {k + 1}", asked, speed.column,
            cells[0], f"data_map_speed_{k}", "The column of the vehicle's own speed.",
        )  # fmt: skip
        before = st.session_state.get(f"data_map_unit_of_{k}", speed.column)
        if column != before:  # the unit begins with what the numbers of the new column suggest
            st.session_state[f"data_map_speed_unit_{k}"] = _speed_unit(table, column)
        st.session_state[f"data_map_unit_of_{k}"] = column
        chosen_speeds.append(SpeedColumn(
            column=column,
            unit=_pick("Unit", [*SPEED_UNITS], speed.unit, cells[1],
                       f"data_map_speed_unit_{k}", "Of that column."),
            name=cells[2].text_input(
                "Make and model", speed.name, max_chars=60, key=f"data_map_name_{k}",
                help="As tables and charts are to show it.",
            ),
        ))  # fmt: skip
        if k == 0:
            continue
        gap = begin.gaps[k - 1]
        chosen_gaps.append(GapColumn(
            column=_pick("Space-gap ahead", asked, gap.column, cells[3], f"data_map_gap_{k}",
                         "From bumper to bumper, to the vehicle ahead."),
            unit=_pick("Unit", [*GAP_UNITS], gap.unit, cells[4], f"data_map_gap_unit_{k}",
                       "Of that column."),
            subtract=cells[5].number_input(
                "Less [m]", value=gap.subtract, step=0.5, key=f"data_map_subtract_{k}",
                help="Length of the vehicle ahead, where the column is a distance of positions.",
            ),
        ))  # fmt: skip
    modes = _modes(names, table, known, int(count))
    held = [time.column] if time else []
    held += [*(speed.column for speed in chosen_speeds), *(gap.column for gap in chosen_gaps)]
    twice = sorted({name for name in held if held.count(name) > 1} - {CHOOSE})
    if twice:
        show.messages(f"{', '.join(twice)}: a column holds one thing; it is chosen twice.", "error")
        return None
    if CHOOSE in held:
        show.messages("Choose the columns that their names do not tell.")
        return None
    return CsvMapping(
        speeds=tuple(chosen_speeds),
        gaps=tuple(chosen_gaps),
        time=time,
        sample_time=sample_time,
        modes=modes,
        trajectory=None if trajectory == NONE else trajectory,
    )


def _guessed(names: Sequence[str], table: Layout) -> CsvMapping:
    """What names and first numbers suggest, for the most vehicles; `CHOOSE` where they do not."""
    times = [name for name in names if _is_time(table, name)]
    times.sort(key=lambda name: not _is_named(name, "time"))
    rest = [name for name in names if name not in times[:1]]
    speeds = [name for name in rest if _is_likely(table, name, "speed")]
    gaps = [name for name in rest if name not in speeds and _is_likely(table, name, "gap")]
    speeds += [CHOOSE] * MOST_VEHICLES
    gaps += [CHOOSE] * MOST_VEHICLES
    return CsvMapping(
        speeds=tuple(SpeedColumn(s, _speed_unit(table, s)) for s in speeds[:MOST_VEHICLES]),
        gaps=tuple(GapColumn(name) for name in gaps[: MOST_VEHICLES - 1]),
        time=TimeColumn(times[0], _time_unit(table, times[0])) if times else None,
    )


def _modes(
    names: Sequence[str], table: Layout, known: CsvMapping | None, count: int
) -> tuple[ModeColumn, ...]:
    before = {mode.vehicle: mode for mode in (known.modes if known else ())}
    modes = []
    with st.expander("Who drives: ACC or a human", expanded=bool(before)):
        st.caption(
            "Say who drives, if a column tells: else nobody knows whether the parameters are ACC's."
        )
        for vehicle in range(1, count + 1):
            old = before.get(vehicle)
            cells = st.columns((1.3, 1, 1), vertical_alignment="bottom")
            title = "Mode of the leader" if vehicle == 1 else f"Mode of vehicle {vehicle}"
            column = _pick(
                title, (NONE, *names), old.column if old else NONE, cells[0],
                f"data_map_mode_{vehicle}", "The column that says who controls the vehicle.",
            )  # fmt: skip
            if column == NONE:
                continue
            likely = ("1", "0") if {*_cells(table, column)} <= {"0", "1", ""} else ("ACC", "Human")
            acc = cells[1].text_input(
                "Under ACC it says", ", ".join(old.acc) if old else likely[0],
                key=f"data_map_acc_{vehicle}", help="One word, or several separated by commas.",
            )  # fmt: skip
            human = cells[2].text_input(
                "Under a human", ", ".join(old.human) if old else likely[1],
                key=f"data_map_human_{vehicle}", help="One word, or several separated by commas.",
            )  # fmt: skip
            modes.append(ModeColumn(vehicle, column, _words(acc), _words(human)))
    return tuple(modes)


def _words(text: str) -> tuple[str, ...]:
    return tuple(word.strip() for word in text.split(",") if word.strip())


def _time(
    names: Sequence[str], table: Layout, begin: CsvMapping, columns: Sequence[Any]
) -> tuple[TimeColumn | None, float | None]:
    known = begin.time
    column = _pick(
        "Time", (*names, EVEN), known.column if known else EVEN, columns[0], "data_map_time",
        "The column of time, or even steps between rows.",
    )  # fmt: skip
    if column == EVEN:
        step = columns[1].number_input(
            "Step [s]", 0.001, 5.0, begin.sample_time or 0.1, format="%.3f",
            key="data_map_step", help="Between two rows.",
        )  # fmt: skip
        return None, float(step)
    unit = known.unit if known else _time_unit(table, column)
    return TimeColumn(
        column,
        _pick("Unit", [*TIME_UNITS], unit, columns[1], "data_map_time_unit", "Of that column."),
    ), None


def _pick(label: str, options: Sequence[str], default: str, place: Any, key: str, help: str) -> str:
    index = list(options).index(default) if default in options else 0
    return str(place.selectbox(label, options, index, key=key, help=help))


def _is_named(name: str, what: str) -> bool:
    """Whether a column's name says that it holds this."""
    return any(word in LIKELY[what] for word in re.findall("[a-z]+", name.lower()))


def _is_time(table: Layout, name: str) -> bool:
    """Whether the first numbers grow from row to row, and evenly where the name does not say so."""
    steps = np.diff(_numbers(table, name))
    grows = len(steps) > 1 and bool((steps > 0).all())
    return grows and (_is_named(name, "time") or bool(np.ptp(steps) < EVEN_WITHIN * steps.mean()))


def _is_likely(table: Layout, name: str, what: str) -> bool:
    """Whether name and first numbers are those of speeds, or of gaps."""
    values = _numbers(table, name)
    return _is_named(name, what) and all(0 <= value < LARGEST[what] for value in values)


def _numbers(table: Layout, name: str) -> list[float]:
    """The first cells of a column, as far as they are numbers."""
    numbers = []
    for cell in _cells(table, name):
        with suppress(ValueError):
            numbers.append(float(cell.replace(table.decimal, ".")))
    return numbers


def _cells(table: Layout, name: str) -> list[str]:
    if name == CHOOSE:
        return []
    at = table.names.index(name)
    return [row[at].strip() for row in table.rows if at < len(row)]


def _time_unit(table: Layout, name: str) -> str:
    """The unit with which rows are as far apart as those of recordings."""
    cells = _numbers(table, name)
    step = abs(cells[1] - cells[0]) if len(cells) > 1 else 0.1
    return next((unit for unit in ("s", "ms", "µs", "ns") if step * TIME_UNITS[unit] < 5.0), "s")


def _speed_unit(table: Layout, name: str) -> str:
    """km/h where speeds in m/s would be those of no car."""
    return "km/h" if max(_numbers(table, name), default=0.0) > FASTEST else "m/s"
