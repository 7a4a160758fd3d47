"""The whole stability report: every vehicle's numbers and verdicts, and those of the platoon."""

from dataclasses import dataclass
from math import isinf, isnan

from accpinn.model.cthp import Parameters
from accpinn.stability.cascade import Gains, head_to_tail_gains
from accpinn.stability.criteria import MARGINAL
from accpinn.stability.frequency import Peak
from accpinn.stability.head_to_tail import head_to_tail_peaks
from accpinn.stability.vehicle import VehicleNumbers, numbers
from accpinn.stability.verdicts import Verdict, exact_verdict, factor, l2_verdict, paper_verdict


@dataclass(frozen=True)
class VehicleStability(VehicleNumbers):
    """One vehicle's numbers and what they mean."""

    l2: Verdict
    linf_paper: Verdict
    linf_exact: Verdict


@dataclass(frozen=True, eq=False)
class PlatoonStability:
    """The vehicles as a platoon, in the order given.

    Strict: no vehicle makes a disturbance larger than it got it. Weak: the last follower's is no
    larger than the leader's, whatever happened between.
    """

    peaks: tuple[Peak, ...]
    """From the leader to follower 1, 2, .., M."""
    linf: Gains
    """From the leader to follower 1, 2, .., M; numerical."""
    l2_strict: Verdict
    l2_weak: Verdict
    linf_strict: Verdict
    linf_weak: Verdict


@dataclass(frozen=True, eq=False)
class StabilityReport:
    """What is to be said about the stability of some vehicles."""

    vehicles: tuple[VehicleStability, ...]
    platoon: PlatoonStability


def stability_report(parameters: Parameters) -> StabilityReport:
    """Numbers, verdicts and reasons for each vehicle and for the platoon they form in this order.

    Raises:
        ParameterError: for values that are missing, negative or beyond all bounds.
    """
    vehicles = tuple(
        VehicleStability(
            **vars(item),
            l2=l2_verdict(item),
            linf_paper=paper_verdict(item),
            linf_exact=exact_verdict(item),
        )
        for item in numbers(parameters)
    )
    return StabilityReport(vehicles, _platoon(vehicles))


def _platoon(vehicles: tuple[VehicleStability, ...]) -> PlatoonStability:
    parameters = Parameters.stack(vehicle.parameters for vehicle in vehicles)
    peaks = head_to_tail_peaks(parameters).each()
    linf = head_to_tail_gains(parameters)
    l2_strict = _strict("L2, every pair", [(v.l2, v.peak.gain) for v in vehicles], "disturbance")
    linf_strict = _strict("L∞, every pair", [(v.linf_exact, v.linf_gain) for v in vehicles], "peak")
    return PlatoonStability(
        peaks,
        linf,
        l2_strict,
        _l2_weak(l2_strict, peaks[-1]),
        linf_strict,
        _linf_weak(linf_strict, float(linf.gain[-1]), float(linf.error[-1])),
    )


def _strict(name: str, pairs: list[tuple[Verdict, float]], what: str) -> Verdict:
    """Stable where every vehicle is; ``pairs`` are each vehicle's verdict and gain."""
    amplifying = [k for k, (verdict, _) in enumerate(pairs, 1) if not verdict.stable]
    value = max(gain for _, gain in pairs)
    marginal = any(verdict.marginal for verdict, _ in pairs) and value <= 1.0 + MARGINAL
    if not amplifying:
        return Verdict(name, True, marginal, value, f"No follower lets a {what} come out larger.")
    worst = max(amplifying, key=lambda k: pairs[k - 1][1])
    if len(amplifying) == 1:
        reason = f"Follower {worst} lets a {what} come out larger: {_extent(value)}."
    else:
        who = f"Followers {', '.join(map(str, amplifying[:-1]))} and {amplifying[-1]}"
        reason = f"{who} let a {what} come out larger, {worst} the most: {_extent(value)}."
    return Verdict(name, False, marginal, value, reason)


def _l2_weak(strict: Verdict, peak: Peak) -> Verdict:
    """Is no frequency larger at the last follower than at the leader?"""
    stable = peak.gain <= 1.0
    if strict.stable:
        reason = "No follower amplifies any frequency, so neither do all of them together."
    elif stable:
        reason = (
            "What some followers amplify others damp: no frequency reaches the last one larger."
        )
    else:
        reason = (
            f"A disturbance at {peak.omega:.3g} rad/s reaches the last follower larger:"
            f" {_extent(peak.gain)}."
        )
    marginal = 1.0 < peak.gain <= 1.0 + MARGINAL or (strict.stable and strict.marginal)
    return Verdict("L2, first to last", stable or strict.stable, marginal, peak.gain, reason)


def _linf_weak(strict: Verdict, gain: float, error: float) -> Verdict:
    """Is no peak larger at the last follower than at the leader, as far as can be computed?"""
    none = gain <= 1.0 + max(MARGINAL, error)
    if strict.stable:
        reason = "No follower lets a peak come out larger, so neither do all of them together."
    elif isnan(gain):
        reason = "The vehicles' time scales differ too much for this to be computed."
    elif none:
        reason = "As far as can be computed, no peak reaches the last follower larger."
    else:
        reason = (
            "A peak of the leader's speed deviation can reach the last follower larger:"
            f" {_extent(gain)}."
        )
    marginal = strict.marginal if strict.stable else none or isnan(gain)
    return Verdict("L∞, first to last", strict.stable or none, marginal, gain, reason)


def _extent(gain: float) -> str:
    return "without limit" if isinf(gain) else f"up to {factor(gain)} times"
