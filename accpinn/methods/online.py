"""What the online methods share: estimates instant by instant, and what becomes of them."""

import numpy as np

from accpinn.methods.fit import ParameterTrack
from accpinn.model.cthp import LinearSolution, solve_linear
from accpinn.segment.segment import Segment
from accpinn.units import FloatArray, Seconds, SecondsArray

COURSE_EVERY: Seconds = 0.5
"""Between kept instants; the law changes more slowly than this shows."""
NEAR_ZERO = 1.5
"""Deviations from zero that say nothing; a cloud pressed against zero has its mean at 1.3."""


def kept_samples(segment: Segment) -> list[int]:
    """Which samples a course keeps, the last among them; the first tells nothing of the law."""
    stride = max(1, round(COURSE_EVERY / segment.sample_time))
    return list(range(segment.samples - 1, 0, -stride))[::-1]


def track(
    time: SecondsArray, theta: FloatArray, covariance: FloatArray, followers: int
) -> ParameterTrack:
    """Parameters and their deviations over time; one law for all where G = 1.

    Args:
        time: (K,) in s from the segment's start.
        theta: (K, G, 3), α, ατ, β of G laws.
        covariance: (K, G, 3, 3) of θ.
        followers: M.
    """
    alpha, alpha_tau, beta = np.moveaxis(theta, -1, 0)
    per_alpha = np.full_like(alpha, np.nan)
    np.divide(1.0, alpha, out=per_alpha, where=alpha > 0)
    tau = alpha_tau * per_alpha
    variance = np.moveaxis(np.diagonal(covariance, axis1=2, axis2=3), -1, 0)
    # τ = ατ / α to first order.
    of_tau = variance[1] - 2 * tau * covariance[..., 0, 1] + tau**2 * variance[0]
    shape = (len(time), followers, 3)
    squares = np.stack([variance[0], variance[2], np.maximum(of_tau, 0) * per_alpha**2], -1)
    return ParameterTrack(
        time,
        np.broadcast_to(np.stack([alpha, beta, tau], -1), shape),
        np.broadcast_to(np.sqrt(squares), shape),
    )


def doubts(segment: Segment, path: ParameterTrack) -> tuple[str, ...]:
    """A sentence for each gain that its filter hardly tells from zero at the end."""
    assert path.deviation is not None
    notes = []
    for vehicle, values, deviations in zip(
        segment.vehicles[1:], path.parameters[-1], path.deviation[-1], strict=True
    ):
        for name, value, deviation in zip("αβ", values, deviations, strict=False):
            if 0 < value < NEAR_ZERO * deviation:
                notes.append(
                    f"Vehicle {vehicle}: {name} = {value:.4f} has a standard deviation of"
                    f" {deviation:.4f} in the filter, so the recording hardly tells it from zero."
                )
    return tuple(notes)


def nearest_lawful(theta: FloatArray, covariance: FloatArray) -> LinearSolution:
    """The most likely θ >= 0 of a normal distribution: mean (3,) and covariance (3, 3)."""
    information = np.asarray(np.linalg.inv(covariance), np.float64)
    return solve_linear(information, information @ theta)
