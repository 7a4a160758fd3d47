"""A platoon behind a leader: its exact motion, how close it gets, and what limits the result.

The deviations x from the equilibrium (v = speed, p = τ·speed) and the leader's own state
e = (level, slope, a sin ωt, a cos ωt) obey one linear equation on each phase of its drive,

    d/dt (x, e) = G (x, e),   so   (x, e)(t + h) = exp(Gh) (x, e)(t)

whatever h is, so there is no step-size error. An equilibrium stays one to the last bit, as its
deviations are zero. The model has no limit of acceleration, no standstill and no collision: a run
says where it leaves what cars can do, and goes on. Each vehicle depends on those ahead of it alone,
so what follows a collision has no meaning for the vehicle that collides and those behind it, which
would have a wreck ahead; those ahead of it drive on.

Behind a sinusoid, once the transient is over, follower k's speed is one of amplitude
A |H_1(jω) .. H_k(jω)|. The measured amplitude is the least-squares fit of a constant, a sine and a
cosine over the last whole periods. The transient is known exactly: it is the platoon left to
itself, started from what the sinusoids would need and the equilibrium does not have.

Another model than a CTHP is integrated, by Runge's and Kutta's method in steps of `NONLINEAR_STEP`.
What is predicted is then that of its linearisation at the leader's first speed, which small
disturbances follow.
"""

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from math import ceil, isinf

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm

from accpinn.errors import ParameterError
from accpinn.findings import Finding
from accpinn.model import cthp
from accpinn.model.cthp import Parameters, Trajectories, collides, motion_matrix, orbit
from accpinn.model.registry import FOLLOWING, PAPER, following_model
from accpinn.platoon.leader import Leader, Planned, Recorded, Sinusoid
from accpinn.stability.criteria import checked, response, slowest_rate
from accpinn.units import FloatArray, Metres, PerSecond, Seconds, frozen

SAMPLE_TIME: Seconds = 0.1
"""Sample time of the recordings and of a simulation, by default."""
SAMPLES_PER_PERIOD = 24
"""Least samples a period of a fast sinusoid, which gets more samples a second."""
MOST_SAMPLES = 200_000
MOST_FOLLOWERS = 100
"""Largest platoon of one parameter set that is repeated."""
FASTEST: PerSecond = 1e6
"""Fastest reaction; beyond it a step of any use loses the slow motion to rounding."""
NONLINEAR_STEP: Seconds = 0.05
"""Largest step of the integration: with half of it speeds differ by less than 1 mm/s."""
SLACK: Seconds = 1e-9
"""An instant this close before a phase belongs to it."""
FARTHEST: Metres = 1e6
"""A larger gap is that of a model that diverges."""
SETTLED = 1e-3
"""A transient below this share of the sinusoid's amplitude is over."""
PERIODS = 5
"""Number of last whole periods to measure over; one, if the transient leaves no room for more."""
INSTANTS = 2000
"""Instants among which the end of the transient is looked for, on horizons that double."""
FIRST_HORIZON = 10.0
"""The first horizon, in time constants of the slowest pole."""
HORIZONS = 20
"""Largest number of horizons."""


AFTER_COLLISION = (
    "The model knows no contact: what is simulated after a collision has no meaning for that"
    " vehicle and those behind it, so they end there; those ahead of it drive on."
)


class Collision(Finding, frozen=True):
    """A follower's gap is used up; what it and those behind it do afterwards has no meaning."""

    text = "{follower} collides with the vehicle ahead at {time:.1f} s. " + AFTER_COLLISION

    follower: int
    """1 = the one behind the leader."""
    time: Seconds


class Reversal(Finding, frozen=True):
    """A vehicle drives backwards, the first one to do so, before any collision that concerns it."""

    text = "{follower} drives backwards from {time:.1f} s on, as the model has no standstill."

    follower: int
    """0 = the leader."""
    time: Seconds


class NeverSettles(Finding, frozen=True):
    """A follower's transient never ends, so its amplitude never becomes constant."""

    text = (
        "{follower} never settles, so its amplitude never becomes constant: its own motion does not"
        " decay."
    )

    follower: int


class TooShort(Finding, frozen=True):
    """The run holds no whole period after the transient."""

    text = (
        "The run is too short to measure amplitudes over a whole period of {period:.3g} s; a"
        " duration of {duration:.0f} s is enough."
    )

    period: Seconds
    duration: Seconds
    """Duration that is enough, in s."""


class TransientLeft(Finding, frozen=True):
    """A transient is above `SETTLED` where the amplitude is measured."""

    text = (
        "{follower} is still in its transient, above"
        f" {100 * SETTLED:.3g} % of its amplitude,"
        " where that is measured; a duration of {duration:.0f} s is enough."
    )

    follower: int
    duration: Seconds
    """Duration that is enough, in s."""


@dataclass(frozen=True, eq=False)
class Amplitudes:
    """Amplitudes of speed along the platoon, leader first."""

    measured: FloatArray
    """(M+1,) in m/s; nan where the run holds no whole period."""
    predicted: FloatArray
    """(M+1,) in m/s: A |H_1 .. H_k|; infinite from a vehicle on that is itself unstable."""
    settled: FloatArray
    """(M+1,) in s after the sinusoid's start, when the transient is over; inf where it never is."""
    periods: int
    """Number of last whole periods that were measured."""
    findings: tuple[Finding, ...]
    """Why the measured amplitudes may differ from those predicted: one reason, or none."""

    @property
    def free(self) -> bool:
        """Whether all transients were over before those periods."""
        return not self.findings


@dataclass(frozen=True, eq=False)
class PlatoonRun:
    """A simulated drive of M followers behind a leader."""

    parameters: Parameters
    leader: Leader
    trajectories: Trajectories
    minimum_gap: FloatArray
    """(M,) smallest gap among the samples, in m."""
    minimum_gap_time: FloatArray
    """(M,) time of the smallest gap, in s."""
    largest_deviation: FloatArray
    """(M+1,) in m/s: the peak of |v - speed| as far as it has meaning, leader first."""
    collisions: tuple[Collision, ...]
    """First collision of each follower that has one before any ahead of it, in order of time."""
    meaningful: NDArray[np.intp]
    """(M+1,) number of samples of each vehicle until a collision of it or of one ahead; two at
    least, and all without a collision."""
    amplitudes: Amplitudes | None
    """Amplitudes behind a sinusoid; None behind any other leader."""
    findings: tuple[Finding, ...]
    """Findings where the run leaves what cars can do, or the amplitudes cannot be measured."""
    linear: Trajectories | None = None
    """Motion of the linearisation at the leader's first speed; None for a model that is linear."""

    @cached_property
    def valid(self) -> Trajectories:
        """The trajectories, nan where they have no meaning: see `meaningful`."""
        driven = self.trajectories
        gone = np.arange(len(driven.time))[:, None] >= self.meaningful
        return Trajectories(
            driven.time,
            frozen(np.where(gone, np.nan, driven.speeds)),
            frozen(np.where(gone[:, 1:], np.nan, driven.gaps)),
        )

    @property
    def survivors(self) -> int:
        """The number of vehicles, the leader included, that drive to the end."""
        return min((hit.follower for hit in self.collisions), default=len(self.meaningful))


def order_of(count: int, followers: int | None) -> list[int]:
    """(M,) which of ``count`` parameter sets each follower has: one is repeated, several are not.

    Raises:
        ParameterError: for a number of followers that they cannot make.
    """
    if followers is None:
        return list(range(count))
    if not 1 <= followers <= MOST_FOLLOWERS:
        raise ParameterError(
            f"followers: {followers} is not allowed; choose 1 to {MOST_FOLLOWERS}."
        )
    if count not in (1, followers):
        raise ParameterError(
            f"followers: {count} parameter sets make {count} followers, not {followers}; leave it"
            " out, or give one set, as parameters[0]."
        )
    return [0] * followers if count == 1 else list(range(count))


def simulate_platoon(
    parameters: Parameters, leader: Leader, sample_time: Seconds | None = None, model: str = PAPER
) -> PlatoonRun:
    """Simulate the platoon behind the leader from equilibrium, exactly at every sample.

    Args:
        parameters: one entry a follower, in their order.
        leader: what the vehicle ahead of them does.
        sample_time: by default 0.1 s, or less for a fast sinusoid; a recorded leader has its own.
        model: whose parameters, where that is no CTHP.

    Raises:
        ParameterError: for parameters or settings that cannot be simulated.
    """
    parameters = parameters.flat
    theta = parameters.nonlinear
    is_nonlinear = not parameters.is_linear
    if is_nonlinear:
        following_model(model)
        if theta.shape[-1] != len(FOLLOWING[model].parameters):
            raise ParameterError(
                f"model: {theta.shape[-1]} parameters a vehicle are not those of {model}, which has"
                f" {len(FOLLOWING[model].parameters)}; name the model that they are of."
            )
        parameters = FOLLOWING[model].linearisations(theta.T, leader.speed)
        if np.isnan(parameters.tau).any():
            raise ParameterError(
                f"{FOLLOWING[model].title}: a vehicle has no equilibrium at {leader.speed:g} m/s;"
                " choose a lower speed."
            )
    parameters = _with_equilibrium(parameters)
    about = Parameters.of(parameters.complete * [1, 1, 1, 0, 1, 1])  # deviations have no s₀
    if isinstance(leader, Recorded):
        still, time = np.zeros(len(parameters)), leader.time
        deviations = leader.speeds - leader.speed
        moved = cthp.simulate(about, time - time[0], deviations, still, still)
    else:
        time = _instants(leader, sample_time)
        moved = _deviations(about, leader, time)
    driven = Trajectories(
        frozen(time),
        frozen(moved.speeds + leader.speed),
        frozen(moved.gaps + leader.speed * parameters.tau + parameters.s0),
    )
    linear = driven if is_nonlinear else None
    if is_nonlinear:
        start = driven.speeds[0, 1:], driven.gaps[0]
        substeps = ceil((time[-1] - time[0]) / (len(time) - 1) / NONLINEAR_STEP)
        with np.errstate(over="ignore", invalid="ignore"):  # what diverges is told as a collision
            driven = FOLLOWING[model].simulate(
                theta.T, driven.time, driven.speeds[:, 0], *start, substeps
            )
    wave = _amplitudes(about, leader, driven) if isinstance(leader, Sinusoid) else None
    collisions = _collisions(driven)
    # The motion of a vehicle has a meaning until a collision of it or of one ahead.
    ends = np.full(driven.speeds.shape[1], np.inf)
    for hit in collisions:
        ends[hit.follower :] = np.minimum(ends[hit.follower :], hit.time)
    meaningful = np.maximum(2, np.searchsorted(driven.time, ends, side="right"))
    meaningful.setflags(write=False)
    counts = np.arange(len(driven.time))[:, None] < meaningful
    reversals = [
        Reversal(vehicle, float(driven.time[at]))
        for at, vehicle in np.argwhere(counts & (driven.speeds < 0))[:1].tolist()
    ]
    moves = np.where(counts, np.abs(driven.speeds - leader.speed), 0.0)
    return PlatoonRun(
        parameters,
        leader,
        driven,
        minimum_gap=frozen(driven.gaps.min(axis=0)),
        minimum_gap_time=frozen(driven.time[driven.gaps.argmin(axis=0)]),
        largest_deviation=frozen(moves.max(axis=0)),
        collisions=collisions,
        meaningful=meaningful,
        amplitudes=wave,
        findings=(*collisions[:1], *reversals, *(wave.findings if wave else ())),
        linear=linear,
    )


def _with_equilibrium(parameters: Parameters) -> Parameters:
    """Checked parameters, with the τ that says where each gap starts, also where α = 0."""
    clean, tau = checked(parameters), parameters.tau
    for k in np.flatnonzero(~(np.isfinite(tau) & (tau >= 0)))[:1]:
        raise ParameterError(
            f"Parameter set {k + 1}: with α = 0 the equilibrium gap is not determined; give τ as"
            " well, so that the simulation can start from the gap τv."
        )
    rate = clean.alpha * clean.tau + clean.beta + np.sqrt(clean.alpha)
    for k in np.flatnonzero(rate > FASTEST)[:1]:
        raise ParameterError(
            f"Parameter set {k + 1}: it reacts within a microsecond, which cannot be simulated;"
            " give α in 1/s², β in 1/s and τ in s."
        )
    return Parameters(clean.alpha, clean.beta, tau, *clean.complete[:, 3:].T)


def _instants(leader: Planned, sample_time: Seconds | None) -> FloatArray:
    """(N,) instants in s, from 0 to the duration."""
    step = SAMPLE_TIME if sample_time is None else sample_time
    if sample_time is None and isinstance(leader, Sinusoid):
        step = min(step, leader.period / SAMPLES_PER_PERIOD)
    if not 0 < step <= leader.duration:
        raise ParameterError(
            f"Sample time {step:g} s: give more than zero and no more than the duration of"
            f" {leader.duration:g} s."
        )
    count = leader.duration / step
    if count > MOST_SAMPLES:
        raise ParameterError(
            f"The run would have {count:.0f} samples; shorten its duration of {leader.duration:g} s"
            f" to {step * MOST_SAMPLES:.3g} s."
        )
    return np.asarray(np.arange(int(count + 1e-9) + 1) * step)


def _deviations(parameters: Parameters, leader: Planned, time: FloatArray) -> Trajectories:
    """Deviations from the equilibrium, in which the platoon starts; ``time`` (N,) in s."""
    matrix, phases = motion_matrix(parameters), leader.phases()
    size = len(matrix)
    step = (time[-1] - time[0]) / (len(time) - 1)
    result = np.zeros((len(time), size + 1))  # p_1, v_1, .., p_M, v_M, .. and the leader's speed
    followers = np.zeros(size)
    starts = [phase.start for phase in phases] + [np.inf]
    edges = np.searchsorted(time, np.array(starts) - SLACK)
    for phase, (start, end), (first, last) in zip(
        phases, pairwise(starts), pairwise(edges), strict=True
    ):
        state = np.concatenate([followers, [phase.level, phase.slope, 0.0, phase.amplitude]])
        if not state.any():
            continue  # the equilibrium stays
        generator = _generator(matrix, phase.frequency)
        if last > first:
            offset = max(time[first] - start, 0.0)
            begin = expm(generator * offset) @ state if offset else state
            with np.errstate(over="ignore", invalid="ignore"):  # of an unstable vehicle
                states = orbit(expm(generator * step), begin, int(last - first))
            result[first:last, :size] = states[:, :size]
            result[first:last, size] = states[:, size] + states[:, size + 2]
        if np.isfinite(end):
            followers = (expm(generator * (end - start)) @ state)[:size]
    moving = 2 * len(parameters)
    speeds = np.column_stack([result[:, -1], result[:, 1:moving:2]])
    return Trajectories(time, speeds, result[:, 0:moving:2])


def _generator(matrix: FloatArray, frequency: float) -> FloatArray:
    """(K+4, K+4): G of a platoon with the motion matrix (K, K+1)."""
    size = len(matrix)
    level, slope, sine, cosine = range(size, size + 4)
    generator = np.zeros((size + 4, size + 4))
    generator[:size, :size] = matrix[:, :size]
    generator[:size, level] = generator[:size, sine] = matrix[:, size]
    generator[level, slope] = 1.0
    generator[sine, cosine], generator[cosine, sine] = frequency, -frequency
    return generator


def _collisions(driven: Trajectories) -> tuple[Collision, ...]:
    """The first collision of each follower; between samples the gap is taken as straight.

    A collision has no meaning where a vehicle further ahead had one before.
    """
    collisions, end = list[Collision](), len(driven.time)
    for follower, every_gap in enumerate(driven.gaps.T, 1):
        gap = every_gap[:end]
        if np.isnan(gap).any():  # a nonlinear model diverges between samples where a gap is used up
            gap = np.where(np.abs(gap) < FARTHEST, gap, -FARTHEST)
            end = int(collides(gap).argmax())
        used_up = collides(gap)
        used_up[0] = gap[0] <= 0
        if used_up.any():
            k = int(used_up.argmax())
            back = gap[k] / (gap[k] - gap[k - 1]) if k else 0.0
            step = driven.time[k] - driven.time[k - 1] if k else 0.0
            time = float(driven.time[k] - back * step)
            if all(time <= ahead.time for ahead in collisions):
                collisions.append(Collision(follower, time))
    return tuple(sorted(collisions, key=lambda collision: collision.time))


def _amplitudes(parameters: Parameters, leader: Sinusoid, run: Trajectories) -> Amplitudes:
    """Amplitudes measured in the run and predicted, with the time until they can agree."""
    single = response(parameters, np.array([leader.frequency]))[:, 0]
    rates = [slowest_rate(vehicle) for vehicle in parameters]
    settled = _settled(parameters, leader, single, rates)
    driven = max(run.time[-1] - leader.settle, 0.0)
    free = (driven - np.max(settled)) / leader.period
    periods = min(int(driven / leader.period + 1e-9), int(np.clip(free, 1, PERIODS)))
    measured = _measured(leader, run, periods) if periods else np.full(len(settled), np.nan)
    with np.errstate(invalid="ignore"):  # an infinite response may meet one of zero
        along = leader.amplitude * np.cumprod(np.concatenate([[1.0], np.abs(single)]))
    unstable = np.cumsum([0] + [rate < 0 for rate in rates]) > 0
    predicted = np.where(unstable, np.inf, np.nan_to_num(along, nan=0.0, posinf=np.inf))
    findings: tuple[Finding, ...] = ()
    last = int(np.argmax(settled))
    needed = leader.settle + float(settled[last]) + leader.period
    if isinf(needed):
        findings = (NeverSettles(last),)
    elif not periods:
        findings = (TooShort(leader.period, ceil(needed)),)
    elif needed > run.time[-1] + 1e-9:
        findings = (TransientLeft(last, ceil(needed)),)
    return Amplitudes(frozen(measured), frozen(predicted), frozen(settled), periods, findings)


def _measured(leader: Sinusoid, run: Trajectories, periods: int) -> FloatArray:
    """(M+1,) amplitudes of speed over the last whole periods, in m/s."""
    last = run.time > run.time[-1] - periods * leader.period - 1e-9
    angle = leader.frequency * run.time[last]
    design = np.stack([np.ones_like(angle), np.sin(angle), np.cos(angle)], axis=1)
    moved = run.speeds[last] - leader.speed
    fitted = np.linalg.solve(design.T @ design, design.T @ moved)  # all but orthogonal columns
    return np.asarray(np.hypot(fitted[1], fitted[2]))


def _settled(
    parameters: Parameters,
    leader: Sinusoid,
    single: NDArray[np.complex128],
    rates: list[PerSecond],
) -> FloatArray:
    """(M+1,) seconds until each speed's transient is, and stays, below `SETTLED`.

    ``single`` are the (M,) responses at the leader's frequency, ``rates`` the (M,) slowest decays.
    """
    endless = [k for k, rate in enumerate(rates) if rate <= 0 and parameters.alpha[k] > 0]
    count = min(endless, default=len(parameters))
    settled = np.full(len(parameters) + 1, np.inf)
    settled[: count + 1] = 0.0
    rates = [rate for rate in rates[:count] if rate]
    if not rates:
        return settled
    matrix = motion_matrix(parameters[:count])
    system, chain = matrix[:, :-1], np.cumprod(single[:count])
    turning = 1j * leader.frequency * np.eye(len(system))
    start = np.asarray(-np.linalg.solve(turning - system, matrix[:, -1]).imag, float)
    horizon: Seconds = FIRST_HORIZON / min(rates)
    transition = expm(system * (horizon / INSTANTS))
    for _ in range(HORIZONS):
        step = horizon / INSTANTS
        speeds = orbit(transition, start, INSTANTS)[:, 1 : 2 * count : 2]
        above = np.abs(speeds) > SETTLED * np.abs(chain)
        until = np.where(above.any(axis=0), INSTANTS - np.argmax(above[::-1], axis=0), 0)
        if until.max() <= INSTANTS / 2:
            break
        horizon, transition = 2.0 * horizon, transition @ transition
    settled[1 : count + 1] = until * step
    return settled
