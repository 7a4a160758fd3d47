"""The time left of an estimation, on simulated clocks."""

from collections.abc import Iterator

import numpy as np
import pytest

from accpinn.methods.estimate import Progress
from accpinn.methods.forecast import Forecast, Pace, Phase
from accpinn.model.cthp import Parameters, Trajectories
from accpinn.units import Seconds

PHASES = {"search": Phase(30, 0.1), "curves": Phase(1, 1.0), "intervals": Phase(8, 1.0)}
TRUE = Parameters.of([[0.1, 0.2, 1.0]])
CURVES = Trajectories(np.zeros(1), np.zeros((1, 2)), np.zeros((1, 1)))
TOLERANCE = 1.5


def moment(phase: str, iteration: int, expected: int, seconds: Seconds) -> Progress:
    return Progress(phase, iteration, expected, seconds, 1.0, 1.0, 1.0, 0.0, TRUE)


def course(slowness: float, rounds: int, typical: float, seed: int) -> Iterator[Progress]:
    """The moments of a training on a slower computer, with another number of rounds.

    The typical times of later phases are off by a factor, and each step by some 20 %.
    """
    rng, seconds = np.random.default_rng(seed), 0.0
    for name, phase in PHASES.items():
        count, off = (rounds, 1.0) if name == "search" else (phase.iterations, typical)
        for done in range(count):
            expected = max(phase.iterations, done + 2) if name == "search" else count
            yield moment(name, done, expected, seconds)
            seconds += slowness * off * phase.seconds * rng.uniform(0.8, 1.2)
    yield moment("end", 0, 1, seconds)


@pytest.mark.parametrize("slowness", [0.3, 1.0, 5.0])
@pytest.mark.parametrize("rounds", [20, 30, 45])
@pytest.mark.parametrize("typical", [0.8, 1.0, 1.25])
def test_the_time_left_of_all_phases_comes_true(
    slowness: float, rounds: int, typical: float
) -> None:
    ratios = []
    for seed in range(5):
        *moments, last = course(slowness, rounds, typical, seed)
        forecast = Forecast(PHASES)
        for now in moments:
            told = forecast.of(now).left
            assert told is not None
            if now.seconds > 0.1 * last.seconds:
                ratios.append(told / (last.seconds - now.seconds))
    within = (np.array(ratios) < TOLERANCE) & (np.array(ratios) > 1 / TOLERANCE)
    assert within.mean() > 0.95
    assert within[: len(within) // 2].mean() > 0.95


def test_the_rate_is_the_latest_and_what_is_unknown_has_one_too() -> None:
    forecast = Forecast({})
    assert forecast.of(moment("Adam", 0, 1000, 0.0)).left is None
    times = np.concatenate([np.arange(100) * 0.01, 1.0 + np.arange(400) * 0.1])
    for iteration, seconds in enumerate(times):
        told = forecast.of(moment("Adam", iteration, 1000, float(seconds))).left
    assert told == pytest.approx(0.1 * (1000 - 499), rel=0.05), "the computer became slower"


def test_a_training_that_is_continued_is_told_by_what_it_does_now() -> None:
    forecast = Forecast({"Adam": Phase(1000, 0.1)})
    for iteration in range(500, 600):
        told = forecast.of(moment("Adam", iteration, 1000, 900.0 + 0.2 * iteration)).left
    assert told == pytest.approx(0.2 * 400, rel=0.1)


def test_drawing_takes_little_of_the_time() -> None:
    pace, drawn = Pace(), []
    for _ in range(1000):
        drawn.append(pace.drawn(lambda: CURVES))
    assert drawn[0] is CURVES, "the first at once"
    assert sum(curves is not None for curves in drawn) == 1
