"""Which parameters are recommended: of a better form, else of the CTHP with room for a lag."""

from dataclasses import replace

import numpy as np
import pytest

from accpinn.inference.intervals import ParameterInterval
from accpinn.inference.model_adequacy import Adequacy, BetterForm, Inadequate, PossibleLag
from accpinn.results.messages import message
from accpinn.segment.segment import Segment
from accpinn.study.comparison import MethodResult, compare, results_among
from accpinn.study.recommendation import recommend
from tests.support.samples import NOISY, sample

ENDS = {"α": (0.01, 0.02), "β": (0.1, 0.9), "τ": (1.0, 1.5)}


@pytest.fixture(scope="module")
def segment() -> Segment:
    return sample(NOISY).segment


@pytest.fixture(scope="module")
def rows(segment: Segment) -> tuple[MethodResult, ...]:
    return results_among(compare(segment, "II", ("maximum-likelihood", "least-squares")))


def adequacy(*findings: object) -> Adequacy:
    """A comparison of forms with these findings."""
    return Adequacy(("any form",), None, findings)  # type: ignore[arg-type]


def form(kind: type, **further: float) -> object:
    intervals = tuple(
        ParameterInterval(s, low, high, likeliest=low) for s, (low, high) in ENDS.items()
    )
    return kind(vehicle=2, form="lag", extra=0.5, intervals=intervals, extra_lower=0.0,
                extra_upper=0.8, level=0.9, **further)  # fmt: skip


def test_a_better_form_is_used_with_its_own_estimates(
    segment: Segment, rows: tuple[MethodResult, ...]
) -> None:
    better = form(BetterForm, aic=-20.0, holdout=3.0)
    (found,) = recommend(segment, rows, adequacy(better))
    assert found.better is better
    assert [one.likeliest for one in found.intervals] == [low for low, _ in ENDS.values()]
    assert found.wide == ("β",), "from 0.1 to 0.9"
    assert found.is_adequate is None, "of a better form no test is known"
    assert "actuator lag describes the data better" in message(found, segment)


def test_without_one_the_estimates_are_the_cthp_s_and_the_intervals_allow_for_a_lag(
    segment: Segment, rows: tuple[MethodResult, ...]
) -> None:
    centre = rows[0].uncertainty.centre[0].values
    unlike = Inadequate(vehicle=2, correlated=True, uneven=False, nonnormal=False, nonlinear=False)
    (found,) = recommend(segment, rows, adequacy(form(PossibleLag), unlike))
    assert np.allclose([one.likeliest for one in found.intervals], centre)  # type: ignore[arg-type]
    assert [(one.lower, one.upper) for one in found.intervals] == [*ENDS.values()]
    assert found.is_adequate is False
    (plain,) = recommend(segment, rows, None)
    assert plain.is_adequate is None
    assert plain.intervals[0].lower == rows[0].uncertainty.lower[0].alpha


def test_methods_outside_the_intervals_are_named(
    segment: Segment, rows: tuple[MethodResult, ...]
) -> None:
    fit = rows[1].fit
    away = replace(
        rows[1], fit=replace(fit, parameters=fit.parameters.of(9 * fit.parameters.values))
    )
    (found,) = recommend(segment, (rows[0], away), None)
    assert found.outside == ("least-squares",)
    assert "Least squares" in message(found, segment)
