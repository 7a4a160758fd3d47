"""Reasons of verdicts: one sentence each, whatever the vehicle."""

from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from accpinn.model.cthp import Parameters
from accpinn.results.messages.stability import reason
from accpinn.stability.report import StabilityReport, VehicleStability, stability_report
from tests.support.vehicles import AUDI, BMW, CALM, TESLA, UNDAMPED, extreme, ordinary, row

DAMPED = Parameters(0.08, 0.02, 9.0)


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


def test_where_the_two_linf_criteria_differ_the_reason_says_why() -> None:
    found = reasons(stability_report(TESLA).vehicles[0])
    assert "real" in found["linf_paper"]
    assert "necessary but not sufficient" in found["linf_exact"]
    assert "1.095" in found["linf_exact"]


@pytest.mark.parametrize("name", ["l2", "linf_exact"])
def test_the_boundary_is_named(name: str) -> None:
    headways = stability_report(TESLA).vehicles[0].smallest_tau
    at = Parameters(TESLA.alpha, TESLA.beta, getattr(headways, name))
    assert reasons(stability_report(at).vehicles[0])[name].startswith("On the boundary")


@pytest.mark.parametrize(
    ("vehicles", "name", "words"),
    [
        (row(CALM, TESLA), "l2_strict", "Follower 2 amplifies disturbances by"),
        (row(AUDI, CALM, BMW), "linf_strict", "Followers 1 and 3 amplify peaks, follower 1 the m"),
        (row(TESLA, DAMPED, DAMPED), "l2_weak", "others damp"),
        (row(AUDI, UNDAMPED, CALM), "l2_weak", "at 0.5 rad/s grows without limit"),
        (row(CALM, CALM), "linf_weak", "neither does the platoon"),
        (row(TESLA, CALM), "linf_weak", "from the leader to the last"),
        (row(Parameters(1e-12, 1.0, 0.1), Parameters(1e8, 1, 1e-5)), "linf_weak", "time scales"),
    ],
)
def test_a_platoons_reason_names_who_and_how_much(
    vehicles: Parameters, name: str, words: str
) -> None:
    assert words in reasons(stability_report(vehicles))[name]
