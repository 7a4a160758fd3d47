"""Tests of the innovations reject what is true as often as they say, and what is not more often."""

import numpy as np
import pytest
from scipy.stats import chi2, kstest

from accpinn.inference.innovation_tests import InnovationTests, score_test


def test_what_no_follower_shows_may_show_in_all() -> None:
    """p-values of 0.02 are no reason for doubt; six of them are."""
    each, none = np.full(6, 0.02), np.ones(6)
    tests = InnovationTests(none, each, none, np.full(6, np.nan))
    assert not tests.fails.any()
    assert tests.united.fails.tolist() == [[False, True, False, False]]


def test_terms_that_share_nothing_are_tested_by_chi_squared() -> None:
    terms, beside = np.eye(100)[:, :6], np.eye(100)[:, 6:10]
    for length in (0.5, 2.0, 4.0, 10.0):
        errors = np.full(100, length)
        found = score_test(terms, beside, errors)
        assert found == pytest.approx(chi2.sf(6 * length**2, 6), rel=0.05)


def test_terms_that_resemble_each_other_reject_what_is_true_as_often_as_they_say() -> None:
    rng = np.random.default_rng(0)
    level = np.sin(np.arange(200) / 9)
    terms = np.array([np.maximum(level - height, 0) for height in (0, 0.2, 0.5, 0.6)]).T
    beside = np.array([level, np.ones(200)]).T
    found = [score_test(terms, beside, errors) for errors in rng.standard_normal((2000, 200))]
    assert kstest(found, "uniform").pvalue > 0.01
    assert score_test(terms, beside, rng.standard_normal(200) + 2 * terms[:, 2]) < 1e-3


def test_what_is_certain_has_no_chance() -> None:
    rng = np.random.default_rng(0)
    terms, beside = rng.standard_normal((50, 3)), np.ones((50, 1))
    for size in (1e2, 1e5, 1e12, 1e100):
        assert score_test(terms, beside, size * terms[:, 0]) < 1e-9
    assert score_test(terms, beside, np.zeros(50)) == 1.0


def test_what_stands_beside_the_terms_explains_nothing_more() -> None:
    rng = np.random.default_rng(0)
    beside, errors = rng.standard_normal((50, 3)), rng.standard_normal(50)
    assert score_test(beside @ rng.standard_normal((3, 2)), beside, errors) == 1.0
    term = rng.standard_normal((50, 1))
    alone = score_test(term, beside, errors)
    both = score_test(np.hstack([term, term + beside[:, :1]]), beside, 1e6 * beside[:, 0] + errors)
    assert both == pytest.approx(alone, rel=1e-6)
