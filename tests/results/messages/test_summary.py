"""A result in a few sentences: its numbers, their uncertainty, and what goes wrong."""

import re
from dataclasses import replace

import numpy as np
import pytest
from accpinn.results.snapshot import Snapshot, stability

from accpinn.evaluation.closed_loop import SimulatedCollision
from accpinn.inference.intervals import Uncertainty
from accpinn.methods.fit import Outcome
from accpinn.model.cthp import Parameters
from accpinn.results.messages.summary import (
    about_data,
    cautions,
    headway_words,
    setting,
    summary,
    title,
)
from tests.support.snapshots import small, whole


def said(snapshot: Snapshot) -> str:
    return " ".join(summary(snapshot))


def colliding(snapshot: Snapshot, vehicle: int, time: float) -> Snapshot:
    findings = (SimulatedCollision(vehicle, time, -1.5),)
    return replace(snapshot, evaluation=replace(snapshot.evaluation, findings=findings))


def test_title_agrees_in_number() -> None:
    assert title(whole()) == "whole"
    assert title(replace(whole(), name="")) == "How 4 vehicles follow the vehicle ahead"
    assert "follows the vehicle ahead" in title(replace(small(), name=""))


def test_estimates_outside_their_intervals_are_named_at_once() -> None:
    uncertainty = whole().uncertainty
    inside = np.ones_like(uncertainty.inside)
    assert "outside" not in said(replace(whole(), uncertainty=replace(uncertainty, inside=inside)))
    inside[1, 0] = False
    text = said(replace(whole(), uncertainty=replace(uncertainty, inside=inside)))
    assert f"Some estimates of {whole().info.labels[2]} lie outside" in text


def test_summary_gives_parameters_with_intervals_and_probabilities() -> None:
    text, uncertainty = said(whole()), whole().uncertainty
    values = whole().fit.parameters.values
    headways = values[:, 2]
    [ends] = re.findall(r"time headways τ ([\d.]+) to ([\d.]+) s", text)
    np.testing.assert_allclose(np.array(ends, float), [headways.min(), headways.max()], atol=0.005)
    lower, upper = (Parameters.of(values + end) for end in (-0.5, 0.5))
    wide = said(replace(whole(), uncertainty=replace(uncertainty, lower=lower, upper=upper)))
    ends = f"{values[:, 1].min():.2f} to {values[:, 1].max():.2f}"
    assert f"β {ends} 1/s" in wide, "no more digits than the intervals support"
    known = small().uncertainty
    low, high = known.lower.tau[0], known.upper.tau[0]
    assert f"(90 % interval: {low:.2f} to {high:.2f} s)" in said(small())
    assert "All four vehicles amplify" in text
    assert "Probability of L∞ string stability: " in text
    assert "misses the space-gap by" in text
    shared = replace(whole(), fit=replace(whole().fit, case="I"))
    assert "4 vehicles as one set: time headway" in said(shared)
    values = np.where(np.arange(3) == 2, np.nan, values)
    unknown = replace(whole(), fit=replace(whole().fit, parameters=Parameters.of(values)))
    assert "time headways τ not determined" in said(replace(unknown, stability=None))
    values = np.where(np.arange(4)[:, None] == 1, values, whole().fit.parameters.values)
    unknown = replace(whole(), fit=replace(whole().fit, parameters=Parameters.of(values)))
    alone = f"(not determined for {whole().info.labels[2]}), gains"
    assert alone in said(replace(unknown, stability=None))


def test_undetermined_headways_and_probabilities_are_called_so() -> None:
    uncertainty = small().uncertainty

    def words(low: float, high: float) -> str:
        ends = Parameters.of([[0.1, 0.1, low]]), Parameters.of([[0.1, 0.1, high]])
        return headway_words(replace(uncertainty, lower=ends[0], upper=ends[1]), 0)

    assert words(1.0, np.inf) == "90 % interval: 1.00 s or more"
    assert words(0.0, np.inf) == "not determined by the data"
    assert words(np.nan, np.nan) == headway_words(None, 0) == ""
    nothing = np.full_like(uncertainty.probability_l2, np.nan)
    unknown: Uncertainty = replace(uncertainty, probability_l2=nothing, probability_linf=nothing)
    assert "no probability of string stability" in said(replace(small(), uncertainty=unknown))


def test_collisions_are_named_with_vehicle_and_time() -> None:
    assert "collide" not in said(whole())
    text = said(colliding(whole(), 3, 12.34))
    assert "1 of 4 vehicles collides" in text
    assert f"{whole().info.labels[2]} at 12.3 s." in text
    assert "the follower collides with the vehicle ahead at 22.6 s." in said(
        colliding(small(), 2, 22.6)
    )
    assert len(cautions(colliding(whole(), 3, 12.34))["closed_loop"]) == 1


@pytest.mark.parametrize("lost", [(3,), (2, 3), (0, 1, 2, 3)])
def test_followers_without_closed_loop_errors_are_named(lost: tuple[int, ...]) -> None:
    evaluation = whole().evaluation
    gaps = np.array([1.23, 2.34, 3.45, 4.56])
    gaps[list(lost)] = np.nan
    errors = replace(evaluation.closed_loop, gap_mae=gaps)
    text = said(replace(whole(), evaluation=replace(evaluation, closed_loop=errors)))
    assert "nan" not in text
    named = ", ".join(whole().info.labels[1 + k] for k in lost)
    assert (f"(without {named}, whose simulation diverges)" in text) == (len(lost) < 4)
    assert ("misses the space-gap by 1.2" in text) == (len(lost) < 4)


def test_a_stopped_training_is_called_so_first() -> None:
    fit = replace(whole().fit, outcome=Outcome.STOPPED, iterations=12)
    first = summary(replace(whole(), fit=fit))[0]
    assert "stopped at 12 of 20 iterations" in first
    assert "amplify" not in said(replace(whole(), fit=fit)), "no verdict"


def test_stable_vehicles_are_called_so() -> None:
    fit = replace(small().fit, parameters=Parameters.of([[0.05, 0.6, 3.0]]))
    found = replace(small(), fit=fit, stability=stability(fit), uncertainty=None)
    assert "does not amplify" in said(found)


def test_facts_of_the_data_are_terms_and_descriptions() -> None:
    facts = {"acc_flag": 1, "campaign": "AstaZero", "distance_setting": None}
    info = replace(whole().info, excluded_regimes=("manual",), excluded_share=(0.25, 0, 0, 0))
    rows = dict(about_data(replace(whole(), facts=facts, info=info)))
    assert rows["ACC flag of the file"].startswith("ACC, for the recording as a whole")
    assert rows["Campaign"] == "AstaZero"
    assert "Distance setting" not in rows
    assert rows["Excluded"].startswith("manual from the model's equation: 25 % of")
    assert (setting([1.0, 0.5]), setting("fast")) == ("1, 0.5", "fast")
