"""What the two filters assume: the law between two samples, what disturbs it, who shares it.

The state of a follower is (p, v). Between two samples it obeys the law, one step of the classical
Runge-Kutta method with the predecessor's measured speed taken as straight. What is measured is
(p, v) with the receiver's errors. What the law leaves out (slopes, gears, delays) is taken as a
white acceleration, as strong at low frequencies as errors that last: σ² held for T seconds on
either side have the spectral density 2 σ² T. As that is large, a filtered motion stays close to the
measured one, noise and all; the less a recording moves, the more this noise pulls β up.

Where the segment leaves the law out, a step tells nothing of it: θ stays as it is, and the motion
is taken as measured, as if the law left any acceleration open.

θ = (α, ατ, β) of a car may drift slowly, as α, τ and β each in a random walk of its own.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple, Self

import numpy as np

from accpinn.model.cthp import Case, Parameters
from accpinn.segment.segment import Segment
from accpinn.units import FloatArray, Metres, MetresPerSecond, Seconds

SPEED_ERROR: MetresPerSecond = 0.05
"""Of a receiver's Doppler speed, standard deviation."""
GAP_ERROR: Metres = 0.1
"""Of a space-gap from two receivers, whose positions wander by decimetres."""
UNEXPLAINED = 0.3
"""In m/s²: what the law leaves of the accelerations in OpenACC's runs is 0.27 to 0.46."""
LASTING: Seconds = 2.0
"""For how long it stays alike; means over 3 s are hardly smaller than means over 1 s."""
TYPICAL = Parameters(0.08, 0.2, 1.4)
"""The middle of published laws of ACC cars, from which every filter starts."""
DRIFT = (5e-4, 2e-3, 2e-3)
"""Of α, τ, β in a second, standard deviation; in five minutes 0.009, 0.035 and 0.035. Without it
a filter ends up certain of the law of the first minutes, whatever comes later."""


class State(NamedTuple):
    """Gap and speed, or rates of them; arrays of one shape."""

    gap: FloatArray
    speed: FloatArray


@dataclass(frozen=True, eq=False)
class Measurements:
    """The measurements, ordered for G laws with F followers each; G F = M."""

    gaps: FloatArray
    """(N, G, F) in m."""
    speeds: FloatArray
    """(N, G, F) in m/s."""
    ahead: FloatArray
    """(N, G, F) in m/s, each predecessor's."""
    step: Seconds
    told: FloatArray
    """(N, G, F) 1 where the step that ends there tells of the law, 0 where it is left out."""

    @classmethod
    def of(cls, segment: Segment, case: Case) -> Self:
        """Case I: one law, M followers. Case II: M laws, one follower each."""
        laws = 1 if case == "I" else segment.followers
        shape = (segment.samples, laws, segment.followers // laws)
        told = np.ones(segment.gaps.shape)
        if segment.mask is not None:  # a step needs both of its samples
            told[1:] = segment.mask[1:] & segment.mask[:-1]
        return cls(
            segment.gaps.reshape(shape),
            segment.speeds[:, 1:].reshape(shape),
            segment.speeds[:, :-1].reshape(shape),
            segment.sample_time,
            told.reshape(shape),
        )


def move(
    law: Sequence[FloatArray], state: State, before: FloatArray, after: FloatArray, step: Seconds
) -> State:
    """The state one step later.

    Args:
        law: α, ατ, β; they, states and speeds broadcast against each other.
        state: at the step's beginning.
        before: the predecessor's speed then.
        after: the predecessor's speed at the step's end.
        step: in s.
    """
    alpha, alpha_tau, beta = law

    def rates(at: State, ahead: FloatArray) -> State:
        relative = ahead - at.speed
        return State(relative, alpha * at.gap - alpha_tau * at.speed + beta * relative)

    def onward(rate: State, by: Seconds) -> State:
        return State(state.gap + by * rate.gap, state.speed + by * rate.speed)

    middle = (before + after) / 2
    first = rates(state, before)
    second = rates(onward(first, step / 2), middle)
    third = rates(onward(second, step / 2), middle)
    last = rates(onward(third, step), after)
    return State(
        *(
            x + step / 6 * (a + 2 * (b + c) + d)
            for x, a, b, c, d in zip(state, first, second, third, last, strict=True)
        )
    )


def measurement_noise() -> FloatArray:
    """(2, 2) covariance of a measured (p, v)."""
    return np.diag([GAP_ERROR**2, SPEED_ERROR**2])


def motion_noise(step: Seconds) -> FloatArray:
    """(2, 2) covariance that a white acceleration adds to (p, v) in one step."""
    density = 2 * UNEXPLAINED**2 * LASTING
    return density * np.array([[step**3 / 3, -(step**2) / 2], [-(step**2) / 2, step]])


def law_covariance(deviation: tuple[float, float, float]) -> FloatArray:
    """(3, 3) of θ near `TYPICAL`, for independent deviations of α, τ, β."""
    slopes = np.array([[1.0, 0, 0], [TYPICAL.tau, TYPICAL.alpha, 0], [0, 0, 1]])
    return np.asarray(slopes @ np.diag(np.square(deviation)) @ slopes.T)


def drift(step: Seconds) -> FloatArray:
    """(3, 3) covariance that θ gains in one step."""
    return step * law_covariance(DRIFT)


def settings() -> dict[str, Any]:
    """The assumptions above, as a fit's configuration has them."""
    return {
        "speed_error": SPEED_ERROR,
        "gap_error": GAP_ERROR,
        "unexplained": UNEXPLAINED,
        "lasting": LASTING,
        "drift": list(DRIFT),
    }
