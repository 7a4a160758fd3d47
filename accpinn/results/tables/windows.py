"""Several windows of the same vehicles as tables: each by itself, together, and their spread."""

from dataclasses import replace

from accpinn.channels import PARAMETERS
from accpinn.model.cthp import Parameters
from accpinn.results.tables.estimates import interval_cells, name_of, parameter_cells
from accpinn.results.tables.table import ABSENT, Column, Range, Table
from accpinn.study.windows import JointFit, RandomEffects

TOGETHER = "all together"


def sources(joint: JointFit) -> str:
    """The recordings in a few words."""
    return ", ".join(dict.fromkeys(one.segment.source for one in joint.windows))


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
    several = len({one.segment.source for one in joint.windows}) > 1
    names = [
        f"{one.segment.source}, {one.segment.window}" if several else str(one.segment.window)
        for one in joint.windows
    ]
    estimates = [one.fit.parameters[follower] for one in joint.windows]
    known = [*(one.uncertainty for one in joint.windows), joint.uncertainty]
    return Table.of(
        joint.windows[0].segment.labels[follower + 1],
        [
            (Column("Window"), [*names, TOGETHER]),
            *parameter_cells(Parameters.stack([*estimates, joint.parameters[follower]])),
            *interval_cells(
                replace(
                    joint.uncertainty,
                    lower=Parameters.stack(one.lower[follower] for one in known),
                    upper=Parameters.stack(one.upper[follower] for one in known),
                )
            ),
        ],
    )


def between_table(joint: JointFit, follower: int) -> Table:
    """One row a parameter of one follower (0 for the first): how far it differs between windows."""
    effects = joint.between[follower].effects
    percent = f"{100 * joint.uncertainty.level:.0f} % interval"
    return Table.of(
        f"{joint.windows[0].segment.labels[follower + 1]}, differences between windows",
        [
            (Column("Parameter"), [quantity.heading for quantity in PARAMETERS]),
            (Column("Median"), [_text(k, one.typical) for k, one in enumerate(effects)]),
            (Column("further window", group=percent),
             [_further(k, one) for k, one in enumerate(effects)]),
            (Column("Deviation", "%", 0), [100.0 * one.deviation for one in effects]),
            (Column("Deviation", "%", 0, percent),
             [Range(100.0 * one.lower, 100.0 * one.upper) for one in effects]),
            (Column("Q", "", 1), [one.q for one in effects]),
            (Column("Probability", "", 3), [one.probability for one in effects]),
            (Column("I²", "%", 0), [100.0 * one.i_squared for one in effects]),
        ],
    )  # fmt: skip


def _text(parameter: int, value: float) -> str:
    return PARAMETERS[parameter].text(value) if value == value else ABSENT


def _further(parameter: int, effect: RandomEffects) -> str:
    low, high = effect.further
    return f"{_text(parameter, low)} to {_text(parameter, high)}" if low == low else ABSENT
