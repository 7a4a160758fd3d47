"""The values of an estimate, and the history of a training, thinned as it grows."""

from dataclasses import fields, replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from accpinn.errors import ConfigError
from accpinn.methods import estimate as module
from accpinn.methods import least_squares
from accpinn.methods.estimate import SPEEDS, History, Progress, Recorder, for_window, of_window
from accpinn.methods.findings import Undetermined
from accpinn.model.cthp import Parameters
from accpinn.model.spec import ModelSpec
from tests.support.driving import MIXED, driven
from tests.support.estimates import point


def test_a_point_has_values_by_name_and_no_intervals() -> None:
    estimate = least_squares.METHOD.fit(driven(MIXED), spec=ModelSpec("cthp-s0"))
    assert (estimate.model, estimate.level, estimate.posterior) == ("cthp-s0", None, None)
    assert estimate.numbers == (2, 3, 4)
    spans = [estimate.span(name, 1) for name in estimate.names] + [estimate.time_gap(25.0, 1)]
    np.testing.assert_allclose([span.value for span in spans[:3]], MIXED[1], rtol=1e-3)
    assert spans[-1].value == pytest.approx(spans[2].value + spans[3].value / 25.0)
    for span in spans:
        ends = span.lower, span.upper, span.further_lower, span.further_upper
        assert np.isnan(ends).all()
    assert "–" not in repr(estimate)
    with pytest.raises(ConfigError, match="lag is not known; choose from alpha"):
        estimate.span("lag", 0)
    with pytest.raises(ConfigError, match="choose 0 to 2"):
        estimate.time_gap(25.0, 3)


def test_its_gains_are_those_of_its_linearisation() -> None:
    estimate = point(driven(duration=40.0), model="idm")
    near = estimate.following.linearised(
        estimate.parameters.nonlinear[0], float(estimate.speeds[0])
    )
    alpha, beta, gap = (span.value for span in estimate.gains_and_gap(0))
    assert (alpha, beta) == pytest.approx((near.alpha, near.beta))
    assert gap == pytest.approx(near.tau + near.s0 / estimate.speeds[0])


def test_a_parameter_that_the_data_do_not_tell_is_not_determined() -> None:
    estimate = least_squares.METHOD.fit(driven(MIXED[:2]))
    undetermined = replace(estimate, findings=(Undetermined(3, "CTHP", ("β",)),))
    assert [undetermined.is_determined("beta", k) for k in (0, 1)] == [True, False]
    assert undetermined.is_determined("tau", 1)
    shared = replace(estimate, findings=(Undetermined(0, "CTHP", ("β",)),))
    assert not shared.is_determined("beta", 0)


@pytest.mark.parametrize(
    ("speeds", "stated"),
    [((25.0, 30.0), SPEEDS[1]), ((20.0, 27.0), SPEEDS[0]), ((5.0, 28.0), SPEEDS[0])],
    ids=["fast", "below 100 km/h", "mostly slow"],
)
def test_the_time_gap_is_stated_at_a_speed_that_was_driven(
    speeds: tuple[float, float], stated: float
) -> None:
    segment = driven()
    times = segment.speeds.copy()
    times[:, 1] = speeds[0]
    times[-20:, 1] = speeds[1]
    estimate = least_squares.METHOD.fit(replace(segment, speeds=times))
    assert estimate.stated_speed == stated
    assert [estimate.is_driven(speed, 0) for speed in (speeds[0] - 1, *speeds, speeds[1] + 1)] == [
        False, True, True, False,
    ]  # fmt: skip


def test_arrays_of_windows_have_their_windows_name() -> None:
    arrays = for_window({"weights": np.ones(2)}, 1) | for_window({"weights": np.zeros(2)}, 11)
    assert of_window(arrays, 1)["weights"].tolist() == [1, 1]
    assert of_window(arrays | {"unknowns": np.ones(1)}, 0) == {}


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
        patch.setattr(module, "KEPT", 20)
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
