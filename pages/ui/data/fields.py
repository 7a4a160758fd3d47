"""The fields in which a mapping is given, each drawn by its name."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import isnan, nan
from typing import Any

from msgspec.structs import replace

from accpinn.channels import MAX_VEHICLES
from accpinn.recordings import time_forms
from accpinn.recordings.clocks import FRAME
from accpinn.recordings.mapping import (
    LONGEST_SHIFT,
    TIME_UNITS,
    ByVehicle,
    CsvMapping,
    GapColumn,
    ModeColumn,
    SpeedColumn,
    TimeColumn,
)
from accpinn.recordings.names import ColumnName
from accpinn.recordings.source import excerpt
from accpinn.units import GAP_UNITS, SPEED_UNITS
from pages.ui.components.show import bound, segments, select
from pages.ui.session.pending import Pending
from pages.ui.session.workspace import Workspace

CHOOSE = ""
"""The name of a column that is to be chosen."""
NONE = ""
EVEN = "(even steps)"


@dataclass
class Fields:
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
        """Whether the mapping has a value for the field."""
        what, _, at = name.rpartition("_")
        if at.isdigit():
            parts = self.mapping.gaps if what in ("gap", "length") else self.mapping.speeds
            return int(at) < len(parts)
        if name == "time_unit":
            return self.mapping.time is not None
        if name == "step":
            return self.mapping.sample_time is not None or counts_frames(self.mapping)
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
            read_by(self.workspace, edit(now.mapping))

    def edit_speed(self, k: int, **changes: Any) -> None:
        """Change a speed."""
        self.change(lambda m: replace(m, speeds=_with(m.speeds, k, **changes)))

    def edit_gap(self, k: int, **changes: Any) -> None:
        """Change a gap."""
        self.change(lambda m: replace(m, gaps=_with(m.gaps, k, **changes)))

    def edit_by(self, **changes: Any) -> None:
        """Change the columns that identify vehicles."""
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
        """Quantity, unit and vehicle that a column's name states."""
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
        heading = f"{column} [{name.unit}]" if name.unit_cell else column
        recognised = time_forms.recognised(heading, cells, layout.decimal)
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
            "Time between frames [s]" if counts_frames(self.mapping) else "Time between rows [s]",
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
        """The columns that identify vehicles."""
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
        """The column with a vehicle's driver, and its words for ACC and human."""
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
                words = tuple(word.strip() for word in text.split(",") if word.strip())
                keep(replace(mode, **{part: words}))

            place.text_input(
                label,
                **bound(f"data_map_{part}_{vehicle}", ", ".join(getattr(mode, part)), say),
                help="One word, or several separated by commas.",
            )  # fmt: skip

    def _is_digital(self, column: str) -> bool:
        choice = next((c for c in self.pending.file.proposal.choices if c.column == column), None)
        cells = choice.cells if choice else ()
        return {cell.removesuffix(".0") for cell in cells} <= {"0", "1", ""}


def read_by(workspace: Workspace, mapping: CsvMapping) -> None:
    """Read the pending table by another mapping."""
    if workspace.pending:
        workspace.pending = workspace.pending.read_by(mapping)


def _with(parts: Sequence[Any], k: int, **changes: Any) -> tuple[Any, ...]:
    """Parts of which one is changed, if it is there yet."""
    return tuple(replace(part, **changes) if j == k else part for j, part in enumerate(parts))


def counts_frames(mapping: CsvMapping) -> bool:
    """Whether the time is a counter of frames."""
    return mapping.time is not None and mapping.time.unit == FRAME
