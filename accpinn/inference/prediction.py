"""Bands of the space-gaps that the model predicts when only the leader's speed is given.

Each of n simulations of the platoon takes one draw of α, β, τ and s₀ from the posterior (see
`inference.posterior`) and a random disturbance r for each follower k = 1..M:

    dp = (v_{k-1} - v) dt
    dv = (α (p - s₀ - τ v) + β (v_{k-1} - v) + r) dt
    dr = (w - r)/T₂ dt,   dw = -w/T dt + s √(2 (T + T₂)) / T dW

with the deviation s, memory T and rise T₂ of greatest likelihood under the same model (see
`methods.state_space`, also for a lag or a delay of the command). v_0 is the leader's measured
speed, straight between samples 0.5 s apart; the other followers drive behind a simulated vehicle.
The system is linear, so every step is exact, noise included. A simulation begins with the measured
gaps and speeds, as if the command had been the same before, and with a disturbance drawn from its
stationary distribution; where the leader's speed is missing for long, it begins anew.

The model has no collisions: a simulated gap may fall below zero. Such simulations continue and are
part of the band, as in `evaluation.closed_loop`; their share is stated. Of a model that is no CTHP
its linearisation is simulated.
"""

from dataclasses import dataclass

import numpy as np

from accpinn.evaluation.closed_loop import simulable
from accpinn.findings import Finding, Labelled, Words, percent, probability
from accpinn.inference.intervals import Uncertainty
from accpinn.methods.estimate import Estimate
from accpinn.methods.joint_likelihood import DISTURBANCE, UNKNOWNS, joint_maxima
from accpinn.methods.series import determined_followers, stride_of
from accpinn.methods.state_space import discretise
from accpinn.model.cthp import add_command, collides
from accpinn.model.spec import PAPER_SPEC
from accpinn.segment import Segment
from accpinn.units import FloatArray, Mask, Seconds, interval_ends, nanmean

SIMULATIONS = 200
"""Number of simulations."""
SEED = 0
"""Seed of the disturbances."""
STATES = 4
"""Number of states of a follower: p, v, r and w; two more where the command is late."""
ROUNDING = 1e-9
"""Share of a variance that is added to it against rounding."""
LATE: Seconds = 0.02
"""Shortest lag or delay; one that is shorter makes no difference."""
TINY = 1e-30
"""Variance of a state that nothing moves."""
MOST_STEPS = 20_000
"""Longest window with a band, in steps: nearly three hours, which take some seconds."""
CHUNK = 256
"""Number of steps whose noise is drawn at once."""
TOO_FEW = 0.75
"""Share within a 90 % band below which the model is not adequate: in 40 recordings of 300 s
simulated with the published parameters the share was 0.84 to 0.95."""


class BandCoverage(Finding, frozen=True):
    """The share of a follower's measured space-gap that lies within its band."""

    text = (
        "{vehicle}: {share:.0%} of the measured space-gap lies within the {level:.0%} band,"
        " {verdict}.{collisions}"
    )

    vehicle: int
    share: float
    """Share of the instants, 0 to 1."""
    level: float
    """Share that is expected if the model holds."""
    colliding: float
    """Share of the simulations in which the follower collides with the vehicle ahead."""

    def _words(self, about: Labelled) -> Words:
        verdict = f"in keeping with {percent(self.level)}"
        if self.share < TOO_FEW:
            verdict = "too little for a model that holds with the same parameters throughout"
        collisions = f" The follower collides in {probability(self.colliding)} of the simulations."
        return {"verdict": verdict, "collisions": collisions if self.colliding else ""}


@dataclass(frozen=True, eq=False)
class GapBand:
    """The band of each of M followers' space-gaps at K instants."""

    time: FloatArray
    """(K,) time in s from the segment's start."""
    lower: FloatArray
    """(K, M) lower ends in m; nan where nothing is simulated or the follower is not determined."""
    upper: FloatArray
    """(K, M) upper ends in m."""
    level: float
    """Level of the band."""
    findings: tuple[BandCoverage, ...]
    """One finding for each follower with a band."""


def gap_band(segment: Segment, estimate: Estimate, uncertainty: Uncertainty) -> GapBand | None:
    """Compute the bands at the level of the intervals; takes some tenths of a second.

    Args:
        segment: speeds (N, M+1) in m/s and space-gaps (N, M) in m.
        estimate: with a posterior, of windows that the segment is one of.
        uncertainty: what follows from the estimate's draws.

    Returns:
        None if no follower has draws, if at no instant all vehicles are measured, or if the
        window has more than `MOST_STEPS`. A follower without draws has no band, nor have those
        behind it.

    Examples:
        >>> import accpinn
        >>> result = accpinn.fit(accpinn.sample("motorway"), 0, 60, vehicles="1-2")
        >>> band = accpinn.gap_band(result.segment, result.estimate, result.uncertainty)
        >>> band.lower.shape  # one instant each half second
        (121, 1)
    """
    if segment.samples > MOST_STEPS * stride_of(segment):
        return None
    sizes, pieces = _disturbances(segment, estimate), simulable(segment)
    determined = np.isfinite(uncertainty.draws.values).all(axis=(0, 2))
    determined &= np.isfinite(sizes).all(axis=1)
    followers = int(np.logical_and.accumulate(determined).sum())
    if not followers or not pieces:
        return None
    stride = stride_of(segment)
    step, rows = stride * segment.sample_time, np.arange(0, segment.samples, stride)
    steps = _Steps(uncertainty, sizes[:followers], step)
    gaps = np.full((SIMULATIONS, len(rows), segment.followers), np.nan)
    measured = segment.measured_gaps[rows]
    samples = np.hstack([measured, segment.measured_speeds[rows]])
    complete: Mask = np.asarray(np.isfinite(samples).all(axis=1))
    rng = np.random.default_rng(SEED)
    for piece in pieces:
        instants = np.flatnonzero((rows >= piece.first) & (rows <= piece.last))
        # From where all are measured.
        instants = instants[np.logical_or.accumulate(complete[instants])]
        if len(instants) > 1:
            at = rows[instants]
            start = segment.gaps[at[0], :followers], segment.speeds[at[0], 1 : followers + 1]
            simulated = steps.simulate(segment.speeds[at, 0], *start, rng)
            gaps[:, instants, :followers] = simulated
    lower, upper = interval_ends(gaps, uncertainty.level)
    inside = np.where(np.isnan(measured - lower), np.nan, (lower <= measured) & (measured <= upper))
    shares = nanmean(inside)
    touching = (collides(gaps) & (measured > 0)).any(axis=1).mean(axis=0)
    findings = tuple(
        BandCoverage(vehicle, float(share), uncertainty.level, float(touch))
        for vehicle, share, touch in zip(segment.vehicles[1:], shares, touching, strict=True)
        if np.isfinite(share)
    )
    return GapBand(segment.time[rows], lower, upper, uncertainty.level, findings)


def _disturbances(segment: Segment, estimate: Estimate) -> FloatArray:
    """(M, 3) s, T and T₂ of each follower; nan for followers that are not determined.

    An estimate by a method without a likelihood takes those of the CTHP.
    """
    if UNKNOWNS in estimate.arrays:
        return estimate.arrays[UNKNOWNS][:, DISTURBANCE]
    determined = determined_followers((segment,), estimate.case)
    sizes = np.full((segment.followers, 3), np.nan)
    if determined:
        maxima = joint_maxima((segment,), estimate.case, PAPER_SPEC, determined)
        sizes[list(determined)] = [maximum.values[DISTURBANCE] for maximum in maxima]
    return sizes


class _Steps:
    """A step of n simulations; S states of each of F followers, then v_0 and its slope."""

    def __init__(self, uncertainty: Uncertainty, disturbances: FloatArray, step: Seconds) -> None:
        """The steps of evenly chosen draws, for disturbances (F, 3) s, T and T₂."""
        followers, complete = len(disturbances), uncertainty.draws.complete
        deviation, memory, rise = disturbances.T
        white = deviation**2 * (memory + rise) / memory
        chosen = np.linspace(0, len(complete) - 1, SIMULATIONS).astype(int)
        complete = complete[chosen, :followers]
        states = STATES + 2 * bool(complete[..., 4:].any())
        size = states * followers
        rates, density = np.zeros((2, SIMULATIONS, size + 2, size + 2))
        p, v, r, w = (np.arange(followers) * states + k for k in range(STATES))
        for k in range(followers):
            alpha, beta, tau, _, lag, delay = complete[:, k].T
            ahead, command = v[k - 1] if k else size, np.zeros((SIMULATIONS, size + 2))
            rates[:, p[k], ahead], rates[:, p[k], v[k]] = 1.0, -1.0
            command[:, p[k]], command[:, ahead] = alpha, beta
            command[:, v[k]] = -alpha * np.nan_to_num(tau) - beta
            late = (np.maximum(value, LATE * value.any()) for value in (lag, delay))
            add_command(rates, command, v[k], w[k] + 1, *late)
        rates[:, v, r] = 1.0
        rates[:, r, r], rates[:, r, w] = -1.0 / rise, 1.0 / rise
        rates[:, w, w] = -1.0 / memory
        rates[:, size, size + 1] = 1.0
        density[:, w, w] = 2.0 * white / memory
        transition, process = discretise(rates, density, step)
        covariance = process[:, :size, :size]
        # The variance that a step adds to a gap is so small that rounding may make it negative.
        covariance += (ROUNDING * covariance + TINY) * np.eye(size)
        self._step = step
        self._complete = np.moveaxis(complete, 1, 0)
        """(F, n, 6) the parameters; the states' gaps are without s₀."""
        self._transition = np.ascontiguousarray(np.moveaxis(transition, 0, -1))
        """(SF+2, SF+2, n)"""
        self._root = np.asarray(np.linalg.cholesky(covariance))
        """(n, SF, SF) of the covariance of the added noise."""
        self._deviations = np.sqrt([deviation**2, white]).T
        """(F, 2) of r and w before the first step."""

    def simulate(
        self, leader: FloatArray, gaps: FloatArray, speeds: FloatArray, rng: np.random.Generator
    ) -> FloatArray:
        """Simulate the gaps (n, K, F) behind a leader's speed (K,), from gaps and speeds (F,)."""
        size, count = self._transition.shape[1:]
        followers, states = len(gaps), (size - 2) // len(gaps)
        state = np.zeros((size, count))
        alpha, beta, tau, intercepts, lag, delay = np.moveaxis(self._complete, -1, 0)
        state[0:-2:states] = gaps[:, None] - intercepts
        state[1:-2:states] = speeds[:, None]
        spacing = gaps[:, None] - intercepts - np.nan_to_num(tau) * speeds[:, None]
        before = np.append(leader[0], speeds[:-1])[:, None]
        command = alpha * spacing + beta * (before - speeds[:, None])
        if states > STATES:
            state[4:-2:states] = np.where(lag > 0, command, command * delay**2 / 12.0)
        w = self._deviations[:, 1:] * rng.standard_normal((followers, count))
        # r follows w with the rise time, so that their covariance is the variance of r.
        share = (self._deviations[:, :1] / self._deviations[:, 1:]) ** 2
        remainder = self._deviations[:, :1] * np.sqrt(1.0 - share)
        state[2:-2:states] = share * w + remainder * rng.standard_normal((followers, count))
        state[3:-2:states] = w
        slopes = np.append(np.diff(leader) / self._step, 0.0)
        simulated = np.empty((count, len(leader), followers))
        for first in range(0, len(leader), CHUNK):
            part = range(first, min(first + CHUNK, len(leader)))
            normal = rng.standard_normal((count, size - 2, len(part)))
            added = np.moveaxis(self._root @ normal, 0, 1)
            for k in part:
                simulated[:, k] = (state[0:-2:states] + intercepts).T
                state[-2], state[-1] = leader[k], slopes[k]
                state = np.einsum("ijb,jb->ib", self._transition, state)
                state[:-2] += added[:, :, k - first]
        return simulated
