"""Which car-following model describes a car in other windows? `python -m bench.models FOLDER`.

Every follower of every recording is judged by itself, as `compare --models` does, in its windows of
car-following under ACC. The table is over all windows left out; the last column is the mean over
cars of the difference of ln RMSE to the first model's, with its standard error.
"""

import sys
from collections import defaultdict
from pathlib import Path

import numpy as np
from scipy.stats import sem

from accpinn.model.registry import FOLLOWING, JUDGED
from accpinn.recordings.files import read
from accpinn.study.judge import Judgement, difference, judge, subjects_of, wins
from accpinn.units import FloatArray
from bench.population import Car, windows_of

LEAST = 2
"""Windows that a follower needs."""


def judgements(folder: str, models: tuple[str, ...]) -> dict[Car, list[Judgement]]:
    """The judgements of each car: campaign and name."""
    found = defaultdict[Car, list[Judgement]](list)
    for (campaign, name, path, _), windows in windows_of(folder).items():
        if len(windows) >= LEAST:
            *_, (judged,) = judge(subjects_of(read(path), windows[0].vehicles), models)
            found[campaign, name].append(judged)
            print(Path(path).name, judged.info.labels[1], len(judged.windows), flush=True)
    return found


def main() -> None:
    """Print the table."""
    models = tuple(sys.argv[2:]) or JUDGED
    cars = judgements(sys.argv[1], models)
    every = [judged for judged_ones in cars.values() for judged in judged_ones]
    count = sum(len(one.windows) for one in every)
    print(f"\n{count} windows of {len(cars)} cars\n")
    columns = "median [m]", "geometric mean [m]", "best in", "collides in", "|H| off [dB]"
    print("| model |", " | ".join(columns), f"| ln RMSE - that of {models[0]} |")
    share = wins(every)
    for k, key in enumerate(models):
        scores = [one.scores[k] for one in every]
        errors: FloatArray = np.concatenate([score.rmse for score in scores])
        hit = np.concatenate([score.collided for score in scores])
        gain = np.nanmedian([score.gain_error for score in scores])
        more = [
            np.mean([difference([one.scores[k]], [one.scores[0]])[0] for one in ones])
            for ones in cars.values()
        ]
        mean = np.exp(np.log(errors).mean())
        print(
            f"| {FOLLOWING[key].title} | {np.median(errors):.2f} | {mean:.2f}"
            f" | {100 * share[k]:.0f} % | {100 * hit.mean():.0f} % | {gain:.1f}"
            f" | {np.mean(more):+.2f} ± {sem(more):.2f} |"
        )


if __name__ == "__main__":
    main()
