"""Car-following models compared on left-out windows: `python -m bench.models FOLDER`.

Every follower of every recording is judged by itself, as `compare --models` does: each model is
fitted by closed-loop simulation. Windows, reference and means are those of `bench.prediction`: the
ratio of the gap's RMSE in a left-out window to that of the CTHP by maximum likelihood from one
other window, by all others, and where three or more are there by two and by all of them. |H| is
that by all windows. The last column is the mean over cars of the difference of ln RMSE to the first
model's, with its standard error.
"""

import sys
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from multiprocessing import get_context
from typing import NamedTuple

import numpy as np

from accpinn.model.registry import FOLLOWING, JUDGED
from accpinn.study.judge import LONGEST_STRETCH, STRETCH, Judgement, Subject, judge, wins
from accpinn.units import FloatArray
from bench.population import LONGEST, windows_of
from bench.prediction import (
    REFERENCE,
    SHORTEST,
    SOURCES,
    WORKERS,
    Windows,
    driven,
    errors_by,
    errors_of,
    over_cars,
    ratio,
    simulation,
    two_others,
)


class Judged(NamedTuple):
    """Errors of several models in the K windows of one follower."""

    judgement: Judgement
    reference: FloatArray
    """(K,) RMSE in m by the CTHP from one other window."""
    two: FloatArray
    """(models, K) RMSE in m by pairs of other windows; see `two_others`."""


def judged(windows: Windows, stretches: Windows, models: tuple[str, ...]) -> Judged:
    """The models on one follower in one recording."""
    *_, (judgement,) = judge([Subject(tuple(windows), tuple(stretches))], models)
    sources = [partial(driven, simulation, model) for model in models]
    two = [two_others(len(windows), errors_by(windows, source)) for source in sources]
    reference = errors_of(windows, SOURCES[REFERENCE]).one_other
    return Judged(judgement, reference, np.array(two))


def main() -> None:
    """Print the table."""
    models = tuple(sys.argv[2:]) or JUDGED
    windows = windows_of(sys.argv[1], LONGEST, SHORTEST)
    stretches = windows_of(sys.argv[1], LONGEST_STRETCH, STRETCH)
    followers = [car for car, parts in windows.items() if len(parts) > 1]
    given = ([parts.get(car, []) for car in followers] for parts in (windows, stretches))
    with ProcessPoolExecutor(WORKERS, mp_context=get_context("spawn")) as pool:
        every = list(pool.map(partial(judged, models=models), *given))
    cars = [car[:2] for car in followers for _ in windows[car]]
    reference = np.concatenate([car.reference for car in every])
    two = np.concatenate([car.two for car in every], axis=1)
    more = np.isfinite(two[0])
    chosen = [car for car, has_more in zip(cars, more, strict=True) if has_more]
    judgements = [car.judgement for car in every]
    scores = [[judgement.scores[k] for judgement in judgements] for k in range(len(models))]
    errors = np.array([np.concatenate([score.rmse for score in of]) for of in scores])
    print(f"{len(cars)} windows of {len(set(cars))} cars; with three other windows or more")
    print(f"{len(chosen)} windows of {len(set(chosen))} cars\n")
    columns = "median [m]", "all others", "two", "more", "best in", "collides in", "|H| off [dB]"
    print("| model |", " | ".join(columns), f"| ln RMSE - that of {models[0]} |")
    share = wins(judgements)
    for k, key in enumerate(models):
        hit = np.concatenate([score.collided for score in scores[k]])
        gain = np.nanmedian([score.gain_error for score in scores[k]])
        ratios = [ratio(cars, errors[k], reference)]
        ratios += [ratio(chosen, row[k][more], reference[more]) for row in (two, errors)]
        mean, error = over_cars(cars, np.log(errors[k] / errors[0]))
        print(
            f"| {FOLLOWING[key].title} | {np.median(errors[k]):.2f} | {' | '.join(ratios)}"
            f" | {100 * share[k]:.0f} % | {100 * hit.mean():.0f} % | {gain:.1f}"
            f" | {mean:+.2f} ± {error:.2f} |"
        )


if __name__ == "__main__":
    main()
