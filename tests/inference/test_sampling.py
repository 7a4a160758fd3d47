"""Parts of the intervals against brute force: instruments, jackknife, and projected draws."""

import numpy as np
import pytest

from accpinn.inference.instrumental_variables import Equations, solve_iv
from accpinn.inference.sampling import block_length, jackknife, project, quantile_interval
from accpinn.methods import least_squares
from accpinn.model.cthp import Parameters
from bench.disturbed import Disturbance, disturbed
from tests.support.driving import LAW, standing_still

TRUTH = Parameters.of([LAW])


def test_instruments_recover_the_truth_where_least_squares_is_biased() -> None:
    """Over ten recordings with disturbances of seconds; the model holds but for these."""
    sets = [disturbed(TRUTH, seed, Disturbance(0.25, 4.0)) for seed in range(10)]
    ours = np.array([solve_iv(one, "II")[0].theta for one in sets])
    theirs = np.array([least_squares.fit(one).parameters[0].theta for one in sets])
    off, biased = (np.abs(x.mean(axis=0) / TRUTH[0].theta - 1.0) for x in (ours, theirs))
    assert off[0] < 0.15
    assert biased[0] > 2 * off[0]


def test_where_nothing_moves_nothing_is_determined() -> None:
    (equations,) = solve_iv(standing_still(), "II")
    assert not equations.determined
    assert jackknife(equations, 0.1) is None


def test_leaving_a_block_out_is_solving_without_it() -> None:
    rng = np.random.default_rng(0)
    count, step = 400, 0.5
    terms, noise = rng.standard_normal((count, 3)), rng.standard_normal(count)
    rates = terms @ TRUTH[0].theta + noise
    normal = terms[:, :, None] * terms[:, None, :]
    theta = np.linalg.solve(normal.sum(axis=0), terms.T @ rates)
    scores = terms * (rates - terms @ theta)[:, None]
    found = jackknife(Equations(theta, normal, scores, True), step)
    assert found is not None
    length = round(block_length((count - 1) * step) / step)
    scale = np.zeros((3, 3))
    for first in range(count):
        kept = np.ones(count, bool)
        kept[np.arange(first, first + length) % count] = False
        move = np.linalg.lstsq(terms[kept], rates[kept], rcond=None)[0] - theta
        scale += np.outer(move, move) / length
    np.testing.assert_allclose(found.scale, scale, rtol=1e-8)


def test_a_projection_is_the_nearest_feasible_point() -> None:
    """Against a fine grid over the feasible region."""
    rng = np.random.default_rng(1)
    root = rng.standard_normal((3, 3))
    scale = root @ root.T + 0.1 * np.eye(3)
    wanted = rng.standard_normal((20, 3)) - 0.3
    found = project(wanted, scale)
    assert (found >= 0).all()
    axis = np.linspace(0.0, 4.0, 41)
    grid = np.stack(np.meshgrid(axis, axis, axis), axis=-1).reshape(-1, 3)
    metric = np.linalg.inv(scale)
    for one, best in zip(wanted, found, strict=True):
        costs = np.einsum("ki,ij,kj->k", grid - one, metric, grid - one)
        assert (best - one) @ metric @ (best - one) <= costs.min() + 1e-6
    feasible = np.array([[0.1, 0.2, 0.3]])
    np.testing.assert_array_equal(project(feasible, np.eye(3)), feasible)


def test_a_headway_without_a_gain_may_be_any() -> None:
    draws = Parameters.from_theta([[0.0, 0.0, 0.2], [0.1, 0.15, 0.2]])
    assert draws.tau.tolist() == pytest.approx([np.nan, 1.5], nan_ok=True)
    assert quantile_interval(draws.tau, 0.9) == (0.0, np.inf)
