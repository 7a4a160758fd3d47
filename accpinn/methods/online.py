"""What the online methods share: the track of their estimates, and the assumptions of the filters.

The state of a follower is (p, v). Between two samples it obeys the model, one step of the classical
Runge-Kutta method with the predecessor's measured speed taken as straight. Measured are (p, v) with
the receivers' errors. What the model leaves out (slopes, gears, delays) is taken as a white
acceleration, as strong at low frequencies as errors that last: σ² held for T seconds on either side
have the spectral density 2 σ² T. As that is large, a filtered motion stays close to the measured
one, noise and all; the less a recording moves, the more this noise biases β upwards.

A step that the segment masks does not change θ, and the motion is reset to the measured one.

θ = (α, ατ, β) may drift slowly, as α, τ and β each in a random walk of its own.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from accpinn.methods.estimate import FilterDiverged, FilterUncertain, Fit, Outcome, ParameterTrack
from accpinn.methods.regression import Solution
from accpinn.model.cthp import TYPICAL, Case, Parameters, Trajectories
from accpinn.segment import Segment
from accpinn.units import FloatArray, Metres, MetresPerSecond, Seconds

UNIT = np.eye(2, 4)
TRACK_EVERY: Seconds = 0.5
"""Between kept instants; the parameters change more slowly than this resolves."""
INSIGNIFICANT = 1.5
"""Deviations from zero below which a gain may be zero; a cloud at the bound has a mean of 1.3."""
SPEED_ERROR: MetresPerSecond = 0.05
"""Standard deviation of a receiver's Doppler speed."""
GAP_ERROR: Metres = 0.1
"""Standard deviation of a space-gap from two receivers, whose positions wander by decimetres."""
UNEXPLAINED = 0.3
"""In m/s²: the model's residual of the accelerations in OpenACC's runs is 0.27 to 0.46."""
LASTING: Seconds = 2.0
"""Correlation time of that residual; its means over 3 s are hardly smaller than those over 1 s."""
DRIFT = (5e-4, 2e-3, 2e-3)
"""Standard deviation of the drift of α, τ, β in a second; in five minutes 0.009, 0.035 and 0.035.
Without it a filter ends up certain of the parameters of the first minutes, whatever comes later."""


def kept_samples(segment: Segment) -> list[int]:
    """The samples that a track keeps, the last among them and never the first."""
    stride = max(1, round(TRACK_EVERY / segment.sample_time))
    return list(range(segment.samples - 1, 0, -stride))[::-1]


def track(segment: Segment, theta: FloatArray, covariance: FloatArray) -> ParameterTrack:
    """Parameters and their deviations at the kept samples, from θ (K, G, 3) and its covariance.

    G is 1 (shared by all followers) or M.
    """
    alpha, alpha_tau, beta = np.moveaxis(theta, -1, 0)
    per_alpha = np.full_like(alpha, np.nan)
    np.divide(1.0, alpha, out=per_alpha, where=alpha > 0)
    tau = alpha_tau * per_alpha
    variance = np.moveaxis(np.diagonal(covariance, axis1=2, axis2=3), -1, 0)
    # τ = ατ / α to first order.
    of_tau = variance[1] - 2 * tau * covariance[..., 0, 1] + tau**2 * variance[0]
    shape = (len(theta), segment.followers, 3)
    squares = np.stack([variance[0], variance[2], np.maximum(of_tau, 0) * per_alpha**2], -1)
    return ParameterTrack(
        segment.time[kept_samples(segment)],
        Parameters.of(np.broadcast_to(np.stack([alpha, beta, tau], -1), shape)),
        np.broadcast_to(np.sqrt(squares), shape),
    )


def step_maps(theta: FloatArray, step: Seconds) -> FloatArray:
    """The motion over a step as a linear map; the same for parameters and motions of any number.

    The classical Runge-Kutta method takes a linear system on by the exponential's series up to the
    fourth order; p, v, the speed ahead and its rise over the step are such a system. The maps
    (.., 2, 4) of θ (.., 3) give p and v a step later from p, v and the predecessor's speeds before
    and after it.
    """
    alpha, alpha_tau, beta = theta[..., 0], theta[..., 1], theta[..., 2]
    rates = np.zeros((*alpha.shape, 4, 4))
    rates[..., 0, 1], rates[..., 0, 2] = -step, step
    rates[..., 1, 0], rates[..., 1, 2] = step * alpha, step * beta
    rates[..., 1, 1] = -step * (alpha_tau + beta)
    rates[..., 2, 3] = 1.0
    series = UNIT
    for order in (4, 3, 2, 1):
        series = UNIT + series @ rates / order
    series[..., 2] -= series[..., 3]
    return series


class Filter(ABC):
    """Estimates of G parameter sets with F followers each, sample by sample."""

    mean: FloatArray
    """(G, 3) of θ."""
    covariance: FloatArray
    """(G, 3, 3) of θ."""
    motion: FloatArray
    """(G, F, 2) the mean of p and v."""

    def __init__(self, segment: Segment, case: Case) -> None:
        """Order the measurements by parameter set: one of M followers (Case I), or M of one."""
        sets = 1 if case == "I" else segment.followers
        shape = (segment.samples, sets, segment.followers // sets)
        mask = np.ones(segment.gaps.shape)
        if segment.mask is not None:  # a step needs both of its samples
            mask[1:] = segment.mask[1:] & segment.mask[:-1]
        self.mask = mask.reshape(shape)
        """(N, G, F) 1 where the step that ends there counts, else 0."""
        states, leading = [segment.gaps, segment.speeds[:, 1:]], segment.speeds[:, :-1]
        self.states = np.stack(states, axis=-1).reshape(*shape, 2)
        """(N, G, F, 2) p in m and v in m/s."""
        ahead = np.stack([np.roll(leading, 1, axis=0), leading], axis=-1)
        self.ahead = ahead.reshape(*shape, 2)
        """(N, G, F, 2) each predecessor's speed at the beginning and the end of a step."""
        self._step = step = segment.sample_time
        self._noise = np.diag([GAP_ERROR**2, SPEED_ERROR**2])
        # What a white acceleration adds to (p, v) in one step.
        mixed = np.array([[step**3 / 3, -(step**2) / 2], [-(step**2) / 2, step]])
        self._motion_noise = 2 * UNEXPLAINED**2 * LASTING * mixed
        self._drift = step * theta_covariance(DRIFT)

    @staticmethod
    def solution(theta: FloatArray, covariance: FloatArray) -> Solution:
        """The estimate within the bounds of one parameter set: mean (3,), covariance (3, 3)."""
        return Solution.of(theta)

    @abstractmethod
    def update(self, ahead: FloatArray, measured: FloatArray, mask: FloatArray) -> None:
        """Process one more sample, p and v (G, F, 2); the mask (G, F) is 1 where the step counts.

        ``ahead`` (G, F, 2) are the predecessors' speeds at the step's beginning and at its end.
        """


def filtered(
    method: str,
    segment: Segment,
    case: Case,
    kind: Callable[[Segment, Case], Filter],
    config: dict[str, Any],
) -> Fit:
    """The last estimate of the parameters, their track, and the filtered motion.

    A filter of a ``kind`` knows the first sample when it is made; ``config`` holds what it alone
    assumes.
    """
    filter_, config = kind(segment, case), settings() | config
    motion = filter_.states.copy()
    solutions, covariances, kept = [], [], set(kept_samples(segment))
    try:
        for now in range(1, segment.samples):
            filter_.update(filter_.ahead[now], filter_.states[now], filter_.mask[now])
            motion[now] = filter_.motion
            if now in kept:
                pairs = zip(filter_.mean, filter_.covariance, strict=True)
                solutions.append([filter_.solution(*pair) for pair in pairs])
                covariances.append(filter_.covariance)
    except np.linalg.LinAlgError:  # no motion follows the measurements
        unknown = Solution.of(np.full((segment.followers, 3), np.nan))
        return Fit.of(
            method,
            segment,
            case,
            unknown,
            outcome=Outcome.DIVERGED,
            config=config,
            findings=[FilterDiverged()],
        )
    gaps, speeds = np.moveaxis(motion.reshape(*segment.gaps.shape, 2), -1, 0)
    speeds = np.column_stack([segment.speeds[:, 0], speeds])
    theta = np.array([[solution.theta for solution in now] for now in solutions])
    path = track(segment, theta, np.array(covariances))
    return Fit.of(
        method,
        segment,
        case,
        Solution.stack(solutions[-1], segment.followers),
        surrogate=Trajectories(segment.time, speeds, gaps),
        outcome=Outcome.FILTERED,
        config=config,
        track=path,
        findings=_uncertain_gains(segment, path),
    )


def _uncertain_gains(segment: Segment, path: ParameterTrack) -> Iterator[FilterUncertain]:
    """One finding for each gain that is not significantly different from zero at the end."""
    assert path.deviation is not None
    rows = zip(segment.vehicles[1:], path.parameters.values[-1], path.deviation[-1], strict=True)
    for vehicle, values, deviations in rows:
        for name, value, deviation in zip("αβ", values, deviations, strict=False):
            if 0 < value < INSIGNIFICANT * deviation:
                yield FilterUncertain(vehicle, name, float(value), float(deviation))


def theta_covariance(deviation: tuple[float, float, float]) -> FloatArray:
    """(3, 3) of θ near `TYPICAL`, for independent deviations of α, τ, β."""
    slopes = np.array([[1.0, 0, 0], [TYPICAL.tau, TYPICAL.alpha, 0], [0, 0, 1]])
    return np.asarray(slopes @ np.diag(np.square(deviation)) @ slopes.T)


def settings() -> dict[str, Any]:
    """The assumptions above, as a fit's configuration has them."""
    return {
        "speed_error": SPEED_ERROR,
        "gap_error": GAP_ERROR,
        "unexplained": UNEXPLAINED,
        "lasting": LASTING,
        "drift": list(DRIFT),
    }


def symmetric(matrix: FloatArray) -> FloatArray:
    """What rounding has made unequal, made equal again."""
    return np.asarray((matrix + matrix.swapaxes(-1, -2)) / 2)
