"""Which parameters are recommended: of a better form, else of the CTHP with room for a lag."""

from dataclasses import replace

import numpy as np
import pytest
from msgspec import structs

from accpinn.inference.intervals import SLACK, judged
from accpinn.inference.model_adequacy import Adequacy, Inadequate, WeightedForms
from accpinn.model.cthp import Parameters
from accpinn.results.messages import message
from accpinn.segment.segment import Segment
from accpinn.study.comparison import MethodResult, compare, results_among
from accpinn.study.recommendation import recommend
from tests.support.samples import NOISY, sample
from tests.support.snapshots import delayed


@pytest.fixture(scope="module")
def segment() -> Segment:
    return sample(NOISY).segment


@pytest.fixture(scope="module")
def rows(segment: Segment) -> tuple[MethodResult, ...]:
    return results_among(compare(segment, "II", ("maximum-likelihood", "least-squares")))


def adequacy(*findings: object) -> Adequacy:
    """A comparison of forms with these findings."""
    return Adequacy(("any form",), None, findings)


def test_a_better_form_is_named_and_the_intervals_are_those_over_all_forms(
    segment: Segment, rows: tuple[MethodResult, ...]
) -> None:
    better, weighted = delayed().findings
    (found,) = recommend(segment, rows, adequacy(better, weighted))
    assert found.better is better
    assert isinstance(weighted, WeightedForms)
    assert found.intervals == weighted.intervals
    assert found.is_adequate is None, "of a better form no test is known"
    assert "delay describes the data better" in message(found, segment)


def test_what_is_wide_and_what_is_not_noise_is_told(
    segment: Segment, rows: tuple[MethodResult, ...]
) -> None:
    (weighted,) = delayed().recommended
    alpha, beta, tau = weighted.intervals
    weighted = structs.replace(
        weighted, intervals=(alpha, structs.replace(beta, lower=0.1, upper=0.9), tau)
    )
    unlike = Inadequate(vehicle=2, correlated=True, uneven=False, nonnormal=False, nonlinear=False)
    (found,) = recommend(segment, rows, adequacy(weighted, unlike))
    assert found.wide == ("β",), "from 0.1 to 0.9"
    assert found.is_adequate is False


def test_without_other_forms_it_is_maximum_likelihood(
    segment: Segment, rows: tuple[MethodResult, ...]
) -> None:
    (plain,) = recommend(segment, rows, None)
    assert plain.is_adequate is None
    assert plain.intervals[0].lower == rows[0].uncertainty.lower[0].alpha
    centre = rows[0].uncertainty.centre[0].values
    assert np.allclose([one.estimate for one in plain.intervals], centre)


def test_methods_outside_the_intervals_are_named(
    segment: Segment, rows: tuple[MethodResult, ...]
) -> None:
    upper, known = rows[0].uncertainty.upper.values, rows[0].uncertainty

    def moved(share: float) -> MethodResult:
        beyond = upper + share * (upper - known.lower.values)
        fit = replace(rows[1].fit, parameters=Parameters.of(beyond))
        return replace(rows[1], fit=fit, uncertainty=judged(known, segment, fit))

    (found,) = recommend(segment, (rows[0], moved(1.0)), None)
    assert found.outside == ("least-squares",)
    assert "Least squares" in message(found, segment)
    (found,) = recommend(segment, (rows[0], moved(SLACK / 2)), None)
    assert found.outside == (), "the ends are drawn, so they are known to within SLACK only"
