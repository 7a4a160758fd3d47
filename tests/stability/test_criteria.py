"""The criteria: the paper's expressions, their boundaries in τ, and what is refused."""

from math import inf, nan

import pytest
from hypothesis import given
from hypothesis import strategies as st

from accpinn.errors import ParameterError
from accpinn.model.cthp import Parameters
from accpinn.stability.criteria import (
    checked,
    exact_margin,
    l2_margin,
    paper_margin,
    smallest_headway_exact,
    smallest_headway_l2,
    smallest_headway_paper,
)
from tests.support.vehicles import AUDI, ordinary, row

BOUNDARIES = (
    (l2_margin, smallest_headway_l2),
    (paper_margin, smallest_headway_paper),
    (exact_margin, smallest_headway_exact),
)


@given(ordinary, st.floats(0.01, 0.5))
def test_each_margin_changes_sign_at_the_smallest_headway(vehicle: Parameters, off: float) -> None:
    for margin, smallest in BOUNDARIES:
        headway = smallest(vehicle)
        below, above = (
            margin(Parameters(vehicle.alpha, vehicle.beta, headway * factor))
            for factor in (1 - off, 1 + off)
        )
        assert above > 0
        assert below < 0 or headway == 0


def test_without_alpha_the_smallest_headways_are_the_limits() -> None:
    for smallest in (smallest_headway_l2, smallest_headway_exact):
        at_zero, near = smallest(Parameters([0.0, 1e-9], 0.5, 0.0))
        assert at_zero == pytest.approx(1 / 0.5)
        assert near == pytest.approx(at_zero, rel=1e-6)


def test_values_below_all_measure_are_zero() -> None:
    assert checked(Parameters(1e-60, 0.3, 1.2)) == Parameters(0.0, 0.3, 0.0)
    assert checked(Parameters(0.0, 0.3, nan)) == Parameters(0.0, 0.3, 0.0)


@pytest.mark.parametrize(
    ("vehicle", "words"),
    [
        ((nan, 0.1, 1.0), "α is missing"),
        ((0.1, nan, 1.0), "β is missing"),
        ((0.1, 0.1, nan), "τ is missing"),
        ((-0.1, 0.1, 1.0), "α = -0.1 is negative"),
        ((0.1, -0.2, 1.0), "β = -0.2 is negative"),
        ((0.1, 0.1, -1.0), "τ = -1 is negative"),
        ((inf, 0.1, 1.0), "α = inf is beyond any vehicle"),
        ((0.1, 1e51, 1.0), "β = 1e+51 is beyond any vehicle"),
    ],
)
def test_impossible_values_are_refused(vehicle: tuple[float, float, float], words: str) -> None:
    with pytest.raises(ParameterError, match=f"^Parameter set 2: {words.replace('+', '.')}"):
        checked(row(AUDI, Parameters(*vehicle)))


def test_nothing_is_refused_too() -> None:
    with pytest.raises(ParameterError, match="no vehicle"):
        checked(Parameters([], [], []))
