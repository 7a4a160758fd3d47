"""String stability and simulated platoons in sentences: the answer, how certain, and why."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import isinf, isnan

from accpinn.channels import PARAMETERS
from accpinn.inference.intervals import Uncertainty
from accpinn.model.published import ParameterSet
from accpinn.platoon import simulation
from accpinn.platoon.simulation import PlatoonRun
from accpinn.results.messages import Labelled, joined, message, probability
from accpinn.results.tables.table import between
from accpinn.stability.report import (
    Assessment,
    Behaviour,
    Criterion,
    StabilityReport,
    VehicleStability,
    Verdict,
    assessment,
)
from accpinn.units import FloatArray

TITLES: Mapping[Criterion, str] = {
    Criterion.L2: "L₂ string stability",
    Criterion.LINF_PAPER: "L∞ string stability, the paper's criterion",
    Criterion.LINF_EXACT: "L∞ string stability, exact criterion",
    Criterion.L2_STRICT: "Strict L₂ string stability",
    Criterion.L2_WEAK: "Weak L₂ string stability",
    Criterion.LINF_STRICT: "Strict L∞ string stability",
    Criterion.LINF_WEAK: "Weak L∞ string stability",
}
BEHAVIOURS: Mapping[Behaviour, str] = {
    Behaviour.REAL_POLES: "Both poles are real: the vehicle settles without oscillating.",
    Behaviour.COMPLEX_POLES: "The poles are complex: the vehicle oscillates while it settles.",
    Behaviour.UNDAMPED: "With β = 0 and τ = 0 the vehicle is undamped: it oscillates for ever.",
    Behaviour.NO_GAP_CONTROL: (
        "With α = 0 there is no gap control: the vehicle follows the speed ahead, so no speed"
        " disturbance grows, but the gap stays wherever it ends up."
    ),
    Behaviour.NO_REACTION: (
        "With α = 0 and β = 0 the vehicle does not react to the one ahead, so no disturbance"
        " passes it."
    ),
}
_UNDAMPED = "With β = 0 and τ = 0 the vehicle is undamped"
NUMBERS = ("no", "one", "two", "three", "four", "five", "six", "seven", "eight", "nine", "ten")
_ASSESSED: Mapping[Assessment, tuple[str, str]] = {
    "unstable": ("amplifies disturbances", "amplify disturbances"),
    "stable": ("is L₂ string stable", "are L₂ string stable"),
    "open": ("may or may not amplify disturbances", "may or may not amplify disturbances"),
    "not determined": ("is not determined by the data", "are not determined by the data"),
}
"""Of one vehicle, and of several."""
AFTER_COLLISION = (
    "The model has no collisions: what is simulated after one has no meaning for that vehicle and"
    " those behind it, so they end there; those ahead of it drive on."
)
GIVEN_PARAMETERS = (
    "The verdict is that of the CTHP with these parameters; a car whose actuator lags or whose"
    " controller responds with a delay may amplify more."
)
"""What a verdict on parameters without a recording takes for granted."""
BY_ESTIMATES = (
    "The verdicts here are those of the estimates; the probability of string stability says how"
    " certain they are."
)
"""What stands over verdicts on an estimate whose posterior is known."""
SAME_AMPLITUDE = 0.005
"""An amplitude that differs by a smaller share is called as large as the leader's."""


def reason(
    verdict: Verdict, of: VehicleStability | StabilityReport, names: Sequence[str] = ()
) -> str:
    """Why a verdict is as it is, in one sentence.

    Args:
        verdict: one of those that ``of`` holds.
        of: the vehicle; or the report, for a verdict on its platoon.
        names: (M,) of the platoon's followers within a sentence; by default their places.
    """
    if isinstance(of, StabilityReport):
        if verdict.criterion in (Criterion.L2_STRICT, Criterion.LINF_STRICT):
            return _strict(verdict, of, names)
        return _weak(verdict, of)
    if of.behaviour in (Behaviour.NO_GAP_CONTROL, Behaviour.NO_REACTION):
        return BEHAVIOURS[of.behaviour]
    if verdict.criterion is Criterion.L2:
        return _l2(of)
    return _linf_paper(of) if verdict.criterion is Criterion.LINF_PAPER else _linf_exact(of)


def _l2(vehicle: VehicleStability) -> str:
    verdict, peak = vehicle.l2, vehicle.peak
    if verdict.stable and not verdict.marginal:
        return "No frequency is amplified: |H| is below 1 at every ω above zero."
    if verdict.stable:
        return (
            "On the boundary: |H| is below 1 at every ω above zero, but would not be at any smaller"
            " headway; the paper's strict form counts this as unstable."
        )
    if vehicle.behaviour is Behaviour.UNDAMPED:
        return f"{_UNDAMPED}: a disturbance at {peak.omega:.3g} rad/s grows without limit."
    low = f"Disturbances below {vehicle.crossover:.3g} rad/s are amplified"
    if verdict.marginal:
        return f"{low}, but by one part in 10⁹ at most, so the verdict is marginal."
    return (
        f"{low}, most at {peak.omega:.3g} rad/s, by a factor of {factor(peak.gain)}"
        f" ({peak.db:.2f} dB)."
    )


def _linf_paper(vehicle: VehicleStability) -> str:
    if vehicle.linf_paper.marginal:
        return "On the boundary: the poles coincide, and the paper's criterion requires two."
    damping = f"(damping ratio {vehicle.damping_ratio:#.3g})"
    if vehicle.linf_paper.stable:
        return f"Both poles are real {damping}, which is all that the paper's criterion requires."
    return f"The poles are complex {damping}, but the paper's criterion requires real ones."


def _linf_exact(vehicle: VehicleStability) -> str:
    verdict = vehicle.linf_exact
    if verdict.stable:
        start = "On the boundary: the" if verdict.marginal else "The"
        return (
            f"{start} impulse response never changes sign, so no peak of the speed deviation ahead"
            " is amplified."
        )
    if vehicle.behaviour is Behaviour.UNDAMPED:
        return f"{_UNDAMPED}: a disturbance at its natural frequency makes peaks of any height."
    if verdict.marginal:
        return (
            "The impulse response changes sign, but amplifies peaks by one part in 10⁹ at most, so"
            " the verdict is marginal."
        )
    peak = f"a peak of the speed deviation ahead can grow {_extent(verdict.value)}"
    if vehicle.linf_paper.stable:
        return (
            "Real poles, which the paper's criterion requires, are necessary but not sufficient:"
            f" the impulse response changes sign, so {peak}."
        )
    return f"The vehicle oscillates, so its impulse response changes sign, and {peak}."


def _strict(verdict: Verdict, report: StabilityReport, names: Sequence[str]) -> str:
    """Who amplifies."""
    if verdict.criterion is Criterion.L2_STRICT:
        what, own = "disturbances", [(v.l2, v.peak.gain) for v in report.vehicles]
    else:
        what, own = "peaks", [(v.linf_exact, v.linf_gain) for v in report.vehicles]
    names = names or [f"follower {k}" for k in range(1, len(own) + 1)]
    gains = {name: gain for name, (one, gain) in zip(names, own, strict=True) if not one.stable}
    who = [*gains]
    if not who:
        return f"No follower amplifies {what}."
    extent = _extent(verdict.value)
    if len(who) == 1:
        return f"{_capital(who[0])} amplifies {what} {extent}."
    worst = max(gains, key=lambda name: gains[name])
    return f"{_capital(joined(who))} amplify {what}, {worst} the most, {extent}."


def _weak(verdict: Verdict, report: StabilityReport) -> str:
    """What reaches the last follower."""
    platoon = report.platoon
    if verdict.criterion is Criterion.L2_WEAK:
        if platoon.l2_strict.stable:
            return "No follower amplifies disturbances, so neither does the platoon."
        if verdict.stable:
            return (
                "Some followers amplify, but others damp more: no frequency grows along the"
                " platoon."
            )
        at = f"A disturbance at {platoon.peaks[-1].omega:.3g} rad/s grows"
    else:
        if platoon.linf_strict.stable:
            return "No follower amplifies peaks, so neither does the platoon."
        if isnan(verdict.value):
            return "The vehicles' time scales differ too much for this to be computed."
        if verdict.stable:
            return "As far as can be computed, no peak grows from the leader to the last follower."
        at = "A peak of the speed deviation can grow"
    return f"{at} {_extent(verdict.value)} from the leader to the last follower."


def _extent(gain: float) -> str:
    return "without limit" if isinf(gain) else f"by a factor of up to {factor(gain)}"


def factor(gain: float) -> str:
    """A gain for a sentence: three digits, and more the closer it is to 1."""
    excess = abs(gain - 1.0)
    if excess >= 0.2:
        return _three(gain)
    return f"{gain:.4g}" if excess >= 5e-4 else f"1 + {gain - 1.0:.2g}"


def _three(value: float) -> str:
    """Three significant digits, of which a last zero is one."""
    return f"{value:#.3g}".rstrip(".")


def amplification(chosen: ParameterSet, report: StabilityReport) -> str:
    """How many vehicles amplify disturbances, and which most, in a sentence.

    Args:
        chosen: the vehicles' names and parameters.
        report: theirs.
    """
    who = [k for k, vehicle in enumerate(report.vehicles) if not vehicle.l2.stable]
    count, total = len(who), len(chosen)
    if not who:
        growing = any(not vehicle.linf_exact.stable for vehicle in report.vehicles)
        peaks = " But peaks can still grow: see the L∞ gain." if growing else ""
        if total == 1:
            return f"{_capital(chosen.spoken[0])} does not amplify any frequency.{peaks}"
        return f"None of the vehicles amplifies any frequency.{peaks}"
    worst = max(who, key=lambda k: report.vehicles[k].peak.gain)
    peak, name = report.vehicles[worst].peak, chosen.spoken[worst]
    extent = "without limit" if isinf(peak.gain) else f"up to {peak.gain:.3g} times"
    most = extent + (f" at {peak.omega:.3g} rad/s" if peak.omega > 0 else "")
    if total == 1:
        return f"{_capital(name)} amplifies disturbances {most}."
    if count == 1:
        return f"One of {_number(total)} vehicles amplifies disturbances: {name}, {most}."
    start = f"All {_number(total)}" if count == total else f"{_number(count)} of {_number(total)}"
    return f"{_capital(start)} vehicles amplify disturbances, {name} the most: {most}."


def headline(chosen: ParameterSet, report: StabilityReport, uncertainty: Uncertainty | None) -> str:
    """The headline on L₂ string stability, by the posterior where it is known; and who drives.

    Args:
        chosen: the vehicles' names and parameters.
        report: theirs.
        uncertainty: of the fit that the parameters are from; None for given parameters.
    """
    said = _verdict(chosen, uncertainty) if uncertainty else amplification(chosen, report)
    return f"{said} {not_acc(chosen)}".rstrip()


def not_acc(chosen: ParameterSet) -> str:
    """The vehicles that a driver controls; empty where none does."""
    who = [label for label, by in zip(chosen.labels, chosen.drivers, strict=False) if by]
    if not who:
        return ""
    if len(who) == len(chosen):
        return "Driven by hand, not by ACC."
    return f"Driven by hand, not by ACC: {', '.join(who)}."


def _verdict(chosen: ParameterSet, uncertainty: Uncertainty) -> str:
    stable = uncertainty.probability_l2
    if len(chosen) == 1:
        return f"{_capital(chosen.spoken[0])} {_ASSESSED[assessment(stable[0])][0]}{_odds(stable)}."
    counts = Counter(map(assessment, stable))
    total = _number(len(chosen))
    if len(counts) == 1:
        (only,) = counts
        return f"All {total} vehicles {_ASSESSED[only][1]}{_odds(stable)}."
    parts = [
        f"{_number(counts[one])} {_ASSESSED[one][counts[one] > 1]}"
        for one in _ASSESSED
        if counts[one]
    ]
    return f"Of {total} vehicles {joined(parts)}."


def _odds(stable: FloatArray) -> str:
    """The probability of each of M vehicles, or its range, in brackets."""
    low, high = float(stable.min()), float(stable.max())
    if isnan(low):
        return ""
    said = " to ".join(dict.fromkeys((probability(low), probability(high))))
    return f" (probability of L₂ string stability: {said})"


def certainty(chosen: ParameterSet, report: StabilityReport, uncertainty: Uncertainty) -> str:
    """The interval of the largest peak, and the estimates outside their intervals.

    Args:
        chosen: the vehicles' names and parameters.
        report: theirs.
        uncertainty: of the fit that the parameters are from.
    """
    worst = max(range(len(chosen)), key=lambda k: report.vehicles[k].peak.gain)
    parts = (_peak_interval(chosen, report, uncertainty, worst), _outside(chosen, uncertainty))
    return " ".join(part for part in parts if part)


def criteria_differ(chosen: ParameterSet, report: StabilityReport) -> str:
    """Which vehicles are L∞ stable by the paper's criterion only; empty where none is.

    Args:
        chosen: the vehicles' names and parameters.
        report: theirs.
    """
    who = [
        name
        for name, vehicle in zip(chosen.spoken, report.vehicles, strict=True)
        if vehicle.linf_paper.stable and not vehicle.linf_exact.stable
    ]
    if not who:
        return ""
    verb = "meets" if len(who) == 1 else "meet"
    return (
        f"{_capital(joined(who))} {verb} the paper's L∞ criterion, which is necessary but not"
        " sufficient: by the exact criterion peaks grow."
    )


def probabilities(chosen: ParameterSet, uncertainty: Uncertainty) -> str:
    """Each vehicle's probability of L₂ string stability."""
    pairs = zip(chosen.labels, uncertainty.probability_l2.tolist(), strict=True)
    each = (f"{label} {'not determined' if isnan(p) else probability(p)}" for label, p in pairs)
    return f"Probability of L₂ string stability: {', '.join(each)}."


def _peak_interval(
    chosen: ParameterSet, report: StabilityReport, uncertainty: Uncertainty, k: int
) -> str:
    if isnan(uncertainty.probability_l2[k]):
        return f"The data do not determine whether {chosen.spoken[k]} amplifies disturbances."
    peak = uncertainty.peak_gain
    interval = between(float(peak.lower[k]), float(peak.upper[k]), 2)
    gain, level = report.vehicles[k].peak.gain, 100 * uncertainty.level
    whose = f" of {chosen.spoken[k]}" if len(chosen) > 1 else ""
    return f"Peak gain{whose}: {gain:.3g} by the estimate, {level:.0f} % interval {interval}."


def _outside(chosen: ParameterSet, uncertainty: Uncertainty) -> str:
    """Which estimates lie outside their intervals."""
    parts = []
    for name, row in zip(chosen.spoken, uncertainty.inside, strict=True):
        symbols = [one.symbol for one, inside in zip(PARAMETERS, row, strict=True) if not inside]
        if symbols:
            whose = f" of {name}" if len(chosen) > 1 else ""
            parts.append(f"{' and '.join(symbols)}{whose}")
    return f"Estimates outside their intervals: {'; '.join(parts)}." if parts else ""


def _capital(words: str) -> str:
    return words[:1].upper() + words[1:]


def _number(count: int) -> str:
    return NUMBERS[count] if count < len(NUMBERS) else str(count)


@dataclass(frozen=True)
class Places:
    """Names the vehicles of a platoon by their place, 0 for the leader."""

    names: tuple[str, ...] = ()
    """(M,) of the followers within a sentence; by default their places."""
    source: str = "platoon"

    def label(self, number: int) -> str:
        """As at the beginning of a sentence."""
        return _capital(self.spoken(number))

    def spoken(self, number: int) -> str:
        """As within a sentence."""
        if not number:
            return "the leader"
        return self.names[number - 1] if self.names else f"follower {number}"


PLACES = Places()
"""What the findings of a `PlatoonRun` are about."""


@message.register
def _(finding: simulation.PlatoonFinding, about: Labelled) -> str:
    match finding:
        case simulation.Collision():
            who = about.label(finding.follower)
            return (
                f"{who} collides with the vehicle ahead at {finding.time:.1f} s. {AFTER_COLLISION}"
            )
        case simulation.Reversal():
            return (
                f"{about.label(finding.follower)} drives backwards from {finding.time:.1f} s on, as"
                " the model has no standstill."
            )
        case simulation.NeverSettles():
            who = about.label(finding.follower)
            return f"{who} never settles, so its amplitude never becomes constant."
        case simulation.TooShort():
            return (
                "The run is too short to measure amplitudes over a whole period of"
                f" {finding.period:.3g} s; a duration of {finding.duration:.0f} s is enough."
            )
        case simulation.TransientLeft():
            return (
                f"{about.label(finding.follower)} is still in its transient, above"
                f" {100 * simulation.SETTLED:g} % of its amplitude, where that is measured; a"
                f" duration of {finding.duration:.0f} s is enough."
            )


def disturbance(run: PlatoonRun, places: Places = PLACES) -> str:
    """Whether the disturbance has grown at the last follower; ``places`` name the vehicles."""
    wave, moved = run.amplitudes, run.largest_deviation
    what = "oscillation" if wave else "largest speed deviation"
    if run.collisions:
        first, *others = run.contacts
        end = f"{places.spoken(first.follower)} collides at {first.time:.0f} s"
        if others:
            who = [f"{places.spoken(one.follower)} at {one.time:.0f} s" for one in others]
            end += f", then {joined(who)}"
        if not moved[0] > 0:
            return f"{_capital(end)}."
        ratio = moved.max() / moved[0]
        return f"Speeds deviate up to {ratio:.3g} times as much as the leader's; {end}."
    sizes = wave.measured if wave and wave.periods else moved
    if not sizes[0] > 0:
        return "The leader's speed is constant, so there is no disturbance."
    ratio, size = sizes[-1] / sizes[0], f"{_three(sizes[-1])} m/s against {_three(sizes[0])} m/s"
    if abs(ratio - 1) < SAME_AMPLITUDE:
        return f"The last follower's {what} is as large as the leader's: {size}."
    verb = "grows" if ratio > 1 else "fades"
    return f"The {what} {verb} to {ratio:.3g} times the leader's: {size}."


def disturbance_details(run: PlatoonRun, places: Places = PLACES) -> str:
    """The amplitude predicted for a sinusoid and the smallest gap; ``places`` name the vehicles."""
    wave, parts = run.amplitudes, []
    if run.collisions:
        parts.append(AFTER_COLLISION)
        last = run.survivors - 1
        if last:
            size = run.largest_deviation[last]
            parts.append(
                f"The last one that drives on, {places.spoken(last)}, deviates by {size:.3g} m/s."
            )
    if wave:
        would = "would reach" if run.collisions else "reaches"
        parts.append(f"By |H| the last follower {would} {wave.predicted[-1]:.3g} m/s.")
    if not run.collisions:
        k = int(run.minimum_gap.argmin())
        gap = round(run.minimum_gap[k], 1) + 0.0
        parts.append(
            f"The smallest gap is {gap:.1f} m, that of {places.spoken(k + 1)} at"
            f" {run.minimum_gap_time[k]:.0f} s."
        )
    return " ".join(parts)
