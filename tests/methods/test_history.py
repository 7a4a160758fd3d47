"""The history of a training, thinned as it grows."""

from dataclasses import fields

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from accpinn.methods import history
from accpinn.methods.history import History, Progress, Recorder
from accpinn.model.cthp import Parameters


def moment(iteration: int) -> Progress:
    return Progress(
        phase="Adam",
        iteration=iteration,
        iterations=1_000_000,
        seconds=0.5 * iteration,
        total=6.0 + iteration,
        data=1.0 + iteration,
        physics=2.0 + iteration,
        initial=3.0,
        parameters=Parameters.of(np.full((2, 3), float(iteration))),
    )


def recorded(count: int) -> Recorder:
    recorder = Recorder()
    for iteration in range(count):
        recorder.add(moment(iteration))
    return recorder


def test_keeps_everything_while_it_is_short() -> None:
    kept = recorded(3).history()
    assert kept.iteration.tolist() == [0, 1, 2]
    assert kept.seconds.tolist() == [0, 0.5, 1]
    assert kept.total.tolist() == [6, 7, 8]
    assert kept.data.tolist() == [1, 2, 3]
    assert kept.physics.tolist() == [2, 3, 4]
    assert kept.initial.tolist() == [3, 3, 3]
    assert kept.parameters.values.shape == (3, 2, 3)
    assert kept.parameters.values[:, 0, 0].tolist() == [0, 1, 2]


@given(st.integers(1, 400))
def test_first_and_last_stay_and_the_length_is_bounded(count: int) -> None:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(history, "KEPT", 20)
        iterations = recorded(count).history().iteration
    assert iterations[0] == 0
    assert iterations[-1] == count - 1
    assert len(iterations) <= 20
    assert (np.diff(iterations) > 0).all()
    assert len(iterations) >= min(count, 10)


@given(st.integers(30, 400))
def test_what_is_kept_is_spread_evenly(count: int) -> None:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(history, "KEPT", 20)
        steps = np.diff(recorded(count).history().iteration)
    # The latest moment is extra, and one thinning may have kept such a moment.
    assert steps.max() <= 2 * np.median(steps)


@given(st.integers(1, 150), st.integers(1, 150))
def test_goes_on_from_its_state_as_if_never_interrupted(before: int, after: int) -> None:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(history, "KEPT", 20)
        straight = recorded(before + after).history()
        second = Recorder()
        second.restore(recorded(before).state())
        for iteration in range(before, before + after):
            second.add(moment(iteration))
        resumed = second.history()
    for name in (field.name for field in fields(History)):
        assert np.all(getattr(resumed, name) == getattr(straight, name))
