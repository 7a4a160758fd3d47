"""Loss and parameters over iterations; a follower's data and curves."""

from dataclasses import replace
from typing import Any

import numpy as np
import plotly.graph_objects as go

from accpinn.evaluation.closed_loop import simulated
from accpinn.methods.estimate import History
from accpinn.model.cthp import Parameters, Trajectories
from accpinn.model.registry import FOLLOWING
from accpinn.results.figures import training
from accpinn.results.figures.training import SIMULATION, curves_in
from accpinn.results.tables.estimates import EVERY_FOLLOWER
from accpinn.segment.cut import cut
from tests.support.figures import named, names
from tests.support.openacc_files import recording
from tests.support.snapshots import recommended, result_for, trained, two_windows

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


def in_panel(figure: go.Figure, panel: int) -> list[Any]:
    """The lines of a panel, without bands and marks."""
    axis = "y" if panel == 1 else f"y{panel}"
    return [t for t in figure.data if t.yaxis == axis and not t.fill and t.name != training.MARK]


def axis_of(figure: go.Figure, panel: int) -> Any:
    return figure.layout["yaxis" if panel == 1 else f"yaxis{panel}"]


def test_a_loss_that_is_unused_zero_or_infinite_is_omitted() -> None:
    track = history()
    assert len(in_panel(training.course(track, INFO), 1)) == 3, "Ψ_R is not used"
    track.physics[:] = 0.0
    track.total[-1] = np.inf
    figure = training.course(track, INFO)
    assert len(in_panel(figure, 1)) == 2
    assert np.isfinite(axis_of(figure, 1).range).all()
    track.total[:] = np.nan
    track.data[:] = 0.0
    assert axis_of(training.course(track, INFO), 1).range is None


def test_an_objective_below_zero_is_drawn_too() -> None:
    track = history()
    track.data[:] = track.physics[:] = track.initial[:] = np.nan
    track = replace(track, total=np.linspace(300.0, -200.0, 40))
    (line,) = in_panel(training.course(track, INFO), 1)
    np.testing.assert_allclose(line.y, track.total + 200.0)


def test_a_log_likelihood_stands_in_place_of_losses_and_bands_narrow() -> None:
    track = history()
    nothing = np.full(40, np.nan)
    track = replace(track, total=nothing, data=nothing, physics=nothing, initial=nothing)
    rising = -(0.5 ** np.arange(40.0))
    figure = training.course(replace(track, log_likelihood=rising), INFO)
    (line,) = in_panel(figure, 1)
    np.testing.assert_array_equal(line.y, rising - rising[-1])
    low, high = axis_of(figure, 1).range
    assert line.y[0] < low < line.y[len(line.y) // 10] < line.y[-1] <= high
    deviations = np.repeat(0.01 - rising[:, None, None], 2, axis=1) * np.ones(3)
    figure = training.course(replace(track, deviations=deviations), INFO)
    band = next(trace for trace in figure.data if trace.fill and trace.yaxis == "y2")
    lower, upper = band.y[:40], band.y[40:][::-1]
    assert (np.diff(np.log(upper / lower)) < 0).all()
    assert lower[-1] < 0.1 < upper[-1]


def test_the_course_of_an_estimate_is_drawn_whatever_it_maximises() -> None:
    for result, name in ((recommended(), "log likelihood"), (trained(), "total")):
        estimate = result.estimate
        figure = training.course(result.history, result.info, estimate.model)
        (line,) = [t for t in in_panel(figure, 1) if t.name == name]
        assert len(line.y) == len(result.history.iteration)
        assert np.isfinite(axis_of(figure, 1).range).all()
        headings = [axis_of(figure, k).title.text for k in range(2, 2 + len(estimate.names))]
        symbols = [parameter.symbol for parameter in estimate.following.parameters]
        assert [heading.partition(" ")[0] for heading in headings] == symbols


def test_each_model_has_the_curves_of_its_own_parameters() -> None:
    track, model = history(), FOLLOWING["idm"]
    own = np.linspace(model.typical, 2 * model.typical, 40)[:, None] * [[1.0], [1.5]]
    table = Parameters.of(np.concatenate([track.parameters.complete, own], axis=2))
    truth = Parameters.of(table.everything[-1])
    figure = training.course(replace(track, parameters=table), INFO, "idm", truth)
    for k, parameter in enumerate(model.parameters):
        assert axis_of(figure, k + 2).title.text == f"{parameter.symbol} [{parameter.unit}]"
        for follower, trace in enumerate(in_panel(figure, k + 2)):
            np.testing.assert_array_equal(trace.y, own[:, follower, k])
        lines = [line.y0 for line in figure.layout.shapes if line.yref == f"y{k + 2}"]
        assert lines == truth.nonlinear[:, k].tolist()
    shared = training.course(history(sets=1), INFO)
    assert {trace.name for trace in in_panel(shared, 4)} == {EVERY_FOLLOWER}


def gap_simulated(figure: go.Figure) -> Any:
    return next(trace for trace in figure.data if trace.name == SIMULATION)


def test_a_moment_is_marked_on_every_line_and_its_parameters_drive_the_simulation() -> None:
    for result in (recommended(), trained(), two_windows()):
        estimate, track = result.estimate, result.history
        last, count = len(track.iteration) - 1, len(estimate.names)
        at = training.moments_of(track)
        assert (at[0], at[-1]) == (0, last)
        assert len(at) <= training.MOMENTS + 1
        for moment in (0, last // 2, last):
            figure = training.course(track, result.info, estimate.model, moment=moment)
            marks = [trace for trace in figure.data if trace.name == training.MARK]
            assert {trace.yaxis for trace in marks} == {
                "y",
                *(f"y{k}" for k in range(2, 2 + count)),
            }
            assert {float(trace.x[0]) for trace in marks} == {float(track.iteration[moment])}
            window = len(result.segments) - 1
            line = gap_simulated(training.tracking_at(result, 0, window, moment))
            pair = result.segments[window].pair(0)
            alone = simulated(pair, estimate.model, track.parameters[moment][[0]])
            np.testing.assert_allclose(line.y, alone.gaps[:, 0])
        final = gap_simulated(training.tracking_of(result, 0, window))
        np.testing.assert_allclose(line.y, final.y, err_msg="the last is the result's own")


def test_few_of_many_moments_can_be_chosen_most_at_the_beginning() -> None:
    at = training.moments_of(history(moments=1500))
    assert (at[:3], at[-1]) == ([0, 1, 2], 1499)
    assert len(at) <= training.MOMENTS


def test_tracking_shows_data_network_and_simulation() -> None:
    curves = Trajectories(SEGMENT.time, SEGMENT.speeds + 1, SEGMENT.gaps + 1)
    alone = Trajectories(SEGMENT.time, SEGMENT.speeds[:, 1:] + 2, SEGMENT.gaps[:, 1:] + 2)
    figure = training.drive(curves_in(SEGMENT, 1, curves, alone))
    assert names(figure) == [*2 * ["data"], *3 * ["network"], *3 * [SIMULATION]]
    np.testing.assert_array_equal(figure.data[0].y, SEGMENT.gaps[:, 1])
    np.testing.assert_array_equal(figure.data[2].y, SEGMENT.gaps[:, 1] + 1)
    np.testing.assert_array_equal(figure.data[3].y, SEGMENT.speeds[:, 2] + 1)
    errors = [trace for trace in figure.data if trace.yaxis == "y3"]
    np.testing.assert_allclose([np.mean(trace.y) for trace in errors], [1.0, 2.0])
    assert {figure.layout.xaxis.matches, figure.layout.xaxis2.matches} == {"x3"}
    assert {*names(training.tracking(SEGMENT, 0))} == {"data"}


def test_the_simulation_is_that_of_the_estimate_behind_the_measured_vehicle_ahead() -> None:
    for result in (recommended(), trained()):
        estimate, segment = result.estimate, result.segments[0]
        figure = training.tracking_of(result, 1)
        pair = segment.pair(1)
        alone = simulated(pair, estimate.model, estimate.parameters[[1]])
        line = next(trace for trace in figure.data if trace.name == SIMULATION)
        np.testing.assert_allclose(line.y, alone.gaps[:, 0])
        network = next(trace for trace in figure.data if trace.name == "network")
        np.testing.assert_allclose(network.y, result.curves[0].gaps[:, 1])
        bands = [trace for trace in figure.data if trace.fill]
        assert bool(bands) == (result.posterior is not None)


def test_a_point_without_curves_has_data_and_simulation_and_each_window_its_own_chart() -> None:
    assert {*names(training.tracking_of(result_for(SEGMENT), 0))} == {"data", SIMULATION}
    result = two_windows()
    second = training.tracking_of(result, 0, 1)
    window = result.segments[1].window
    assert (second.data[0].x[0], second.data[0].x[-1]) == (window.start, window.end)
    assert not [trace for trace in second.data if trace.fill], "the band is that of the first"
    assert "disturbance" in names(second)


def test_tracking_runs_in_the_recordings_time_and_marks_a_collision() -> None:
    later = replace(SEGMENT, start=320.0)
    gaps = SEGMENT.gaps[:, :1].copy()
    gaps[100:] = -1.0
    colliding = Trajectories(SEGMENT.time, SEGMENT.speeds[:, :2], gaps)
    assert "collision" not in names(training.drive(curves_in(later, 0)))
    figure = training.drive(curves_in(later, 0, None, colliding))
    mark = named(figure, "collision")
    assert (mark.x[0], mark.y[0]) == (320.0 + SEGMENT.time[100], 0.0)
    assert any(shape.y0 == shape.y1 == 0 for shape in figure.layout.shapes)
    ends = [(trace.x[0], trace.x[-1]) for trace in figure.data if trace is not mark]
    np.testing.assert_allclose(ends, [(320.0, 350.0)] * len(ends))
