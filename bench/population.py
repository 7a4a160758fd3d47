"""What the recordings teach about how parameters differ: `python -m bench.population FOLDER`.

Every car's windows in car-following under ACC are estimated by themselves. Then, for each model,
the centre m and spread S of the cars and the usual covariance Σ₀ between windows of a car (see
`accpinn.inference.population`) are those that the typical values of all cars have, found in rounds:
each car is sampled under the present m, S and Σ₀, which then become those of the samples. Runs of
one car in one campaign count as one car. It prints the entries of `POPULATIONS`.
"""

import sys
from collections.abc import Iterable, Mapping, Sequence
from itertools import pairwise
from pathlib import Path

import numpy as np

from accpinn.errors import AccpinnError
from accpinn.inference.answer import window_posterior
from accpinn.inference.population import Population, sampled_population
from accpinn.inference.posterior import log_prior_of_features
from accpinn.model.models import MODELS, Model, terms_of
from accpinn.recordings.files import read
from accpinn.segment.cut import cut
from accpinn.segment.segment import Segment
from accpinn.study.plan import files_of, plan
from accpinn.units import FloatArray, Seconds

Car = tuple[str, ...]
LONGEST: Seconds = 150.0
SHORTEST: Seconds = 100.0
ROUNDS = 8
START = (0.4, 0.4, 0.1), {"s0": 3.0, "lag": 0.2, "delay": 0.2}
"""Deviations between windows of ln α, ln β, ln G and of the terms, to begin with."""


def windows_of(
    folder: str, longest: Seconds = LONGEST, shortest: Seconds = SHORTEST
) -> dict[Car, list[Segment]]:
    """The windows of each follower of each recording: campaign, vehicle's name, file, number."""
    windows: dict[Car, list[Segment]] = {}
    for path in files_of(folder):
        try:
            recording = read(path)
        except AccpinnError:
            continue
        for planned in plan(recording, longest):
            start, duration = planned.window.start, planned.window.duration
            if duration < shortest:
                continue
            for pair in pairwise(planned.vehicles):
                segment = cut(recording, start, duration, pair)
                name = segment.labels[1].split(" ", 1)[-1]
                car = (path.parent.name, name, path.name, str(pair[1]))
                windows.setdefault(car, []).append(segment)
    return windows


def draws_of(segments: Iterable[Segment], model: Model) -> FloatArray:
    """(K, n, p) posterior draws of each window that determines the parameters."""
    drawn = [window_posterior(segment, "II", model).drawn[0] for segment in segments]
    return np.array([rows for rows in drawn if np.isfinite(rows).all()])


def learn(cars: Sequence[FloatArray], model: Model, rounds: int = ROUNDS) -> Population:
    """The population of cars, each of which is known by draws (K, n, p)."""
    usual, terms = START
    between = np.diag([*usual, *(terms[term] for term in terms_of(model))]) ** 2
    means = np.array([drawn.mean(axis=(0, 1)) for drawn in cars])
    population = Population(np.median(means, axis=0), np.cov(means.T) + between, between)
    weights = np.array([len(drawn) - 1.0 for drawn in cars])
    for _ in range(rounds):
        sampled = [
            sampled_population(drawn, log_prior_of_features(model, drawn), population)
            for drawn in cars
        ]
        values = np.array([one.value.mean(axis=0) for one in sampled])
        within = np.mean([np.cov(one.value.T) for one in sampled], axis=0)
        covariances = np.array([one.covariance.mean(axis=0) for one in sampled])
        population = Population(
            values.mean(axis=0),
            np.cov(values.T) + within,
            np.einsum("c,cij->ij", weights, covariances) / weights.sum(),
        )
    return population


def cars_of(windows: Mapping[Car, list[Segment]], model: Model) -> dict[Car, FloatArray]:
    """Draws of each car over all its runs in a campaign."""
    together: dict[Car, list[Segment]] = {}
    for car, segments in windows.items():
        together.setdefault(car[:2], []).extend(segments)
    return {car: draws_of(segments, model) for car, segments in together.items()}


def main() -> None:
    """Print the population of each model."""
    windows = windows_of(sys.argv[1])
    for model in MODELS:
        cars = [drawn for drawn in cars_of(windows, model).values() if len(drawn)]
        population = learn(cars, model)
        print(f'    "{model}": _population(')
        for values in (population.centre, population.cars, population.windows):
            print(f"        {np.round(values, 4).tolist()},")
        print("    ),", flush=True)
        print(f"# {len(cars)} cars, {sum(map(len, cars))} windows", file=sys.stderr, flush=True)


if __name__ == "__main__":
    assert Path(sys.argv[1]).is_dir()
    main()
