"""Several windows of the same vehicles as tables: each by itself, together, and their spread."""

from dataclasses import replace
from math import isnan

from accpinn.channels import PARAMETERS, Quantity
from accpinn.model.cthp import Parameters
from accpinn.results.tables.estimates import interval_cells, name_of, parameter_cells
from accpinn.results.tables.table import ABSENT, Column, Range, Table, percent_cells
from accpinn.study.result import Result
from accpinn.study.windows import BetweenWindows

TOGETHER = "all together"


def joint_table(result: Result) -> Table:
    """One row a follower: the parameters that all windows share, and their intervals."""
    info, seconds = result.info, sum(each.window.duration for each in result.infos)
    case = f", Case {result.fit.case}" if info.followers > 1 else ""
    return Table.of(
        f"{name_of(result.fit)}, {info.source}, {len(result.infos)} windows,"
        f" {seconds:g} s together{case}",
        [
            (Column("Vehicle"), info.labels[1:]),
            *parameter_cells(result.parameters),
            *interval_cells(result.uncertainty),
        ],
    )


def windows_table(result: Result, follower: int) -> Table:
    """One row a window for one follower (0 for the first); the joint estimate in the last."""
    rows = [*result.windows, result]
    known = [row.uncertainty for row in rows]
    return Table.of(
        result.info.labels[follower + 1],
        [
            (Column("Window"), [*(str(info.window) for info in result.infos), TOGETHER]),
            *parameter_cells(Parameters.stack(row.parameters[follower] for row in rows)),
            *interval_cells(
                replace(
                    result.uncertainty,
                    lower=Parameters.stack(intervals.lower[follower] for intervals in known),
                    upper=Parameters.stack(intervals.upper[follower] for intervals in known),
                )
            ),
        ],
    )


def between_table(result: Result, between: BetweenWindows) -> Table:
    """One row a parameter of one follower: how far it differs between windows."""
    effects = between.effects
    percent = f"{100 * result.uncertainty.level:.0f} % interval"
    pairs = list(zip(PARAMETERS, effects, strict=True))
    return Table.of(
        f"{result.info.label(between.vehicle)}, differences between windows",
        [
            (Column("Parameter"), [quantity.heading for quantity in PARAMETERS]),
            (Column("Median"), [_text(quantity, effect.typical) for quantity, effect in pairs]),
            (Column("further window", group=percent),
             [_text(quantity, *effect.further) for quantity, effect in pairs]),
            (Column("Deviation", "%", 0), percent_cells([e.deviation for e in effects])),
            (Column("Deviation", "%", 0, percent),
             [Range(100.0 * effect.lower, 100.0 * effect.upper) for effect in effects]),
            (Column("Q", "", 1), [effect.q for effect in effects]),
            (Column("Probability", "", 3), [effect.probability for effect in effects]),
            (Column("I²", "%", 0), percent_cells([effect.i_squared for effect in effects])),
        ],
    )  # fmt: skip


def _text(quantity: Quantity, *values: float) -> str:
    """A value, or the ends of an interval, with the digits of the quantity."""
    return ABSENT if isnan(values[0]) else " to ".join(map(quantity.text, values))
