"""The history of a training, thinned as it grows."""

from dataclasses import fields

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from accpinn.methods import fit
from accpinn.methods.estimate import History, Progress, Recorder
from accpinn.model.cthp import Parameters


def recorded(iterations: range, recorder: Recorder | None = None) -> Recorder:
    """A recorder that has seen these iterations; Ψ and its terms are their numbers and more."""
    recorder = recorder or Recorder()
    for k in iterations:
        parameters = Parameters.of(np.full((2, 3), float(k)))
        recorder.add(
            Progress("Adam", k, 1_000_000, 0.5 * k, 6.0 + k, 1.0 + k, 2.0 + k, 3.0, parameters)
        )
    return recorder


@settings(max_examples=30)
@given(st.integers(1, 200), st.integers(0, 200))
def test_the_history_is_bounded_evenly_spread_and_goes_on_from_its_state(
    before: int, after: int
) -> None:
    count, second = before + after, Recorder()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(fit, "KEPT", 20)
        straight = recorded(range(count)).history()
        second.restore(recorded(range(before)).state())
        resumed = recorded(range(before, count), second).history()
    for name in (field.name for field in fields(History)):
        assert np.all(getattr(resumed, name) == getattr(straight, name))
    iterations, steps = straight.iteration, np.diff(straight.iteration)
    assert (iterations[0], iterations[-1]) == (0, count - 1)
    assert min(count, 10) <= len(iterations) <= 20
    assert (steps > 0).all()
    if count >= 30:  # the latest moment is extra, and one thinning may have kept such a moment
        assert steps.max() <= 2 * np.median(steps)
