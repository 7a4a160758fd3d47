"""Tests of the innovations reject what is true as often as they say, and what is not more often."""

import numpy as np
from scipy.stats import kstest

from accpinn.inference.innovation_tests import InnovationTests, score_test


def test_what_no_follower_shows_may_show_in_all() -> None:
    """p-values of 0.02 are no reason for doubt; six of them are."""
    each, none = np.full(6, 0.02), np.ones(6)
    tests = InnovationTests(none, each, none, np.full(6, np.nan))
    assert not tests.fails.any()
    assert tests.united.fails.tolist() == [[False, True, False, False]]


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
