"""The online methods' common part: the track of estimates, and the assumptions of the filters.

The state of a follower is (p, v). Between two samples it obeys the model, one step of the classical
Runge-Kutta method with the predecessor's measured speed taken as straight. Measured are (p, v) with
the receivers' errors. What the model leaves out (slopes, gears, delays) is taken as a white
acceleration, as strong at low frequencies as errors that last: σ² held for T seconds on either side
have the spectral density 2 σ² T. As that is large, a filtered motion stays close to the measured
one, noise and all; the less a recording moves, the more this noise biases β upwards.

A step that the segment masks does not change θ, and the motion is reset to the measured one.

θ = (α, ατ, β) may drift slowly, as α, τ and β each in a random walk of its own.

Of several windows each takes over what the one before it, in the order of time, knows of θ, and
begins with a motion of its own. In the time between them θ neither drifts nor is forgotten, as the
estimate is of all windows together and not of the last one.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from accpinn.methods import Segments
from accpinn.methods.estimate import Estimate, Outcome, ParameterTrack
from accpinn.methods.findings import FilterDiverged, FilterUncertain
from accpinn.methods.regression import Solution
from accpinn.model.cthp import TYPICAL, Case, Parameters, Trajectories
from accpinn.model.spec import ModelSpec
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


@dataclass(frozen=True, eq=False)
class Turn:
    """A window in the order in which the online methods take them."""

    index: int
    """Its place among the windows that are given."""
    segment: Segment
    begin: Seconds
    """Its start in the time of a track; see `in_turn`."""

    @property
    def tracked(self) -> list[int]:
        """The samples that a track keeps, the last among them and never the first."""
        stride = max(1, round(TRACK_EVERY / self.segment.sample_time))
        return list(range(self.segment.samples - 1, 0, -stride))[::-1]


def in_turn(segments: Segments) -> list[Turn]:
    """The windows in the order of time, those of a further recording after the former one's.

    A track's time counts from the first window's start, and windows of a recording lie as far apart
    as in it; a further recording begins where the last window of the former one ends.
    """
    turns: list[Turn] = []
    begin = 0.0
    for recording in dict.fromkeys((s.source, s.sha256) for s in segments):
        places = [k for k, s in enumerate(segments) if (s.source, s.sha256) == recording]
        places.sort(key=lambda k: segments[k].start)
        first = begin - segments[places[0]].start
        turns += [Turn(k, segments[k], first + segments[k].start) for k in places]
        begin = max(turn.begin + turn.segment.window.duration for turn in turns)
    return turns


def track(turns: Sequence[Turn], theta: FloatArray, covariance: FloatArray) -> ParameterTrack:
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
    shape = (len(theta), turns[0].segment.followers, 3)
    squares = np.stack([variance[0], variance[2], np.maximum(of_tau, 0) * per_alpha**2], -1)
    return ParameterTrack(
        np.concatenate([turn.begin + turn.segment.time[turn.tracked] for turn in turns]),
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

    def __init__(self, followers: int, case: Case) -> None:
        """Know no sample yet; one parameter set of M followers (Case I), or M of one."""
        self.sets = 1 if case == "I" else followers
        """G."""
        self.members = followers // self.sets
        """F."""
        self._noise = np.diag([GAP_ERROR**2, SPEED_ERROR**2])

    def begin(self, segment: Segment) -> None:
        """Begin a window with the motion of its first sample, and with θ as it is known so far."""
        shape = (segment.samples, self.sets, self.members)
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
    segments: Segments,
    case: Case,
    spec: ModelSpec,
    kind: Callable[[int, Case], Filter],
    config: dict[str, Any],
) -> Estimate:
    """The last estimate of the parameters, their track, and the filtered motion in each window.

    ``kind`` makes a filter of followers and Case; ``config`` holds what it alone assumes.
    """
    followers, config = segments[0].followers, settings() | config
    filter_, turns = kind(followers, case), in_turn(segments)
    solutions, covariances, curves = [], [], {}
    try:
        for turn in turns:
            segment, tracked = turn.segment, set(turn.tracked)
            filter_.begin(segment)
            motion = filter_.states.copy()
            for now in range(1, segment.samples):
                filter_.update(filter_.ahead[now], filter_.states[now], filter_.mask[now])
                motion[now] = filter_.motion
                if now in tracked:
                    pairs = zip(filter_.mean, filter_.covariance, strict=True)
                    solutions.append([filter_.solution(*pair) for pair in pairs])
                    covariances.append(filter_.covariance)
            gaps, speeds = np.moveaxis(motion.reshape(*segment.gaps.shape, 2), -1, 0)
            speeds = np.column_stack([segment.speeds[:, 0], speeds])
            curves[turn.index] = Trajectories(segment.time, speeds, gaps)
    except np.linalg.LinAlgError:  # no motion follows the measurements
        unknown = Solution.of(np.full((followers, 3), np.nan))
        return Estimate.of(
            method,
            segments,
            case,
            spec,
            unknown,
            outcome=Outcome.DIVERGED,
            settings=config,
            findings=[FilterDiverged()],
        )
    theta = np.array([[solution.theta for solution in now] for now in solutions])
    path = track(turns, theta, np.array(covariances))
    return Estimate.of(
        method,
        segments,
        case,
        spec,
        Solution.stack(solutions[-1], followers),
        curves=tuple(curves[k] for k in range(len(segments))),
        outcome=Outcome.FILTERED,
        settings=config,
        track=path,
        findings=_uncertain_gains(segments[0], path),
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
    """The assumptions above, as `Estimate.settings` has them."""
    return {
        "speed_error": SPEED_ERROR,
        "gap_error": GAP_ERROR,
        "unexplained": UNEXPLAINED,
        "lasting": LASTING,
        "drift": list(DRIFT),
    }


def symmetric(matrix: FloatArray) -> FloatArray:
    """The symmetric part of matrices (.., n, n) that rounding made asymmetric."""
    return np.asarray((matrix + matrix.swapaxes(-1, -2)) / 2)
