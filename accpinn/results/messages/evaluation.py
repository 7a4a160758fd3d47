"""Sentences about the closed-loop simulation and the residual."""

from functools import singledispatch

from accpinn.errors import Finding
from accpinn.evaluation.closed_loop import (
    DIVERGED,
    ClosedLoopFinding,
    SimulatedCollision,
    SimulatedDivergence,
    SimulatedReversing,
)
from accpinn.evaluation.whiteness import (
    NEGLIGIBLE,
    CorrelatedResidual,
    ShortResidual,
    WhiteResidual,
)
from accpinn.results.messages import Labelled, message


@singledispatch
def closed_loop_event(finding: Finding) -> str:
    """What happens in the closed-loop simulation, without the vehicle: the predicate alone.

    Raises:
        NotImplementedError: for a finding that is not about the simulation.
    """
    raise NotImplementedError(type(finding).__name__)


@closed_loop_event.register
def _(finding: SimulatedCollision) -> str:
    gap = f"{finding.smallest_gap:z.1f}"
    return f"collides with the vehicle ahead at {finding.time:.1f} s; its gap falls to {gap} m"


@closed_loop_event.register
def _(finding: SimulatedReversing) -> str:
    return f"drives backwards at {finding.time:.1f} s, at up to {finding.speed:.1f} m/s"


@closed_loop_event.register
def _(finding: SimulatedDivergence) -> str:
    return (
        f"diverges: its gap leaves ±{DIVERGED:.0f} m at {finding.time:.1f} s, so neither it nor the"
        " vehicles behind it have closed-loop errors"
    )


@message.register(SimulatedCollision)
@message.register(SimulatedReversing)
@message.register(SimulatedDivergence)
def _(finding: ClosedLoopFinding, about: Labelled) -> str:
    who = about.label(finding.vehicle)
    return f"In the closed-loop simulation, {who} {closed_loop_event(finding)}."


@message.register
def _(finding: ShortResidual, about: Labelled) -> str:
    who = about.label(finding.vehicle)
    return f"{who}: the window is too short to test whether the model's residual is white."


@message.register
def _(finding: WhiteResidual, about: Labelled) -> str:
    residual = (
        f"{about.label(finding.vehicle)}: the model's residual ({finding.deviation:.2f} m/s²)"
    )
    if finding.deviation < NEGLIGIBLE:
        return f"{residual} is no larger than noise and rounding make it."
    return f"{residual} is not correlated beyond a second."


@message.register
def _(finding: CorrelatedResidual, about: Labelled) -> str:
    return (
        f"{about.label(finding.vehicle)}: the model's residual ({finding.deviation:.2f} m/s²) is"
        f" correlated over about {finding.memory:.0f} s, so {finding.samples:,} samples estimate"
        f" its mean no better than some {finding.independent:.0f} independent ones."
    )
