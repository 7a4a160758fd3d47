"""String stability and simulated platoons in sentences: counts, probabilities, reasons."""

import math
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from accpinn.inference.gain_check import GainCheck
from accpinn.model.cthp import Parameters
from accpinn.model.published import ParameterSet
from accpinn.platoon.leader import Sinusoid
from accpinn.platoon.simulation import AFTER_COLLISION, simulate_platoon
from accpinn.results.messages.stability import (
    against_measured,
    amplification,
    criteria_differ,
    disturbance,
    factor,
    headline,
    probabilities,
    reason,
    smallest_gap,
)
from accpinn.stability.report import (
    StabilityReport,
    VehicleStability,
    assessment,
    stability_report,
)
from tests.support.vehicles import AUDI, BMW, CALM, TESLA, UNDAMPED, extreme, ordinary, row

DAMPED, LOUD = Parameters(0.08, 0.02, 9.0), Parameters(0.08, 0.12, 1.5)


def named(*vehicles: Parameters) -> ParameterSet:
    names = tuple(f"V{k}" for k in range(1, len(vehicles) + 1))
    return ParameterSet("Mine", names, row(*vehicles))


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
    sentence = amplification(chosen, stability_report(chosen.parameters))
    assert [fact for fact in facts if fact not in sentence] == []


def posterior(*stable: float) -> Any:
    """What the headline reads of the uncertainty of one or several vehicles."""
    return SimpleNamespace(probability_l2=np.array(stable))


@pytest.mark.parametrize(
    ("stable", "state"),
    [(0.001, "unstable"), (0.05, "unstable"), (0.09, "open"), (0.95, "stable"),
     (math.nan, "not determined")],
)  # fmt: skip
def test_a_verdict_follows_the_posterior_not_the_estimate(stable: float, state: str) -> None:
    chosen = named(LOUD)
    report = stability_report(chosen.parameters)
    assert assessment(stable) == state
    said = headline(chosen, report, posterior(stable))
    assert ("amplifies" in said) == (state == "unstable")
    assert ("probability" in said) == (stable == stable)
    assert headline(chosen, report, None) == amplification(chosen, report)


def test_verdicts_of_several_vehicles_are_counted() -> None:
    chosen = named(LOUD, CALM, LOUD)
    report = stability_report(chosen.parameters)
    assert "All three" in headline(chosen, report, posterior(0.0, 0.01, 0.03))
    assert "under 1 % to 3 %" in headline(chosen, report, posterior(0.0, 0.01, 0.03))
    mixed = headline(chosen, report, posterior(0.0, 1.0, 0.4))
    assert mixed.startswith("Of three vehicles one amplifies disturbances, one is L₂ string stable")
    each = probabilities(chosen, posterior(0.0, 1.0, math.nan))
    for part in ("under 1 %", "over 99 %", "not determined"):
        assert part in each


def test_vehicles_without_a_comparison_are_named_in_one_sentence() -> None:
    checks = [GainCheck(2, 9, rms=1.5), GainCheck(3, 0), GainCheck(4, 2)]
    vehicles = replace(named(LOUD, CALM, LOUD), vehicles=(1, 2, 3, 4))
    first, others = against_measured(checks, vehicles)
    assert first == checks[0].sentence(vehicles)
    assert all(vehicles.label(number) in others for number in (3, 4))
    assert against_measured(checks[:2], vehicles) == tuple(c.sentence(vehicles) for c in checks[:2])


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
        assert ". " not in text
        assert "nan" not in text
        assert "inf " not in text
        assert "None" not in text


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
    sentence = reasons(stability_report(vehicles))[name]
    assert [fact for fact in facts if fact not in sentence] == []


@pytest.mark.parametrize(
    ("gain", "text"), [(1.4, "1.40"), (12.0, "12.0"), (123.4, "123"), (1.00002, "1 + 2e-05")]
)
def test_a_factor_keeps_its_digits(gain: float, text: str) -> None:
    assert factor(gain) == text


def test_the_disturbance_names_each_collision_and_who_drives_on() -> None:
    run = simulate_platoon(row(*[AUDI] * 8), Sinusoid(0.214))
    said = disturbance(run)
    assert "follower 6 collides at 88 s, then follower 5 at 114 s" in said
    assert smallest_gap(run) == AFTER_COLLISION
    calm = simulate_platoon(CALM, Sinusoid(0.214))
    assert f"{calm.minimum_gap[0]:.1f} m" in smallest_gap(calm)


def test_who_meets_the_papers_criterion_only_is_named() -> None:
    chosen = named(TESLA, CALM)
    assert criteria_differ(chosen, stability_report(chosen.parameters)).startswith("V1 meets")
    assert not criteria_differ(named(CALM), stability_report(CALM))
