"""All numbers of one vehicle's string stability, from the closed forms of this package."""

from dataclasses import dataclass

from accpinn.model.cthp import Parameters
from accpinn.serial import NamedEnum
from accpinn.stability.criteria import (
    checked,
    exact_margin,
    l2_criterion,
    l2_margin,
    paper_criterion,
    paper_margin,
    smallest_headway_exact,
    smallest_headway_l2,
    smallest_headway_paper,
)
from accpinn.stability.frequency import Peak, crossovers, peaks, poles, zero
from accpinn.stability.impulse import step_metrics
from accpinn.units import PerSecondSquared, RadiansPerSecond, Seconds


class Behaviour(NamedEnum):
    """What kind of motion the parameters make, as the sentence the user reads."""

    REAL_POLES = "Both poles are real: the vehicle settles without oscillating."
    COMPLEX_POLES = "The poles are complex: the vehicle oscillates while it settles."
    UNDAMPED = "With β = 0 and τ = 0 nothing damps the vehicle: it oscillates for ever."
    NO_SPACING = (
        "With α = 0 the vehicle follows the speed ahead without keeping a gap: no speed disturbance"
        " grows, but the gap stays wherever it ends up."
    )
    NO_REACTION = (
        "With α = 0 and β = 0 the vehicle does not react to the one ahead, so no disturbance"
        " passes it."
    )


@dataclass(frozen=True)
class Headways:
    """The smallest τ that meets each criterion at the vehicle's α and β."""

    l2: Seconds
    linf_paper: Seconds
    """The criterion asks for more than this."""
    linf_exact: Seconds


@dataclass(frozen=True)
class Margins:
    """Signed relative distances from the boundaries, positive on the stable side."""

    l2: float
    linf_paper: float
    linf_exact: float


@dataclass(frozen=True)
class VehicleNumbers:
    """What can be computed of one vehicle."""

    parameters: Parameters
    behaviour: Behaviour
    l2_criterion: PerSecondSquared
    """κ = α²τ² + 2αβτ - 2α."""
    paper_criterion: PerSecondSquared
    """D = (ατ+β)² - 4α."""
    linf_gain: float
    """‖h‖₁: how much larger a peak can come out at most."""
    overshoot: float
    """How far a unit step of the speed ahead is passed."""
    peak: Peak
    crossover: RadiansPerSecond | None
    """ω_c: what is slower is amplified; None where nothing is."""
    natural_frequency: RadiansPerSecond
    damping_ratio: float | None
    """None where α = 0."""
    poles: tuple[complex, complex]
    """In rad/s, the slow one first."""
    zero: float | None
    """In rad/s; None where β = 0."""
    smallest_tau: Headways | None
    """None where α = 0, as τ then has no effect."""
    margins: Margins


def numbers(parameters: Parameters) -> tuple[VehicleNumbers, ...]:
    """The numbers of each vehicle.

    Raises:
        ParameterError: for values that are missing, negative or beyond all bounds.
    """
    parameters = checked(parameters)
    swing = step_metrics(parameters)
    rows = zip(
        parameters,
        checked(parameters),
        l2_criterion(parameters).tolist(),
        paper_criterion(parameters).tolist(),
        swing.gain.tolist(),
        swing.overshoot.tolist(),
        peaks(parameters).each(),
        crossovers(parameters).tolist(),
        _headways(parameters),
        _margins(parameters),
        strict=True,
    )
    return tuple(
        VehicleNumbers(
            parameters=given,
            behaviour=_behaviour(law, margins),
            l2_criterion=kappa,
            paper_criterion=paper,
            linf_gain=gain,
            overshoot=overshoot,
            peak=peak,
            crossover=crossover if crossover > 0 else None,
            natural_frequency=law.alpha**0.5,
            damping_ratio=_damping_ratio(law),
            poles=poles(law),
            zero=zero(law),
            smallest_tau=headways if law.alpha else None,
            margins=margins,
        )
        for given, law, kappa, paper, gain, overshoot, peak, crossover, headways, margins in rows
    )


def _headways(parameters: Parameters) -> list[Headways]:
    kinds = (smallest_headway_l2, smallest_headway_paper, smallest_headway_exact)
    return list(map(Headways, *(kind(parameters).tolist() for kind in kinds)))


def _margins(parameters: Parameters) -> list[Margins]:
    kinds = (l2_margin, paper_margin, exact_margin)
    return list(map(Margins, *(kind(parameters).tolist() for kind in kinds)))


def _behaviour(law: Parameters, margins: Margins) -> Behaviour:
    if not law.alpha:
        return Behaviour.NO_SPACING if law.beta else Behaviour.NO_REACTION
    if not law.beta and not law.tau:
        return Behaviour.UNDAMPED
    return Behaviour.REAL_POLES if margins.linf_paper >= 0 else Behaviour.COMPLEX_POLES


def _damping_ratio(law: Parameters) -> float | None:
    """Of s² + (ατ+β)s + α."""
    return (law.alpha * law.tau + law.beta) / law.alpha**0.5 / 2.0 if law.alpha else None
