"""What is said in sentences: its numbers, names and counts, and what goes wrong."""

import math
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from accpinn.evaluation.closed_loop import SimulatedCollision
from accpinn.inference.answer import Answer, HeterogeneousWindows, Span, answer
from accpinn.inference.gain_check import GainCheck
from accpinn.methods import least_squares
from accpinn.methods.fit import Outcome
from accpinn.methods.pinn.config import CALIBRATED, FAST, PAPER
from accpinn.model.cthp import Parameters
from accpinn.model.published import ParameterSet
from accpinn.model.registry import CTHPS, FOLLOWING, TITLES
from accpinn.platoon import AFTER_COLLISION, simulate_platoon
from accpinn.platoon.leader import Sinusoid
from accpinn.recordings.openacc import read
from accpinn.recordings.recording import Window
from accpinn.results import database as on_batch
from accpinn.results.messages import answer as on_answer
from accpinn.results.messages import stability as on_stability
from accpinn.results.messages import summary as on_result
from accpinn.results.messages.stability import headline, reason
from accpinn.results.recording import driver_summary, suggestion_reasons
from accpinn.results.tables import Marked
from accpinn.results.tables.answer import answer_table
from accpinn.results.tables.estimates import name_of
from accpinn.results.vehicles import KnownVehicles, known_vehicles
from accpinn.segment.suggestion import Suggestion
from accpinn.stability.report import (
    StabilityReport,
    VehicleStability,
    assessment,
    stability_report,
)
from accpinn.study.batch import BatchProgress
from accpinn.study.groups import group
from accpinn.study.studies import Failure, Request
from tests.support import studies
from tests.support.samples import FOLDER, NOISY, PLATOON, sample
from tests.support.snapshots import altered, delayed, small, whole
from tests.support.vehicles import AUDI, BMW, CALM, TESLA, UNDAMPED, extreme, ordinary, row

SEGMENT = sample(PLATOON, 60.0).segment
INFO, FOLLOWER = SEGMENT.info, SEGMENT.vehicles[1]
DAMPED, LOUD = Parameters(0.08, 0.02, 9.0), Parameters(0.08, 0.12, 1.5)


def missing(facts: list[str], said: str) -> list[str]:
    return [fact for fact in facts if fact not in said]


# The answer


@pytest.fixture(scope="module")
def answered() -> Answer:
    return answer((SEGMENT,), model="cthp")


def subject(answered: Answer) -> KnownVehicles:
    names, labels = SEGMENT.names[1:], SEGMENT.labels[1:]
    vehicles = ParameterSet(
        SEGMENT.source, names, answered.parameters, SEGMENT.vehicles, labels
    )  # fmt: skip
    return KnownVehicles(vehicles, answered.uncertainty)


def test_followers_that_share_their_parameters_have_one_card_and_one_row() -> None:
    answered = answer((SEGMENT,), "I", "cthp")
    (said,) = on_answer.cards(INFO, answered, subject(answered))
    assert said.lead.startswith("All followers keep ")
    assert len(answer_table(INFO, answered, "I").rows) == 1


def test_a_card_has_time_gap_gains_disturbances_and_trust(answered: Answer) -> None:
    judged = subject(answered)
    cards = on_answer.cards(INFO, answered, judged)
    assert len(cards) == len(answer_table(INFO, answered).rows) == SEGMENT.followers
    span, gain = answered.time_gap(answered.stated_speed, 0), judged.report.vehicles[0].peak.gain
    facts = [f"keeps {span.value:.2f} s at 100 km/h", f"grow by up to {100 * (gain - 1):.0f} % ("]
    assert not missing(facts, cards[0].lead)
    assert "one window" in cards[0].trust
    check = GainCheck(FOLLOWER, 9, rms=3.0, contradiction="apart")
    against, *_ = on_answer.cards(INFO, answered, replace(judged, checks=(check,)))
    assert "by the model" in against.lead
    assert check.short in against.trust
    slow = replace(answered, speeds=0.0 * answered.speeds + 5.0)
    assert "at 50 km/h" in on_answer.cards(INFO, slow, subject(slow))[0].lead


def test_a_time_gap_at_a_speed_that_no_window_holds_is_marked(answered: Answer) -> None:
    assert answered.driven.shape == (2, SEGMENT.followers)
    assert not answered.is_driven(50 / 3.6, 0)
    assert answered.stated_speed == 100 / 3.6, "which is driven"
    table = answer_table(INFO, answered)
    at_50, at_100, at_median = table.rows[0][1:4]
    assert isinstance(at_50, Marked)
    assert [type(cell) for cell in (at_50.cell, at_100, at_median)] == [Span] * 3
    assert table.columns[1].shown(at_50).endswith("*")
    low, high = table.to_csv().splitlines()[1].split(",")[2:4]
    assert float(low) < answered.time_gap(50 / 3.6, 0).value < float(high)
    assert "extrapolates" in on_answer.about_answer(answered)
    town = replace(answered, driven=answered.driven - 12.0, speeds=answered.speeds - 12.0)
    assert town.stated_speed == 50 / 3.6, "as 100 km/h was not driven"


def test_windows_that_differ_are_one_sentence(answered: Answer) -> None:
    assert on_answer.differing_windows(INFO, answered) == ""
    finding = HeterogeneousWindows(FOLLOWER, 5, 3e-35)
    said = on_answer.differing_windows(INFO, replace(answered, findings=(finding,)))
    assert not missing([f"5 windows of {INFO.label(FOLLOWER)}", "p < 0.001"], said)


def test_the_papers_presets_say_so() -> None:
    fit = least_squares.fit(SEGMENT)
    presets = [replace(fit, method="pinn", config=c.to_json()) for c in (FAST, PAPER, CALIBRATED)]
    said = map(on_answer.papers_estimate, (*presets, replace(presets[0], model="idm"), fit))
    assert [*map(bool, said)] == [True, True, False, False, False]


# A result


def test_a_result_is_titled_and_summed_up_by_its_answer() -> None:
    assert on_result.title(whole()) == "whole"
    assert "4 vehicles follow " in on_result.title(replace(whole(), name=""))
    assert " follows " in on_result.title(replace(small(), name=""))
    for result in (small(), whole()):
        said = on_answer.cards(result.info, result.answer, known_vehicles(result))
        assert on_result.summary(result) == tuple(f"{card.lead} {card.trust}" for card in said)
        assert len(said) == result.info.followers
    (only,) = on_result.summary(altered(replace(whole(), segments=()), answer=None, gain_checks=()))
    assert "All four vehicles amplify" in only
    stopped = replace(whole().fit, outcome=Outcome.STOPPED, iterations=12)
    assert "12 of 20 iterations" in on_result.summary(altered(whole(), fit=stopped))[0]


def test_collisions_are_cautions() -> None:
    hits = (SimulatedCollision(3, 12.34, -1.5),)
    hit = altered(whole(), evaluation=replace(whole().evaluation, findings=hits))
    counts = [len(on_result.cautions(result)["closed_loop"]) for result in (whole(), hit)]
    assert counts == [0, 1]


def test_what_estimates_assume_names_those_with_a_better_form() -> None:
    adequacy, info = delayed(), small().info
    assert info.labels[1] in on_result.conditional(adequacy, info)
    for other in (replace(adequacy, findings=()), None):
        assert info.labels[1] not in on_result.conditional(other, info)


def test_methods_outside_the_intervals_are_named_by_parameter() -> None:
    first, second = whole().compared
    name, ones = name_of(first.fit), np.ones_like(first.uncertainty.inside)

    def judged(which: list[int], **changes: object) -> str:
        inside = ones.copy()
        inside[0, which] = False
        row = altered(first, uncertainty=replace(first.uncertainty, inside=inside, **changes))
        other = altered(second, uncertainty=replace(row.uncertainty, inside=ones))
        return on_result.outside_intervals((row, other), 0)

    assert f"α of {name}; β of {name}." in judged([0, 1])
    assert name not in judged([])
    nothing = Parameters.of(np.full((4, 3), np.nan))
    assert name not in judged([0], lower=nothing, upper=nothing)


def test_facts_of_the_data_are_terms_and_descriptions() -> None:
    facts = {"acc_flag": 1, "campaign": "AstaZero", "distance_setting": None}
    info = replace(whole().info, excluded_regimes=("manual",), excluded_share=(0.25, 0, 0, 0))
    rows = dict(on_result.about_data(altered(replace(whole(), facts=facts), info=info)))
    assert rows["ACC flag of the file"].startswith("ACC,")
    assert rows["Campaign"] == "AstaZero"
    assert "Distance setting" not in rows
    assert not missing(["manual", "25 % of"], rows["Excluded"])
    assert [*map(on_result.setting, ([1.0, 0.5], "fast"))] == ["1, 0.5", "fast"]


def test_a_band_says_whose_it_is_where_the_answer_s_model_is_another() -> None:
    assert TITLES[small().answer.model] in on_result.about_band(small())
    same = small().under(replace(small().analysis, model="cthp"))
    assert "answer" not in on_result.about_band(same)
    lagged = on_result.about_band(altered(small(), fit=replace(small().fit, model="idm-lag")))
    assert not missing([f"linearisation of the {TITLES['idm-lag']}", "not part of it"], lagged)


@pytest.mark.parametrize("model", FOLLOWING)
def test_an_equation_has_every_parameter_of_its_model_and_no_other(model: str) -> None:
    said, terms = " ".join(on_result.equation(model)), FOLLOWING[model].terms
    assert not missing([parameter.symbol for parameter in FOLLOWING[model].parameters], said)
    if model not in CTHPS:
        assert TITLES[model] in said
        assert not {"α", "β", "τ"} & {*said}
        return
    for name, symbol in (("s0", "s₀"), ("lag", "λ d²v"), ("delay", "time d")):
        assert (symbol in said) is (name in terms)


# A batch and a recording


def test_a_batchs_answer_names_share_interval_and_time_gap() -> None:
    cells = studies.row
    given = studies.rows(
        cells("A", tau=1.0), cells("A", tau=1.1), cells("B", beta=1.9), cells("C", tau=None)
    )
    whole, one, unknown = (group(part, ()).groups[0] for part in (given, given[:2], given[3:]))
    start = f"{100 * whole.l2_stable.value:.0f} % of the 2 vehicles"
    assert on_batch.headline(whole).startswith(start)
    assert f"{whole.time_gap(100 / 3.6).value:.2f} s (" in on_batch.typical_line(whole)
    assert "probability" in on_batch.headline(one)
    assert "nan" not in on_batch.headline(unknown) + on_batch.typical_line(unknown)


def test_failures_settings_and_progress_of_a_batch_are_counted_and_named() -> None:
    none = Failure("a.csv", None, None, "broken")
    assert on_batch.failures_line(()) == ""
    assert on_batch.failures_line((none, none)).startswith("1 file without a window;")
    windows = (Failure("a.csv", 3.0, 2, "x"), Failure("a.csv", 9.0, None, "x"))
    facts = ["1 file without a window", "2 estimates failed"]
    assert not missing(facts, on_batch.failures_line((none, *windows)))
    assert not missing(["300 s", "Case II", "CTHP"], on_batch.batch_line(studies.REQUEST))
    assert "any length" in on_batch.batch_line(Request((), (), None, "I"))
    assert on_batch.batch_line(None) == ""
    said = on_batch.progress_line(BatchProgress(files=7, done=7.0, finished=20, rows=1076))
    assert not missing(["7 of 7 files", "20 windows", "1,076 rows"], said)
    assert "3 failed" in on_batch.progress_line(BatchProgress(files=7, done=1.0, failed=3))


@pytest.mark.parametrize(
    ("suggestion", "figures"),
    [
        (Suggestion(Window(330, 630), (1, 2), 0.963, None, 190, 300.0),
         ["330–630 s", "190 complete windows of 300 s", "96 %"]),
        (Suggestion(Window(32.4, 44.4), (1, 2), 0.62, 0.05, 1, 300.0), ["5 %", "300 s are usual"]),
        (Suggestion(Window(0, 300), (1, 2), 1.0, 0.0, 1, 300.0), ["all the time"]),
    ],
    ids=["modes not known", "short", "all well"],
)  # fmt: skip
def test_reasons_for_a_window_have_their_numbers(
    suggestion: Suggestion, figures: list[str]
) -> None:
    said = " ".join(suggestion_reasons(suggestion, Window(10.0, 20.0), 0.504))
    assert not missing([*figures, "10–20 s", "50 %"], said)
    assert len(suggestion_reasons(suggestion, suggestion.window, 1.0)) < said.count(".")


def test_drivers_are_told_by_their_modes_or_else_by_the_flag() -> None:
    recording = read(FOLDER / f"{NOISY}.csv")
    assert "2" in driver_summary(recording).partition("ACC: ")[2]
    vehicles = tuple(replace(vehicle, modes=None) for vehicle in recording.vehicles)
    assert "ACC" in driver_summary(replace(recording, vehicles=vehicles, acc_flag=1))


# String stability


def named(*vehicles: Parameters) -> ParameterSet:
    names = tuple(f"V{k}" for k in range(1, len(vehicles) + 1))
    return ParameterSet("Mine", names, row(*vehicles))


def posterior(*stable: float) -> Any:
    """What the headline reads of the uncertainty of one or several vehicles."""
    return SimpleNamespace(probability_l2=np.array(stable))


@pytest.mark.parametrize(
    ("vehicles", "facts"),
    [
        ((CALM,), ["V1 does not"]),
        ((CALM, CALM), ["None"]),
        ((Parameters(0.05, 0.6, 1.62),) * 2, ["None", "L∞"]),
        ((CALM, UNDAMPED), ["One of two", "V2", "without limit"]),
        ((CALM, LOUD), ["One of two", "V2", "1.38 times at 0.235 rad/s"]),
        ((LOUD, CALM, LOUD), ["Two of three", "V1"]),
        ((LOUD,) * 12, ["All 12", "V1"]),
    ],
)
def test_the_headline_counts(vehicles: tuple[Parameters, ...], facts: list[str]) -> None:
    chosen = named(*vehicles)
    assert not missing(facts, headline(chosen, stability_report(chosen.parameters), None))


@pytest.mark.parametrize(
    ("stable", "state"),
    [(0.001, "unstable"), (0.05, "unstable"), (0.09, "open"), (0.95, "stable"),
     (math.nan, "not determined")],
)  # fmt: skip
def test_a_verdict_follows_the_posterior_not_the_estimate(stable: float, state: str) -> None:
    chosen = named(LOUD)
    assert assessment(stable) == state
    said = headline(chosen, stability_report(chosen.parameters), posterior(stable))
    assert ("amplifies" in said) == (state == "unstable")
    assert ("probability" in said) == (stable == stable)


def test_verdicts_of_several_vehicles_are_counted() -> None:
    chosen = named(LOUD, CALM, LOUD)
    report = stability_report(chosen.parameters)
    said = headline(chosen, report, posterior(0.0, 0.01, 0.03))
    assert not missing(["All three", "under 1 % to 3 %"], said)
    mixed = headline(chosen, report, posterior(0.0, 1.0, 0.4))
    assert not missing(["three vehicles one amplifies", "one is L₂ string stable"], mixed)
    each = on_stability.probabilities(chosen, posterior(0.0, 1.0, math.nan))
    assert not missing(["under 1 %", "over 99 %", "not determined"], each)


def test_vehicles_without_a_comparison_are_named_in_one_sentence() -> None:
    checks = [GainCheck(2, 9, rms=1.5), GainCheck(3, 0), GainCheck(4, 2)]
    vehicles = replace(named(LOUD, CALM, LOUD), vehicles=(1, 2, 3, 4))
    first, others = on_stability.against_measured(checks, vehicles)
    assert first == checks[0].sentence(vehicles)
    assert not missing([vehicles.label(number) for number in (3, 4)], others)
    both = on_stability.against_measured(checks[:2], vehicles)
    assert both == tuple(check.sentence(vehicles) for check in checks[:2])


def reasons(of: VehicleStability | StabilityReport) -> dict[str, str]:
    """By the verdict's name in the report."""
    held: Any = of.platoon if isinstance(of, StabilityReport) else of
    names = ("l2_strict", "l2_weak", "linf_strict", "linf_weak")
    names = names if isinstance(of, StabilityReport) else ("l2", "linf_paper", "linf_exact")
    return {name: reason(getattr(held, name), of) for name in names}


@given(st.one_of(ordinary, extreme))
@settings(max_examples=50)
def test_every_reason_is_one_sentence_without_odd_numbers(vehicle: Parameters) -> None:
    report = stability_report(row(vehicle, AUDI))
    for text in [*reasons(report.vehicles[0]).values(), *reasons(report).values()]:
        assert text.endswith(".")
        assert not [odd for odd in (". ", "nan", "inf ", "None") if odd in text]


@pytest.mark.parametrize("name", ["l2", "linf_exact"])
def test_the_boundary_is_named(name: str) -> None:
    headways = stability_report(TESLA).vehicles[0].smallest_tau
    at = Parameters(TESLA.alpha, TESLA.beta, getattr(headways, name))
    assert reasons(stability_report(at).vehicles[0])[name].startswith("On the boundary")


@pytest.mark.parametrize(
    ("vehicles", "name", "facts"),
    [
        (row(CALM, TESLA), "l2_strict", ["Follower 2", "1.04"]),
        (row(AUDI, CALM, BMW), "linf_strict", ["Follower 1 and follower 3", "follower 1 the most"]),
        (row(TESLA, DAMPED, DAMPED), "l2_weak", ["others damp"]),
        (row(AUDI, UNDAMPED, CALM), "l2_weak", ["0.5 rad/s", "without limit"]),
        (row(CALM, CALM), "linf_weak", ["No follower"]),
        (row(TESLA, CALM), "linf_weak", ["from the leader to the last"]),
        (row(Parameters(1e-12, 1.0, 0.1), Parameters(1e8, 1, 1e-5)), "linf_weak", ["time scales"]),
    ],
)
def test_a_platoons_reason_names_who_and_how_much(
    vehicles: Parameters, name: str, facts: list[str]
) -> None:
    assert not missing(facts, reasons(stability_report(vehicles))[name])


@pytest.mark.parametrize(
    ("gain", "text"), [(1.4, "1.40"), (12.0, "12.0"), (123.4, "123"), (1.00002, "1 + 2e-05")]
)
def test_a_factor_keeps_its_digits(gain: float, text: str) -> None:
    assert on_stability.factor(gain) == text


def test_the_disturbance_names_each_collision_and_who_drives_on() -> None:
    run = simulate_platoon(row(*[AUDI] * 8), Sinusoid(0.214))
    facts = ["follower 6 collides at 88 s", "follower 5 at 114 s"]
    assert not missing(facts, on_stability.disturbance(run))
    assert on_stability.smallest_gap(run) == AFTER_COLLISION
    calm = simulate_platoon(CALM, Sinusoid(0.214))
    assert f"{calm.minimum_gap[0]:.1f} m" in on_stability.smallest_gap(calm)


def test_who_meets_the_papers_criterion_only_is_named() -> None:
    differ, chosen = on_stability.criteria_differ, named(TESLA, CALM)
    assert differ(chosen, stability_report(chosen.parameters)).startswith("V1 meets")
    assert not differ(named(CALM), stability_report(CALM))
