"""`python -m bench.calibration`: do posteriors say as much as they know, no more and no less?

Simulation-based calibration: parameters are drawn from the prior, a recording from the model with
these parameters, and draws of its posterior by the package. Among draws of an exact posterior the
true value has every rank as often as any other. A histogram of ranks that is a U means intervals
that are too narrow, a hill too wide ones, a slope a bias. Printed are the histogram of each
parameter and the p-value of Neyman's smooth test for a flat one. The exit status is 1 if the least
p-value times their number (Bonferroni) is below `LEVEL`.

* A window: motion, disturbance and noise are drawn from the model of `methods.state_space`, from a
  beginning that depends on no parameter (`FIRST`). The prior is that of `WindowPosterior.drawn`, or
  with --cars that of `WindowPosterior.likely`.
* A population (--windows): μ, Σ and the windows' parameters are drawn from the hierarchy of
  `inference.population`. Each window is known by exact draws of a normal posterior.

Prior and posterior of a window are restricted to parameters with which the vehicle does not lose
control. With a large β and a delay it does, and its speed grows without limit.

Sources: Talts, Betancourt, Simpson, Vehtari and Gelman, arXiv 1804.06788 (2018); Neyman,
Skandinavisk Aktuarietidskrift 20 (1937) 149-199 (the test).
"""

import argparse
import os
import sys
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from multiprocessing import get_context

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2, invwishart

from accpinn.inference.coordinates import (
    AT_SPEED,
    PRIOR_SPREAD,
    of_others,
    time_gap_coordinates,
)
from accpinn.inference.population import TAILS, Population, population_of, sampled_population
from accpinn.inference.window_posterior import sampled
from accpinn.methods.likelihood import natural
from accpinn.methods.series import SPACING
from accpinn.methods.state_space import COMMON, EXTRA, Form, StateSpace, coordinates, state_space
from accpinn.model.cthp import TYPICAL
from accpinn.model.registry import FOLLOWING, PAPER
from accpinn.model.spec import ModelSpec
from accpinn.segment import Segment
from accpinn.units import FloatArray, Mask, Seconds
from tests.support.driving import segment_of

Ranks = NDArray[np.int64]
DRAWS, BINS = 39, 10
"""Draws among which the truth has a rank from 0 to their number; bins of the histogram of ranks."""
LEVEL = 0.01
"""Significance level of the test that all histograms are flat."""
FIRST = (35.0, 25.0, 25.0), (8.0, 3.0, 3.0)
"""Means and deviations of the first p in m, v and u in m/s."""
WINDOW_DRAWS, ERROR = 400, 4.0
"""Draws a window that a population is sampled from, and how often the covariance of what a window
leaves open is that between windows. With so much, the population counts."""
NUISANCE = "s", "T", "T₂", "noise of p", "noise of v", "deviation of a"
"""Names of a window's further unknowns, in the order of `COMMON`."""


def drawn_parameters(form: Form, of_cars: bool, rng: np.random.Generator) -> FloatArray:
    """(P,) coordinates of all unknowns from the prior, within its bounds and stable."""
    unknowns, terms = coordinates(form), FOLLOWING[form].terms
    lower, upper = np.array([unknown.bounds for unknown in unknowns]).T
    centre = np.append(np.log(TYPICAL.values), [EXTRA[term].start for term in terms])
    root = np.diag(np.append(PRIOR_SPREAD, [EXTRA[term].spread for term in terms]))
    if of_cars:
        population = population_of(form, len(centre))
        centre, root = population.centre, np.linalg.cholesky(population.cars + population.windows)
    while True:
        stretch = np.sqrt(rng.gamma(TAILS / 2, 2 / TAILS)) if of_cars else 1.0
        phi = centre + root @ rng.standard_normal(len(centre)) / stretch
        tau = np.exp(phi[2]) - (phi[3] / AT_SPEED if "s0" in terms else 0.0)
        if tau > 0.0:
            others = [
                unknown.centre + unknown.spread * rng.standard_normal() for unknown in COMMON[3:]
            ]
            z = np.array([phi[0], phi[0] + np.log(tau), phi[1], *others, *phi[3:]])
            if ((z >= lower) & (z <= upper)).all() and are_stable(form, z[None])[0]:
                return z


def are_stable(form: Form, z: FloatArray) -> Mask:
    """(n,) whether a vehicle with coordinates (n, P) comes to rest behind one that does."""
    rates = state_space(form, natural(form, z), SPACING).rates.transpose(2, 0, 1)
    places = [0, 1, *range(6, rates.shape[1])]
    return np.asarray(np.linalg.eigvals(rates[:, places][:, :, places]).real.max(axis=1) < 0.0)


def simulated(model: StateSpace, samples: int, rng: np.random.Generator) -> Segment:
    """A recording by the first of some models, one sample each `SPACING`."""
    normal = partial(rng.multivariate_normal, method="eigh")  # covariances are nearly singular
    first, process = model.first_covariance[..., 0], model.process[..., 0]
    # What is not measured begins as it does in the model beside these p, v and u.
    measured = rng.normal(*FIRST)
    tied = first[3:, :3] @ np.linalg.inv(first[:3, :3])
    state = np.append(measured, normal(tied @ measured, first[3:, 3:] - tied @ first[:3, 3:]))
    states = normal(np.zeros(len(first)), process, samples)
    for now in states:
        state, now[:] = model.transition[..., 0] @ state + now, state
    values = states[:, :3] + rng.standard_normal((samples, 3)) * np.sqrt(model.noise[:, 0])
    gap, speed, ahead = values.T
    time = SPACING * np.arange(samples)
    return segment_of(time, np.column_stack([ahead, speed]), (gap + model.shift)[:, None])


def ranks_of_window(seed: int, form: Form, of_cars: bool, duration: Seconds) -> Ranks:
    """(Q,) ranks of the true φ, and of what else is unknown, among draws of one window."""
    rng, spec = np.random.default_rng(seed), ModelSpec(form)
    z = drawn_parameters(form, of_cars, rng)
    model = state_space(form, natural(form, z[None]), SPACING)
    segment = simulated(model, round(duration / SPACING) + 1, rng)
    ((_, _, posterior),) = sampled((segment,), "II", spec)
    if of_cars:
        posterior = posterior.under(of_others(spec, posterior.coordinates))
    chosen = rng.choice(posterior.coordinates, 20 * DRAWS, p=posterior.weights)
    chosen = chosen[are_stable(form, chosen)][:DRAWS]
    return ranks(with_others(form, z), with_others(form, chosen), rng)


def with_others(form: Form, z: FloatArray) -> FloatArray:
    """(.., Q) φ, then what else is unknown, at coordinates (.., P)."""
    phi = time_gap_coordinates(form).of_unknowns(z)
    return np.concatenate([phi, z[..., 3 : len(COMMON)]], axis=-1)


def ranks(truth: FloatArray, drawn: FloatArray, rng: np.random.Generator) -> Ranks:
    """(Q,) how many of the draws (n, Q) are less than the truth (Q,); equal ones by lot."""
    equal = (drawn == truth).sum(axis=0)
    return np.asarray((drawn < truth).sum(axis=0) + rng.integers(0, equal + 1))


def ranks_of_population(
    seed: int, population: Population, windows: int, count: int = WINDOW_DRAWS
) -> Ranks:
    """(3 p,) ranks of the true μ, ln Σ_ii and φ of a further window among a population's draws."""
    rng, p, freedom = np.random.default_rng(seed), len(population.centre), population.freedom
    value = rng.multivariate_normal(population.centre, population.cars)
    scale = invwishart.rvs(freedom, (freedom - p - 1) * population.windows, random_state=rng)
    normal = rng.multivariate_normal(np.zeros(p), scale, windows + 1)
    phi = value + normal / np.sqrt(rng.gamma(TAILS / 2, 2 / TAILS, (windows + 1, 1)))
    car = sampled_population(*known_windows(phi[1:], population, count, rng), population, seed)
    variances = np.log(np.einsum("nii->ni", car.covariance))
    every = np.concatenate([car.value, variances, car.further], axis=1)
    truth = np.concatenate([value, np.log(np.diag(scale)), phi[0]])
    return ranks(truth, rng.choice(every, DRAWS), rng)


def known_windows(
    phi: FloatArray, population: Population, count: int, rng: np.random.Generator
) -> tuple[FloatArray, FloatArray]:
    """Draws (K, n, p) that tell of K windows' φ (K, p), and their log prior (K, n).

    Prior, as wide as windows of any car, and error of what is measured are normal.
    """
    error, prior = ERROR * population.windows, population.cars + 2.0 * population.windows
    precision, prior_precision = np.linalg.inv(error), np.linalg.inv(prior)
    normal = partial(rng.multivariate_normal, np.zeros(len(error)))
    covariance = np.linalg.inv(precision + prior_precision)
    means = (
        (phi + normal(error, len(phi))) @ precision + population.centre @ prior_precision
    ) @ covariance
    drawn = means[:, None] + normal(covariance, (len(phi), count))
    away = drawn - population.centre
    return drawn, -0.5 * np.einsum("kni,ij,knj->kn", away, prior_precision, away)


def chances(ranks: Ranks) -> FloatArray:
    """(Q,) p-values of flat histograms of the ranks (N, Q), by Neyman's smooth test.

    Under it the sums of the first two Legendre polynomials, of which one sees a slope and the other
    a U or a hill, are independent and normal.
    """
    place = (2.0 * ranks + 1.0) / (DRAWS + 1) - 1.0
    slope = np.sqrt(3.0) * place
    bend = np.sqrt(5.0) * (1.5 * place**2 - 0.5)
    squares = slope.sum(axis=0) ** 2 + bend.sum(axis=0) ** 2
    return np.asarray(chi2.sf(squares / len(ranks), 2))


def together(probabilities: FloatArray) -> float:
    """The p-value of all tests (Q,) together, by Bonferroni's inequality."""
    return min(1.0, len(probabilities) * float(probabilities.min()))


def main(arguments: list[str] | None = None) -> int:
    """Simulate, rank and print; the exit status is described above."""
    parser = argparse.ArgumentParser(prog="python -m bench.calibration", description=__doc__)
    parser.add_argument("--recordings", type=int, default=40, help="how many (40)")
    linear = [key for key, model in FOLLOWING.items() if model.is_linear]
    parser.add_argument("--model", choices=linear, default=PAPER)
    parser.add_argument("--duration", type=float, default=100.0, help="of a window in s (100)")
    parser.add_argument("--cars", action="store_true", help="the prior that other cars taught")
    parser.add_argument("--windows", type=int, help="a population of so many windows")
    given = parser.parse_args(arguments)
    symbols = [parameter.symbol for parameter in FOLLOWING[given.model].parameters]
    symbols[2] = "time gap"
    if given.windows:
        population = population_of(given.model, len(symbols))
        ranks_of = partial(ranks_of_population, population=population, windows=given.windows)
        names = [f"{of} {symbol}" for of in ("typical", "Σ of", "further") for symbol in symbols]
    else:
        ranks_of = partial(
            ranks_of_window, form=given.model, of_cars=given.cars, duration=given.duration
        )
        names = [*symbols, *NUISANCE]
    with ProcessPoolExecutor(os.cpu_count(), get_context("spawn")) as pool:
        ranks = np.array(list(pool.map(ranks_of, range(given.recordings))))
    print(", ".join(f"{name}: {value}" for name, value in vars(given).items()))
    probabilities = chances(ranks)
    for name, column, chance in zip(
        names, ranks.T * BINS // (DRAWS + 1), probabilities, strict=True
    ):
        counts = np.bincount(column, minlength=BINS)
        print(f"  {name:20}{''.join(f'{count:4}' for count in counts)}   p = {chance:.3f}")
    print(f"  all together: p = {together(probabilities):.3f}, which is to be {LEVEL:g} or more")
    return int(together(probabilities) < LEVEL)


if __name__ == "__main__":
    sys.exit(main())
