"""Least squares on finite differences against numpy's; on smoothed signals: exact on cubics."""

import numpy as np
import pytest

from accpinn.evaluation.closed_loop import surrogate_errors
from accpinn.methods import least_squares
from accpinn.model.cthp import Case
from tests.support.driving import LAW, MIXED, driven, segment_of


@pytest.mark.parametrize("case", ["I", "II"])
def test_is_numpys_solution_on_central_differences(case: Case) -> None:
    segment = driven(MIXED, noise=0.02)
    v, p = segment.speeds, segment.gaps
    blocks, goals = [], []
    for i in range(1, 4):
        gap, own, ahead = p[1:-1, i - 1], v[1:-1, i], v[1:-1, i - 1]
        blocks.append(np.column_stack([gap, -own, ahead - own]))
        goals.append((v[2:, i] - v[:-2, i]) / 0.2)
    if case == "I":
        blocks, goals = [np.vstack(blocks)] * 3, [np.concatenate(goals)] * 3
    fit = least_squares.fit(segment, case)
    for one, rows, goal in zip(fit.parameters, blocks, goals, strict=True):
        alpha, alpha_tau, beta = np.linalg.lstsq(rows, goal, rcond=None)[0]
        expected = (alpha, beta, alpha_tau / alpha)
        # Ours also has the two ends, where the difference is one-sided.
        assert (one.alpha, one.beta, one.tau) == pytest.approx(expected, rel=0.02)
    assert fit.surrogate is None
    assert surrogate_errors(segment, fit) is None


class TestSmoothed:
    def test_smoothing_takes_away_most_of_the_noise_that_biases_plain_least_squares(self) -> None:
        segment = driven((LAW,), duration=300.0, noise=0.3)
        plain, smooth = (
            abs(estimate(segment).parameters.values[0] / LAW - 1).max()
            for estimate in (least_squares.fit, least_squares.fit_smoothed)
        )
        assert smooth < 0.5 * plain

    def test_leaves_cubics_as_they_are(self) -> None:
        """So the model holds exactly where the motion is a cubic, also at the window's ends."""
        time = 0.1 * np.arange(200)
        follower = 20 + 0.4 * time - 0.03 * time**2 + 0.0008 * time**3
        rate = 0.4 - 0.06 * time + 0.0024 * time**2
        ahead = 22 - 0.2 * time + 0.01 * time**2
        alpha, beta, tau = LAW
        gap = (rate - beta * (ahead - follower)) / alpha + tau * follower
        segment = segment_of(time, np.column_stack([ahead, follower]), gap[:, None])
        fit = least_squares.fit_smoothed(segment)
        np.testing.assert_allclose(fit.parameters.values, [LAW], rtol=1e-6)
        np.testing.assert_allclose(fit.surrogate.speeds, segment.speeds, rtol=1e-9)
