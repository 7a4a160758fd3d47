"""Several windows of the same vehicles as tables: each by itself, together, and their spread."""

from dataclasses import replace
from math import isnan

from accpinn.channels import PARAMETERS, Quantity
from accpinn.model.cthp import Parameters
from accpinn.results.tables.estimates import interval_cells, name_of, parameter_cells
from accpinn.results.tables.table import ABSENT, Column, Range, Table, percent_cells
from accpinn.study.windows import JointFit

TOGETHER = "all together"


def sources(joint: JointFit) -> str:
    """The recordings in a few words."""
    return ", ".join(dict.fromkeys(window.segment.source for window in joint.windows))


def joint_table(joint: JointFit) -> Table:
    """One row a follower: the parameters that all windows share, and their intervals."""
    first, seconds = joint.windows[0].segment, sum(w.segment.window.duration for w in joint.windows)
    case = f", Case {joint.case}" if first.followers > 1 else ""
    return Table.of(
        f"{name_of(joint.fits[0])}, {sources(joint)}, {len(joint.windows)} windows,"
        f" {seconds:g} s together{case}",
        [
            (Column("Vehicle"), first.labels[1:]),
            *parameter_cells(joint.parameters),
            *interval_cells(joint.uncertainty),
        ],
    )


def windows_table(joint: JointFit, follower: int) -> Table:
    """One row a window for one follower (0 for the first); the joint estimate in the last."""
    segments = [window.segment for window in joint.windows]
    several = len({segment.source for segment in segments}) > 1
    names = [f"{s.source}, {s.window}" if several else str(s.window) for s in segments]
    estimates = [window.fit.parameters[follower] for window in joint.windows]
    known = [*(window.uncertainty for window in joint.windows), joint.uncertainty]
    intervals = replace(
        joint.uncertainty,
        lower=Parameters.stack(uncertainty.lower[follower] for uncertainty in known),
        upper=Parameters.stack(uncertainty.upper[follower] for uncertainty in known),
    )
    return Table.of(
        segments[0].labels[follower + 1],
        [
            (Column("Window"), [*names, TOGETHER]),
            *parameter_cells(Parameters.stack([*estimates, joint.parameters[follower]])),
            *interval_cells(intervals),
        ],
    )


def between_table(joint: JointFit, follower: int) -> Table:
    """One row a parameter of one follower (0 for the first): how far it differs between windows."""
    effects = joint.between[follower].effects
    percent = f"{100 * joint.uncertainty.level:.0f} % interval"
    pairs = list(zip(PARAMETERS, effects, strict=True))
    return Table.of(
        f"{joint.windows[0].segment.labels[follower + 1]}, differences between windows",
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
