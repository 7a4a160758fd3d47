"""The string stability of vehicles, and of the platoon they form, as numbers and verdicts.

A nonlinear model answers small disturbances differently at every speed in equilibrium. Its
linearisation at a speed is a CTHP (see `model.following`), so verdict, Bode magnitude and gains are
those of the CTHP; they say nothing of disturbances so large that the linearisation does not hold.
Further sentences about them are in `results.messages.stability`.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from enum import Enum
from functools import lru_cache
from math import isnan
from typing import Literal

import numpy as np

from accpinn.display import Displayed
from accpinn.errors import ParameterError
from accpinn.model.cthp import Parameters
from accpinn.model.following import FollowingModel, Values
from accpinn.stability.criteria import (
    MARGINAL,
    Peak,
    checked,
    crossovers,
    exact_margin,
    l2_criterion,
    l2_margin,
    onsets,
    paper_criterion,
    paper_margin,
    peaks,
    poles,
    smallest_headway_exact,
    smallest_headway_l2,
    smallest_headway_paper,
    step_metrics,
)
from accpinn.stability.head_to_tail import Gains, head_to_tail_gains, head_to_tail_peaks
from accpinn.stability.lagged import is_lagged
from accpinn.units import FloatArray, MetresPerSecond, RadiansPerSecond, Seconds

VEHICLES = 6
"""Vehicles that `print` lists; of more the number is told."""
CERTAIN = 0.95
"""A vehicle is called string stable from this probability on, and unstable up to its complement."""
Assessment = Literal["unstable", "stable", "undecided", "not determined"]


def assessment(stable: float) -> Assessment:
    """The assessment by a probability of string stability; nan is that of unknown parameters."""
    if isnan(stable):
        return "not determined"
    return "stable" if stable >= CERTAIN else "unstable" if stable <= 1 - CERTAIN else "undecided"


class Behaviour(Enum):
    """The kind of motion that the parameters make, as a sentence."""

    REAL_POLES = "Its slowest poles are real: the vehicle settles without oscillating."
    COMPLEX_POLES = "Its slowest poles are complex: the vehicle settles oscillating."
    UNDAMPED = "With β = 0 and τ = 0 the vehicle is undamped: it oscillates for ever."
    NO_GAP_CONTROL = (
        "With α = 0 there is no gap control: the vehicle follows the speed ahead, so no speed"
        " disturbance grows, but the gap stays wherever it ends up."
    )
    NO_REACTION = (
        "With α = 0 and β = 0 the vehicle does not react to the one ahead, so no disturbance"
        " passes it."
    )


class Criterion(Enum):
    """A question that a verdict answers, as a title: three about a vehicle, four of a platoon."""

    L2 = "L₂ string stability"
    LINF_PAPER = "L∞ string stability, the paper's criterion"
    LINF_EXACT = "L∞ string stability, exact criterion"
    L2_STRICT = "Strict L₂ string stability"
    L2_WEAK = "Weak L₂ string stability"
    LINF_STRICT = "Strict L∞ string stability"
    LINF_WEAK = "Weak L∞ string stability"

    def __bool__(self) -> bool:
        """A criterion is neither met nor violated by itself.

        Raises:
            ParameterError: always; a `Verdict` has the answer.
        """
        raise ParameterError(
            f"{self.value} is a question without an answer; ask a verdict, as"
            " report.vehicles[0].l2.stable."
        )


@dataclass(frozen=True)
class Verdict:
    """Whether a vehicle or a platoon is string stable by one criterion."""

    criterion: Criterion
    stable: bool
    marginal: bool
    """Whether it is so close to the boundary that the verdict means nothing, see `MARGINAL`."""
    value: float
    """κ or D in 1/s² for `L2` and `LINF_PAPER`, stable above 0; otherwise the gain, stable at 1."""

    def __bool__(self) -> bool:
        """Whether stable, so that ``if vehicle.l2:`` means what it says."""
        return self.stable

    @property
    def word(self) -> str:
        """The verdict in one word, as in "L₂ string stability: unstable"."""
        return ("stable" if self.stable else "unstable") + " (marginal)" * self.marginal


@dataclass(frozen=True)
class Headways:
    """The smallest τ that meets each criterion at the vehicle's α and β."""

    l2: Seconds
    linf_paper: Seconds
    """Headway above which the paper's criterion holds."""
    linf_exact: Seconds


@dataclass(frozen=True)
class VehicleStability:
    """The string stability of one vehicle."""

    parameters: Parameters
    behaviour: Behaviour
    l2: Verdict
    """Is no frequency amplified? By κ = α²τ² + 2αβτ - 2α."""
    linf_paper: Verdict
    """Are both poles real? By D = (ατ+β)² - 4α, the paper's criterion for L∞."""
    linf_exact: Verdict
    """Is no peak amplified? By the exact gain ‖h‖₁."""
    overshoot: float
    """Overshoot of the response to a unit step of the speed ahead."""
    peak: Peak
    crossover: RadiansPerSecond | None
    """ω_c: the highest frequency that is amplified; None where none is."""
    onset: RadiansPerSecond
    """The lowest one; 0 where all below ω_c are."""
    damping_ratio: float | None
    """Damping ratio ζ; None where α = 0, and with a lag or a delay."""
    poles: tuple[complex, ...]
    """Poles in rad/s, the slow one first."""
    smallest_tau: Headways | None
    """Smallest headways; None where α = 0, as τ then has no effect, and with a lag or a delay."""

    @property
    def linf_gain(self) -> float:
        """‖h‖₁: the largest factor by which a peak can grow."""
        return self.linf_exact.value


@dataclass(frozen=True, eq=False)
class PlatoonStability:
    """The vehicles as a platoon, in the order given.

    Strict: no vehicle amplifies a disturbance. Weak: the last follower's disturbance is no larger
    than the leader's, whatever happens between them.
    """

    peaks: tuple[Peak, ...]
    """Peaks of the responses from the leader to follower 1, 2, .., M."""
    linf: Gains
    """L∞ gains from the leader to follower 1, 2, .., M, found numerically."""
    l2_strict: Verdict
    l2_weak: Verdict
    linf_strict: Verdict
    linf_weak: Verdict


@dataclass(frozen=True, eq=False)
class StabilityReport(Displayed):
    """The string stability of some vehicles, one by one and as a platoon."""

    vehicles: tuple[VehicleStability, ...]
    platoon: PlatoonStability

    def __str__(self) -> str:
        """A line a vehicle, then the platoon's verdicts."""
        lines = ["String stability"]
        for k, vehicle in enumerate(self.vehicles[:VEHICLES], 1):
            at = f" at {vehicle.peak.omega:.2f} rad/s" if vehicle.peak.omega else ""
            lines.append(
                f"  Follower {k}: L₂ {vehicle.l2.word}, peak {vehicle.peak.gain:.3g}{at}; L∞"
                f" {vehicle.linf_exact.word}, gain {vehicle.linf_gain:.3g} (paper's criterion:"
                f" {vehicle.linf_paper.word})"
            )
        if (more := len(self.vehicles) - VEHICLES) > 0:
            lines.append(f"  and {more} more follower{'s' * (more > 1)}")
        platoon = self.platoon
        for verdict in (platoon.l2_weak, platoon.linf_weak):
            lines.append(f"  Platoon: {verdict.criterion.value}: {verdict.word}")
        return "\n".join([*lines, "More: .vehicles[0].poles, .smallest_tau, .platoon.peaks"])


@lru_cache(maxsize=64)  # pages ask for the same again and again
def stability_report(parameters: Parameters) -> StabilityReport:
    """Numbers and verdicts for each follower and for the platoon they form in this order.

    Raises:
        ParameterError: for values that are missing, negative or beyond all bounds.

    Examples:
        >>> import accpinn
        >>> report = accpinn.stability_report(accpinn.Parameters(0.08, 0.3, 1.2))
        >>> report.vehicles[0].l2.stable, round(report.vehicles[0].peak.gain, 2)
        (False, 1.13)
    """
    parameters = Parameters.of(parameters.flat.complete)  # a single one as a platoon of one
    clean = checked(parameters)
    assessed = dict[int, VehicleStability]()
    lagged = (clean.complete[:, 4:] > 0).any(axis=1)
    for kind in (lagged, ~lagged):  # without lag or delay all is in closed form
        if kind.any():
            rows = np.flatnonzero(kind)
            reports = _of_one_kind(parameters[rows], clean[rows])
            assessed.update(zip(rows.tolist(), reports, strict=True))
    vehicles = tuple(assessed[row] for row in sorted(assessed))
    return StabilityReport(vehicles, _platoon(vehicles, clean))


def stability_at(
    model: FollowingModel, theta: Values, speed: MetresPerSecond
) -> VehicleStability | None:
    """The string stability of a vehicle (n,) at a speed; None where it has no equilibrium there."""
    try:
        return stability_report(model.linearised(theta, speed)[None]).vehicles[0]
    except ParameterError:
        return None


def peak_gains(
    model: FollowingModel, theta: Values, speeds: Iterable[MetresPerSecond]
) -> FloatArray:
    """(S,) the largest gain in dB at each speed; nan where there is no equilibrium.

    The parameters are (n,), or (n, S) of their own at each speed.
    """
    speeds, theta = np.fromiter(speeds, float), np.asarray(theta, float)
    near = model.linearisations(theta if theta.ndim > 1 else theta[:, None], speeds)
    finite = np.isfinite(near.alpha)
    gains = np.full(len(speeds), np.nan)
    if finite.any():
        gains[finite] = peaks(near[finite]).db
    return gains


def _of_one_kind(given: Parameters, clean: Parameters) -> Iterator[VehicleStability]:
    """The string stability of vehicles (V,), all of which have a lag or a delay, or none has."""
    metrics, lagged = step_metrics(clean), is_lagged(clean)
    kinds = (smallest_headway_l2, smallest_headway_paper, smallest_headway_exact)
    columns = (
        metrics.gain,
        metrics.overshoot,
        np.where((clean.alpha > 0) | lagged, l2_margin(clean), 0.0),  # without α on the boundary
        l2_criterion(clean),
        paper_margin(clean),
        paper_criterion(clean),
        exact_margin(clean, metrics.gain),
        crossovers(clean),
        onsets(clean),
        *(kind(clean) for kind in kinds),
    )
    rows = zip(*(column.tolist() for column in columns), strict=True)
    for part, vehicle, peak, row in zip(given, clean, peaks(clean), rows, strict=True):
        gain, overshoot, closeness, kappa, paper, value, exact, crossover, onset, *headways = row
        linf_paper = paper > MARGINAL, abs(paper) <= MARGINAL
        motion, damping_ratio = poles(vehicle), None
        if vehicle.alpha and not is_lagged(vehicle):  # ζ of s² + (ατ+β)s + α
            damping = float(vehicle.alpha * vehicle.tau + vehicle.beta)
            damping_ratio = float(damping / vehicle.alpha**0.5 / 2.0)
        yield VehicleStability(
            parameters=part,
            behaviour=_behaviour(vehicle, motion, value),
            l2=Verdict(Criterion.L2, *_against(closeness, peak.gain), kappa),
            linf_paper=Verdict(Criterion.LINF_PAPER, *linf_paper, value),
            linf_exact=Verdict(Criterion.LINF_EXACT, *_against(exact, gain), gain),
            overshoot=overshoot,
            peak=peak,
            crossover=crossover if crossover > 0 else None,
            onset=onset,
            damping_ratio=damping_ratio,
            poles=motion,
            smallest_tau=Headways(*headways) if vehicle.alpha and not lagged else None,
        )


def _against(margin: float, gain: float) -> tuple[bool, bool]:
    """Whether stable, and whether marginal, by the distance to the boundary and the gain."""
    stable = margin >= -MARGINAL
    return stable, abs(margin) <= MARGINAL or (not stable and gain <= 1.0 + MARGINAL)


def _behaviour(vehicle: Parameters, motion: tuple[complex, ...], discriminant: float) -> Behaviour:
    """The kind of motion of a vehicle with these poles, the slowest first."""
    if not vehicle.alpha:
        return Behaviour.NO_GAP_CONTROL if vehicle.beta else Behaviour.NO_REACTION
    if not vehicle.beta and not vehicle.tau:
        return Behaviour.UNDAMPED
    if is_lagged(vehicle):
        return Behaviour.COMPLEX_POLES if motion[0].imag else Behaviour.REAL_POLES
    return Behaviour.REAL_POLES if discriminant >= 0 else Behaviour.COMPLEX_POLES


def _platoon(vehicles: tuple[VehicleStability, ...], parameters: Parameters) -> PlatoonStability:
    along, linf = tuple(head_to_tail_peaks(parameters)), head_to_tail_gains(parameters)
    l2_strict = _strict(Criterion.L2_STRICT, [(v.l2, v.peak.gain) for v in vehicles])
    linf_strict = _strict(Criterion.LINF_STRICT, [(v.linf_exact, v.linf_gain) for v in vehicles])
    # Is no frequency larger at the last follower than at the leader?
    gain = along[-1].gain
    marginal = 1.0 < gain <= 1.0 + MARGINAL or (l2_strict.stable and l2_strict.marginal)
    l2_weak = Verdict(Criterion.L2_WEAK, gain <= 1.0 or l2_strict.stable, marginal, gain)
    # Is no peak, as far as can be computed?
    gain, error = float(linf.gain[-1]), float(linf.error[-1])
    none = gain <= 1.0 + max(MARGINAL, error)
    marginal = linf_strict.marginal if linf_strict.stable else none or isnan(gain)
    linf_weak = Verdict(Criterion.LINF_WEAK, linf_strict.stable or none, marginal, gain)
    return PlatoonStability(along, linf, l2_strict, l2_weak, linf_strict, linf_weak)


def _strict(criterion: Criterion, pairs: list[tuple[Verdict, float]]) -> Verdict:
    """Stable where every vehicle is; ``pairs`` are each vehicle's verdict and gain."""
    value = max(gain for _, gain in pairs)
    marginal = any(verdict.marginal for verdict, _ in pairs) and value <= 1.0 + MARGINAL
    return Verdict(criterion, all(verdict.stable for verdict, _ in pairs), marginal, value)
