"""Variation of parameters between cars and windows: `python -m bench.population FOLDER`.

Every car's windows in car-following under ACC are estimated by themselves. Then, for each model,
the centre m and spread S of the cars and the usual scale Σ₀ between windows of a car (see
`accpinn.inference.population`) are those that the typical values of all cars have, found in rounds:
each car is sampled under the present m, S and Σ₀, which then become those of the samples. Runs of
one car in one campaign count as one car. It prints the rows of `populations.csv`, of all models or
of those named: `python -m bench.population FOLDER idm fvdm`.
"""

import sys
from collections import defaultdict
from collections.abc import Mapping, Sequence
from contextlib import suppress
from itertools import pairwise

import numpy as np

from accpinn.errors import AccpinnError
from accpinn.inference.coordinates import log_prior_of_likely
from accpinn.inference.population import PARTS, Population, sampled_population
from accpinn.inference.window_posterior import window_posterior
from accpinn.methods import PosteriorKind
from accpinn.model.registry import FOLLOWING
from accpinn.model.spec import ModelSpec
from accpinn.recordings.files import read
from accpinn.segment import Segment
from accpinn.segment.cut import cut
from accpinn.segment.windows import plan
from accpinn.study.plan import files_of
from accpinn.units import FloatArray, Seconds

Car = tuple[str, ...]
LONGEST: Seconds = 150.0
SHORTEST: Seconds = 100.0
ROUNDS = 8
START = (0.4, 0.4, 0.1), {"s0": 3.0, "lag": 0.2, "delay": 0.2}
"""Deviations between windows of ln α, ln β, ln G and of the terms, to begin with."""
START_OTHERS = 0.5
"""Deviations between windows of the parameters of other models, in those of their priors."""


def windows_of(
    folder: str, longest: Seconds = LONGEST, shortest: Seconds = SHORTEST
) -> dict[Car, list[Segment]]:
    """The windows of each follower of each recording: campaign, vehicle's name, path, number."""
    windows = defaultdict[Car, list[Segment]](list)
    for path in files_of(folder):
        with suppress(AccpinnError):  # a file that cannot be read has no windows
            recording = read(path)
            for planned in plan(recording, longest):
                start, duration = planned.window.start, planned.window.duration
                for pair in pairwise(planned.vehicles) if duration >= shortest else ():
                    segment = cut(recording, start, duration, pair)
                    name = segment.labels[1].split(" ", 1)[-1]
                    windows[path.parent.name, name, str(path), str(pair[1])].append(segment)
    return windows


def learn(
    cars: Sequence[FloatArray], priors: Sequence[FloatArray], model: str, rounds: int = ROUNDS
) -> Population:
    """The population of cars, each of which is known by draws (K, n, p) under a prior (K, n)."""
    cthp = [*START[0], *(START[1][term] for term in FOLLOWING[model].terms)]
    following = FOLLOWING[model]
    others = following.nonlinear_count * [START_OTHERS]
    between = np.diag(cthp if following.is_linear else others) ** 2
    means = np.array([drawn.mean(axis=(0, 1)) for drawn in cars])
    population = Population(np.median(means, axis=0), np.cov(means.T) + between, between)
    weights = np.array([len(drawn) - 1.0 for drawn in cars])
    for _ in range(rounds):
        sampled = [sampled_population(*car, population) for car in zip(cars, priors, strict=True)]
        values = np.array([car.value.mean(axis=0) for car in sampled])
        within = np.mean([np.cov(car.value.T) for car in sampled], axis=0)
        covariances = np.array([car.covariance.mean(axis=0) for car in sampled])
        population = Population(
            values.mean(axis=0),
            np.cov(values.T) + within,
            np.einsum("c,cij->ij", weights, covariances) / weights.sum(),
        )
    return population


def cars_of(windows: Mapping[Car, list[Segment]], model: str) -> dict[Car, FloatArray]:
    """(K, n, p) draws of `likely` of the K windows of each car, of all its runs in a campaign."""
    together = defaultdict[Car, list[FloatArray]](list)
    for car, segments in windows.items():
        kind: PosteriorKind = "likelihood" if FOLLOWING[model].is_linear else "simulation"
        drawn = [
            window_posterior(segment, "II", ModelSpec(model), kind).likely[0]
            for segment in segments
        ]
        together[car[:2]] += [rows for rows in drawn if np.isfinite(rows).all()]
    return {car: np.array(drawn) for car, drawn in together.items() if drawn}


def main() -> None:
    """Print the population of each model."""
    windows = windows_of(sys.argv[1])
    for model in sys.argv[2:] or FOLLOWING:
        cars = list(cars_of(windows, model).values())
        population = learn(
            cars, [log_prior_of_likely(ModelSpec(model), car) for car in cars], model
        )
        for part in PARTS:
            for row in np.atleast_2d(getattr(population, part)).round(4).tolist():
                print(model, part, *row, sep=",", flush=True)
        print(f"# {len(cars)} cars, {sum(map(len, cars))} windows", file=sys.stderr, flush=True)


if __name__ == "__main__":
    main()
