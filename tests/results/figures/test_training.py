"""Loss and parameters over iterations; a follower's data and curves."""

from dataclasses import replace

import numpy as np
import pytest

from accpinn.evaluation.closed_loop import closed_loop
from accpinn.methods import splines
from accpinn.methods.estimate import History
from accpinn.model.cthp import Parameters, Trajectories
from accpinn.model.registry import FOLLOWING
from accpinn.results.figures import training
from accpinn.results.tables.estimates import EVERY_FOLLOWER
from accpinn.segment.cut import cut
from tests.support.figures import named, names
from tests.support.openacc_files import recording
from tests.support.samples import NOISY, sample

SEGMENT = cut(recording(), 0.0, 30.0)
INFO = SEGMENT.info


def history(*, sets: int = 2, moments: int = 40) -> History:
    """From 1 to the final values 0.1, 0.2 and 1.2, by half each time."""
    steps = np.arange(moments, dtype=float)
    fading = 0.5**steps
    final = np.array([0.1, 0.2, 1.2])
    table = final + fading[:, None] * (1 - final)
    tables = np.repeat(table[:, None, :], sets, axis=1)
    zeros = np.zeros(moments)
    return History(steps, steps, fading + 0.01, fading, zeros + 0.01, zeros, Parameters.of(tables))


def test_a_loss_that_is_unused_zero_or_infinite_is_omitted() -> None:
    track = history()
    assert len(training.loss_history(track).data) == 3, "Ψ_R is not used"
    track.physics[:] = 0.0
    track.total[-1] = np.inf
    figure = training.loss_history(track)
    assert len(figure.data) == 2
    assert np.isfinite(figure.layout.yaxis.range).all()
    track.total[:] = track.data[:] = np.nan
    assert training.loss_history(track).layout.yaxis.range is None


def test_evidence_stands_beside_the_loss_and_gives_an_interval_that_narrows() -> None:
    track = history()
    figure = training.loss_history(replace(track, evidence=-track.total))
    line = named(figure, "log evidence")
    np.testing.assert_array_equal(line.y, track.total[-1] - track.total)
    deviations = np.repeat(track.total[:, None, None], 2, axis=1) * np.ones(3)
    band = training.parameter_history(replace(track, deviations=deviations), 0, INFO).data[0]
    assert band.fill == "toself"
    lower, upper = band.y[: len(track.total)], band.y[len(track.total) :][::-1]
    assert (np.diff(np.log(upper / lower)) < 0).all()
    assert lower[-1] < 0.1 < upper[-1]


def test_each_model_has_the_curves_of_its_own_parameters() -> None:
    track, model = history(), FOLLOWING["idm"]
    own = np.linspace(model.typical, 2 * model.typical, 40)[:, None] * [[1.0], [1.5]]
    table = Parameters.of(np.concatenate([track.parameters.complete, own], axis=2))
    truth = Parameters.of(table.everything[-1])
    figures = training.training_figures(
        replace(track, parameters=table), INFO, "idm", truth, track.parameters[-1]
    )
    assert list(figures) == ["loss", *model.names]
    for k, parameter in enumerate(model.parameters):
        figure = figures[parameter.name]
        assert figure.layout.yaxis.title.text == f"{parameter.symbol} [{parameter.unit}]"
        for follower, trace in enumerate(figure.data):
            np.testing.assert_array_equal(trace.y, own[:, follower, k])
        lines = [line.y0 for line in figure.layout.shapes]
        assert lines == truth.own[:, k].tolist(), "least squares has no such parameters"
    assert [*training.training_figures(track, INFO)] == ["loss", "alpha", "beta", "tau"]
    assert names(training.parameter_history(history(sets=1), 2, INFO)) == [EVERY_FOLLOWER]


def test_tracking_shows_data_network_and_simulation() -> None:
    curves = Trajectories(SEGMENT.time, SEGMENT.speeds + 1, SEGMENT.gaps + 1)
    figure = training.tracking(SEGMENT, 1, curves, curves)
    assert names(figure) == [*2 * ["data"], *2 * ["network"], *2 * ["closed-loop simulation"]]
    np.testing.assert_array_equal(figure.data[0].y, SEGMENT.gaps[:, 1])
    np.testing.assert_array_equal(figure.data[1].y, SEGMENT.speeds[:, 2])
    np.testing.assert_array_equal(figure.data[2].y, SEGMENT.gaps[:, 1] + 1)
    assert {*names(training.tracking(SEGMENT, 0, None, None, with_error=True))} == {"data"}
    figure = training.tracking(INFO, 0, curves, None, with_error=True)
    drawn = [(trace.name, trace.yaxis) for trace in figure.data]
    assert drawn == [("network", "y"), ("network", "y2")]


def test_the_error_has_a_panel_on_the_same_axis_of_time() -> None:
    noisy = sample(NOISY).segment
    fit = splines.fit(noisy)
    simulated = closed_loop(noisy, fit)
    figure = training.tracking(noisy, 0, fit.surrogate, simulated, "Splines", with_error=True)
    assert {figure.layout.xaxis.matches, figure.layout.xaxis2.matches} == {"x3"}
    errors = [trace for trace in figure.data if trace.yaxis == "y3"]
    assert [trace.name for trace in errors] == ["Splines", "closed-loop simulation"]
    assert np.abs(errors[1].y).max() == pytest.approx(np.abs(simulated.gaps - noisy.gaps).max())


def test_tracking_runs_in_the_recordings_time_and_marks_a_collision() -> None:
    later = replace(SEGMENT, start=320.0)
    gaps = SEGMENT.gaps.copy()
    gaps[100:] = -1.0
    colliding = Trajectories(SEGMENT.time, SEGMENT.speeds, gaps)
    assert "collision" not in names(training.tracking(later, 0, None, None, with_error=True))
    figure = training.tracking(later, 0, None, colliding, with_error=True)
    mark = named(figure, "collision")
    assert (mark.x[0], mark.y[0]) == (320.0 + SEGMENT.time[100], 0.0)
    assert any(shape.y0 == shape.y1 == 0 for shape in figure.layout.shapes)
    ends = [(trace.x[0], trace.x[-1]) for trace in figure.data if trace is not mark]
    np.testing.assert_allclose(ends, [(320.0, 350.0)] * len(ends))
