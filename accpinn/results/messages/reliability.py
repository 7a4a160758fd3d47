"""Sentences about how far estimates can be trusted.

Uncertainty, identifiability, model adequacy, multistart, closed-loop simulation, residual and
validation.
"""

from accpinn.channels import PARAMETERS
from accpinn.evaluation import closed_loop, whiteness
from accpinn.evaluation.closed_loop import ClosedLoopFinding
from accpinn.evaluation.validation import OtherVehicles, ValidationOverlaps
from accpinn.inference import intervals, prediction
from accpinn.inference.identifiability import WIDE, NarrowerIntervals, WeakIdentification
from accpinn.inference.intervals import Cause, ParameterInterval
from accpinn.inference.model_adequacy import (
    Adequacy,
    AdequacyFinding,
    BetterForm,
    FormPosterior,
    Inadequate,
    WeightedForms,
)
from accpinn.methods.fit import Fit
from accpinn.methods.maximum_likelihood import DisturbanceSize, disturbance_sizes
from accpinn.methods.registry import METHODS
from accpinn.methods.state_space import Form
from accpinn.results.messages import Labelled, joined, message, messages, percent
from accpinn.segment.segment import SegmentInfo
from accpinn.study import starts
from accpinn.study.recommendation import Recommendation
from accpinn.study.windows import WindowsDiffer

UNLIKELY = 0.005
"""A form of the model with less probability is not named."""
FEW = 3
"""More methods than these are counted, not named."""
QUANTITIES = {one.symbol: one for one in PARAMETERS}
BIAS = (
    "disturbances to which the vehicle itself responds bias what fits the accelerations best, so"
    " prefer maximum likelihood"
)
CAUSES: dict[Cause, str] = {
    "disturbances": BIAS,
    "apart": "the likelihood has a long tail or several maxima here, so rely on the interval",
    "unfinished": f"more iterations may change it, or {BIAS}",
    "stopped": "training was stopped before its end",
    "diverged": "training diverged",
}


@message.register
def _(finding: intervals.UncertaintyFinding, about: Labelled) -> str:
    match finding:
        case intervals.NotDetermined():
            return (
                f"{about.label(finding.vehicle)}: these data determine none of α, β and τ; choose a"
                " longer window, or one in which the vehicle ahead brakes and accelerates."
            )
        case intervals.OutsideInterval():
            estimates = " and ".join(_estimate(one) for one in finding.parameters)
            lies = "lies" if len(finding.parameters) == 1 else "lie"
            return (
                f"{about.label(finding.vehicle)}: the estimate's {estimates} {lies} outside the"
                f" interval; {CAUSES[finding.cause]}."
            )


def _estimate(one: ParameterInterval) -> str:
    text = QUANTITIES[one.symbol].text
    value = "undetermined" if one.estimate is None else text(one.estimate)
    best = "" if one.likeliest is None else f", maximum likelihood {text(one.likeliest)}"
    return f"{one.symbol} = {value} (interval {_ends(one)}{best})"


@message.register
def _(finding: WeakIdentification, about: Labelled) -> str:
    reasons = []
    if finding.leader_deviation is not None:
        reasons.append(f"the leader's speed varies by only {finding.leader_deviation:.2f} m/s")
    if finding.relative_deviation is not None:
        reasons.append(f"Δv varies by only {finding.relative_deviation:.2f} m/s")
    if finding.condition is not None:
        number = f"condition number {finding.condition:.0f}"
        reasons.append(f"the model's terms are nearly proportional ({number})")
    who, because = about.label(finding.vehicle), f", as {joined(reasons)}" if reasons else ""
    if not finding.wide:
        return f"{who}: treat the intervals with caution{because}."
    spans = "interval of {} spans" if len(finding.wide) == 1 else "intervals of {} span"
    wide = joined([_wide(one) for one in finding.wide])
    return f"{who}: the {spans.format(wide)} more than a factor of {WIDE:g}{because}."


@message.register
def _(finding: NarrowerIntervals, about: Labelled) -> str:
    ways = []
    if finding.recording is not None:
        whole, part = f"{finding.recording:,.0f} s", f"{finding.window:,.0f} s"
        ways.append(f"the whole recording ({whole}; this window has {part})")
    elif finding.is_excited:
        ways.append("a longer recording")
    if not finding.is_excited:
        ways.append("a window in which the vehicle ahead brakes and accelerates more")
    ways.append(
        "several windows or runs estimated together (fit --windows, or fit_windows in Python)"
    )
    who = joined([about.label(vehicle) for vehicle in finding.vehicles])
    return f"What would narrow the intervals of {who}: {', or '.join(ways)}."


def _wide(one: ParameterInterval) -> str:
    text = QUANTITIES[one.symbol].text
    end = "or more" if one.upper is None else f"to {text(one.upper)}"
    return f"{one.symbol} ({text(one.lower)} {end})"


@message.register
def _(finding: AdequacyFinding, about: Labelled) -> str:
    match finding:
        case BetterForm():
            own = finding.posterior
            alpha, beta, tau = map(_likeliest, own.intervals)
            return (
                f"{about.label(finding.vehicle)}: a model with {EXTRA[own.form]} describes the"
                f" data better than the CTHP (AIC {finding.aic:+.0f}, log density of held-out time"
                f" {finding.holdout:+.1f}). With {_extra(own)}, α is {alpha}, β {beta} and"
                f" τ {tau}; {percent(finding.level)} intervals in brackets."
            )
        case WeightedForms():
            ends = joined([f"{one.symbol} {_ends(one)}" for one in finding.intervals])
            shares = joined(
                [
                    f"{_extra(k)} {percent(k.probability)}"
                    for k in finding.forms
                    if k.probability >= UNLIKELY
                ]
            )
            return (
                f"{about.label(finding.vehicle)}: over all forms of the model, the"
                f" {percent(finding.level)} intervals are {ends}. Probability of the forms:"
                f" {shares}."
            )
        case Inadequate():
            faults = {
                "correlated over time": finding.correlated,
                "larger at some speeds than at others": finding.uneven,
                "not normally distributed": finding.nonnormal,
                "dependent on the command, as where it is limited": finding.nonlinear,
            }
            what = joined([name for name, holds in faults.items() if holds])
            return (
                f"{about.label(finding.vehicle)}: what the model does not foresee is {what}, so"
                " intervals that take the model for true may be too narrow; compare the forms of"
                " the model, and windows with each other."
            )


def conditional(adequacy: Adequacy | None, about: Labelled) -> str:
    """What estimates and intervals take for granted, and whether another form is better.

    Args:
        adequacy: of the segment, where it is known.
        about: names the vehicles.
    """
    if adequacy is None or not adequacy.forms:
        return (
            "Estimates and intervals are those of the CTHP. They hold if it does; under a model"
            " with a distance at standstill, a lag or a delay they would differ."
        )
    use = (
        "The ones to use are those over all forms of the model, each weighted by its probability;"
        " they stand beside those of the CTHP here."
    )
    if not adequacy.better:
        return (
            "Estimates and intervals are those of the CTHP. No model with a distance at standstill,"
            " a lag or a delay describes the data clearly better, but data hardly tell these from"
            f" none. {use}"
        )
    who = joined([about.label(one.vehicle) for one in adequacy.better])
    return (
        f"Estimates and intervals are those of the CTHP. For {who[0].lower() + who[1:]} a model"
        f" with one term more describes the data better. {use}"
    )


def _likeliest(one: ParameterInterval) -> str:
    """An estimate and its interval."""
    text, value = QUANTITIES[one.symbol].text, one.likeliest
    return f"{'undetermined' if value is None else text(value)} ({_ends(one)})"


def _ends(one: ParameterInterval) -> str:
    text = QUANTITIES[one.symbol].text
    return f"{text(one.lower)} to {'no limit' if one.upper is None else text(one.upper)}"


EXTRA: dict[Form, str] = {
    "offset": "a distance at standstill (or a slope)",
    "lag": "an actuator lag",
    "delay": "a delay",
}
"""What a form of the model adds."""


def _extra(finding: FormPosterior) -> str:
    if finding.form == "cthp":
        return "CTHP"
    digits, unit = (1, "m") if finding.form == "offset" else (2, "s")
    ends = f"{finding.extra_lower:.{digits}f} to {finding.extra_upper:.{digits}f}"
    what = "a distance at standstill" if finding.form == "offset" else EXTRA[finding.form]
    return f"{what} of {finding.extra:.{digits}f} {unit} ({ends})"


@message.register
def _(finding: starts.TrainingSpread, about: Labelled) -> str:
    if finding.largest <= starts.NOTICED:
        where = "" if finding.every else " in the parameters that all of them determine"
        end = f"{max(finding.largest, 0.01):.2g} %"
        return f"All {finding.trainings} trainings end within {end} of each other{where}."
    why = (
        f"; {finding.unconverged} of them had not converged when their iterations were over, so"
        " more iterations may bring them together"
        if finding.unconverged
        else ""
    )
    return (
        f"The {finding.trainings} trainings end up to {finding.largest:.0f} % apart{why}. No single"
        " one of them should be quoted alone."
    )


@message.register
def _(finding: starts.SpreadUndetermined, about: Labelled) -> str:
    who = "all followers" if finding.vehicle == 0 else about.label(finding.vehicle)
    return (
        f"{finding.symbol} of {who} is undetermined in {finding.count} of {finding.trainings}"
        " trainings, so it has no spread."
    )


def closed_loop_event(finding: ClosedLoopFinding) -> str:
    """What happens in the closed-loop simulation, without the vehicle: the predicate alone."""
    match finding:
        case closed_loop.SimulatedCollision():
            gap = f"{finding.smallest_gap:z.1f}"
            return (
                f"collides with the vehicle ahead at {finding.time:.1f} s; its gap falls to {gap} m"
            )
        case closed_loop.SimulatedReversing():
            return f"drives backwards at {finding.time:.1f} s, at up to {finding.speed:.1f} m/s"
        case closed_loop.SimulatedDivergence():
            return (
                f"diverges: its gap leaves ±{closed_loop.DIVERGED:.0f} m at {finding.time:.1f} s,"
                " so neither it nor the vehicles behind it have closed-loop errors"
            )


@message.register
def _(finding: ClosedLoopFinding, about: Labelled) -> str:
    who = about.label(finding.vehicle)
    return f"In the closed-loop simulation, {who} {closed_loop_event(finding)}."


@message.register
def _(finding: whiteness.WhitenessFinding, about: Labelled) -> str:
    who = about.label(finding.vehicle)
    if isinstance(finding, whiteness.ShortResidual):
        return f"{who}: the window is too short to test whether the model's residual is white."
    residual = f"{who}: the model's residual ({finding.deviation:.2f} m/s²)"
    if isinstance(finding, whiteness.CorrelatedResidual):
        return (
            f"{residual} is correlated over about {finding.memory:.0f} s, so {finding.samples:,}"
            f" samples estimate its mean no better than some {finding.independent:.0f} independent"
            " ones."
        )
    if finding.deviation < whiteness.NEGLIGIBLE:
        return f"{residual} is no larger than noise and rounding make it."
    return f"{residual} is not correlated beyond a second."


@message.register
def _(finding: WindowsDiffer, about: Labelled) -> str:
    differ = "differs" if len(finding.symbols) == 1 else "differ"
    return (
        f"{about.label(finding.vehicle)}: {joined(finding.symbols)} {differ} between the"
        f" {finding.windows} windows by more than sampling error explains, so the intervals of the"
        " joint estimate are too narrow; where a further window matters, use the interval for one."
    )


BAND = (
    "Band: the space-gaps that the model predicts from the leader's speed alone, with parameters"
    " drawn from the posterior and disturbances of the size found."
)
"""What a predictive band is."""


@message.register
def _(finding: prediction.BandCoverage, about: Labelled) -> str:
    level = percent(finding.level)
    verdict = (
        "too little for a model that holds with the same parameters throughout"
        if finding.share < prediction.TOO_FEW
        else f"in keeping with {level}"
    )
    touching = (
        f" In {percent(finding.colliding)} of the simulations the vehicle touches the one ahead,"
        " and drives on."
        if finding.colliding
        else ""
    )
    share = f"{percent(finding.share)} of the measured space-gap lies"
    who = about.label(finding.vehicle)
    return f"{who}: {share} within the {level} band, {verdict}.{touching}"


@message.register
def _(finding: DisturbanceSize, about: Labelled) -> str:
    return (
        f"{about.label(finding.vehicle)}: the disturbance has a standard deviation of"
        f" {finding.deviation:.2f} m/s²; it is correlated over about {finding.memory:.1f} s and"
        f" builds up within about {finding.rise:.1f} s."
    )


def about_curves(
    info: SegmentInfo, fit: Fit, follower: int, band: prediction.GapBand | None = None
) -> tuple[str, ...]:
    """How much a band covers of a follower's gap (0 for the first), and what disturbs it."""
    own = (0, info.vehicles[follower + 1])
    covered = [one for one in (band.findings if band else ()) if one.vehicle in own]
    moved = [one for one in disturbance_sizes(info.vehicles, fit) if one.vehicle in own]
    return messages((*covered, *moved), info)


@message.register
def _(finding: Recommendation, about: Labelled) -> str:
    if not finding.intervals:
        return "Nothing: these data determine no parameter."
    said = []
    if finding.better:
        said.append(
            f"A model with {EXTRA[finding.better.posterior.form]} describes the data better."
        )
    elif finding.weighted:
        said.append("The intervals allow for a distance at standstill, a lag or a delay.")
    if finding.wide:
        only = "is" if len(finding.wide) == 1 else "are"
        said.append(f"{joined(finding.wide)} {only} known only to the order of magnitude.")
    else:
        said.append("All three are identified.")
    count, level = len(finding.outside), percent(finding.level)
    if count:
        of = "the CTHP's" if finding.weighted else "the"
        who = joined([METHODS[key].title for key in finding.outside])
        if count > FEW:
            who = f"{count} of {finding.methods} methods"
        said.append(f"Outside {of} {level} intervals: {who}.")
    else:
        said.append(f"All {finding.methods} methods lie within the CTHP's {level} intervals.")
    if finding.is_adequate is False:
        said.append("What the model leaves over is not noise, so intervals may be too narrow.")
    elif finding.is_adequate:
        said.append("No test speaks against the model.")
    return " ".join(said)


@message.register
def _(finding: ValidationOverlaps | OtherVehicles, about: Labelled) -> str:
    match finding:
        case ValidationOverlaps():
            return (
                f"The validation window shares {finding.seconds:.0f} s with the one learned from,"
                " so its errors are too small; choose one outside it."
            )
        case OtherVehicles():
            pairs = zip(finding.learned, finding.validated, strict=True)
            unlike = "; ".join(f"{one} by {two}" for one, two in pairs if one != two)
            return (
                f"Other vehicles: {unlike}. The errors then show how far one car's parameters serve"
                " for another."
            )
