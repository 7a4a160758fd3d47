"""Dual unscented Kalman filter: one filter for the motion, one for the parameters, side by side.

At each sample, with f the model's motion over one step h, u the predecessor's speed, w and r noise:

    motion       x_k = f(x_{k-1}, θ̂_{k-1}, u) + w,      y_k = x_k + r         x = (p, v)
    parameters   θ_k = θ_{k-1} + drift,                 y_k = f(x̂_{k-1}, θ_k, u) + innovation

Either filter uses the other's last estimate. Both carry mean and covariance through f by the scaled
unscented transform: for a normal x of n components with covariance L Lᵀ the 2n+1 points are the
mean and the mean plus or minus sqrt(n + λ) times each column of L, λ = spread² n - n. All but the
first weigh 1 / (2(n + λ)); the first weighs λ / (n + λ) in means, and 1 - spread² + kurtosis more
in covariances. The noise is that of `online`. The paper measures p and Δv; with u known that is the
same as p and v.

The parameters are the last estimate, in which older parts of the windows count a little less than
newer ones, as the parameters may drift. Where it violates the rational driving
constraints, the most likely θ within them is taken instead; the filter itself is not constrained,
as a bound inside it would bias its later estimates. The curves are the filtered motion, which
follows the recording closely whatever the parameters.

Case I stacks the measurements of all followers in one filter for the parameters.

Source: Ampountolas, IEEE Transactions on Intelligent Vehicles (2023), doi 10.1109/TIV.2023.3272660;
Wan and van der Merwe, in Kalman Filtering and Neural Networks (2001), chapter 7;
Julier, Proceedings of the American Control Conference 2002, 4555-4559.
"""

import numpy as np

from accpinn.methods import Segments, direct, online
from accpinn.methods.estimate import Estimate
from accpinn.methods.regression import Solution, solve_bounded
from accpinn.model.cthp import TYPICAL, Case
from accpinn.model.spec import PAPER_SPEC, ModelSpec
from accpinn.segment import Segment
from accpinn.units import FloatArray, Mask

UNCERTAIN = (0.3, 1.0, 1.0)
"""Standard deviations of α, τ, β at first: so large that `TYPICAL` soon has no influence."""
UNINFORMATIVE = 1e12
"""In m² and m²/s²: variance of a masked measurement."""
MEAN_WEIGHTS = np.array([0.0] + 6 * [1 / 6])
COVARIANCE_WEIGHTS = np.array([2.0] + 6 * [1 / 6])
"""Weights of covariances for a kurtosis of 2, the value for normal distributions."""


def fit(segments: Segments, case: Case = "II", spec: ModelSpec = PAPER_SPEC) -> Estimate:
    """The last estimate of the parameters, their track, and the filtered motion in each window."""
    config = {"uncertain": list(UNCERTAIN)}
    return online.filtered("dual-ukf", segments, case, spec, _Dual, config)


class _Dual(online.Filter):
    """Means and covariances of both filters; G parameter sets, F followers each."""

    def __init__(self, followers: int, case: Case) -> None:
        super().__init__(followers, case)
        self.mean = np.tile(TYPICAL.theta, (self.sets, 1))
        self.covariance = np.tile(online.theta_covariance(UNCERTAIN), (self.sets, 1, 1))

    def begin(self, segment: Segment) -> None:
        """See `online.Filter`."""
        super().begin(segment)
        self.motion = self.states[0].copy()  # (G, F, 2)
        self.spread = np.tile(self._noise, (self.sets, self.members, 1, 1))

    @staticmethod
    def solution(theta: FloatArray, covariance: FloatArray) -> Solution:
        """The most likely θ >= 0 of a normal distribution: mean (3,) and covariance (3, 3)."""
        if (theta >= 0).all():
            return Solution.of(theta)
        information = np.asarray(np.linalg.inv(covariance), np.float64)
        return solve_bounded(information, information @ theta)

    def update(self, ahead: FloatArray, measured: FloatArray, mask: FloatArray) -> None:
        """See `online.Filter`."""
        masked = mask == 0
        self.covariance = self.covariance + self._drift
        if masked.all():
            self._forget(measured, masked)
            return
        points = unscented_points(self.mean, self.covariance)
        maps = online.step_maps(points, self._step)  # (G, 7, 2, 4)
        inputs = np.concatenate([self.motion, ahead], axis=-1)
        moved = inputs[:, None] @ maps.swapaxes(-1, -2)  # (G, 7, F, 2)
        # The first point is the mean θ. Given θ the motion is linear, so that the transform's
        # moments are those of the linear map.
        transition, mean = maps[:, :1, :, :2], moved[:, 0]
        predicted = transition @ self.spread @ transition.swapaxes(-1, -2) + self._motion_noise
        innovation = predicted + self._noise
        errors = innovation + UNINFORMATIVE * masked[..., None, None] * np.eye(2)
        self._update_theta(points, moved, measured, errors)
        gain = predicted @ np.linalg.inv(innovation)
        error = (measured - mean)[..., None]
        self.motion = mean + (gain @ error)[..., 0]
        self.spread = online.symmetric(predicted - gain @ predicted)
        if masked.any():
            self._forget(measured, masked)

    def _forget(self, measured: FloatArray, masked: Mask) -> None:
        """A masked motion is the measured one, errors and all."""
        self.motion[masked] = measured[masked]
        self.spread[masked] = self._noise

    def _update_theta(
        self, points: FloatArray, moved: FloatArray, measured: FloatArray, innovation: FloatArray
    ) -> None:
        """The filter of the parameters, with innovations of covariance (G, F, 2, 2)."""
        mean, error, weighted = unscented_moments(moved.reshape(*points.shape[:2], -1))
        sets, followers = measured.shape[:2]
        # The followers' blocks on the diagonal, as a view.
        blocks = error.reshape(sets, followers, 2, followers, 2)
        np.einsum("gfifj->gfij", blocks)[...] += innovation
        crossed = weighted @ (points - self.mean[:, None])
        gain = np.linalg.solve(error, crossed).swapaxes(1, 2)
        surprise = measured.reshape(sets, -1, 1) - mean[..., None]
        self.mean = self.mean + (gain @ surprise)[..., 0]
        self.covariance = online.symmetric(self.covariance - gain @ crossed)


def unscented_points(mean: FloatArray, covariance: FloatArray) -> FloatArray:
    """(.., 7, 3) for mean (.., 3) and covariance (.., 3, 3)."""
    centre = mean[..., None, :]
    columns = np.sqrt(3.0) * np.linalg.cholesky(covariance).swapaxes(-1, -2)
    return np.concatenate([centre, centre + columns, centre - columns], axis=-2)


def unscented_moments(values: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Mean (.., m) and covariance (.., m, m) of the values (.., 7, m) at the points.

    Last come their deviations from the mean times the covariance's weights, (.., m, 7).
    """
    mean = MEAN_WEIGHTS @ values
    deviations = values - mean[..., None, :]
    weighted = deviations.swapaxes(-1, -2) * COVARIANCE_WEIGHTS
    return mean, weighted @ deviations, weighted


METHOD = direct(
    "dual-ukf", "Dual UKF", fit, typical_seconds=1.6,
    summary="dual unscented Kalman filter: motion and parameters, side by side",
)  # fmt: skip
