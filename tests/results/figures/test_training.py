"""Loss and parameters over iterations; a follower's data and curves."""

from dataclasses import replace

import numpy as np
import plotly.graph_objects as go
import pytest

from accpinn.evaluation.closed_loop import closed_loop
from accpinn.methods import splines
from accpinn.methods.fit import History
from accpinn.model.cthp import Parameters, Trajectories
from accpinn.model.registry import FOLLOWING
from accpinn.results.figures import style, training
from accpinn.results.tables.estimates import EVERY_FOLLOWER
from accpinn.segment.cut import cut
from accpinn.segment.segment import Segment
from tests.support.figures import legend, named, names
from tests.support.openacc_files import recording
from tests.support.samples import NOISY, sample


@pytest.fixture
def segment() -> Segment:
    return cut(recording(), 0.0, 30.0)


def history(*, sets: int = 2, moments: int = 40) -> History:
    """From 1 to the final values 0.1, 0.2 and 1.2, by half each time."""
    steps = np.arange(moments, dtype=float)
    fading = 0.5**steps
    final = np.array([0.1, 0.2, 1.2])
    table = final + fading[:, None] * (1 - final)
    tables = np.repeat(table[:, None, :], sets, axis=1)
    zeros = np.zeros(moments)
    return History(steps, steps, fading + 0.01, fading, zeros + 0.01, zeros, Parameters.of(tables))


class TestLoss:
    def test_is_drawn_on_whole_decades(self) -> None:
        figure = training.loss_history(history())
        assert len(figure.data) == 3, "Ψ_R is not used, so it is not drawn"
        colours = {trace.line.color for trace in figure.data}
        assert colours <= {style.LEADER, *style.SERIES}, "no vehicle's"
        axis = figure.layout.yaxis
        assert axis.type == "log"
        assert axis.range[0] % 1 == 0
        assert axis.range[1] == 1, "the loss starts a little above 1"
        assert (axis.range[1] - axis.range[0]) / axis.dtick <= 7

    def test_that_is_zero_or_infinite_is_omitted(self) -> None:
        track = history()
        track.physics[:] = 0.0
        track.total[-1] = np.inf
        figure = training.loss_history(track)
        assert len(figure.data) == 2
        assert np.isfinite(figure.layout.yaxis.range).all()
        track.total[:] = track.data[:] = np.nan
        assert training.loss_history(track).layout.yaxis.range is None


class TestEvidence:
    def test_stands_beside_the_loss(self) -> None:
        track = history()
        figure = training.loss_history(replace(track, evidence=-track.total))
        (line,) = [trace for trace in figure.data if trace.name == "log evidence"]
        np.testing.assert_array_equal(line.y, -track.total)
        assert line.yaxis == "y2", "it may be negative, so it has an axis of its own"

    def test_gives_the_parameters_an_interval_that_narrows(self, segment: Segment) -> None:
        track = history()
        deviations = np.repeat(track.total[:, None, None], 2, axis=1) * np.ones(3)
        figure = training.parameter_history(replace(track, deviations=deviations), 0, segment.info)
        band = figure.data[0]
        assert band.fill == "toself"
        lower, upper = band.y[: len(track.total)], band.y[len(track.total) :][::-1]
        assert (np.diff(np.log(upper / lower)) < 0).all()
        assert lower[-1] < 0.1 < upper[-1]


class TestParameters:
    @pytest.mark.parametrize(("which", "label"), [*enumerate(("α [1/s²]", "β [1/s]", "τ [s]"))])
    def test_have_units_colours_and_lines_to_compare_with(
        self, segment: Segment, which: int, label: str
    ) -> None:
        truth = Parameters.of([[0.1, 0.2, 1.2], [0.11, 0.21, 1.21]])
        figure = training.parameter_history(history(), which, segment.info, truth, truth)
        assert figure.layout.yaxis.title.text == label
        assert names(figure) == ["2 B", "3 C"]
        colours = [trace.line.color for trace in figure.data]
        assert colours == [style.vehicle_colour(2, 1), style.vehicle_colour(3, 1)]
        lines = figure.layout.shapes
        assert [line.line.color for line in lines] == 2 * colours
        assert [line.y0 for line in lines] == 2 * truth.values[:, which].tolist()
        assert [line.line.dash for line in lines] == ["dash", "dash", "dot", "dot"]

    def test_axis_shows_the_whole_way_and_what_it_is_compared_with(self, segment: Segment) -> None:
        truth = Parameters.of([[3.0, 0.2, 1.2], [0.11, 0.21, 1.21]])
        figure = training.parameter_history(history(), 0, segment.info, truth)
        low, high = figure.layout.yaxis.range
        assert low < history().parameters.alpha.min()
        assert high > 3.0
        unknown = Parameters.of(np.full((40, 2, 3), np.nan))
        undetermined = replace(history(), parameters=unknown)
        figure = training.parameter_history(undetermined, 2, segment.info)
        assert figure.layout.yaxis.range is None

    def test_a_live_training_is_drawn_with_few_points_the_last_among_them(self) -> None:
        long = history(moments=4000)
        few = training.thinned_history(long, 300)
        assert 200 < len(few.iteration) <= 300
        assert (few.iteration[0], few.iteration[-1]) == (0, 3999)
        assert (np.diff(few.iteration) > 0).all()
        np.testing.assert_array_equal(few.total, long.total[few.iteration.astype(int)])
        assert few.evidence is None
        shared = training.parameter_history(history(sets=1), 2, cut(recording(), 0.0, 30.0).info)
        assert names(shared) == [EVERY_FOLLOWER]


class TestOtherModels:
    def test_have_the_curves_of_their_own_parameters(self, segment: Segment) -> None:
        track, model = history(), FOLLOWING["idm"]
        own = np.linspace(model.typical, 2 * model.typical, 40)[:, None] * [[1.0], [1.5]]
        near = track.parameters.complete
        table = Parameters.of(np.concatenate([near, own], axis=2))
        truth = Parameters.of(table.everything[-1])
        figures = training.training_figures(
            replace(track, parameters=table), segment.info, "idm", truth, track.parameters[-1]
        )
        assert list(figures) == ["loss", *model.names]
        for k, parameter in enumerate(model.parameters):
            figure = figures[parameter.name]
            axis = figure.layout.yaxis.title.text
            assert axis.startswith(parameter.symbol)
            assert parameter.unit in axis
            for follower, trace in enumerate(figure.data):
                np.testing.assert_array_equal(trace.y, own[:, follower, k])
            lines = [line.y0 for line in figure.layout.shapes]
            assert lines == truth.own[:, k].tolist(), "least squares has no such parameters"

    def test_a_cthp_has_alpha_beta_and_tau(self, segment: Segment) -> None:
        assert list(training.training_figures(history(), segment.info)) == [
            "loss", "alpha", "beta", "tau",
        ]  # fmt: skip


class TestTracking:
    def test_shows_data_network_and_simulation(self, segment: Segment) -> None:
        curves = Trajectories(segment.time, segment.speeds + 1, segment.gaps + 1)
        figure = training.tracking(segment, 1, curves, curves)
        assert names(figure) == [
            n for n in ("data", "network", "closed-loop simulation") for _ in range(2)
        ]
        np.testing.assert_array_equal(figure.data[0].y, segment.gaps[:, 1])
        np.testing.assert_array_equal(figure.data[1].y, segment.speeds[:, 2])
        np.testing.assert_array_equal(figure.data[2].y, segment.gaps[:, 1] + 1)
        alone = training.tracking(segment, 0, None, None, with_error=True)
        assert set(names(alone)) == {"data"}
        figure = training.tracking(segment.info, 0, curves, None, with_error=True)
        assert [(trace.name, trace.yaxis) for trace in figure.data] == [
            ("network", "y"), ("network", "y2"),
        ]  # fmt: skip

    def test_the_error_has_a_panel_on_the_same_axis_of_time(self) -> None:
        noisy = sample(NOISY).segment
        fit = splines.fit(noisy)
        simulated = closed_loop(noisy, fit)
        figure = training.tracking(noisy, 0, fit.surrogate, simulated, "Splines", with_error=True)
        assert {figure.layout.xaxis.matches, figure.layout.xaxis2.matches} == {"x3"}
        errors = [trace for trace in figure.data if trace.yaxis == "y3"]
        assert [trace.name for trace in errors] == ["Splines", "closed-loop simulation"]
        worst = np.abs(simulated.gaps - noisy.gaps).max()
        assert np.abs(errors[1].y).max() == pytest.approx(worst)
        shown = [trace.name for trace in legend(figure)]
        assert shown == ["data", "Splines", "closed-loop simulation"], "each once"

    def test_runs_in_the_recordings_time_and_marks_a_collision(self, segment: Segment) -> None:
        later = replace(segment, start=320.0)
        gaps = segment.gaps.copy()
        gaps[100:] = -1.0
        colliding = Trajectories(segment.time, segment.speeds, gaps)

        def draw(simulated: Trajectories | None) -> go.Figure:
            return training.tracking(later, 0, None, simulated, with_error=True)

        assert "collision" not in names(draw(None))
        figure = draw(colliding)
        mark = named(figure, "collision")
        assert (mark.x[0], mark.y[0]) == (320.0 + segment.time[100], 0.0)
        assert any(shape.y0 == shape.y1 == 0 for shape in figure.layout.shapes)
        for trace in figure.data:
            if trace is not mark:
                assert (trace.x[0], trace.x[-1]) == (320.0, pytest.approx(350.0))
