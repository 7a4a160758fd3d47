"""Estimating equations that disturbances cannot bias: instrumental variables.

A real vehicle does not follow the CTHP exactly: dv/dt = X θ + r, X = (p, -v, Δv). The disturbance r
lasts for seconds and moves the vehicle's own speed and space-gap, so it is correlated with X, and
any method that chooses θ to make r small (least squares, splines, the PiNN) is biased, usually
towards smaller gains. No interval around such an estimate can be trusted.

The motion of the vehicle *ahead* is independent of r. Let Z = (p, -v, Δv) of the closed-loop
simulation behind that motion: Z resembles X, yet is free of r. So

    Σ_t Z_tᵀ (dv/dt - X_t θ) = 0

has the right expectation whatever the colour of r. Any parameters make valid instruments and those
near the truth make sharp ones, so they are simulated anew with each new θ.

Source: Söderström and Stoica, Instrumental Variable Methods for System Identification, 1983.
"""

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import gaussian_filter1d

from accpinn.methods.regression import Regression
from accpinn.model.cthp import RESPONSIVE, Case, Parameters, regressors, simulate
from accpinn.segment.segment import Segment
from accpinn.units import FloatArray, Seconds

ROUNDS = 3
"""The third round moves no parameter by more than a tenth of its interval's width."""
LEADER_SMOOTHING: Seconds = 0.5
"""Standard deviation of the kernel over the speed ahead, as its receiver's noise is in X too."""
DEPENDENT = 1e8
"""With a larger condition number the equations do not determine three parameters."""
LEAST_SAMPLES = 20


@dataclass(frozen=True, eq=False)
class Equations:
    """One set of estimating equations A θ = b, and what each instant adds to it."""

    theta: FloatArray
    """(3,) θ = (α, ατ, β), their solution without bounds."""
    normal: FloatArray
    """(N, 3, 3) Z_tᵀ X_t, summed over the followers that share θ; A is their sum over time."""
    scores: FloatArray
    """(N, 3) Z_tᵀ r_t at the solution; they sum to zero."""
    determined: bool
    """Whether the data determine θ at all."""


def solve_iv(segment: Segment, case: Case) -> tuple[Equations, ...]:
    """Solve the equations of each follower (Case II), or one set for all of them (Case I)."""
    regression = Regression.of(segment)
    ahead = gaussian_filter1d(
        segment.speeds[:, :-1], LEADER_SMOOTHING / segment.sample_time, axis=0, mode="nearest"
    )
    start = regression.solve(case).theta
    everyone = tuple(range(segment.followers))
    groups = (everyone,) if case == "I" else tuple((k,) for k in everyone)
    return tuple(_solve(segment.time, ahead, regression, start[g[0]], g) for g in groups)


def _solve(
    time: FloatArray,
    ahead: FloatArray,
    regression: Regression,
    theta: FloatArray,
    followers: tuple[int, ...],
) -> Equations:
    terms, rates = regression.terms[list(followers)], regression.rates[list(followers)]
    mask = terms.any(axis=2)  # rows that the segment masks are zero
    determined = int(mask.sum(axis=1).max()) >= LEAST_SAMPLES
    for _ in range(ROUNDS):
        clipped = _clip(theta)
        instruments = np.stack([_simulated(clipped, time, ahead[:, k]) for k in followers])
        instruments[~mask] = 0.0
        whole = np.einsum("mti,mtj->ij", instruments, terms)
        determined = determined and _is_determined(instruments, terms, whole)
        if not determined:
            break
        theta = np.linalg.solve(whole, np.einsum("mti,mt->i", instruments, rates))
    residuals = rates - terms @ theta
    return Equations(
        theta,
        np.einsum("mti,mtj->tij", instruments, terms),
        np.einsum("mti,mt->ti", instruments, residuals),
        determined,
    )


def _simulated(parameters: Parameters, time: FloatArray, ahead: FloatArray) -> FloatArray:
    """(N, 3) p, -v, Δv simulated behind a speed, from equilibrium, as the measured start has r."""
    speed = ahead[:1]
    motion = simulate(Parameters.stack([parameters]), time, ahead, speed, parameters.tau * speed)
    terms: FloatArray = regressors(motion.speeds, motion.gaps)[0]
    return terms


def _clip(theta: FloatArray) -> Parameters:
    """The parameters of θ, within `RESPONSIVE`."""
    least, most = RESPONSIVE
    alpha = float(np.clip(theta[0], least.alpha, most.alpha))
    beta = float(np.clip(theta[2], least.beta, most.beta))
    return Parameters(alpha, beta, float(np.clip(theta[1] / alpha, least.tau, most.tau)))


def _is_determined(instruments: FloatArray, terms: FloatArray, whole: FloatArray) -> bool:
    """Whether A can be inverted; rows and columns count by their directions only."""
    lengths = [np.sqrt((values**2).sum(axis=(0, 1))) for values in (instruments, terms)]
    scale = np.outer(*lengths)
    return bool((scale > 0).all() and np.linalg.cond(whole / scale) < DEPENDENT)
