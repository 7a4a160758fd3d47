"""What the columns of a table of one's own hold: a form that shows how they were understood.

Open are only those fields that nothing decides; all others are behind "Change columns". What is
chosen is kept in the session's `Pending`, so that plot and findings are always those of the form.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import isnan, nan
from typing import Any, Literal

import streamlit as st
from msgspec.structs import replace

from accpinn.channels import MAX_VEHICLES
from accpinn.findings import Finding
from accpinn.recordings import Recording, clocks
from accpinn.recordings.clocks import FRAME
from accpinn.recordings.consistency import Inconsistency
from accpinn.recordings.draft import Choice, Proposal, roles_of
from accpinn.recordings.files import contradictions
from accpinn.recordings.mapping import (
    LONGEST_SHIFT,
    TIME_UNITS,
    ByVehicle,
    CsvMapping,
    GapColumn,
    ModeColumn,
    SpeedColumn,
    TimeColumn,
    cured,
    cures_of,
    parse_mapping,
    write_mapping,
)
from accpinn.recordings.names import ColumnName
from accpinn.recordings.source import excerpt
from accpinn.results.figures.recording import beginning
from accpinn.results.figures.style import CLEAR, vehicle_colour
from accpinn.results.messages import messages
from accpinn.results.recording import cure_words
from accpinn.results.tables import Column, Table
from accpinn.units import GAP_UNITS, SPEED_UNITS
from pages.ui.components import show
from pages.ui.components.show import bound, escape_markdown, segments, select
from pages.ui.session.pending import Pending, is_complete, lacks_length
from pages.ui.session.workspace import Workspace

CHOOSE = ""
"""The name of a column that is to be chosen."""
NONE = ""
EVEN = "(even steps)"
LISTED = 8
"""Rows of the table of columns, if fewer are used; columns that are not used follow in a line."""
LONGEST_NUMBER, LONGEST_CELL = 9, 28
"""Characters that are shown of a number, and of the first values."""
MOST_CURES = 3
"""Buttons beside a finding."""
CHANGING = "data_map_changing"
"""The entry in Streamlit's session state that shows the fields of all columns."""
Change = Callable[[Callable[[CsvMapping], CsvMapping]], None]
"""Changes the mapping of the form by a function of it."""


def show_form(workspace: Workspace, pending: Pending, opened: Callable[[str | None], None]) -> None:
    """How the pending table is understood, what is open, and the button that opens it.

    Args:
        workspace: the session.
        pending: its pending table.
        opened: is called with the name of the run that is to be opened; None for the only one.
    """
    trajectory = _choose_run(workspace, pending)
    reading = pending.reading(trajectory)
    recording = reading if isinstance(reading, Recording) else None
    mapping = pending.mapping
    _show_header(pending, recording)
    is_open = False
    if mapping:
        is_open = _ask(workspace, pending, mapping)
        _show_columns(workspace, pending, mapping)
    if recording:
        _show_beginning(recording)
        if mapping:
            show_cures(
                recording, mapping, lambda new: _read_by(workspace, new), "data_form", "primary"
            )
        else:
            show.warnings(messages(recording.findings, recording), "the data")
    elif not is_open:
        show.messages(str(reading), "error")
    is_doubtful = recording is not None and bool(contradictions(recording))

    def cancel() -> None:
        workspace.pending = None
        show.forget_flash()

    with st.container(horizontal=True):
        st.button(
            "Open as it is" if is_doubtful else "Open", key="data_open_table",
            type="secondary" if is_doubtful else "primary", disabled=recording is None,
            on_click=opened, args=(trajectory,), icon=":material/arrow_forward:",
            help="What stands above contradicts the data; results would be wrong." if is_doubtful
            else "The recording over time on page Data, where one more click trains on it.",
        )  # fmt: skip
        st.button("Cancel", on_click=cancel, key="data_cancel")
    if mapping:
        _change_columns(workspace, pending, mapping)
    show.flashed()


def _choose_run(workspace: Workspace, pending: Pending) -> str | None:
    """The run that is to be opened, of a table with several."""
    runs = pending.runs
    if not runs:
        return None
    options = {name: f"{excerpt(name, 60)} · {count} vehicles" for name, count in runs}
    return select(
        f"{len(runs)} runs in {pending.file.content.name}; choose one", options, runs[0][0],
        "data_trajectory", workspace, width=420,
        help="Pairs whose leader is another pair's follower at the same time are one run.",
    )  # fmt: skip


def _show_header(pending: Pending, recording: Recording | None) -> None:
    parts = [f"**{escape_markdown(pending.file.content.name)}**"]
    if recording:
        parts += [
            f"{len(recording.present)} vehicles",
            f"{recording.duration:,.0f} s at {1 / recording.sample_time:.3g} Hz",
        ]
    st.markdown(" · ".join(parts))


def _show_beginning(recording: Recording) -> None:
    leader, *_ = recording.present
    show.key(
        [(recording.label(k), vehicle_colour(k, leader)) for k in recording.present],
        title="First minutes:",
    )
    show.chart(beginning(recording), "data_beginning")


def _read_by(workspace: Workspace, mapping: CsvMapping) -> None:
    """Read the pending table by another mapping."""
    if workspace.pending:
        workspace.pending = workspace.pending.read_by(mapping)


# Findings, and what cures them


def show_cures(
    recording: Recording, mapping: CsvMapping, act: Callable[[CsvMapping], None], place: str,
    look: Literal["primary", "secondary"] = "secondary",
) -> None:  # fmt: skip
    """What is wrong with the data, each with the changes of the mapping that would cure it.

    Args:
        recording: as it was read.
        mapping: by which it was.
        act: gets the mapping that a button stands for.
        place: begins the buttons' keys.
        look: of the likeliest cure's button.
    """
    against, offered = contradictions(recording), set[CsvMapping]()
    for k, finding in enumerate(against):
        if k < show.SHOWN:
            show.messages(finding.sentence(recording), "warning")
        if isinstance(finding, Inconsistency):
            with st.container(horizontal=True):
                for cure in cures_of(finding, mapping)[:MOST_CURES]:
                    new = cured(mapping, cure)
                    if new in offered:
                        continue
                    offered.add(new)
                    st.button(
                        cure_words(cure, mapping, finding.vehicle), on_click=act, args=(new,),
                        icon=":material/healing:", key=f"{place}_cure_{len(offered)}",
                        type=look if len(offered) == 1 else "secondary",
                        help="Changes how the columns are read; plot and findings are then new.",
                    )  # fmt: skip
    others = [finding for finding in recording.findings if finding not in against]
    others_said = messages(others, recording)
    left = against[show.SHOWN :]
    show.cautions(others_said[: show.SHOWN])
    rest: tuple[Finding, ...] = (*left, *others[show.SHOWN :])
    if rest:
        with st.expander(f"{len(rest)} more about the data"):
            st.markdown(show.bullets(messages(rest, recording)))


# What was understood


def _show_columns(workspace: Workspace, pending: Pending, mapping: CsvMapping) -> None:
    """A row for each column that is used, and for a few that are not."""
    choices = pending.file.proposal.choices
    is_kept = workspace.mappings.get(pending.file.names) == mapping
    roles: dict[str, list[tuple[str, str]]] = {}
    for name, role, unit in roles_of(mapping):
        roles.setdefault(name, []).append((role, unit))
    used = [choice for choice in choices if choice.column in roles]
    spare = [choice for choice in choices if choice.column not in roles]
    listed = spare[: max(0, LISTED - len(used))]
    rows = [choice for choice in choices if choice in used or choice in listed]
    remarks = _remarks(mapping)
    cells = [
        (
            Column("Column"),
            [excerpt(choice.column, 40) for choice in rows],
        ),
        (
            Column("First values"),
            [_first_values(choice) for choice in rows],
        ),
        (
            Column("Holds"),
            [
                ", ".join([*(role for role, _ in roles.get(choice.column, ())),
                           *remarks.get(choice.column, ())]) or "not used"
                for choice in rows
            ],
        ),
        (
            Column("Unit"),
            [next((unit for _, unit in roles.get(choice.column, ())), "") for choice in rows],
        ),
        (
            Column("Reason", prose=True),
            [_reason(choice, roles.get(choice.column, []), is_kept) for choice in rows],
        ),
    ]  # fmt: skip
    colours = [] if mapping.by else [_colour(mapping, choice.column) for choice in rows]
    show.table(Table.of("", cells), colours)
    rest = [choice.column for choice in spare if choice not in listed]
    if rest:
        show.caption(excerpt(f"{len(rest)} more are not used: {', '.join(rest)}", 200))


def _first_values(choice: Choice) -> str:
    """The first two cells of a column, digits of numbers cut; the first one where it is long."""
    cells = [cell or "–" for cell in choice.cells[:2]]
    if all(set(cell) <= set("+-.,0123456789eE–") for cell in cells):
        return ", ".join(excerpt(cell, LONGEST_NUMBER) for cell in cells)
    both = ", ".join(cells)
    return both if len(both) <= LONGEST_CELL else excerpt(cells[0], LONGEST_CELL)


def _reason(choice: Choice, roles: Sequence[tuple[str, str]], is_kept: bool) -> str:
    if not roles:
        return choice.reason if not choice.role else "as you chose"
    if (choice.role, choice.unit) == roles[0]:
        return choice.reason
    return "as for an earlier table with these columns" if is_kept else "as you chose"


def _remarks(mapping: CsvMapping) -> dict[str, list[str]]:
    """What else is done to columns: sign, clock, and what is subtracted."""
    remarks: dict[str, list[str]] = {}
    parts: tuple[SpeedColumn | GapColumn, ...] = (*mapping.speeds, *mapping.gaps)
    for part in parts:
        said = ["sign reversed"] * part.reversed
        said += [f"shifted by {part.shift:+g} s"] if part.shift else []
        if isinstance(part, GapColumn) and not isinstance(part.subtract, str) and part.subtract > 0:
            said.append(f"less {part.subtract:g} m")
        remarks[part.column] = said
    return remarks


def _colour(mapping: CsvMapping, column: str) -> str:
    """That of the vehicle whose speed or gap the column holds."""
    for k, speed in enumerate(mapping.speeds, 1):
        if column == speed.column:
            return vehicle_colour(k, 1)
    for k, gap in enumerate(mapping.gaps, 2):
        if column in (gap.column, gap.minus):
            return vehicle_colour(k - 1 if gap.minus and column == gap.column else k, 1)
    return CLEAR


# What is open


def _ask(workspace: Workspace, pending: Pending, mapping: CsvMapping) -> bool:
    """The questions and their fields; whether some field is empty yet."""
    proposal = pending.file.proposal
    if workspace.mappings.get(pending.file.names) == mapping or proposal.is_supported:
        return False
    is_open = not is_complete(mapping)
    if is_open or mapping == proposal.mapping:
        show.messages(proposal.undecided, "warning", "help")
    fields = _Fields(workspace, pending, mapping)
    names = [name for name in open_fields(proposal) if fields.has(name)]
    for at in range(0, len(names), 4):
        columns = st.columns(4, vertical_alignment="bottom")
        for name, place in zip(names[at : at + 4], columns, strict=False):
            fields.draw(name, place)
    return is_open


def open_fields(proposal: Proposal) -> tuple[str, ...]:
    """The fields that nothing decides, by their names in `_Fields`."""
    if proposal.is_supported:
        return ()
    mapping = proposal.mapping
    guessed = {c.column: c.is_by_values for c in proposal.choices if c.role and not c.is_supported}
    fields = list[str]()
    if mapping.time is None:
        fields += ["time", "time_unit"]
    elif mapping.time.unit == FRAME:
        fields += ["time_unit"]
    elif mapping.time.column in guessed:
        fields += ["time_unit"]
    if mapping.time is None or mapping.time.unit == FRAME:
        fields.append("step")
    for k, speed in enumerate(mapping.speeds):
        if not speed.column or guessed.get(speed.column):
            fields += [f"speed_{k}"]
    if any(not guessed[s.column] for s in mapping.speeds if s.column in guessed) or any(
        not speed.column for speed in mapping.speeds
    ):
        fields.append("speed_units")
    for k, gap in enumerate(mapping.gaps):
        if not gap.column or guessed.get(gap.column):
            fields += [f"gap_{k}"]
        if lacks_length(gap):
            fields.append(f"length_{k}")
    if any(not gap.column or guessed.get(gap.column) is False for gap in mapping.gaps):
        fields.append("gap_units")
    return tuple(fields)


# The fields


@dataclass
class _Fields:
    """The fields of the form, drawn by name, each once.

    A name is the quantity, with the place of speed or gap in the mapping where there are several.
    """

    workspace: Workspace
    pending: Pending
    mapping: CsvMapping

    @property
    def names(self) -> tuple[str, ...]:
        """The names of the table's columns."""
        return self.pending.file.names

    def has(self, name: str) -> bool:
        """Whether the mapping has what the field sets."""
        what, _, at = name.rpartition("_")
        if at.isdigit():
            parts = self.mapping.gaps if what in ("gap", "length") else self.mapping.speeds
            return int(at) < len(parts)
        if name == "time_unit":
            return self.mapping.time is not None
        if name == "step":
            return self.mapping.sample_time is not None or _counts(self.mapping)
        return True

    def draw(self, name: str, place: Any) -> None:
        """Draw a field in a column or container."""
        what, _, at = name.rpartition("_")
        if at.isdigit():
            getattr(self, f"_{what}")(int(at), place)
        else:
            getattr(self, f"_{name}")(place)

    def change(self, edit: Callable[[CsvMapping], CsvMapping]) -> None:
        """Read the table by a changed mapping."""
        now = self.workspace.pending
        if now and now.mapping:
            _read_by(self.workspace, edit(now.mapping))

    def edit_speed(self, k: int, **changes: Any) -> None:
        """Change a speed."""
        self.change(lambda m: replace(m, speeds=_with(m.speeds, k, **changes)))

    def edit_gap(self, k: int, **changes: Any) -> None:
        """Change a gap."""
        self.change(lambda m: replace(m, gaps=_with(m.gaps, k, **changes)))

    def edit_by(self, **changes: Any) -> None:
        """Change what tells vehicles apart."""
        self.change(lambda m: replace(m, by=replace(m.by or ByVehicle(CHOOSE), **changes)))

    def column(
        self, label: str, key: str, value: str, chosen: Callable[[str], object], place: Any,
        none: str = "choose…", help: str = "",
    ) -> None:  # fmt: skip
        """A list of the columns; the empty name stands for ``none``."""
        options = {CHOOSE: none, **{name: excerpt(name, 60) for name in self.names}}
        if value and value not in options:
            options[value] = f"{excerpt(value, 40)} (not in this table)"
        select(label, options, value, f"data_map_{key}", chosen, place=place, help=help or None)

    def unit(
        self, label: str, key: str, units: Sequence[str], value: str,
        chosen: Callable[[str], object], place: Any,
    ) -> None:  # fmt: skip
        """A list of units."""
        options = dict.fromkeys((*units, value))
        select(
            label, {unit: unit for unit in options}, value, f"data_map_{key}", chosen, place=place
        )

    def named(self, column: str) -> ColumnName:
        """What a column's name says."""
        layout = self.pending.file.layout
        units = layout.units if layout else ()
        at = self.names.index(column) if column in self.names else -1
        return ColumnName(column, units[at] if 0 <= at < len(units) else "")

    # Time

    def _time(self, place: Any) -> None:
        time, step = self.mapping.time, self.mapping.sample_time
        value = time.column if time else CHOOSE if step is None else EVEN
        options = {CHOOSE: "choose…"} if value == CHOOSE else {}
        options |= {name: excerpt(name, 60) for name in (*self.names, EVEN)}
        if value not in options:
            options[value] = f"{excerpt(value, 40)} (not in this table)"

        def choose(column: str) -> None:
            if column == EVEN:
                self.change(lambda m: replace(m, time=None, sample_time=nan))
            elif column:
                unit = self.form_of(column)
                step = nan if unit == FRAME else None
                self.change(lambda m: replace(m, time=TimeColumn(column, unit), sample_time=step))

        select("Time", options, value, "data_map_time", choose, place=place)

    def form_of(self, column: str) -> str:
        """The form of time that a column's name and first cells have."""
        layout = self.pending.file.layout
        if layout is None:
            return "s"
        at = self.names.index(column)
        cells = [row[at].strip() for row in layout.rows if at < len(row)]
        name = self.named(column)
        said = f"{column} [{name.unit}]" if name.unit_cell else column
        recognised = clocks.recognised(said, cells, layout.decimal)
        return recognised.form if recognised else "s"

    def _time_unit(self, place: Any) -> None:
        time = self.mapping.time
        if time is None:
            return

        def choose(unit: str) -> None:
            def edit(m: CsvMapping) -> CsvMapping:
                now = replace(m.time or time, unit=unit)
                step = (m.sample_time or nan) if unit == FRAME else None
                return replace(m, time=now, sample_time=step)

            self.change(edit)

        self.unit("Unit of time", "time_unit", TIME_UNITS, time.unit, choose, place)

    def _date(self, place: Any) -> None:
        time = self.mapping.time
        if time:
            self.column(
                "Date", "date", time.date,
                lambda date: self.change(
                    lambda m: replace(m, time=replace(m.time or time, date=date))
                ), place, "(in the same column)",
            )  # fmt: skip

    def _step(self, place: Any) -> None:
        step = self.mapping.sample_time
        place.number_input(
            "Time between frames [s]" if _counts(self.mapping) else "Time between rows [s]",
            **bound(
                "data_map_step", None if step is None or isnan(step) else step,
                lambda new: self.change(lambda m: replace(m, sample_time=float(new))),
            ),
            min_value=0.001, max_value=5.0, step=0.01, format="%.4g", placeholder="e.g. 0.1",
        )  # fmt: skip

    # Speeds and gaps

    def _speed(self, k: int, place: Any) -> None:
        speed = self.mapping.speeds[k]

        def choose(column: str) -> None:
            unit = self.named(column).speed_unit
            self.edit_speed(k, column=column, **({"unit": unit} if unit else {}))

        label = "Speed" if self.mapping.by else f"Speed of vehicle {k + 1}"
        if k == 0 and not self.mapping.by:
            label = "Speed of vehicle 1, the leader"
        self.column(label, f"speed_{k}", speed.column, choose, place)

    def _speed_unit(self, k: int, place: Any) -> None:
        self.unit(
            "Unit", f"speed_unit_{k}", [*SPEED_UNITS], self.mapping.speeds[k].unit,
            lambda unit: self.edit_speed(k, unit=unit), place,
        )  # fmt: skip

    def _speed_units(self, place: Any) -> None:
        """The unit of all speeds whose names give none."""
        at = [
            k for k, s in enumerate(self.mapping.speeds) if not self.named(s.column).speed_unit
        ] or [0]
        self.unit(
            "Unit of speeds", "speed_units", [*SPEED_UNITS], self.mapping.speeds[at[0]].unit,
            lambda unit: self.change(lambda m: replace(m, speeds=tuple(
                replace(s, unit=unit) if k in at else s for k, s in enumerate(m.speeds)
            ))), place,
        )  # fmt: skip

    def _name(self, k: int, place: Any) -> None:
        place.text_input(
            "Make and model",
            **bound(f"data_map_name_{k}", self.mapping.speeds[k].name,
                    lambda name: self.edit_speed(k, name=name.strip())),
            max_chars=60, help="As tables and charts are to show it.",
        )  # fmt: skip

    def _relative(self, k: int, place: Any) -> None:
        others = [n for n in range(1, len(self.mapping.speeds) + 1) if n != k + 1]
        options = {0: "its own speed"} | {n: f"relative to vehicle {n}" for n in others}
        select(
            "The column is", options, self.mapping.speeds[k].relative_to, f"data_map_relative_{k}",
            lambda other: self.edit_speed(k, relative_to=other), place=place,
        )  # fmt: skip

    def _gap(self, k: int, place: Any) -> None:
        gap = self.mapping.gaps[k]

        def choose(column: str) -> None:
            unit = self.named(column).length_unit
            changes: dict[str, Any] = {"column": column, **({"unit": unit} if unit else {})}
            if self.mapping.by and gap.minus:
                changes["minus"] = column
            self.edit_gap(k, **changes)

        label = f"Position of vehicle {k + 1}" if gap.minus else f"Gap of vehicle {k + 2}"
        if self.mapping.by:
            label = "Position" if gap.minus else "Gap"
        self.column(label, f"gap_{k}", gap.column, choose, place,
                    help="A gap is from bumper to bumper, to the vehicle ahead.")  # fmt: skip

    def _gap_unit(self, k: int, place: Any) -> None:
        self.unit(
            "Unit", f"gap_unit_{k}", [*GAP_UNITS], self.mapping.gaps[k].unit,
            lambda unit: self.edit_gap(k, unit=unit), place,
        )  # fmt: skip

    def _gap_units(self, place: Any) -> None:
        """The unit of all gaps whose names give none."""
        at = [
            k for k, g in enumerate(self.mapping.gaps) if not self.named(g.column).length_unit
        ] or [0]
        self.unit(
            "Unit of gaps", "gap_units", [*GAP_UNITS], self.mapping.gaps[at[0]].unit,
            lambda unit: self.change(lambda m: replace(m, gaps=tuple(
                replace(g, unit=unit) if k in at else g for k, g in enumerate(m.gaps)
            ))), place,
        )  # fmt: skip

    def _minus(self, k: int, place: Any) -> None:
        gap = self.mapping.gaps[k]
        if self.mapping.by:
            options = {False: "a gap", True: "a position"}
            select(
                "The column is", options, bool(gap.minus), "data_map_minus_0",
                lambda is_position: self.edit_gap(
                    k, minus=gap.column if is_position else "",
                    subtract=nan if is_position else 0.0,
                ), place=place,
            )  # fmt: skip
            return
        self.column(
            f"Less position of vehicle {k + 2}", f"minus_{k}", gap.minus,
            lambda column: self.edit_gap(k, minus=column), place, "(none: it is a gap)",
            "Where the two columns are positions along the road.",
        )  # fmt: skip

    def _length(self, k: int, place: Any) -> None:
        subtract = self.mapping.gaps[k].subtract
        value = None if isinstance(subtract, str) or isnan(subtract) else float(subtract)
        ahead = "the vehicle ahead" if self.mapping.by else f"vehicle {k + 1}"
        place.number_input(
            f"Length of {ahead} [m]",
            **bound(f"data_map_length_{k}", value,
                    lambda length: self.edit_gap(k, subtract=float(length))),
            min_value=-50.0, max_value=50.0, step=0.1, format="%.2f", placeholder="e.g. 4.50",
            help="It is subtracted. 0 where the column is a gap from bumper to bumper.",
        )  # fmt: skip

    def _length_column(self, k: int, place: Any) -> None:
        subtract = self.mapping.gaps[k].subtract
        self.column(
            "Or column of lengths", f"length_column_{k}",
            subtract if isinstance(subtract, str) else NONE,
            lambda column: self.edit_gap(k, subtract=column or 0.0), place, "(none)",
        )  # fmt: skip

    def shift_and_sign(self, part: str, k: int, places: Sequence[Any]) -> None:
        """The clock and the sign of a speed or gap."""
        columns = self.mapping.speeds if part == "speed" else self.mapping.gaps
        edit = self.edit_speed if part == "speed" else self.edit_gap
        places[0].number_input(
            "Shift [s]",
            **bound(f"data_map_{part}_shift_{k}", float(columns[k].shift),
                    lambda shift: edit(k, shift=round(float(shift), 3))),
            min_value=-LONGEST_SHIFT, max_value=LONGEST_SHIFT, step=0.1, format="%.2f",
            disabled=self.mapping.by is not None,
            help="Seconds to add to the column's times, where its clock was wrong.",
        )  # fmt: skip
        places[1].checkbox(
            "Reverse sign",
            **bound(f"data_map_{part}_sign_{k}", columns[k].reversed,
                    lambda is_reversed: edit(k, reversed=is_reversed)),
        )  # fmt: skip

    # The rest

    def _rows(self, place: Any) -> None:
        def choose(kind: str) -> None:
            def edit(m: CsvMapping) -> CsvMapping:
                if kind == "vehicle":
                    speed, gap = replace(m.speeds[0], relative_to=0), replace(m.gaps[0], minus="")
                    return replace(m, speeds=(speed,), gaps=(gap,), modes=(), by=ByVehicle(CHOOSE))
                gap = replace(m.gaps[0], minus="")
                speeds = (m.speeds[0], SpeedColumn(CHOOSE, m.speeds[0].unit))
                return replace(m, speeds=speeds, gaps=(gap,), by=None)

            self.change(edit)

        with place:
            segments(
                "A row is", {"instant": "an instant", "vehicle": "a vehicle at an instant"},
                "vehicle" if self.mapping.by else "instant", "data_map_rows", choose, labelled=True,
            )  # fmt: skip

    def _vehicles(self, place: Any) -> None:
        def choose(number: float) -> None:
            count = int(number)

            def edit(m: CsvMapping) -> CsvMapping:
                speeds = (*m.speeds, *[SpeedColumn(CHOOSE, m.speeds[0].unit)] * count)[:count]
                gaps = (*m.gaps, *[GapColumn(CHOOSE, m.gaps[0].unit)] * count)[: count - 1]
                speeds = tuple(
                    replace(s, relative_to=0) if s.relative_to > count else s for s in speeds
                )
                modes = tuple(mode for mode in m.modes if mode.vehicle <= count)
                return replace(m, speeds=speeds, gaps=gaps, modes=modes)

            self.change(edit)

        place.number_input(
            "Vehicles", **bound("data_map_vehicles", len(self.mapping.speeds), choose),
            min_value=2, max_value=MAX_VEHICLES, step=1,
            help="Leader and followers, in their order on the road.",
        )  # fmt: skip

    def _run(self, place: Any) -> None:
        self.column(
            "Run identifier", "runs", self.mapping.trajectory or NONE,
            lambda column: self.change(lambda m: replace(m, trajectory=column or None)), place,
            "(none)", "Of a table with several runs: the column that names them.",
        )  # fmt: skip

    def by_vehicle(self, places: Sequence[Any]) -> None:
        """The columns that tell vehicles apart."""
        by = self.mapping.by or ByVehicle(CHOOSE)
        fields = (
            ("vehicle", "Vehicle", by.vehicle, "choose…"),
            ("leader", "Vehicle ahead", by.leader, "(by lane and position)"),
            ("lane", "Lane", by.lane, "(none)"),
            ("position", "Position in the lane", by.position, "(none)"),
        )
        for place, (part, label, value, none) in zip(places, fields, strict=True):

            def choose(column: str, part: str = part) -> None:
                self.edit_by(**{part: column})

            self.column(label, f"by_{part}", value, choose, place, none)

    def mode(self, vehicle: int, places: Sequence[Any]) -> None:
        """The column that says who drives a vehicle, and its words."""
        mode = next((mode for mode in self.mapping.modes if mode.vehicle == vehicle), None)

        def keep(new: ModeColumn | None) -> None:
            def edit(m: CsvMapping) -> CsvMapping:
                others = [mode for mode in m.modes if mode.vehicle != vehicle]
                modes = sorted([*others, *([new] if new else [])], key=lambda mode: mode.vehicle)
                return replace(m, modes=tuple(modes))

            self.change(edit)

        def choose(column: str) -> None:
            acc, human = ("1", "0") if self._is_digital(column) else ("ACC", "Human")
            keep(ModeColumn(vehicle, column, (acc,), (human,)) if column else None)

        self.column(
            f"Driver of vehicle {vehicle}", f"mode_{vehicle}", mode.column if mode else NONE,
            choose, places[0], "(not recorded)", "The column that says who controls the vehicle.",
        )  # fmt: skip
        if mode is None:
            return
        labels = {"acc": "Under ACC it says", "human": "Under a human"}
        for place, (part, label) in zip(places[1:], labels.items(), strict=True):

            def say(text: str, part: str = part) -> None:
                keep(replace(mode, **{part: _words(text)}))

            place.text_input(
                label,
                **bound(f"data_map_{part}_{vehicle}", ", ".join(getattr(mode, part)), say),
                help="One word, or several separated by commas.",
            )  # fmt: skip

    def _is_digital(self, column: str) -> bool:
        choice = next((c for c in self.pending.file.proposal.choices if c.column == column), None)
        cells = choice.cells if choice else ()
        return {cell.removesuffix(".0") for cell in cells} <= {"0", "1", ""}


def _with(parts: Sequence[Any], k: int, **changes: Any) -> tuple[Any, ...]:
    """Parts of which one is changed, if it is there yet."""
    return tuple(replace(part, **changes) if j == k else part for j, part in enumerate(parts))


def _counts(mapping: CsvMapping) -> bool:
    return mapping.time is not None and mapping.time.unit == FRAME


def _words(text: str) -> tuple[str, ...]:
    return tuple(word.strip() for word in text.split(",") if word.strip())


def _change_columns(workspace: Workspace, pending: Pending, mapping: CsvMapping) -> None:
    """All fields that are not open above, a row a role; and the mapping as a file."""
    expander = st.expander(
        "Change columns", icon=":material/tune:", key=CHANGING, on_change="rerun"
    )
    if not expander.open:
        return
    fields = _Fields(workspace, pending, mapping)
    is_asked = workspace.mappings.get(pending.file.names) != mapping
    shown = set(open_fields(pending.file.proposal)) if is_asked else set[str]()

    def row(names: Sequence[str], widths: Sequence[float]) -> Sequence[Any]:
        """Fields beside each other; the places of further ones are returned."""
        places = st.columns(widths, vertical_alignment="bottom")
        for name, place in zip(names, places, strict=False):
            if name not in shown and fields.has(name):
                fields.draw(name, place)
        return places[len(names) :]

    with expander:
        row(["rows", "run"] if mapping.by else ["rows", "vehicles", "run"], (1.4, 0.7, 1.2))
        time = ["time", "time_unit"] if mapping.time else ["time", "step"]
        time += ["step"] if _counts(mapping) else ["date"] if mapping.time else []
        row(time, (1.4, 0.7, 1.2))
        if mapping.by:
            fields.by_vehicle(st.columns(4, vertical_alignment="bottom"))
        for k in range(len(mapping.speeds)):
            names = [f"speed_{k}", f"speed_unit_{k}"]
            names += [] if mapping.by else [f"name_{k}", f"relative_{k}"]
            widths = (1.4, 0.7, *(() if mapping.by else (1.2, 1.2)), 0.8, 0.8)
            fields.shift_and_sign("speed", k, row(names, widths))
        for k in range(len(mapping.gaps)):
            names = [f"gap_{k}", f"gap_unit_{k}", f"minus_{k}", f"length_{k}", f"length_column_{k}"]
            widths = (1.4, 0.7, 1.2, 1, 1.2, 0.8, 0.8)
            fields.shift_and_sign("gap", k, row(names, widths))
        for vehicle in range(1, len(mapping.speeds) + 1):
            if not mapping.by:
                fields.mode(vehicle, st.columns((1.4, 1, 1), vertical_alignment="bottom"))
        _exchange_mapping(workspace, mapping)


def _exchange_mapping(workspace: Workspace, mapping: CsvMapping) -> None:
    """The mapping from a file, and as one."""

    def took(name: str, raw: bytes) -> None:
        _read_by(workspace, parse_mapping(raw, name))

    with st.container(horizontal=True):
        with st.popover("Use a mapping file", icon=":material/upload_file:"):
            show.upload(
                "A mapping as JSON, as the command line takes it.", "data_mapping_upload", took,
                type="json", max_upload_size=1,
            )  # fmt: skip
        st.download_button(
            "Mapping as JSON", write_mapping(mapping), "mapping.json", "application/json",
            on_click="ignore", icon=":material/download:", key="data_mapping_json",
            help="For the command line's option --mapping, or for another server.",
        )  # fmt: skip
