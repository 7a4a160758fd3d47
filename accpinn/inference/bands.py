"""The draws' frequency responses: a band around the Bode plot."""

from dataclasses import dataclass

import numpy as np

from accpinn.inference.intervals import Uncertainty
from accpinn.inference.sampling import quantile_interval
from accpinn.units import FloatArray


@dataclass(frozen=True, eq=False)
class Band:
    """|H(jω)| of one follower, point by point."""

    omega: FloatArray
    """(K,) in rad/s."""
    lower: FloatArray
    """(K,)"""
    middle: FloatArray
    """(K,) the draws' median."""
    upper: FloatArray
    """(K,)"""


def gain_band(uncertainty: Uncertainty, follower: int, omega: FloatArray) -> Band:
    """The band of |H| over frequency at the uncertainty's level; nan where nothing is known.

    Args:
        uncertainty: what the recording leaves open.
        follower: 0 for the first one.
        omega: (K,) in rad/s, above zero.
    """
    alpha, beta, tau = uncertainty.draws[:, follower].T[:, :, None]
    s = 1j * np.asarray(omega, float)
    alpha_tau = alpha * np.nan_to_num(tau)
    with np.errstate(divide="ignore"):  # an undamped draw is infinite in resonance
        gains = np.abs(beta * s + alpha) / np.abs((s + alpha_tau + beta) * s + alpha)
    if np.isnan(gains).any():
        unknown = np.full(len(s), np.nan)
        return Band(omega, unknown, unknown, unknown)
    lower, upper = quantile_interval(gains, uncertainty.level)
    return Band(omega, lower, np.median(gains, axis=0), upper)
