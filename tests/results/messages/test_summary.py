"""A result in a few sentences: its numbers, their uncertainty, and what goes wrong."""

from dataclasses import replace

import numpy as np
import pytest

from accpinn.evaluation.closed_loop import SimulatedCollision
from accpinn.methods.fit import Outcome
from accpinn.model.cthp import Parameters
from accpinn.model.registry import CTHPS, FOLLOWING, TITLES
from accpinn.results.messages.answer import cards
from accpinn.results.messages.summary import (
    about_band,
    about_data,
    cautions,
    conditional,
    equation,
    outside_intervals,
    setting,
    summary,
    title,
)
from accpinn.results.tables.estimates import name_of
from accpinn.results.vehicles import known_vehicles
from accpinn.study.result import Result
from tests.support.snapshots import altered, delayed, small, whole


def colliding(snapshot: Result, vehicle: int, time: float) -> Result:
    findings = (SimulatedCollision(vehicle, time, -1.5),)
    return altered(snapshot, evaluation=replace(snapshot.evaluation, findings=findings))


def test_title_agrees_in_number() -> None:
    assert title(whole()) == "whole"
    assert title(replace(whole(), name="")) == "How 4 vehicles follow the vehicle ahead"
    assert "follows the vehicle ahead" in title(replace(small(), name=""))


def test_summary_is_the_answer_of_each_follower() -> None:
    for result in (small(), whole()):
        said = cards(result.info, result.answer, known_vehicles(result))
        assert summary(result) == tuple(" ".join(card) for card in said)
        assert len(said) == result.info.followers


def test_without_an_answer_the_fit_has_a_verdict() -> None:
    bare = altered(replace(whole(), segments=()), answer=None, gain_checks=())
    (only,) = summary(bare)
    assert "All four vehicles amplify" in only


def test_collisions_are_cautions() -> None:
    assert not cautions(whole())["closed_loop"]
    assert len(cautions(colliding(whole(), 3, 12.34))["closed_loop"]) == 1


def test_what_estimates_assume_names_those_with_a_better_form() -> None:
    adequacy, info = delayed(), small().info
    assert info.labels[1] in conditional(adequacy, info)
    for other in (replace(adequacy, findings=()), None):
        assert info.labels[1] not in conditional(other, info)


def test_methods_outside_the_intervals_are_named_by_parameter() -> None:
    first, second = whole().compared

    def said_outside(which: list[int], **changes: object) -> str:
        inside = np.ones_like(first.uncertainty.inside)
        inside[0, which] = False
        row = altered(first, uncertainty=replace(first.uncertainty, inside=inside, **changes))
        inside = np.ones_like(inside)
        return outside_intervals(
            (row, altered(second, uncertainty=replace(row.uncertainty, inside=inside))), 0
        )

    name = name_of(first.fit)
    assert f"α of {name}; β of {name}." in said_outside([0, 1])
    assert name not in said_outside([])
    nothing = Parameters.of(np.full((4, 3), np.nan))
    assert name not in said_outside([0], lower=nothing, upper=nothing)


def test_a_stopped_training_is_called_so_first() -> None:
    fit = replace(whole().fit, outcome=Outcome.STOPPED, iterations=12)
    assert "stopped at 12 of 20 iterations" in summary(altered(whole(), fit=fit))[0]


def test_facts_of_the_data_are_terms_and_descriptions() -> None:
    facts = {"acc_flag": 1, "campaign": "AstaZero", "distance_setting": None}
    info = replace(whole().info, excluded_regimes=("manual",), excluded_share=(0.25, 0, 0, 0))
    rows = dict(about_data(altered(replace(whole(), facts=facts), info=info)))
    assert rows["ACC flag of the file"].startswith("ACC, for the recording as a whole")
    assert rows["Campaign"] == "AstaZero"
    assert "Distance setting" not in rows
    assert rows["Excluded"].startswith("manual from the model's equation: 25 % of")
    assert (setting([1.0, 0.5]), setting("fast")) == ("1, 0.5", "fast")


def test_a_band_says_whose_it_is_where_the_answer_s_model_is_another() -> None:
    answered = TITLES[small().answer.model]
    assert answered in about_band(small())
    same = small().under(replace(small().analysis, model="cthp"))
    assert "answer" not in about_band(same)
    lagged = about_band(altered(small(), fit=replace(small().fit, model="idm-lag")))
    assert f"linearisation of the {TITLES['idm-lag']}" in lagged
    assert "is not part of it" in lagged


@pytest.mark.parametrize("model", FOLLOWING)
def test_an_equation_has_every_parameter_of_its_model_and_no_other(model: str) -> None:
    said = " ".join(equation(model))
    assert all(parameter.symbol in said for parameter in FOLLOWING[model].parameters)
    if model not in CTHPS:
        assert TITLES[model] in said
        assert not {"α", "β", "τ"} & {*said}
    for name, symbol in (("s0", "s₀"), ("lag", "λ d²v"), ("delay", "time d")):
        assert (symbol in said) is (name in FOLLOWING[model].terms) or model not in CTHPS
