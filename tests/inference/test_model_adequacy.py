"""Further forms of the model, found where a recording shows them, and tests of innovations."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import kstest

from accpinn.inference.innovation_tests import InnovationTests, score_test
from accpinn.inference.model_adequacy import (
    FORMS,
    BetterForm,
    Inadequate,
    ModelForm,
    model_forms,
)
from accpinn.inference.posterior import sample
from accpinn.methods.joint_likelihood import joint_maxima
from accpinn.methods.series import series_of
from accpinn.model.cthp import Parameters
from accpinn.model.spec import ModelSpec
from accpinn.segment import Segment
from bench.disturbed import Disturbance, disturbed
from tests.support.driving import driven, standing_still

all_draws = pytest.mark.usefixtures("all_draws")

TRUE = (0.1, 0.3, 1.2)


def recorded(**departure: float) -> Segment:
    """Disturbances so small that a term of the model stands out."""
    disturbance = Disturbance(0.05, 2.0, **departure)
    return disturbed(Parameters.of([TRUE]), 1, disturbance)


@pytest.mark.parametrize(
    ("departure", "term", "value", "tolerance"),
    [({"standstill": 6.0}, "s0", 6.0, 2.0), ({"lag": 1.0}, "lag", 1.0, 0.3)],
)
def test_a_term_that_the_recording_shows_is_found(
    departure: dict[str, float], term: str, value: float, tolerance: float
) -> None:
    segment = recorded(**departure)
    adequacy = model_forms(segment)
    (better,) = [item for item in adequacy.findings if isinstance(item, BetterForm)]
    assert better.vehicle == 2
    assert better.aic < -4
    (with_term,) = [item for item in adequacy.forms if item.form == f"cthp-{term}"]
    assert with_term.aic[0] < -4
    assert with_term.form == better.form
    estimate, lower, upper = (
        getattr(part[0], term) for part in (with_term.parameters, with_term.lower, with_term.upper)
    )
    assert estimate == pytest.approx(value, abs=tolerance)
    assert lower < estimate < upper
    np.testing.assert_allclose(with_term.parameters.values[0], TRUE, rtol=0.2)
    assert_hardly_missed(with_term)


def assert_hardly_missed(form: ModelForm) -> None:
    """A 90 % interval misses the truth now and then, but not by far."""
    lower, upper = form.lower.values[0], form.upper.values[0]
    assert ((2 * lower - upper < TRUE) & (TRUE < 2 * upper - lower)).all()


@all_draws
def test_where_the_cthp_holds_no_form_is_better_and_it_is_adequate() -> None:
    adequacy = model_forms(recorded())
    assert [form.form for form in adequacy.forms] == list(FORMS)
    assert not [item for item in adequacy.findings if isinstance(item, BetterForm | Inadequate)]
    np.testing.assert_allclose(adequacy.forms[0].parameters.values[0], TRUE, rtol=0.1)
    assert adequacy.forms[0].aic[0] == adequacy.forms[0].holdout[0] == 0.0
    s0 = next(form for form in adequacy.forms if form.form == "cthp-s0")
    assert s0.likelihood_ratio[0] > -1e-3, "the CTHP is nested in it"
    lag = next(form for form in adequacy.forms if form.form == "cthp-lag")
    assert 0.0 < lag.lower[0].lag < lag.upper[0].lag < 0.5
    for form in adequacy.forms:
        assert_hardly_missed(form)
    holds = adequacy.forms[0]
    assert (holds.lower.values < holds.parameters.values).all()
    assert (holds.parameters.values < holds.upper.values).all()


@all_draws
def test_two_modes_of_a_lag_are_sampled_alike_from_any_seed() -> None:
    """The truth, a lag of a second, is hardly told from none; α differs by half between them."""
    true = Parameters.of([[0.0953, 0.127, 1.2]])
    segment = disturbed(true, 4, Disturbance(lag=1.0), duration=200.0)
    maxima, series = (
        joint_maxima((segment,), "II", ModelSpec("cthp-lag")),
        series_of([segment], "II"),
    )
    ends = []
    for seed in (2, 3):
        (posterior,) = sample(series, maxima, ModelSpec("cthp-lag"), (seed,))
        assert posterior.effective > 100
        ends.append(
            np.quantile(posterior.evenly(1000).coordinates[:, [0, -1]], (0.05, 0.95), axis=0)
        )
    assert (np.abs(ends[1] - ends[0]) < 0.2 * np.ptp(ends[0], axis=0)).all()


@pytest.mark.usefixtures("cthp_alone")
def test_innovations_that_are_not_those_of_the_model_are_told() -> None:
    """Measured speeds that jump."""
    segment = disturbed(Parameters.of([TRUE]), 1, Disturbance(), duration=150.0)
    jumps = 0.4 * (np.sin(4 * segment.time) > 0.9)[:, None]
    findings = model_forms(replace(segment, speeds=segment.speeds + jumps)).findings
    (inadequate,) = [item for item in findings if isinstance(item, Inadequate)]
    assert inadequate.vehicle == 2
    assert inadequate.correlated or inadequate.nonnormal


@pytest.mark.usefixtures("cthp_alone")
def test_a_limited_acceleration_is_no_linear_response() -> None:
    segment = disturbed(Parameters.of([TRUE]), 1, Disturbance(limits=(-2.0, 0.5)), duration=150.0)
    (inadequate,) = [item for item in model_forms(segment).findings if isinstance(item, Inadequate)]
    assert inadequate.nonlinear
    assert not inadequate.nonnormal


def test_a_window_that_is_too_short_has_no_forms_and_one_without_motion_no_parameters() -> None:
    adequacy = model_forms(driven(duration=15.0))
    assert (adequacy.forms, adequacy.tests, adequacy.findings) == ((), None, ())
    still = model_forms(standing_still()).forms
    assert all(np.isnan(form.parameters.values).all() for form in still)


@pytest.mark.usefixtures("cthp_alone")
def test_short_stretches_leave_the_tests_open() -> None:
    segment = disturbed(Parameters.of([TRUE]), 1, Disturbance(), duration=60.0)
    mask = np.arange(segment.samples)[:, None] % 60 < 52
    adequacy = model_forms(replace(segment, mask=mask))
    assert np.isfinite(adequacy.forms[0].lower.values).all()
    assert np.isnan([*adequacy.tests.correlated, *adequacy.tests.nonlinear]).all()
    assert not adequacy.tests.fails.any()


def test_what_no_follower_shows_may_show_in_all() -> None:
    """p-values of 0.02 are no reason for doubt; six of them are."""
    weak, none = np.full(6, 0.02), np.ones(6)
    tests = InnovationTests(none, weak, none, np.full(6, np.nan))
    assert not tests.fails.any()
    assert tests.united.fails.tolist() == [[False, True, False, False]]


def test_terms_that_resemble_each_other_reject_what_is_true_as_often_as_they_say() -> None:
    rng = np.random.default_rng(0)
    level = np.sin(np.arange(200) / 9)
    terms = np.array([np.maximum(level - height, 0) for height in (0, 0.2, 0.5, 0.6)]).T
    beside = np.array([level, np.ones(200)]).T
    probabilities = [
        score_test(terms, beside, errors) for errors in rng.standard_normal((2000, 200))
    ]
    assert kstest(probabilities, "uniform").pvalue > 0.01
    assert score_test(terms, beside, rng.standard_normal(200) + 2 * terms[:, 2]) < 1e-3


def test_what_is_certain_has_no_chance() -> None:
    rng = np.random.default_rng(0)
    terms, beside = rng.standard_normal((50, 3)), np.ones((50, 1))
    for size in (1e2, 1e5, 1e12, 1e100):
        assert score_test(terms, beside, size * terms[:, 0]) < 1e-9
    assert score_test(terms, beside, np.zeros(50)) == 1.0
