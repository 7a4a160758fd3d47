"""`python -m bench.ensemble`: are the posteriors those of an independent sampler?

The posterior of a window, and that of a population, are sampled by emcee's ensemble of walkers as
well, from densities that stand here, written anew from the equations: the step by scipy's matrix
exponential, a textbook Kalman filter, the priors over the parameters themselves. Printed are the
difference of both means in percent of the deviation, and the excess of the deviation in percent.
Both may be 10 %, chance included; the exit status is 1 if one is not.

Sources: Foreman-Mackey, Hogg, Lang and Goodman, PASP 125 (2013) 306-312 (emcee); ter Braak,
Statistics and Computing 16 (2006) 239-249 (its moves along differences); Van Loan, IEEE Trans.
Autom. Control 23 (1978) 395-404 (the step).
"""

import argparse
import sys
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import NamedTuple

import emcee
import numpy as np
from scipy.linalg import expm
from scipy.special import logsumexp

from accpinn.inference.coordinates import log_prior_of_likely, of_others, time_gap_coordinates
from accpinn.inference.population import Population, population_of, sampled_population
from accpinn.inference.posterior import sample
from accpinn.inference.window_posterior import window_posterior
from accpinn.methods.joint_likelihood import joint_maxima
from accpinn.methods.series import series_of
from accpinn.model.cthp import Parameters
from accpinn.model.registry import FOLLOWING
from accpinn.model.spec import ModelSpec
from accpinn.segment import Segment
from accpinn.units import FloatArray, Seconds
from bench.disturbed import Disturbance, disturbed
from bench.measurement import Measurement, measured, show

LogDensity = Callable[[FloatArray], FloatArray]
"""(B,) log density at (B, P), up to a constant."""
ENOUGH = 500
"""Independent draws of the ensemble at least: their mean is uncertain by .045 deviations."""
SEEDS = 4
"""Runs of the package's samplers that count as one, so that their chance is small beside it."""
LIMIT = 10.0
"""Largest difference of means and of deviations, in percent of the deviation."""
TRUTH = {
    "cthp": (Parameters(0.1, 0.25, 1.3), Disturbance()),
    "cthp-s0-delay": (Parameters(0.1, 0.3, 1.1), Disturbance(delay=0.6, standstill=6.0)),
}
"""The car, by model."""
SPEED = 100 / 3.6
"""In m/s, that of the time gap."""


class Unknown(NamedTuple):
    """A parameter, or what disturbs or blurs the motion: its prior, and where that ends."""

    symbol: str
    centre: float
    """Median."""
    spread: float
    """Standard deviation, of the logarithm unless it `is_plain`."""
    least: float
    most: float
    is_plain: bool = False
    """Whether it is not known by its logarithm."""


UNKNOWNS = (
    Unknown("α", 0.08, 2.0, 1e-4, 10.0),
    Unknown("β", 0.2, 1.5, 1e-4, 10.0),
    Unknown("time gap", 1.4, 0.6, 0.0, np.inf),
    Unknown("s", 0.25, 0.7, 0.01, 3.0),
    Unknown("T", 4.0, 0.7, 0.3, 60.0),
    Unknown("T₂", 0.3, 1.0, 0.005, 20.0),
    Unknown("noise of p", 0.03, 1.0, 0.01, 3.0),
    Unknown("noise of v", 0.05, 1.0, 0.02, 1.0),
    Unknown("deviation of a", 0.5, 0.5, 0.02, 3.0),
)
TERMS = (
    Unknown("s₀", 6.0, 6.0, -30.0, 60.0, is_plain=True),
    Unknown("d", 0.7, 0.4, 0.05, 3.0, is_plain=True),
)
"""Unknowns of the CTHP with an intercept and a delay, behind the others."""
LEAST, MOST = 1e-4, 10.0
"""Bounds of ατ."""


def log_density_of_window(model: str, series: FloatArray, step: Seconds) -> LogDensity:
    """The posterior of one follower, of which p, v, u are measured (N, 3) a step apart.

    Its coordinates are those unknowns, by their logarithms unless they are plain.
    """
    unknowns = UNKNOWNS if model == "cthp" else UNKNOWNS + TERMS
    _, centre, spread, least, most, is_plain = map(np.array, zip(*unknowns, strict=True))
    middle = np.where(is_plain, centre, np.log(np.where(is_plain, 1.0, centre)))

    def log_density(x: FloatArray) -> FloatArray:
        values = np.where(is_plain, x, np.exp(np.where(is_plain, 0.0, x)))
        s0, delay = values[:, 9:].T if len(unknowns) > 9 else np.zeros((2, len(x)))
        alpha_tau = values[:, 0] * (values[:, 2] - s0 / SPEED)
        inside = ((values >= least) & (values <= most)).all(axis=1)
        inside &= (alpha_tau >= LEAST) & (alpha_tau <= MOST)
        log = np.full(len(x), -np.inf)
        log[inside] = -0.5 * (((x - middle) / spread) ** 2).sum(axis=1)[inside]
        beta = values[inside]
        parts = (alpha_tau[inside], beta, delay[inside], step)
        shifted = series - s0[inside, None, None] * np.array([1.0, 0.0, 0.0])
        log[inside] += log_likelihood(shifted, *state_space(*parts))
        return log

    return log_density


def state_space(
    alpha_tau: FloatArray, values: FloatArray, delay: FloatArray, step: Seconds
) -> tuple[FloatArray, ...]:
    """Transition, added covariance, noise and first covariance of the states p, v, u, r, w, a.

    With a delay the two states of its Padé approximant follow, which is 1 - 12ds/(d²s² + 6ds + 12).
    """
    alpha, beta, _, s, memory, rise, gap, speed, leader = values[:, :9].T
    p, v, u, r, w, a, x, rate = range(8)
    size = 8 if delay.any() else 6
    rates, density, first = np.zeros((3, len(values), size, size))
    rates[:, p, u], rates[:, p, v] = 1.0, -1.0
    command = np.stack([alpha, -alpha_tau - beta, beta], axis=1)
    rates[:, v, :3] = command
    rates[:, v, r] = 1.0
    rates[:, r, w], rates[:, r, r] = 1.0 / rise, -1.0 / rise
    rates[:, w, w] = -1.0 / memory
    rates[:, u, a] = 1.0
    rates[:, a, a] = -1.0 / 3.0
    of_w = s**2 * (1.0 + rise / memory)
    density[:, p, p] = 2.0 * 0.14**2 / 60.0
    density[:, w, w] = 2.0 * of_w / memory
    density[:, a, a] = 2.0 * leader**2 / 3.0
    first[:, [p, v, u], [p, v, u]] = 100.0**2, 50.0**2, 50.0**2
    first[:, r, r] = first[:, r, w] = first[:, w, r] = s**2
    first[:, w, w], first[:, a, a] = of_w, leader**2
    if size == 8:
        rates[:, x, rate] = 1.0
        rates[:, rate, :3] = command
        rates[:, rate, x], rates[:, rate, rate] = -12.0 / delay**2, -6.0 / delay
        rates[:, v, rate] = -12.0 / delay
        # At first x is about where a command at rest holds it, the command d²/12.
        scale, observed = delay**2 / 12.0, first[:, :3, :3]
        tied = np.einsum("b,bi,bij->bj", scale, command, observed)
        first[:, x, :3] = first[:, :3, x] = tied
        first[:, x, x] = scale * np.einsum("bi,bi->b", tied, command) + (0.25 * scale) ** 2
        first[:, rate, rate] = (0.25 * delay / 6.0) ** 2
    noise = np.zeros((len(values), 3, 3))
    noise[:, range(3), range(3)] = np.stack([gap, speed, speed], axis=1) ** 2
    return (*stepped(rates, density, step), noise, first)


def stepped(
    rates: FloatArray, density: FloatArray, step: Seconds, halvings: int = 5
) -> tuple[FloatArray, FloatArray]:
    """Transition and added covariance of a step, by Van Loan's block over a short part of it."""
    size = rates.shape[1]
    block = np.zeros((len(rates), 2 * size, 2 * size))
    block[:, :size, :size], block[:, :size, size:] = -rates, density
    block[:, size:, size:] = rates.transpose(0, 2, 1)
    whole = expm(block * (step / 2**halvings))
    transition = whole[:, size:, size:].transpose(0, 2, 1)
    process = transition @ whole[:, :size, size:]
    for _ in range(halvings):
        process = process + transition @ process @ transition.transpose(0, 2, 1)
        transition = transition @ transition
    return transition, process


def log_likelihood(
    values: FloatArray,
    transition: FloatArray,
    process: FloatArray,
    noise: FloatArray,
    covariance: FloatArray,
) -> FloatArray:
    """(B,) of measurements (B, N, 3) under B models, by a Kalman filter of all three at once."""
    mean = np.zeros((*covariance.shape[:2], 1))
    total, has_settled = np.zeros(len(mean)), False
    for now in values.transpose(1, 0, 2):
        if not has_settled:
            inverse = np.linalg.inv(covariance[:, :3, :3] + noise)
            volume = np.linalg.slogdet(inverse / (2.0 * np.pi))[1]
            gain = covariance[:, :, :3] @ inverse
            updated = covariance - gain @ covariance[:, :3]
            after = transition @ updated @ transition.transpose(0, 2, 1) + process
            after = (after + after.transpose(0, 2, 1)) / 2
            size = np.sqrt(np.einsum("bii->bi", after))
            change = np.abs(after - covariance) / (size[:, :, None] * size[:, None])
            covariance, has_settled = after, bool(change.max() < 1e-9)
        error = now[:, :, None] - mean[:, :3]
        total += 0.5 * (volume - (error * (inverse @ error)).sum(axis=(1, 2)))
        mean = transition @ (mean + gain @ error)
    return total


def log_density_of_population(
    drawn: FloatArray, log_prior: FloatArray, population: Population, tails: float = 4.0
) -> LogDensity:
    """The posterior of μ and Σ, given draws (K, n, p) of K windows and their log prior (K, n).

        Π_w [Σ_k t(φ_wk; μ, Σ)/p(φ_wk)] N(μ; m, S) W⁻¹(Σ; ν, (ν - p - 1) Σ₀),   ν = p + 4

    Its coordinates (B, p + p (p + 1)/2) are those of `mean_and_root`.
    """
    p = drawn.shape[2]
    between_cars = np.linalg.inv(population.cars)
    scale = 3.0 * population.windows

    def log_density(x: FloatArray) -> FloatArray:
        mean, root = mean_and_root(x, p)
        logs = np.log(np.einsum("bii->bi", root))
        inverse = np.linalg.inv(root)
        away = np.einsum("bij,wkbj->wkbi", inverse, drawn[:, :, None] - mean)
        distance = (away**2).sum(axis=-1)
        densities = -0.5 * (tails + p) * np.log1p(distance / tails) - logs.sum(axis=1)
        log = logsumexp(densities - log_prior[:, :, None], axis=1).sum(axis=0)
        apart = mean - population.centre
        log -= 0.5 * np.einsum("bi,ij,bj->b", apart, between_cars, apart)
        log -= (2 * p + 5) * logs.sum(axis=1)
        log -= 0.5 * np.einsum("bij,jk,bik->b", inverse, scale, inverse)
        # dΣ = 2^p Π L_ii^(p - i + 1) dL, and dL_ii = L_ii d ln L_ii.
        return np.asarray(log + logs @ np.arange(p + 1, 1, -1))

    return log_density


def mean_and_root(x: FloatArray, p: int) -> tuple[FloatArray, FloatArray]:
    """μ (B, p) and Cholesky's root of Σ (B, p, p); of its diagonal x has the logarithms."""
    root = np.zeros((len(x), p, p))
    root[:, *np.tril_indices(p)] = x[:, p:]
    root[:, range(p), range(p)] = np.exp(root[:, range(p), range(p)])
    return x[:, :p], root


def walked(
    log_density: LogDensity, start: FloatArray, steps: int, left_out: int, seed: int = 0
) -> FloatArray:
    """(n, P) draws by as many walkers as there are starts (W, P), without their first steps.

    Raises:
        ArithmeticError: when they are worth fewer than `ENOUGH` independent ones.
    """
    moves = [(emcee.moves.DEMove(), 0.5), (emcee.moves.StretchMove(), 0.5)]
    sampler = emcee.EnsembleSampler(*start.shape, log_density, moves=moves, vectorize=True)
    random_state = np.random.RandomState(seed).get_state()
    sampler.run_mcmc(emcee.State(start, random_state=random_state), steps)
    independent = sampler.get_autocorr_time(discard=left_out, tol=0).max()
    drawn = np.asarray(sampler.get_chain(discard=left_out, flat=True))
    if len(drawn) < ENOUGH * independent:
        raise ArithmeticError(f"{len(drawn) / independent:.0f} independent draws; take more steps")
    return drawn


class Moments(NamedTuple):
    """Mean and deviation (Q,) of draws."""

    mean: FloatArray
    deviation: FloatArray

    @classmethod
    def of(cls, drawn: FloatArray, weights: FloatArray | None = None) -> "Moments":
        """Moments of draws (n, Q) with weights (n,), by default of equal weight."""
        mean = np.average(drawn, axis=0, weights=weights)
        return cls(mean, np.sqrt(np.average((drawn - mean) ** 2, axis=0, weights=weights)))

    def beside(self, other: "Moments") -> tuple[FloatArray, FloatArray]:
        """Differences (Q,) of the means, and of the deviations, in deviations of the other."""
        return (self.mean - other.mean) / other.deviation, self.deviation / other.deviation - 1.0


def of_window(
    model: str, segment: Segment, walkers: int, steps: int, left_out: int
) -> tuple[Moments, Moments]:
    """The posterior of φ of a segment's first follower: the package's, and the ensemble's."""
    series, spec = series_of([segment], "II"), ModelSpec(model)
    (maximum,) = joint_maxima((segment,), "II", spec)
    others, of_unknowns = partial(of_others, spec), time_gap_coordinates(model).of_unknowns
    posteriors = [sample(series, (maximum,), spec, [seed], others)[0] for seed in range(SEEDS)]
    log_density = log_density_of_window(model, series.measured[..., 0], series.step)
    # From beside the maximum, so from no draw of the package, and far from none.
    centre = np.append(of_unknowns(maximum.coordinates)[:3], maximum.coordinates[3:])
    start = centre + 0.02 * np.random.default_rng(0).standard_normal((walkers, len(centre)))
    drawn = walked(log_density, start, steps, left_out)
    of_phi = np.append([True] * 3, [False] * 6 + [True] * (len(centre) - 9))
    every = np.concatenate([of_unknowns(posterior.coordinates) for posterior in posteriors])
    weights = np.concatenate([posterior.weights for posterior in posteriors])
    return Moments.of(every, weights), Moments.of(drawn[:, of_phi])


def of_population(
    drawn: FloatArray,
    log_prior: FloatArray,
    population: Population,
    walkers: int,
    steps: int,
    left_out: int,
) -> tuple[Moments, Moments]:
    """The posterior of μ and the logarithms of Σ's diagonal: the package's, and the ensemble's."""
    p = drawn.shape[2]
    log_density = log_density_of_population(drawn, log_prior, population)
    root = np.linalg.cholesky(population.windows)
    root[range(p), range(p)] = np.log(np.diag(root))
    centre = np.append(drawn.mean(axis=(0, 1)), root[np.tril_indices(p)])
    rng = np.random.default_rng(0)
    start = centre + 0.1 * rng.standard_normal((walkers, len(centre)))
    value, root = mean_and_root(walked(log_density, start, steps, left_out), p)
    every = [sampled_population(drawn, log_prior, population, seed) for seed in range(SEEDS)]
    values, covariances = (np.concatenate(parts) for parts in list(zip(*every, strict=True))[:2])
    learned = np.append(values, np.log(np.einsum("nii->ni", covariances)), axis=1)
    return Moments.of(learned), Moments.of(np.append(value, np.log((root**2).sum(axis=2)), axis=1))


def measure(model: str, windows: int, duration: Seconds) -> Iterator[Measurement]:
    """Compare the posteriors of some windows of a car, and that of the car."""
    parameters, disturbance = TRUTH[model]
    segments = [
        disturbed([parameters], seed, disturbance, duration=duration) for seed in range(windows)
    ]
    symbols = [parameter.symbol for parameter in FOLLOWING[model].parameters]
    symbols[2] = "time gap"
    for number, segment in enumerate(segments):
        ours, other = of_window(model, segment, walkers=150, steps=1200, left_out=300)
        yield from differences([f"{symbol}, window {number}" for symbol in symbols], ours, other)
    drawn = np.array(
        [window_posterior(part, "II", ModelSpec(model)).likely[0] for part in segments]
    )
    log_prior = log_prior_of_likely(ModelSpec(model), drawn)
    population = population_of(model, len(symbols))
    sizes = {"walkers": 60, "steps": 2000, "left_out": 400}
    ours, other = of_population(drawn, log_prior, population, **sizes)
    names = [*symbols, *(f"ln Σ of {symbol}" for symbol in symbols)]
    yield from differences([f"{name}, population" for name in names], ours, other)


def differences(names: Sequence[str], ours: Moments, other: Moments) -> Iterator[Measurement]:
    """The package's moments (Q,) beside those of the ensemble, by the names (Q,)."""
    for what, values in zip(("mean", "deviation"), ours.beside(other), strict=True):
        for name, value in zip(names, (100.0 * values).tolist(), strict=True):
            yield Measurement(
                name=f"{what} of {name}", value=value, unit="%", at_most=LIMIT, at_least=-LIMIT
            )


def main(arguments: list[str] | None = None) -> int:
    """Compare and print; the exit status is described above."""
    parser = argparse.ArgumentParser(prog="python -m bench.ensemble", description=__doc__)
    parser.add_argument("--model", choices=tuple(TRUTH), default="cthp")
    parser.add_argument("--windows", type=int, default=4, help="how many of one car (4)")
    parser.add_argument("--duration", type=float, default=150.0, help="of each in s (150)")
    given = parser.parse_args(arguments)
    study = partial(measure, given.model, given.windows, given.duration)
    return show({f"{given.model}, windows of {given.duration:g} s": measured(study)})


if __name__ == "__main__":
    sys.exit(main())
