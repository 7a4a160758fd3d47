"""Verdicts on one vehicle: stable or not, on the boundary or not, and why in one sentence."""

from dataclasses import dataclass

from accpinn.stability.criteria import MARGINAL
from accpinn.stability.vehicle import Behaviour, VehicleNumbers

L2 = "L2"
LINF_PAPER = "L∞, the paper's criterion"
LINF_EXACT = "L∞, exact gain"

NO_FOLLOWING = (Behaviour.NO_SPACING, Behaviour.NO_REACTION)


@dataclass(frozen=True)
class Verdict:
    """The answer to one question of stability."""

    name: str
    """Which question: L2; L∞ by the paper's criterion; L∞ by the exact gain; ..."""
    stable: bool
    marginal: bool
    """So close to the boundary that the answer means nothing; see `criteria.MARGINAL`."""
    value: float
    """The criterion (stable above 0), or the gain (stable at 1)."""
    reason: str
    """One sentence for the user."""


def l2_verdict(vehicle: VehicleNumbers) -> Verdict:
    """Is no frequency amplified?"""
    margin, gain = vehicle.margins.l2, vehicle.peak.gain
    if vehicle.behaviour in NO_FOLLOWING:
        return Verdict(L2, True, True, vehicle.l2_criterion, vehicle.behaviour.value)
    stable, marginal = _against(margin, gain)
    return Verdict(L2, stable, marginal, vehicle.l2_criterion, _l2_reason(vehicle, margin, gain))


def _l2_reason(vehicle: VehicleNumbers, margin: float, gain: float) -> str:
    if margin > MARGINAL:
        return "No frequency is amplified: |H| is below 1 at every ω above zero."
    if margin >= -MARGINAL:
        return (
            "On the boundary: |H| is still below 1 at every ω above zero, but not with any smaller"
            " headway; the paper's strict form counts this as unstable."
        )
    if vehicle.behaviour is Behaviour.UNDAMPED:
        return (
            f"{vehicle.behaviour.value[:-1]}, and a disturbance at {vehicle.peak.omega:.3g} rad/s"
            " grows without limit."
        )
    slow = f"Disturbances slower than {vehicle.crossover:.3g} rad/s are amplified"
    if gain <= 1.0 + MARGINAL:
        return f"{slow}, but so little that the answer is marginal: by one part in 10⁹ at most."
    return (
        f"{slow}, most at {vehicle.peak.omega:.3g} rad/s, where they come out {factor(gain)} times"
        f" as large ({vehicle.peak.db:.2f} dB)."
    )


def paper_verdict(vehicle: VehicleNumbers) -> Verdict:
    """Are both poles real? The paper's criterion for L∞."""
    margin = vehicle.margins.linf_paper
    return Verdict(
        LINF_PAPER,
        margin > MARGINAL,
        abs(margin) <= MARGINAL,
        vehicle.paper_criterion,
        _paper_reason(vehicle, margin),
    )


def _paper_reason(vehicle: VehicleNumbers, margin: float) -> str:
    if vehicle.behaviour in NO_FOLLOWING:
        return vehicle.behaviour.value
    if abs(margin) <= MARGINAL:
        return "On the boundary: the two poles meet, and the paper's criterion asks for two."
    damping = f"(damping ratio {vehicle.damping_ratio:.3g})"
    if margin > 0:
        return f"Both poles are real {damping}, and the paper's criterion asks for nothing more."
    return f"The poles are complex {damping}, and the paper's criterion asks for real ones."


def exact_verdict(vehicle: VehicleNumbers) -> Verdict:
    """Can no peak come out larger? By the exact gain ‖h‖₁."""
    if vehicle.behaviour in NO_FOLLOWING:
        return Verdict(LINF_EXACT, True, False, vehicle.linf_gain, vehicle.behaviour.value)
    stable, marginal = _against(vehicle.margins.linf_exact, vehicle.linf_gain)
    return Verdict(LINF_EXACT, stable, marginal, vehicle.linf_gain, _exact_reason(vehicle))


def _exact_reason(vehicle: VehicleNumbers) -> str:
    margin, gain = vehicle.margins.linf_exact, vehicle.linf_gain
    if margin >= -MARGINAL:
        start = "On the boundary: the" if margin <= MARGINAL else "The"
        return (
            f"{start} impulse response never changes sign, so no peak of the leader's speed"
            " deviation can come out larger."
        )
    if vehicle.behaviour is Behaviour.UNDAMPED:
        return (
            f"{vehicle.behaviour.value[:-1]}, and a disturbance that keeps its beat makes peaks of"
            " any height."
        )
    if gain <= 1.0 + MARGINAL:
        return (
            "The impulse response changes sign, but so little that the answer is marginal: a peak"
            " can grow by one part in 10⁹ at most."
        )
    peak = (
        f"a peak of the leader's speed deviation can come out up to {factor(gain)} times as large"
    )
    if vehicle.margins.linf_paper > MARGINAL:
        return (
            "The paper's criterion asks for real poles only, which is necessary but not sufficient:"
            f" here the impulse response changes sign, so {peak}."
        )
    return f"The vehicle oscillates, so its impulse response changes sign, and {peak}."


def _against(margin: float, gain: float) -> tuple[bool, bool]:
    """Stable and marginal, from the distance to the boundary and the gain it leads to."""
    stable = margin >= -MARGINAL
    return stable, abs(margin) <= MARGINAL or (not stable and gain <= 1.0 + MARGINAL)


def factor(gain: float) -> str:
    """A gain for a sentence: three digits, and more the closer it is to 1."""
    excess = abs(gain - 1.0)
    if excess >= 0.2:
        return f"{gain:#.3g}".rstrip(".")
    return f"{gain:.4g}" if excess >= 5e-4 else f"1 + {gain - 1.0:.2g}"
