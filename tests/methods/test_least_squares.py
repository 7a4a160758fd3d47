"""Least squares on finite differences against numpy's."""

import numpy as np
import pytest

from accpinn.evaluation.closed_loop import surrogate_errors
from accpinn.methods import least_squares
from accpinn.model.cthp import Case
from tests.support.driving import MIXED, driven


@pytest.mark.parametrize("case", ["I", "II"])
def test_is_numpys_solution_on_central_differences(case: Case) -> None:
    segment = driven(MIXED, noise=0.02)
    v, p = segment.speeds, segment.gaps
    blocks, goals = [], []
    for i in range(1, 4):
        acceleration = (v[2:, i] - v[:-2, i]) / 0.2
        gap, own, ahead = p[1:-1, i - 1], v[1:-1, i], v[1:-1, i - 1]
        blocks.append(np.column_stack([gap, -own, ahead - own]))
        goals.append(acceleration)
    if case == "I":
        blocks, goals = [np.vstack(blocks)] * 3, [np.concatenate(goals)] * 3
    fit = least_squares.fit(segment, case)
    for one, rows, goal in zip(fit.parameters, blocks, goals, strict=True):
        alpha, alpha_tau, beta = np.linalg.lstsq(rows, goal, rcond=None)[0]
        expected = (alpha, beta, alpha_tau / alpha)
        # Ours also has the two ends, where the difference is one-sided.
        assert (one.alpha, one.beta, one.tau) == pytest.approx(expected, rel=0.02)


def test_has_no_trajectories_of_its_own() -> None:
    fit = least_squares.fit(driven())
    assert fit.surrogate is None
    assert surrogate_errors(driven(), fit) is None
