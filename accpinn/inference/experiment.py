"""Which drive of the car ahead would tell most of a car's parameters.

A drive of the car ahead u(t) makes measurements y whose likelihood is that of the Kalman filter
(`methods.kalman`), with the Fisher information of its unknowns z

    J(z; u) = E Σ [(∂e/∂z)(∂e/∂z)ᵀ / v + ½ (∂ ln v/∂z)(∂ ln v/∂z)ᵀ]

over the innovations e of all measurements, of variance v (see `methods.likelihood`). Disturbance
and noise are unknown, too, so what a drive says of the coordinates φ of
`inference.coordinates` is the Schur complement of their block. Before the drive, a further window
has φ ~ N(m, W), of which the car's typical value μ has the covariance V. After it

    W' = (W⁻¹ + J)⁻¹,   V' = V - V W⁻¹ V + V W⁻¹ W' W⁻¹ V,   gain = ½ E ln |1 + W J|

The gain in nats is about the drive's φ: the normal approximation of Lindley's expected information,
averaged over draws of φ from the prior, each with a disturbance and noise of its own. Among the
drives on offer the best has most. V' needs Cov(μ, φ) = V: what differs between windows is
independent of the car's typical value.

Drives are steps, sinusoids, chirps and staircases within limits of speed and acceleration, and
mixtures of the best of these. None is offered behind which a simulated car comes too close.

Sources: Lindley, Annals of Mathematical Statistics 27 (1956) 986-1005; Chaloner and Verdinelli,
Statistical Science 10 (1995) 273-304 (Bayesian design); Ljung, System Identification, 2nd ed.,
1999, chapter 13.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import permutations

import numpy as np

from accpinn.inference.coordinates import AT_SPEED
from accpinn.methods.likelihood import Criterion
from accpinn.methods.series import SPACING, Series
from accpinn.methods.state_space import COMMON, coordinates, discretise, state_space
from accpinn.model.registry import FOLLOWING
from accpinn.model.spec import ModelSpec
from accpinn.units import FloatArray, Metres, MetresPerSecond, Seconds

STEP: Seconds = 0.1
"""Step of a drive, and of its simulation."""
SMOOTHED: Seconds = 1.0
"""Time over which a drive is averaged, so that its acceleration does not jump."""
HOLDS = (4.0, 6.0, 8.0, 12.0, 20.0)
"""Durations in s of steps, from one to the next."""
FREQUENCIES = (0.08, 0.12, 0.18, 0.27, 0.4, 0.6)
"""Of sinusoids, in rad/s; the first and last are the ends of a chirp."""
LEVELS, STAIRCASES = 4, 3
"""Speeds of a staircase, and how many are offered."""
STAIRS = (4.0, 15.0)
"""Shortest and longest time between their changes, in s."""
MIXED = 6
"""Drives of one kind of which each two make a mixture."""
DRAWS = 8
"""Draws of a car for which a drive is assessed."""
TOO_CLOSE: Metres = 3.0
"""Gap of a simulated car down to which a drive is not on offer."""
UNLIKELY = 1
"""Draws that may come closer: the posterior of the car may be wide."""
GENTLE = 0.5
"""Share of the largest acceleration with which drives are offered as well."""
LEAST_TAU: Seconds = 0.1
"""Least τ for which information is computed: that of ln τ has no other end."""
P, V, U, R, W, A = range(6)
"""Places of the states, see `methods.state_space`."""


@dataclass(frozen=True, eq=False)
class Drive:
    """A speed over time that the car ahead may drive."""

    kind: str
    speed: FloatArray
    """(N,) in m/s, every `STEP`."""


@dataclass(frozen=True, eq=False)
class Assessed:
    """What is expected of a drive."""

    drive: Drive
    gain: float
    """Expected information in nats."""
    information: FloatArray
    """(D, p, p) about φ of each draw."""
    smallest_gap: Metres
    """At the instants measured, of all draws but `UNLIKELY`."""


@dataclass(frozen=True, eq=False)
class Prior:
    """What a posterior says of a car before a drive."""

    spec: ModelSpec
    draws: FloatArray
    """(n, p) φ of a further window."""
    unknowns: FloatArray
    """(P,) those of the likelihood; of these disturbance and noise are taken."""
    free: np.ndarray
    """(p,) whether a coordinate is estimated."""


@dataclass(frozen=True)
class Limits:
    """What the car ahead may do."""

    duration: Seconds = 120.0
    slowest: MetresPerSecond = 15.0
    fastest: MetresPerSecond = 33.0
    acceleration: float = 2.0
    """Largest in m/s², of braking, too."""

    @property
    def time(self) -> FloatArray:
        """(N,) the instants in s."""
        return np.asarray(STEP * np.arange(round(self.duration / STEP) + 1), float)


def drives(limits: Limits) -> Iterator[Drive]:
    """The drives of one kind, with the limits' acceleration."""
    time, low, high = limits.time, limits.slowest, limits.fastest
    middle, half = (low + high) / 2.0, (high - low) / 2.0
    for hold in HOLDS:
        is_first = (time // hold) % 2 == 0
        for place, ends in (("low", (low, high)), ("high", (high, low))):
            wanted = np.where(is_first, *ends)
            kind = f"steps of {hold:g} s from {place} speed, {limits.acceleration:g} m/s²"
            yield Drive(kind, _driven(wanted, limits))
    for omega in FREQUENCIES:
        amplitude = min(half, limits.acceleration / omega)
        wanted = middle + amplitude * np.sin(omega * time)
        kind = f"sinusoid at {omega:g} rad/s, amplitude {amplitude:.1f} m/s"
        yield Drive(kind, _driven(wanted, limits))
    first, last = FREQUENCIES[0], FREQUENCIES[-1]
    rate = np.log(last / first) / limits.duration
    omega = first * np.exp(rate * time)
    amplitudes = np.minimum(half, limits.acceleration / omega)
    chirp = middle + amplitudes * np.sin((omega - first) / rate)
    kind = f"chirp from {first:g} to {last:g} rad/s, {limits.acceleration:g} m/s²"
    yield Drive(kind, _driven(chirp, limits))
    rng = np.random.default_rng(0)
    for number in range(1, STAIRCASES + 1):
        speeds, wanted = np.linspace(low, high, LEVELS), np.empty(len(time))
        at = 0
        while at < len(time):
            end = at + round(rng.uniform(*STAIRS) / STEP)
            wanted[at:end] = rng.choice(speeds)
            at = end
        kind = f"staircase {number}, {limits.acceleration:g} m/s²"
        yield Drive(kind, _driven(wanted, limits))


def mixture(first: Drive, second: Drive, limits: Limits) -> Drive:
    """One drive for half of the time, then the other."""
    half = len(first.speed) // 2
    wanted = np.concatenate([first.speed[:half], second.speed[: len(first.speed) - half]])
    return Drive(f"{first.kind}; then {second.kind}", _driven(wanted, limits))


def _driven(wanted: FloatArray, limits: Limits) -> FloatArray:
    """(N,) the speed of a car that follows a wanted one within its limits, smoothly."""
    most, speed = limits.acceleration * STEP, np.empty(len(wanted))
    speed[0] = wanted[0]
    for k in range(1, len(wanted)):
        speed[k] = speed[k - 1] + np.clip(wanted[k] - speed[k - 1], -most, most)
    width = round(SMOOTHED / STEP)
    padded = np.pad(speed, (width // 2, width - 1 - width // 2), mode="edge")
    return np.asarray(np.convolve(padded, np.full(width, 1.0 / width), mode="valid"))


def best_drives(prior: Prior, limits: Limits, others: Sequence[Drive] = ()) -> list[Assessed]:
    """The drives on offer and their mixtures, the best first; ``others`` stand at the end.

    Those behind which a car comes too close are left out, if need be all.
    """
    assessment = Assessment(prior, limits)
    gentle = replace(limits, acceleration=GENTLE * limits.acceleration)
    kinds = {drive.kind: drive for part in (limits, gentle) for drive in drives(part)}
    single = [assessment.of(drive) for drive in kinds.values()]
    single = sorted((a for a in single if a.smallest_gap > TOO_CLOSE), key=lambda a: -a.gain)
    mixed = [
        assessment.of(mixture(first.drive, second.drive, limits))
        for first, second in permutations(single[:MIXED], 2)
    ]
    offered = [*single, *(a for a in mixed if a.smallest_gap > TOO_CLOSE)]
    return [*sorted(offered, key=lambda a: -a.gain), *map(assessment.of, others)]


class Assessment:
    """The expected information of drives about one car."""

    def __init__(self, prior: Prior, limits: Limits) -> None:
        """Choose the draws, and draw the disturbance and the noise that they have in all drives."""
        self.prior, form = prior, prior.spec.model
        self.covariance = spread_of_draws(prior.draws[:, prior.free])
        rows = np.linspace(0, len(prior.draws) - 1, DRAWS).astype(int)
        self.phi = prior.draws[rows]
        self.z = _unknowns(form, self.phi, prior.unknowns)
        self.values = np.exp(self.z)
        self.values[:, len(COMMON) :] = self.z[:, len(COMMON) :]
        model = state_space(form, self.values, STEP)
        rates = np.moveaxis(model.rates, -1, 0).copy()
        rates[:, A] = 0.0  # the speed ahead is given: between two instants it changes evenly
        density = np.zeros_like(rates)
        memory, rise, deviation = self.values[:, 4], self.values[:, 5], self.values[:, 3]
        white = deviation**2 * (memory + rise) / memory
        density[:, W, W] = 2.0 * white / memory
        self.transition, process = discretise(rates, density, STEP)
        root = np.linalg.cholesky(process + 1e-14 * np.eye(process.shape[1]))
        rng, steps = np.random.default_rng(0), round(limits.duration / STEP)
        normal = rng.standard_normal((steps, DRAWS, process.shape[1]))
        self.pushed = np.einsum("bij,kbj->kbi", root, normal)
        first = rng.standard_normal((2, DRAWS))
        self.first = np.zeros((DRAWS, process.shape[1]))
        self.first[:, R] = deviation * first[0]
        self.first[:, W] = self.first[:, R] + np.sqrt(white - deviation**2) * first[1]
        self.stride = round(SPACING / STEP)
        self.shift = model.shift
        shape = steps // self.stride + 1, 3, DRAWS
        self.noise = rng.standard_normal(shape) * np.sqrt(model.noise)

    def of(self, drive: Drive) -> Assessed:
        """What is expected of a drive."""
        measured = self._simulated(drive.speed) + self.noise
        series = Series(measured, tuple(range(DRAWS)), SPACING)
        criterion = Criterion(series, self.prior.spec, is_flat=True)
        _, _, information = criterion.score(self.z, np.arange(DRAWS))
        about = self._about_coordinates(information)
        inside = np.eye(about.shape[1]) + self.covariance @ about
        gain = 0.5 * float(np.linalg.slogdet(inside)[1].mean())
        gaps = np.sort((measured - self.noise)[:, 0].min(axis=0))
        return Assessed(drive, gain, about, float(gaps[UNLIKELY]))

    def _simulated(self, speed: FloatArray) -> FloatArray:
        """(K, 3, D) gap, speed and speed ahead of each draw at the instants measured."""
        state, taken = self.first.copy(), []
        tau = self.values[:, 1] / self.values[:, 0]
        state[:, P], state[:, V] = tau * speed[0], speed[0]
        slopes = np.append(np.diff(speed) / STEP, 0.0)
        for k, (at, slope) in enumerate(zip(speed, slopes, strict=True)):
            state[:, U], state[:, A] = at, slope
            if k % self.stride == 0:
                taken.append(state[:, [P, V, U]].copy())
            if k < len(self.pushed):
                state = np.einsum("bij,bj->bi", self.transition, state) + self.pushed[k]
        simulated = np.array(taken).transpose(0, 2, 1)
        simulated[:, P] += self.shift
        return simulated

    def _about_coordinates(self, information: FloatArray) -> FloatArray:
        """(D, p, p) about the free coordinates, disturbance and noise being unknown, too."""
        size = information.shape[1]
        places = np.array([0, 1, 2, *range(len(COMMON), size)])
        nuisance = np.arange(3, len(COMMON))
        across = information[:, places[:, None], nuisance]
        complement = information[:, places[:, None], places] - across @ np.linalg.solve(
            information[:, nuisance[:, None], nuisance], across.transpose(0, 2, 1)
        )
        # ln ατ = ln α + ln τ with τ = G - s₀/v, by φ = (ln α, ln β, ln G, further terms).
        slopes = np.zeros((len(complement), len(places), len(places)))
        slopes[:, 0, 0] = slopes[:, 1, 0] = slopes[:, 2, 1] = 1.0
        tau, gap = self.values[:, 1] / self.values[:, 0], np.exp(self.phi[:, 2])
        slopes[:, 1, 2] = gap / tau
        slopes[:, range(3, len(places)), range(3, len(places))] = 1.0
        if "s0" in FOLLOWING[self.prior.spec.model].terms:
            slopes[:, 1, 3] = -1.0 / AT_SPEED / tau
        about = slopes.transpose(0, 2, 1) @ complement @ slopes
        free = np.flatnonzero(self.prior.free)
        return np.asarray(about[:, free[:, None], free])


def _unknowns(form: str, phi: FloatArray, unknowns: FloatArray) -> FloatArray:
    """(D, P) z of coordinates (D, p), with disturbance and noise of the unknowns (P,)."""
    z = np.tile(np.append(np.log(unknowns[: len(COMMON)]), unknowns[len(COMMON) :]), (len(phi), 1))
    tau = np.exp(phi[:, 2])
    if "s0" in FOLLOWING[form].terms:
        tau = tau - phi[:, 3] / AT_SPEED
    z[:, 0], z[:, 2] = phi[:, 0], phi[:, 1]
    z[:, 1] = phi[:, 0] + np.log(np.maximum(tau, LEAST_TAU))
    z[:, len(COMMON) :] = phi[:, 3:]
    bounds = np.array([unknown.bounds for unknown in coordinates(form)])
    return np.asarray(np.clip(z, *bounds.T))


def spread_of_draws(draws: FloatArray) -> FloatArray:
    """(p, p) the covariance of draws (n, p), by the quantiles of a normal: tails count little."""
    middle = np.median(draws, axis=0)
    low, high = np.quantile(draws, (0.05, 0.95), axis=0)
    deviations = np.maximum((high - low) / 3.29, 1e-9)
    scores = np.clip((draws - middle) / deviations, -2.5, 2.5)
    related = np.corrcoef(scores, rowvar=False).reshape(len(middle), len(middle))
    return np.asarray(related * np.outer(deviations, deviations))


def after_drive(
    typical: FloatArray, further: FloatArray, information: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Covariances (D, p, p) of the typical value and of the drive's φ, see the head.

    Before it they are ``typical`` and ``further`` (p, p); the information is (D, p, p).
    """
    inverse = np.linalg.inv(further)
    driven = np.asarray(np.linalg.inv(inverse + information), float)
    pull = typical @ inverse
    return np.asarray(typical - pull @ typical.T + pull @ driven @ pull.T), driven
