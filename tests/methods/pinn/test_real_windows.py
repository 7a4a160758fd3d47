"""The preset fast on real windows: the shared parameters minimise the loss of all of them."""

import numpy as np
import pytest
from scipy.optimize import minimize

from accpinn import METHODS, Estimate, Parameters, Recording, cut
from accpinn.methods import Segments
from accpinn.methods.estimate import of_window
from accpinn.methods.pinn.config import FAST
from accpinn.methods.pinn.loss import output_columns, stack_outputs
from accpinn.methods.pinn.network import Network
from accpinn.methods.pinn.projection import Projection, solve_output
from accpinn.segment.windows import car_following
from accpinn.units import FloatArray


class Profile:
    """Ψ of all windows at the best output layers for some θ, by the formula in `loss`."""

    def __init__(self, segments: Segments, estimate: Estimate) -> None:
        """Take the hidden layers of an estimate."""
        self._parts = []
        for k, segment in enumerate(segments):
            network = Network(segment.followers, FAST, float(segment.time[-1]))
            network.load_arrays(of_window(estimate.arrays, k))
            measured = stack_outputs(segment.speeds, segment.gaps)
            projection = Projection(network, segment.time, measured, None)
            hidden = projection.hidden()
            self._parts.append((segment, projection, hidden, projection.sums(hidden)))

    def __call__(self, parameters: FloatArray) -> float:
        """Ψ at α, β, τ (M, 3)."""
        total, samples = 0.0, 0
        for segment, projection, hidden, sums in self._parts:
            layer = solve_output(sums, Parameters.of(parameters).theta, FAST)
            outputs, rates = projection.surrogate(hidden, layer)
            speeds, gaps = output_columns(segment.followers)
            v, p, v_rate, p_rate = (
                outputs[:, speeds],
                outputs[:, gaps],
                rates[:, speeds],
                rates[:, gaps],
            )
            alpha, beta, tau = parameters.T
            ahead = v[:, :-1] - v[:, 1:]
            command = alpha * (p - tau * v[:, 1:]) + beta * ahead
            errors = (segment.speeds - v, segment.gaps - p, p_rate - ahead, v_rate[:, 1:] - command)
            total += sum((error**2).sum() for error in errors) / segment.followers
            samples += segment.samples
        return float(total / samples)


@pytest.fixture(scope="module")
def drive(astazero: Recording) -> Segments:
    """The first three windows of AstaZero's run in car-following, with four followers."""
    windows = car_following(astazero)[:3]
    return tuple(cut(astazero, window.start, window.duration) for window in windows)


def test_in_case_one(drive: Segments) -> None:
    """Another search, from ten percent beside them, ends no lower and at the same parameters."""
    estimate = METHODS["pinn"].fit(drive, "I", FAST)
    psi, parameters = Profile(drive, estimate), estimate.parameters.values[0]
    assert psi(np.tile(parameters, (4, 1))) == pytest.approx(estimate.loss["total"], rel=1e-6)
    best = minimize(
        lambda logs: psi(np.tile(np.exp(logs), (4, 1))),
        np.log(parameters) + np.array([0.1, -0.1, 0.03]),
        method="BFGS",
        options={"eps": 1e-3, "gtol": 1e-4},
    )
    assert best.fun < psi(np.tile(parameters * (1.1, 0.9, 1.03), (4, 1))) / 1.01
    assert estimate.loss["total"] < 1.001 * best.fun
    np.testing.assert_allclose(parameters, np.exp(best.x), rtol=0.005)


def test_in_case_two(drive: Segments) -> None:
    """Along each of them Ψ is a parabola, whose lowest point is where it was left."""
    estimate = METHODS["pinn"].fit(drive, "II", FAST)
    psi, parameters = Profile(drive, estimate), estimate.parameters.values
    lowest = psi(parameters)
    assert lowest == pytest.approx(estimate.loss["total"], rel=1e-6)
    for follower in range(4):
        for column, step in enumerate((0.05, 0.05, 0.01)):
            moved = np.ones((2, 4, 3))
            moved[:, follower, column] += step, -step
            up, down = (psi(parameters * factor) for factor in moved)
            assert min(up, down) > lowest
            bend = up + down - 2 * lowest
            assert (up - down) ** 2 / (8 * bend) < 1e-3 * lowest
            assert abs(up - down) / (2 * bend) * step < 0.005
