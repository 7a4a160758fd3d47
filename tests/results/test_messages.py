"""What is said in sentences: names, counts and numbers; the checks of an estimate."""

import math
from collections.abc import Callable
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from accpinn.evaluation.closed_loop import SimulatedCollision
from accpinn.inference.gain_check import GainCheck
from accpinn.inference.intervals import Uncertainty
from accpinn.methods.estimate import Outcome
from accpinn.methods.pinn.config import CALIBRATED, FAST, PAPER
from accpinn.model.cthp import Parameters
from accpinn.model.published import ParameterSet
from accpinn.model.registry import FOLLOWING, TITLES
from accpinn.model.spec import ModelSpec
from accpinn.platoon import AFTER_COLLISION, PlatoonRun, simulate_platoon
from accpinn.platoon.leader import Sinusoid
from accpinn.recordings import Window
from accpinn.recordings.openacc import read
from accpinn.results import database as on_batch
from accpinn.results import naming
from accpinn.results.cast import Cast
from accpinn.results.messages import estimate as on_estimate
from accpinn.results.messages import incidents
from accpinn.results.messages import platoon as on_platoon
from accpinn.results.messages import stability as on_stability
from accpinn.results.messages import summary as on_result
from accpinn.results.messages.estimate import Check, checks
from accpinn.results.messages.stability import headline, platoon_reasons, reasons
from accpinn.results.recording import driver_summary, suggestion_reasons
from accpinn.segment.windows import Suggestion
from accpinn.stability import assessment, stability_report
from accpinn.study.batch import BatchProgress
from accpinn.study.groups import group
from accpinn.study.result import Result
from accpinn.study.studies import Failure
from accpinn.study.vehicles import AssessedVehicles, assessed_vehicles
from accpinn.units import Quantity
from tests.support import studies
from tests.support.samples import FOLDER, NOISY, PLATOON, sample
from tests.support.snapshots import (
    altered,
    delayed,
    missing_the_drive,
    recommended,
    result_for,
    small,
    trained,
    whole,
)
from tests.support.vehicles import AUDI, BMW, CALM, TESLA, UNDAMPED, extreme, ordinary, row

INFO = sample(PLATOON, 60.0).segment.info
DAMPED, LOUD = Parameters(0.08, 0.02, 9.0), Parameters(0.08, 0.12, 1.5)


def missing(facts: list[str], said: str) -> list[str]:
    return [fact for fact in facts if fact not in said]


def named(*vehicles: Parameters) -> ParameterSet:
    names = tuple(f"V{k}" for k in range(1, len(vehicles) + 1))
    return ParameterSet("Mine", names, row(*vehicles))


def judged(*vehicles: Parameters, stable: tuple[float, ...] = ()) -> str:
    """The headline of vehicles, by the posterior's probabilities where some are given."""
    return headline(AssessedVehicles(named(*vehicles), posterior(*stable) if stable else None))


def posterior(*stable: float) -> Any:
    """What sentences read of the uncertainty of some vehicles."""
    count = len(stable)
    gains = SimpleNamespace(lower=np.full(count, 1.25), upper=np.full(count, 1.75))
    shares = np.array(stable)
    return SimpleNamespace(
        probability_l2=shares, peak_gain=gains, probability_linf=shares, linf_gain=gains, level=0.9
    )


VERDICTS = ("l2_strict", "l2_weak", "linf_strict", "linf_weak")


def platoons(name: str, *vehicles: Parameters) -> str:
    """The reason of a verdict of the platoon."""
    _, why = platoon_reasons(AssessedVehicles(named(*vehicles)))[VERDICTS.index(name)]
    return why


def behind_a_wave(*vehicles: Parameters) -> tuple[PlatoonRun, Cast]:
    """The run of vehicles that go by their places."""
    cast = Cast(named(AUDI), (0,) * len(vehicles))
    return simulate_platoon(row(*vehicles), Sinusoid(0.214)), cast


def batches(*given: dict[str, Any]) -> str:
    (found,) = group(studies.rows(*given), ()).groups
    return on_batch.headline(found) + on_batch.typical_line(found)


def knowing(result: Result, **parts: Any) -> Result:
    """The same result, of which some parts are known to be something else."""
    changed = replace(result)
    changed.__dict__.update(parts)
    return changed


def stopped() -> str:
    return on_result.summary(altered(whole(), outcome=Outcome.STOPPED, iterations=12))[0]


def collided() -> tuple[str, ...]:
    findings = (SimulatedCollision(3, 12.34, -1.5),)
    hit = knowing(whole(), evaluation=replace(whole().evaluation, findings=findings))
    return incidents(hit.evaluation, hit.info)


MOVED = Suggestion(Window(330, 630), 0.963, None, 190)
BROKEN = Failure("a.csv", None, None, "broken")
FAILED = (Failure("a.csv", 3.0, 2, "x"), Failure("a.csv", 9.0, None, "x"))
FAST_SCALES, SLOW_SCALES = Parameters(1e-12, 1.0, 0.1), Parameters(1e8, 1, 1e-5)
SAID: list[tuple[Callable[[], str], list[str]]] = [
    # String stability
    (lambda: judged(CALM), ["V1"]),
    (lambda: judged(*(Parameters(0.05, 0.6, 1.62),) * 2), ["L∞"]),
    (lambda: judged(CALM, UNDAMPED), ["V2"]),
    (lambda: judged(CALM, LOUD), ["V2", "38 % at 0.235 rad/s"]),
    (lambda: judged(LOUD, CALM, LOUD), ["V1 and V3 amplify", "V2 is L₂ string stable"]),
    (lambda: judged(*(LOUD,) * 12), ["All 12", "38 %"]),
    (lambda: judged(LOUD, CALM, LOUD, stable=(0.0, 0.01, 0.03)),
     ["All three", "at most 3 % each", "90 % interval 25–75 %"]),
    (lambda: judged(LOUD, CALM, LOUD, stable=(0.0, 1.0, 0.4)),
     ["V1 amplifies", "V2 is L₂ string stable", "V3 may or may not"]),
    (lambda: on_stability.probabilities(named(LOUD, CALM, LOUD), posterior(0.0, 1.0, math.nan)),
     ["under 1 %", "over 99 %", "not determined"]),
    (lambda: platoons("l2_strict", CALM, TESLA), ["V2", "by up to 4 %"]),
    (lambda: platoons("linf_strict", AUDI, CALM, BMW),
     ["V1 and V3", "V1 the most"]),
    (lambda: platoons("l2_weak", TESLA, DAMPED, DAMPED), ["others damp"]),
    (lambda: platoons("l2_weak", AUDI, UNDAMPED, CALM), ["0.500 rad/s", "without limit"]),
    (lambda: platoons("linf_weak", CALM, CALM), ["No follower"]),
    (lambda: platoons("linf_weak", TESLA, CALM), ["from the leader to the last"]),
    (lambda: platoons("linf_weak", FAST_SCALES, SLOW_SCALES), ["time scales"]),
    (lambda: on_stability.grown(1.00002), ["less than 0.5 %"]),
    (lambda: on_stability.grown(3.4, Quantity(3.4, 2.0, math.inf)), ["3.4-fold (2.0 or more)"]),
    (lambda: on_platoon.disturbance(*behind_a_wave(*[AUDI] * 8)),
     ["Follower 6 collides at 88 s", "follower 5 at 114 s", "at least"]),
    (lambda: on_platoon.smallest_gap(*behind_a_wave(*[AUDI] * 8)),
     [AFTER_COLLISION]),
    (lambda: on_platoon.smallest_gap(*behind_a_wave(CALM, CALM)),
     ["58.2 m", "follower 1 at 251 s"]),
    (lambda: on_stability.criteria_differ(AssessedVehicles(named(TESLA, CALM))),
     ["V1 meets"]),
    # A result and its data
    (lambda: on_result.title(whole()), ["whole"]),
    (lambda: on_result.title(replace(whole(), name="")), ["4 vehicles"]),
    (lambda: collided()[0], ["12.3 s"]),
    (stopped, ["12 of 20 iterations"]),
    (lambda: on_result.summary(whole())[0], ["2 Audi (A6-like) keeps", "amplifies disturbances"]),
    (lambda: on_result.conditional(small(), delayed()), [small().info.labels[1]]),
    (lambda: on_estimate.about_band("cthp-s0-delay"), [TITLES["cthp-s0-delay"]]),
    (lambda: on_estimate.about_band("idm-lag"), [f"linearisation of the {TITLES['idm-lag']}"]),
    (lambda: " ".join(suggestion_reasons(MOVED, Window(10.0, 20.0), 0.504)),
     ["330–630 s", "190 complete windows of 300 s", "96 %", "10–20 s", "50 %"]),
    (lambda: driver_summary(read(FOLDER / f"{NOISY}.csv")), ["ACC: 2"]),
    # A batch
    (lambda: batches(studies.row("A", tau=1.0), studies.row("A", tau=1.1)), ["probability"]),
    (lambda: batches(studies.row("A"), studies.row("B", beta=1.9), studies.row("C", tau=None)),
     ["None of the 2 vehicles"]),
    (lambda: on_batch.failures_line((BROKEN, BROKEN)), ["1 file without a window"]),
    (lambda: on_batch.failures_line((BROKEN, *FAILED)),
     ["1 file without a window", "2 estimates failed"]),
    (lambda: on_batch.batch_line(studies.REQUEST), ["300 s", "Case II", "CTHP"]),
    (lambda: repr(on_batch.batch_line(None)), ["''"]),
    (lambda: on_batch.progress_line(BatchProgress(files=7, done=7.0, finished=20, rows=1076)),
     ["7 of 7 files", "20 windows", "1,076 rows"]),
    (lambda: on_batch.progress_line(BatchProgress(files=7, done=1.0, failed=3)), ["3 failed"]),
]  # fmt: skip


@pytest.mark.parametrize(("say", "facts"), SAID)
def test_a_sentence_has_its_names_counts_and_numbers(
    say: Callable[[], str], facts: list[str]
) -> None:
    assert not missing(facts, say())


def test_followers_that_share_their_parameters_have_one_card() -> None:
    result = result_for(sample(PLATOON, 60.0).segment, case="I")
    (card,) = on_estimate.cards(result)
    assert card.who == "All followers"


def test_a_point_is_told_without_intervals() -> None:
    """A verdict on it is certain or absent, and has no probability."""
    result = trained()
    gap = result.estimate.time_gap(100 / 3.6, 0).value
    gain = result.stability.vehicles[0].peak.gain
    card = on_estimate.cards(result)[0]
    label = result.info.labels[1]
    assert card.lead == (
        f"{label} keeps {gap:.2f} s at 100 km/h."
        f" It amplifies disturbances by up to {100 * (gain - 1):.0f} %."
    )
    assert card.trust == result.trust[0].in_words
    (together,) = on_estimate.cards(result, together=True)
    assert "%" not in together.lead.partition("They amplify")[0]
    assert "probability" not in headline(assessed_vehicles(result))
    for said in (on_estimate.assumption(result), on_estimate.about_estimate(result)):
        assert naming.PAPERS_POINT in said.replace("The paper's", "the paper's")
        assert "bracket" not in said


def test_a_card_has_time_gap_gains_disturbances_and_trust() -> None:
    result = recommended()
    estimate, subject = result.estimate, assessed_vehicles(result)
    cards = on_estimate.cards(result)
    assert len(cards) == result.info.followers
    span, peak = estimate.time_gap(estimate.stated_speed, 0), subject.report.vehicles[0].peak
    words = on_estimate.time_gap_in_words(span, estimate.stated_speed, estimate.level)
    facts = [f"keeps {words}", f"disturbances by up to {100 * (peak.gain - 1):.0f} % ("]
    assert not missing(facts, cards[0].lead)
    assert "one window" in cards[0].trust
    assert "bracket" in on_estimate.about_estimate(result)
    check = GainCheck(result.info.vehicles[1], 9, rms=3.0, contradiction="apart")
    doubted = knowing(result, gain_checks=(check,))
    against, *_ = on_estimate.cards(doubted)
    assert "By the model, it" in against.lead
    assert check.short in against.trust
    assert against.is_contradicted
    assert against.trust == f"{against.against} {result.trust[0].in_words}"
    assert any(check.short in said for said in on_estimate.contradictions(doubted))
    assert any(check.short in said for said in on_estimate.contradictions(doubted, [0, 0]))
    assert not any(check.short in said for said in on_estimate.contradictions(doubted, [1]))


def test_followers_of_one_verdict_share_a_card_unless_something_is_against_them() -> None:
    result = recommended()
    estimate, subject = result.estimate, assessed_vehicles(result)
    one_each = on_estimate.cards(result)
    (shared,) = on_estimate.cards(result, together=True)
    spans = [estimate.time_gap(estimate.stated_speed, k) for k in range(len(one_each))]
    growths = sorted(100 * (vehicle.peak.gain - 1) for vehicle in subject.report.vehicles)
    low, *_, high = sorted(span.value for span in spans)
    facts = [f"keep {low:.2f}–{high:.2f} s at 100 km/h, each ±"]
    facts += [f"by up to {growths[k]:.0f} % (" for k in (0, -1)]
    assert not missing(facts, shared.lead)
    check = GainCheck(result.info.vehicles[1], 9, rms=3.0, contradiction="apart")
    against = knowing(result, gain_checks=(check,))
    alone, *others = on_estimate.cards(against, together=True)
    assert alone == on_estimate.cards(against)[0]
    assert alone.is_contradicted
    assert len(others) == 1


def test_a_follower_that_is_not_determined_has_no_time_gap() -> None:
    result = recommended()
    typical = result.posterior.typical.everything.copy()
    typical[:, 0] = np.nan
    unknown = replace(result.posterior, typical=Parameters.of(typical))
    card = on_estimate.cards(altered(result, posterior=unknown))[0]
    assert card.lead == f"{result.info.labels[1]}: the data do not determine the time gap."


def test_gains_are_as_far_off_as_their_intervals_say() -> None:
    estimate = recommended().estimate
    centre = np.array([[0.1, 0.2, 1.0, 0.0, 0.0, 0.0]] * 2)

    def said(low: float, high: float) -> str:
        factors = np.array([low, *[1.0] * 98, high])[:, None, None]
        typical = np.concatenate([centre[:, :2] * factors, centre[:, 2:] + 0 * factors], axis=2)
        ends = replace(estimate.posterior, typical=Parameters.of(typical), level=1.0)
        known = replace(estimate, posterior=ends, parameters=Parameters.of(centre))
        return on_estimate.cards(replace(recommended(), estimate=known))[0].lead

    assert "Its gains: ±15 %." in said(0.9, 1.12)
    assert "Its gains: -20/+50 %." in said(0.8, 1.5)
    assert "Its gains are hardly known." in said(0.1, 1.5)


def test_methods_are_as_far_from_the_recommended_estimate_as_is_said() -> None:
    first, other = recommended(), whole().compared[0]
    spread = np.linspace(-0.3, 0.3, 101)[:, None, None]
    centre = Parameters.of(np.tile([0.1, 0.0, 1.0, 0.0, 0.0, 0.0], (2, 1)))
    typical = Parameters.of(centre.everything * np.exp(spread))
    known = replace(first.posterior, typical=typical)
    first = altered(first, parameters=centre, posterior=known)

    def said(*values: float) -> str:
        row = altered(other, parameters=Parameters.of(np.tile(values, (2, 1))))
        return " ".join(on_result.agreement((first, row), first))

    assert said(0.106, 0.0, 1.002).startswith("Every method agrees with the recommended estimate")
    assert "6 % (α) and 1 % (time gap) of it" in said(0.106, 0.0, 1.002)
    assert said(0.2, 0.0, 1.0).startswith("No method agrees")
    assert "1 % (time gap) of it" in said(math.nan, 0.3, 1.002)
    assert "%" not in said(math.nan, 0.3, math.nan).partition("intervals")[2]
    assert on_result.agreement((first,), first) == ("", ""), "nothing is compared"


def test_the_recommended_estimate_is_one_with_a_posterior() -> None:
    points = whole().compared
    assert on_result.recommended_of(points) is None
    assert on_result.recommended_of((*points, recommended())) is recommended()


def test_the_true_parameters_of_a_recording_are_all_said() -> None:
    estimate = trained().estimate
    simple, late = row(TESLA), row(Parameters(0.08, 0.3, 0.8, s0=6.0, delay=0.5))
    said = on_estimate.about_truth(simple, estimate)
    assert "without s₀" in said
    assert "0.0409" in said
    said = on_estimate.about_truth(late, estimate)
    assert all(part in said for part in ("time gap", "s₀ 6.0 m", "d 0.50 s", "τ 0.80"))
    other = row(Parameters(0.1, 0.1, 1.0, 1.0, 0.1, 0.1))
    assert on_estimate.about_truth(other, estimate) == ""


def test_a_point_says_what_it_is() -> None:
    point = small().estimate
    presets = [replace(point, method="pinn", settings=c.to_json()) for c in (FAST, PAPER)]
    stopped = replace(presets[0], settings=CALIBRATED.to_json())
    nonlinear = replace(presets[0], spec=ModelSpec("idm"))
    said = [naming.about_point(one) for one in (*presets, stopped, nonlinear, point)]
    assert said == [naming.PAPERS_POINT] * 2 + [naming.POINT] * 3
    assert naming.about_point(recommended().estimate) == ""


def test_facts_of_the_data_are_terms_and_descriptions() -> None:
    facts = {"acc_flag": 1, "campaign": "AstaZero", "distance_setting": None}
    info = replace(whole().info, excluded_regimes=("manual",), excluded_share=(0.25, 0, 0, 0))
    rows = dict(on_result.about_data(altered(replace(whole(), facts=facts), info=info)))
    assert rows["ACC flag of the file"].startswith("ACC,")
    assert rows["Campaign"] == "AstaZero"
    assert "Distance setting" not in rows
    assert not missing(["manual", "25 % of"], rows["Excluded"])
    assert [*map(on_result.setting, ([1.0, 0.5], "fast"))] == ["1, 0.5", "fast"]


def test_what_parameters_mean_is_said_with_their_intervals_where_the_model_has_words() -> None:
    span = Quantity(2.0, 1.55, 11.2)
    values = {p.name: SimpleNamespace(span=span) for p in FOLLOWING["unequal-delay"].parameters}
    of_car: Any = SimpleNamespace(values=SimpleNamespace(parameters=values))
    said = on_estimate.meaning_of("unequal-delay", of_car)
    assert "2.0 (1.6 to 11) times" in said
    assert not on_estimate.meaning_of("cthp", of_car)
    values["q"].span = Quantity(math.nan, math.nan, math.nan)
    assert not on_estimate.meaning_of("unequal-delay", of_car)


@pytest.mark.parametrize("model", FOLLOWING)
def test_an_equation_has_every_parameter_of_its_model_and_no_other(model: str) -> None:
    said, terms = " ".join(on_result.equation(model)), FOLLOWING[model].terms
    assert not missing([parameter.symbol for parameter in FOLLOWING[model].parameters], said)
    if not FOLLOWING[model].is_linear:
        assert TITLES[model] in said
        own = {parameter.symbol[0] for parameter in FOLLOWING[model].parameters}
        assert not ({"α", "β", "τ"} - own) & {*said}
        return
    for name, symbol in (("s0", "s₀"), ("lag", "λ d²v"), ("delay", "time d")):
        assert (symbol in said) is (name in terms)


@pytest.mark.parametrize(
    ("stable", "state"),
    [(0.001, "unstable"), (0.05, "unstable"), (0.09, "undecided"), (0.95, "stable"),
     (math.nan, "not determined")],
)  # fmt: skip
def test_a_verdict_follows_the_posterior_not_the_estimate(stable: float, state: str) -> None:
    assert assessment(stable) == state
    said = judged(LOUD, stable=(stable,))
    assert ("amplifies" in said) == (state == "unstable")
    assert ("probability" in said) == (stable == stable)


def test_vehicles_without_a_comparison_are_named_in_one_sentence() -> None:
    checks = [GainCheck(2, 9, rms=1.5), GainCheck(3, 0), GainCheck(4, 2)]
    vehicles = replace(named(LOUD, CALM, LOUD), vehicles=(1, 2, 3, 4))
    first, others = on_stability.measured_gain_sentences(checks, vehicles)
    assert first == checks[0].sentence(vehicles)
    assert not missing([vehicles.label(number) for number in (3, 4)], others)
    both = on_stability.measured_gain_sentences(checks[:2], vehicles)
    assert both == tuple(check.sentence(vehicles) for check in checks[:2])


HEADWAYS = stability_report(TESLA).vehicles[0].smallest_tau


@given(st.one_of(ordinary, extreme))
@example(Parameters(TESLA.alpha, TESLA.beta, HEADWAYS.l2))
@example(Parameters(TESLA.alpha, TESLA.beta, HEADWAYS.linf_exact))
@example(Parameters(8e6, 1e9, 0.0))  # amplifies by less than one part in 10⁹
@settings(max_examples=50)
def test_every_reason_is_one_sentence_without_odd_numbers(vehicle: Parameters) -> None:
    said = reasons(AssessedVehicles(named(vehicle, AUDI)))
    for text in [why for _, verdicts in said for _, why in verdicts]:
        assert text.endswith(".")
        assert not [odd for odd in (". ", "nan", "inf ", "None") if odd in text]


@pytest.fixture(scope="module")
def known() -> Uncertainty:
    """All is narrow but the α of the first of two followers."""
    lower = np.full((2, 3), 0.9)
    lower[0, 0] = 0.01
    upper = Parameters.of(np.full((2, 3), 1.1))
    return replace(recommended().uncertainty, lower=Parameters.of(lower), upper=upper)


def checked(result: Result) -> dict[str, Check]:
    return {check.title: check for check in checks(result)}


def test_each_check_names_the_followers_that_fail(known: Uncertainty) -> None:
    result = recommended()
    _, first, second = result.info.vehicles
    evaluation = result.evaluation
    hit = replace(evaluation, out_of_window_findings=(SimulatedCollision(second, 12.0, -1.0),))
    amplifies = GainCheck(first, 9, rms=3.0, contradiction="amplifies")
    parts = {"uncertainty": known, "evaluation": hit, "gain_checks": (amplifies,)}
    answers = checked(knowing(result, **parts))
    labels = [result.info.label(number) for number in (first, second)]
    assert answers["Identified"].why == (f"{labels[0]}: α.",)
    collision = answers["Simulated without collision"]
    assert labels[1] in collision.why[0]
    assert collision.why[0].startswith("Outside the window")
    assert labels[0] in answers["Measured gain agrees"].why[0]
    assert answers["Converged"].why == (Outcome.CONVERGED.value,)
    failed = [title for title, check in answers.items() if check.passed is False]
    assert failed == ["Identified", "Simulated without collision", "Measured gain agrees"]
    few = checked(knowing(result, gain_checks=(GainCheck(first, 2),)))
    assert few["Measured gain agrees"].passed is None


def test_a_drive_that_is_not_reproduced_fails(known: Uncertainty) -> None:
    missed, said = missing_the_drive(trained())
    check = checked(missed)["Drive reproduced"]
    assert check.passed is False
    assert said in check.why[0]
    assert checked(trained())["Drive reproduced"].passed is True


def test_a_point_has_no_checks_of_intervals() -> None:
    assert [*checked(trained())] == ["Converged", "Simulated without collision", "Drive reproduced"]


def test_what_did_not_converge_or_is_not_determined(known: Uncertainty) -> None:
    for outcome in (Outcome.STOPPED, Outcome.DIVERGED, Outcome.FINISHED):
        assert checked(altered(trained(), outcome=outcome))["Converged"].passed is False
    lower = known.lower.values.copy()
    lower[1] = np.nan
    result = knowing(recommended(), uncertainty=replace(known, lower=Parameters.of(lower)))
    _, first, second = map(result.info.label, result.info.vehicles)
    assert checked(result)["Identified"].why == (f"{first}: α.", f"{second}: α, β and τ.")
