"""Other intervals around the same estimate; only to be compared.

    naive        the covariance s²(XᵀX)⁻¹ of independent residuals
    blocks       a bootstrap over 30 s blocks of the estimating equations
    loop blocks  a bootstrap over such blocks of the residuals, passed through the closed loop so
                 that the vehicle responds to them; reflected about the estimate, which corrects
                 the bias that this shows

All start from the spline estimate of one follower and from its smooth trajectories.
"""

from collections.abc import Callable

import numpy as np
from scipy.linalg import expm
from scipy.stats import norm

from accpinn.inference.intervals import Interval, interval_ends
from accpinn.methods.fit import Fit
from accpinn.model.cthp import Parameters, motion_matrix, regressors
from accpinn.segment.segment import Segment
from accpinn.units import FloatArray

BLOCK = 30.0
DRAWS = 200


class Smooth:
    """The regression that the spline estimate of a segment with one follower solves."""

    def __init__(self, segment: Segment, fit: Fit) -> None:
        """Rows and residuals from the fit's own trajectories."""
        assert fit.surrogate is not None
        assert segment.followers == 1
        self.step = segment.sample_time
        self.terms = regressors(fit.surrogate.speeds, fit.surrogate.gaps)[0]
        self.rates = np.gradient(fit.surrogate.speeds[:, 1], self.step)
        self.theta = np.linalg.lstsq(self.terms, self.rates, rcond=None)[0]
        self.residuals = self.rates - self.terms @ self.theta

    def blocks(self, rng: np.random.Generator) -> np.ndarray:
        """(N, DRAWS) instants: blocks drawn with replacement, cyclic at the end."""
        count, length = len(self.rates), round(BLOCK / self.step)
        firsts = rng.integers(0, count, (-(-count // length), 1, DRAWS))
        instants = (firsts + np.arange(length)[None, :, None]).reshape(-1, DRAWS)
        return instants[:count] % count


def naive(smooth: Smooth, level: float, rng: np.random.Generator) -> Interval:
    """See the module's head; nothing is drawn."""
    variance = (smooth.residuals**2).sum() / (len(smooth.rates) - 3)
    covariance = variance * np.linalg.inv(smooth.terms.T @ smooth.terms)
    alpha, alpha_tau, _ = smooth.theta
    slope = np.array([-alpha_tau / alpha**2, 1 / alpha, 0.0])
    deviation = np.sqrt([covariance[0, 0], covariance[2, 2], slope @ covariance @ slope])
    centre = Parameters.from_theta(smooth.theta).values
    reach = norm.ppf((1 + level) / 2) * deviation
    return Interval(centre - reach, centre + reach)


def blocks(smooth: Smooth, level: float, rng: np.random.Generator) -> Interval:
    """See the module's head."""
    products = smooth.terms[:, :, None] * np.c_[smooth.terms, smooth.rates][:, None, :]
    sums = np.stack([products[instants].sum(axis=0) for instants in smooth.blocks(rng).T])
    drawn = np.linalg.solve(sums[:, :, :3], sums[:, :, 3:])[..., 0]
    return Interval(*interval_ends(Parameters.from_theta(drawn).values, level))


def loop_blocks(smooth: Smooth, level: float, rng: np.random.Generator) -> Interval:
    """See the module's head."""
    follower = Parameters.from_theta(np.maximum(smooth.theta, 0.0))
    pushes = smooth.residuals[smooth.blocks(rng)] - smooth.residuals[:, None]
    moves = _response(follower, pushes, smooth.step)
    gap, speed = moves[:, 0], moves[:, 1]
    terms = smooth.terms[:, :, None] + np.stack([gap, -speed, -speed], axis=1)
    alpha, alpha_tau, beta = follower.theta
    rates = smooth.rates[:, None] + alpha * gap - (alpha_tau + beta) * speed + pushes
    grams = np.einsum("nik,njk->kij", terms, terms, optimize=True)
    moments = np.einsum("nik,nk->ki", terms, rates)
    drawn = np.linalg.solve(grams, moments[..., None])[..., 0]
    low, high = interval_ends(Parameters.from_theta(drawn).values, level)
    centre = Parameters.from_theta(smooth.theta).values
    return Interval(2 * centre - high, 2 * centre - low)


def _response(follower: Parameters, pushes: FloatArray, step: float) -> FloatArray:
    """(N, 2, K): changes of gap and speed that accelerations ``pushes`` (N, K) cause."""
    rates = np.zeros((3, 3))
    rates[:2, :2], rates[1, 2] = motion_matrix(Parameters.stack([follower]))[:, :2], 1.0
    held = expm(rates * step)[:2]
    states = np.empty((len(pushes), 2, pushes.shape[1]))
    state = np.zeros((2, pushes.shape[1]))
    for k, push in enumerate(pushes):
        states[k] = state
        state = held[:, :2] @ state + np.outer(held[:, 2], push)
    return states


OTHERS: dict[str, Callable[[Smooth, float, np.random.Generator], Interval]] = {
    "naive": naive,
    "blocks": blocks,
    "loop blocks": loop_blocks,
}
