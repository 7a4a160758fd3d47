"""String stability in sentences: the verdict, its probability and reason."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from math import isfinite, isinf, isnan

from accpinn.findings import all_of, capital, joined, percent, probability, spelled
from accpinn.inference.gain_check import COHERENT, FASTEST
from accpinn.inference.intervals import Uncertainty
from accpinn.inference.measured_growth import DIFFERENT
from accpinn.model.published import ParameterSet
from accpinn.results.objections import against_model
from accpinn.results.objections import measured_gain_sentences as measured_gain_sentences
from accpinn.stability import (
    Assessment,
    Behaviour,
    Criterion,
    StabilityReport,
    VehicleStability,
    Verdict,
)
from accpinn.stability.margin import NormMargin, State
from accpinn.stability.waves import Waves
from accpinn.study.vehicles import ALL_OF_IT, AssessedVehicles, PeakGrowth
from accpinn.units import FloatArray, Quantity

_UNDAMPED = "With β = 0 and τ = 0 the vehicle is undamped"
_UNSTABLE = (
    "The vehicle itself is unstable, as its lag or delay is too long for its gains: any disturbance"
    " grows without limit."
)
_ASSESSED: Mapping[Assessment, tuple[str, str]] = {
    "unstable": ("amplifies disturbances", "amplify disturbances"),
    "stable": ("is L₂ string stable", "are L₂ string stable"),
    "undecided": ("may or may not amplify disturbances", "may or may not amplify disturbances"),
    "not determined": ("is not determined by the data", "are not determined by the data"),
}
"""Verb for one vehicle, and for several."""
MAY_AMPLIFY = (
    "a car whose actuator lags or whose controller responds with a delay may amplify more."
)
GIVEN_PARAMETERS = f"The verdict is that of the CTHP with these parameters; {MAY_AMPLIFY}"
"""What a verdict on parameters without a recording assumes."""
SEVERAL = "Each car by the model of its own result, linearised at its median speed."
"""What a verdict on vehicles of several results assumes."""
MEASURED = (
    "Points: the gain measured from the recorded speeds alone by Welch's method, |Ĝ| = |S_uv|/S_uu;"
    " bars: |Ĝ| exp(±t ε) with ε² = (1 - γ²)/(2(n - 1)γ²), at the bands' level (Bendat and Piersol,"
    f" Random Data, 2010). Full points: coherence γ² of at least {COHERENT:g} up to {FASTEST:g}"
    " rad/s, which the sentences compare; faint: less, but above that of unrelated signals."
)
"""What the measured gain in the Bode magnitude is."""
CRITERIA = (
    "Criteria and gains of each vehicle, in their order in the platoon: stable where a criterion is"
    " above 0 and no gain above 1. Dotted: from the leader to that follower, through all vehicles"
    " before it."
)
"""What the criteria along the platoon are."""
NAMED = 3
"""Vehicles up to which those of one verdict are named, not counted."""
FOLD, LEAST_GROWTH = 2.0, 0.005
"""Gain from which growth is said as a multiple, not in percent, and the least that is said."""


def about_bode(uncertainty: Uncertainty | None) -> str:
    """What is drawn over the Bode magnitudes."""
    band = f" Shaded: {100 * uncertainty.level:.0f} % bands." if uncertainty else ""
    marks = "Diamonds: peaks. Rings: ends of amplified frequencies. Bars: the paper's L∞ limits."
    return f"{marks}{band}"


def about_map(chosen: ParameterSet, held: int, parameter: str = "α") -> str:
    """What the map of stability is that holds the parameter of one vehicle."""
    rings = (
        f" Rings: vehicles with another {parameter}, for which the boundaries do not hold."
        if len(chosen) > 1
        else ""
    )
    parameters = chosen.parameters[held]
    late = " lag and delay included," if parameters.lag or parameters.delay else ""
    return (
        f"Boundaries at {chosen.labels[held]}'s {parameter},{late} stable in the green."
        f" Hatched: stable by the paper's L∞ criterion, but peaks grow.{rings}"
    )


def most_needed(subject: AssessedVehicles) -> str:
    """The vehicle that is farthest from string stability, or nearest to losing it, in a sentence.

    By L₂, as the verdict above the pages' pictures.
    """
    margins, spoken = subject.l2_margins, subject.vehicles.spoken
    judged = [k for k, margin in enumerate(margins) if not isnan(margin.distance.value)]
    if not judged:
        return "The data do not determine the margins."
    worst = min(judged, key=lambda k: margins[k].distance.value)
    margin, name = margins[worst], spoken[worst]
    value = margin.distance.value
    if margin.state is State.NEVER:
        return f"No time gap makes {name} L₂ string stable."
    if margin.state is State.TOO_LONG:
        return f"{capital(name)} is L₂ string stable at smaller time gaps alone."
    if isinf(value):
        return "The time gap has no effect on string stability."
    if value >= 0:
        least = f"{capital(name)} has" if len(judged) == 1 else f"All are stable, {name} with"
        return f"{least} {_gap(margin.distance, 1)} to spare."
    most = " most:" if len(judged) > 1 else ""
    return (
        f"{capital(name)} needs{most} {_gap(margin.distance, -1)} more time gap to be L₂ string"
        " stable."
    )


def next_to_stable(subject: AssessedVehicles) -> str:
    """How much more time gap the vehicle needs that lacks most, in a sentence.

    Empty where none is L₂ unstable, or no time gap makes it stable.
    """
    lacking = {
        k: margin
        for k, margin in enumerate(subject.l2_margins)
        if margin.state is State.TOO_SHORT and subject.assessed[k].l2.assessment != "not determined"
    }
    if not lacking:
        return ""
    most = min(lacking, key=lambda k: lacking[k].distance.value)
    who = "" if len(subject.vehicles) == 1 else f"{subject.vehicles.labels[most]} "
    are_alike = len({margin.distance.value for margin in lacking.values()}) == 1
    if are_alike and len(lacking) == len(subject.vehicles) > 1:
        who = "each "
    said = f"{who}needs {_gap(lacking[most].distance, -1, 'more')} for string stability."
    return capital(said)


def margin_in_words(margin: NormMargin) -> str:
    """The margin of one vehicle by L₂, as a sentence; empty where there is none."""
    if margin.state is State.TOO_SHORT:
        return f"Needs {_gap(margin.distance, -1, 'more')} time gap."
    if margin.state is State.STABLE and isfinite(margin.distance.value):
        return f"Time gap to spare: {_gap(margin.distance, 1)}."
    is_told = margin.state in (State.NEVER, State.TOO_LONG)
    return f"{capital(margin.state.value)}." if is_told else ""


def _gap(distance: Quantity, sign: int, word: str = "") -> str:
    """A margin as a positive time in s, with its interval; the word stands before that."""
    gap = f"{sign * distance.value:.2f} s {word}".rstrip()
    low, high = sorted((sign * distance.lower, sign * distance.upper))
    if isnan(low) or (isinf(low) and isinf(high)):
        return gap
    if isinf(low):
        within = f"up to {high:.2f}"
    else:
        between = "–" if low >= 0 else " to "
        within = f"{low:.2f} or more" if isinf(high) else f"{low:.2f}{between}{high:.2f}"
    return f"{gap} ({within})".replace("-", "−")


def about_margin(subject: AssessedVehicles) -> str:
    """What the margins are, beside their picture."""
    speeds = 3.6 * subject.margins.speed
    low, high = round(float(speeds.min())), round(float(speeds.max()))
    at = f"{low} km/h" if low == high else f"{low} to {high} km/h"
    level = subject.margins.level
    bars = f" In brackets: {percent(level)} intervals." if level else ""
    return f"At {at}, all else kept.{bars}"


def waves_in_words(found: Waves) -> str:
    """How much the two halves of a wave grow by the vehicle that amplifies most."""
    pairs = zip(found.names, found.vehicles, strict=True)
    grow = [(*vehicle.at(vehicle.usual), vehicle.usual, name) for name, vehicle in pairs]
    judged = [row for row in grow if not isnan(row[0] + row[1])]
    if not judged:
        return "No steady wave is found."
    braking, accelerating, size, name = max(judged, key=lambda row: max(row[:2]))
    lead = f"{name} amplifies{' most' if len(grow) > 1 else ''}"
    if len(judged) == len(grow) > 1 == len({row[:2] for row in judged}):
        lead = f"{capital(all_of(len(grow), 'vehicles'))} amplify"
    return (
        f"{lead}: of a sinusoid of {3.6 * size:.0f} km/h ahead the lower half"
        f" (braking) grows {grown(braking)}, the upper half (accelerating) {grown(accelerating)}."
    )


WAVES = (
    "The speed ahead is a sinusoid of this size about the mean speed; growth is that of the"
    " follower's largest deviation below the mean speed (braking) and above it (accelerating), once"
    " its motion is steady. Over the size: at the frequency at which it grows most, at size 0 the"
    " peak of |H|. None where a gap or a speed would fall below 0, or no motion settles."
)
"""What the growth of waves is."""
MARGIN = (
    "Margin: the vehicle's time gap τ + s₀/v minus the smallest at which it is string stable with"
    " its own gains, s₀, lag and delay; that is τ - τ_min at every speed. A nonlinear model is"
    " linearised at the speed. All cars in order: the change of all time gaps at which no"
    " frequency is larger at the last follower than at the leader. With a lag or a delay, peaks"
    " that grow by less than .02 % count as stable by L∞."
)
"""What a margin is."""
MARGIN_MARKS = "Circles: L₂; diamonds: exact L∞."
POLES = (
    "Crosses: poles, with a delay those of the exact equation; rings: zeros; dots: rightmost poles"
    " of posterior samples; dotted: damping ratios .4 and .7. Faster poles lie left of the picture."
    " Responses have the delay's approximant, as the verdict: ∫h = 1, so ‖h‖₁ is 1 plus twice the"
    " area below zero."
)
"""What poles and responses are."""


def reasons(subject: AssessedVehicles) -> list[tuple[str, list[tuple[Verdict, str]]]]:
    """Every verdict with its reason, by the label of the vehicle; of several also the platoon's."""
    verdicts = [
        (
            label,
            [(v, reason(v, vehicle)) for v in (vehicle.l2, vehicle.linf_paper, vehicle.linf_exact)],
        )
        for label, vehicle in zip(subject.vehicles.labels, subject.report.vehicles, strict=True)
    ]
    return [*verdicts, ("The platoon", platoon_reasons(subject))] if len(verdicts) > 1 else verdicts


def platoon_reasons(subject: AssessedVehicles) -> list[tuple[Verdict, str]]:
    """The platoon's verdicts by L₂, strict and weak, and by L∞, each with its reason."""
    report, names = subject.report, subject.vehicles.spoken
    verdicts, platoon = report.vehicles, report.platoon
    return [
        (
            platoon.l2_strict,
            _strict("disturbances", names, [(v.l2, v.peak.gain) for v in verdicts]),
        ),
        (platoon.l2_weak, along_platoon(subject)),
        (
            platoon.linf_strict,
            _strict("peaks", names, [(v.linf_exact, v.linf_gain) for v in verdicts]),
        ),
        (platoon.linf_weak, _peaks_along(report)),
    ]


def reason(verdict: Verdict, vehicle: VehicleStability) -> str:
    """The reason for a verdict on a vehicle, in one sentence."""
    without = vehicle.behaviour in (Behaviour.NO_GAP_CONTROL, Behaviour.NO_REACTION)
    if without and verdict.stable:  # with a delay disturbances may grow without gap control, too
        return str(vehicle.behaviour.value)
    if verdict.criterion is Criterion.L2:
        return _l2(vehicle)
    is_paper = verdict.criterion is Criterion.LINF_PAPER
    return _linf_paper(vehicle) if is_paper else _linf_exact(vehicle)


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
        return f"{_UNDAMPED}: a disturbance at {three(peak.omega)} rad/s grows without limit."
    if vehicle.crossover is None or isinf(peak.gain):
        return _UNSTABLE
    low = f"Disturbances {band_of(vehicle)} rad/s are amplified"
    if verdict.marginal:
        return f"{low}, but by one part in 10⁹ at most, so the verdict is marginal."
    return (
        f"{low}, most at {three(peak.omega)} rad/s: they grow {grown(peak.gain)}"
        f" ({peak.db:.2f} dB)."
    )


def band_of(vehicle: VehicleStability) -> str:
    """The frequencies that an amplifying vehicle amplifies, as "below 0.43"."""
    last = three(vehicle.crossover or 0.0)
    return f"between {three(vehicle.onset)} and {last}" if vehicle.onset else f"below {last}"


def _linf_paper(vehicle: VehicleStability) -> str:
    if vehicle.linf_paper.marginal:
        return "On the boundary: the poles coincide, and the paper's criterion requires two."
    if vehicle.damping_ratio is None:
        real = "real, as it requires" if vehicle.linf_paper.stable else "complex"
        return f"The paper's criterion ignores lag and delay; without them the poles are {real}."
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
    if isinf(verdict.value):
        return _UNSTABLE
    peak = f"a peak of the speed deviation ahead can grow {grown(verdict.value)}"
    if vehicle.damping_ratio is None:
        return f"The impulse response changes sign, so {peak}."
    if vehicle.linf_paper.stable:
        return (
            "Real poles, which the paper's criterion requires, are necessary but not sufficient:"
            f" the impulse response changes sign, so {peak}."
        )
    return f"The vehicle oscillates, so its impulse response changes sign, and {peak}."


def _strict(what: str, names: Sequence[str], verdicts: Sequence[tuple[Verdict, float]]) -> str:
    """The followers that amplify disturbances or peaks, by their verdicts and gains."""
    pairs = zip(names, verdicts, strict=True)
    gains = {name: gain for name, (verdict, gain) in pairs if not verdict.stable}
    amplifying = [*gains]
    if not amplifying:
        return f"No follower amplifies {what}."
    extent = grown(max(gains.values()))
    if len(amplifying) == 1:
        return f"{capital(amplifying[0])} amplifies {what} {extent}."
    if len(set(gains.values())) == 1:
        return f"{capital(joined(amplifying))} amplify {what} {extent}."
    worst = max(gains, key=lambda name: gains[name])
    return f"{capital(joined(amplifying))} amplify {what}, {worst} the most: {extent}."


def along_platoon(subject: AssessedVehicles) -> str:
    """How much a disturbance grows from the leader to the last of several vehicles, and why."""
    platoon = subject.report.platoon
    measured = subject.platoon_growth
    if measured.is_measured and measured.gain.lower > 1:
        return f"From the leader to the last follower disturbances grow {largest(measured)}."
    if platoon.l2_strict.stable:
        return "No follower amplifies disturbances, so neither does the platoon."
    if platoon.l2_weak.stable:
        return (
            "Some followers amplify, but others damp more, so no frequency grows along the platoon."
        )
    omega = platoon.peaks[-1].omega
    ends = subject.growth(range(len(subject.vehicles))) if omega else None
    return (
        f"A disturbance at {three(omega)} rad/s grows {grown(platoon.l2_weak.value, ends)} from the"
        " leader to the last follower."
    )


def _peaks_along(report: StabilityReport) -> str:
    """How much a peak of the speed deviation can grow up to the last follower."""
    verdict = report.platoon.linf_weak
    if report.platoon.linf_strict.stable:
        return "No follower amplifies peaks, so neither does the platoon."
    if isnan(verdict.value):
        return "The vehicles' time scales differ too much for this to be computed."
    if verdict.stable:
        return "As far as can be computed, no peak grows from the leader to the last follower."
    return (
        f"A peak of the speed deviation can grow {grown(verdict.value)} from the leader to the last"
        " follower."
    )


def grown(gain: float, ends: Quantity | None = None, level: float | None = None) -> str:
    """How much disturbances grow by a gain, as the end of "they grow": "by up to 28 % (19–38 %)".

    Args:
        gain: the largest.
        ends: its interval, which is said in brackets unless it is nan.
        level: of that interval, where it is to be said, too.
    """
    if isinf(gain):
        return "without limit"
    if gain - 1.0 < LEAST_GROWTH:
        return f"by less than {100 * LEAST_GROWTH:.1f} %"
    ends = None if ends is None or isnan(ends.lower) else ends
    parts = gain, *((ends.lower, ends.upper) if ends else ())
    if gain < FOLD:
        most, *interval = (f"{100 * max(part - 1.0, 0.0):.0f}" for part in parts)
        growth, unit = f"by up to {most} %", " %"
    else:
        most, *interval = (f"{part:.1f}" if ends else three(part) for part in parts)
        growth, unit = f"up to {most}-fold", ""
    if not interval:
        return growth
    low, high = interval
    within = f"{low}{unit} or more" if high == "inf" else f"{low}–{high}{unit}"
    return f"{growth} ({percent(level) + ' interval ' if level else ''}{within})"


def three(value: float) -> str:
    """Three significant digits, including zeros at the end."""
    return f"{value:#.3g}".rstrip(".")


def headline(subject: AssessedVehicles) -> str:
    """The headline on L₂ string stability, by the posterior where it is known, and who drives.

    A verdict that the measured gain contradicts is called the model's.
    """
    against = (objection.sentence for objection in against_model(subject))
    sentences = (*_verdicts(subject), *against, not_acc(subject.vehicles))
    return " ".join(filter(None, sentences))


def behind_verdict(subject: AssessedVehicles) -> str:
    """Probabilities of the verdict, what the measured gain has against it, and who drives."""
    uncertainty, chosen = subject.uncertainty, subject.vehicles
    against = (objection.sentence for objection in against_model(subject))
    sentences = (
        probabilities(chosen, uncertainty) if uncertainty else "",
        *against,
        not_acc(chosen),
    )
    return " ".join(filter(None, sentences))


def _verdicts(subject: AssessedVehicles) -> Iterator[str]:
    """What becomes of disturbances, a sentence for the vehicles of each verdict."""
    total, spoken = len(subject.vehicles), subject.vehicles.spoken
    for kind in _ASSESSED:
        alike = [k for k in range(total) if subject.assessed[k].l2.assessment == kind]
        named = joined([spoken[k] for k in alike]) if len(alike) <= NAMED else ""
        named = named or f"{spelled(len(alike))} of {spelled(total)} vehicles"
        if alike:
            named = all_of(total, "vehicles") if len(alike) == total > 1 else named
            yield becomes(subject, alike, named, is_headline=True)
        if kind == "stable" and len(alike) == total:
            if not all(vehicle.linf_exact.stable for vehicle in subject.report.vehicles):
                yield "But peaks can still grow: see the L∞ gain."


def most_amplifying(subject: AssessedVehicles) -> str:
    """The vehicle that amplifies most, and by how much, in twenty words beside its name.

    What the measured gain contradicts is called the model's.
    """
    spoken = subject.vehicles.spoken
    assessed = [vehicle.l2.assessment for vehicle in subject.assessed]
    judged = [k for k, kind in enumerate(assessed) if kind != "not determined"]
    if not judged:
        return "The data do not determine whether these vehicles amplify disturbances."
    amplifying = [k for k in judged if assessed[k] != "stable"]
    growths = subject.growths
    count, most = len(spoken), max(amplifying or judged, key=lambda k: growths[k].gain.value)
    by = largest(growths[most])
    if not amplifying:
        whole = f"{all_of(count, 'vehicles')} damp" if count > 1 else f"{spoken[0]} damps"
        part = f"{joined([spoken[k] for k in judged])} {'damp' if len(judged) > 1 else 'damps'}"
        sentence = f"{whole if len(judged) == count else part} disturbances at every frequency."
    elif assessed[most] == "undecided":
        sentence = f"{spoken[most]} may amplify disturbances: {by}."
    elif count == 1:
        sentence = f"{spoken[most]} amplifies {by}."
    elif all(kind == "unstable" for kind in assessed):
        are_alike = len({growth.gain.value for growth in growths}) == 1
        extent = by if are_alike else f"{spoken[most]} most: {by}"
        sentence = f"{all_of(count, 'vehicles')} amplify{'' if are_alike else ','} {extent}."
    else:
        sentence = f"{spoken[most]} amplifies most: {by}."
    against = _is_contradicted(subject, [most] if amplifying else judged)
    return f"By the model, {sentence}" if against else capital(sentence)


def _is_contradicted(subject: AssessedVehicles, places: Sequence[int]) -> bool:
    """Whether the measured gain contradicts what is said of some vehicles.

    A growth that is measured itself says so, and is contradicted only where nothing grows.
    """
    place_of = {subject.vehicles.vehicles[k + 1]: k for k in places}
    return any(
        check.vehicle in place_of
        and check.contradiction
        and not (
            check.contradiction == "apart" and subject.growths[place_of[check.vehicle]].is_measured
        )
        for check in subject.checks
    )


def largest(growth: PeakGrowth, level: float | None = None, has_frequency: bool = True) -> str:
    """A largest growth, and by what it is known: "up to 2.1-fold (1.9–2.4) at .5 rad/s, measured".

    The level of its interval is said where it is given.
    """
    has_ends = not isnan(growth.gain.lower)
    words = grown(growth.gain.value, growth.gain if has_ends else None, level)
    at = f" at {three(growth.omega)} rad/s" if has_frequency and growth.omega > 0 else ""
    if not growth.is_measured:
        return f"{words}{at}"
    model = f"{growth.model:.1f}-fold" if growth.gain.value >= FOLD else percent(growth.model - 1.0)
    return f"{words}{at}, measured ({model} by the model)"


def explained(subject: AssessedVehicles) -> str:
    """Whether the cars' models explain the measured platoon; empty where that is not known.

    The share is that of the frequencies at which both agree within their bands.
    """
    share = subject.platoon_difference
    if isnan(share):
        return ""
    verb = "do not explain" if share > DIFFERENT else "explain"
    return f"The models {verb} the platoon (within bands: {percent(1.0 - share)})."


def becomes(
    subject: AssessedVehicles,
    alike: Sequence[int],
    named: str,
    are_several: bool | None = None,
    is_headline: bool = False,
) -> str:
    """What becomes of disturbances behind followers of one verdict, in a sentence.

    Args:
        subject: the vehicles, with or without a posterior.
        alike: the followers, 0 for the first.
        named: what they are called within a sentence.
        are_several: whether that is a plural; by default where they are several.
        is_headline: whether probabilities are told of every verdict, and of several vehicles that
            amplify the most alone, with its frequency.
    """
    uncertainty, kind, peaks = subject.uncertainty, subject.assessed[alike[0]].l2.assessment, {}
    verb = _ASSESSED[kind][len(alike) > 1 if are_several is None else are_several]
    against = _is_contradicted(subject, alike)
    start = f"By the model, {named} {verb}" if against else f"{capital(named)} {verb}"
    has_odds = is_headline or kind == "undecided"
    odds = _odds(uncertainty.probability_l2[alike]) if uncertainty and has_odds else ""
    if kind == "not determined":
        return f"Not determined by the data: {named}."
    if kind != "unstable":
        return f"{start}{odds}."
    level = uncertainty.level if uncertainty and is_headline else None
    for k in alike:
        peak = subject.growths[k]
        peaks[k] = peak.gain.value, largest(peak, level, has_frequency=is_headline)
    least, most = (pick(alike, key=lambda k: peaks[k][0]) for pick in (min, max))
    if peaks[least][0] == peaks[most][0]:
        return f"{start} {peaks[most][1]}{odds}."
    if is_headline:
        return f"{start}{odds}, {subject.vehicles.spoken[most]} the most: {peaks[most][1]}."
    labels = subject.vehicles.labels
    return (
        f"{start}: {labels[least]} least, {peaks[least][1]}, and {labels[most]} most,"
        f" {peaks[most][1]}."
    )


def not_acc(chosen: ParameterSet, places: Iterable[int] | None = None) -> str:
    """The vehicles that a driver controls, and how long; empty where none does.

    All that are chosen, or those at some ``places``.
    """
    pairs = [*zip(chosen.labels, chosen.by_hand, strict=False)]
    pairs = pairs if places is None or not pairs else [pairs[k] for k in places]
    whole = [label for label, share in pairs if share > ALL_OF_IT]
    parts = [f"{label} for {percent(share)}" for label, share in pairs if 0 < share <= ALL_OF_IT]
    if whole and len(whole) == len(pairs):
        return "Driven by hand, not by ACC."
    sentences = [f"Driven by hand, not by ACC: {', '.join(whole)}."] if whole else []
    sentences += [f"Driven by hand {joined(parts)} of the time."] if parts else []
    return " ".join(sentences)


def _odds(stable: FloatArray) -> str:
    """The probability (M,), or its range, in brackets."""
    low, high = float(stable.min()), float(stable.max())
    if isnan(low):
        return ""
    ends = [*dict.fromkeys((probability(low), probability(high)))]
    odds = " to ".join(ends)
    if len(ends) > 1 and ends[0].startswith("under"):
        odds = f"at most {ends[1]}"
    each = " each" if len(stable) > 1 and " to " not in odds else ""
    return f" (probability of L₂ string stability: {odds}{each})"


def criteria_differ(subject: AssessedVehicles) -> str:
    """The vehicles that are L∞ stable by the paper's criterion only; empty where none is."""
    differing = {
        name: vehicle
        for name, vehicle in zip(subject.vehicles.spoken, subject.report.vehicles, strict=True)
        if vehicle.linf_paper.stable and not vehicle.linf_exact.stable
    }
    if not differing:
        return ""
    is_late = any(vehicle.damping_ratio is None for vehicle in differing.values())
    limit = "ignores lag and delay" if is_late else "is necessary but not sufficient"
    return (
        f"{capital(joined([*differing]))} {'meets' if len(differing) == 1 else 'meet'} the paper's"
        f" L∞ criterion, which {limit}: by the exact criterion peaks grow."
    )


def probabilities(
    chosen: ParameterSet, uncertainty: Uncertainty, places: Iterable[int] | None = None
) -> str:
    """The probability of L₂ string stability of each vehicle, or of those at some ``places``."""
    shares = uncertainty.probability_l2.tolist()
    parts = (
        f"{chosen.labels[k]} {'not determined' if isnan(shares[k]) else probability(shares[k])}"
        for k in (range(len(chosen)) if places is None else places)
    )
    return f"Probability of L₂ string stability: {', '.join(parts)}."
