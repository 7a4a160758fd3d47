"""Bode magnitude, computed and measured, criteria along the platoon and maps: what they draw."""

from dataclasses import replace

import numpy as np
import plotly.graph_objects as go
import pytest

from accpinn.inference.intervals import Uncertainty, intervals
from accpinn.methods import splines
from accpinn.model.cthp import Parameters
from accpinn.model.published import ASTAZERO, ParameterSet
from accpinn.results.figures import stability as figures
from accpinn.stability.criteria import response
from accpinn.stability.measured_gain import measured_gain
from accpinn.stability.report import StabilityReport, VehicleStability, stability_report
from accpinn.units import FloatArray
from tests.support import draws
from tests.support.figures import legend, named, names, rectangles
from tests.support.samples import PLATOON, sample
from tests.support.vehicles import CALM, NO_REACTION, UNDAMPED, row


@pytest.fixture(scope="module")
def astazero() -> StabilityReport:
    return stability_report(ASTAZERO.parameters)


@pytest.fixture(scope="module")
def figure(astazero: StabilityReport) -> go.Figure:
    return figures.bode(ASTAZERO, astazero)


class TestBode:
    def test_curves_are_the_magnitude_in_db(self, figure: go.Figure) -> None:
        curve = named(figure, "Audi A6")
        expected = 20 * np.log10(np.abs(response(ASTAZERO.parameters[:1], np.asarray(curve.x))[0]))
        np.testing.assert_allclose(curve.y, expected, atol=1e-9)
        whole = named(figure, "Leader to last follower")
        parts = sum(np.asarray(named(figure, label).y) for label in ASTAZERO.labels)
        np.testing.assert_allclose(whole.y, parts, atol=1e-9)
        assert whole.line.dash == "dash"

    def test_peaks_and_crossovers_are_marked_on_the_curves(
        self, figure: go.Figure, astazero: StabilityReport
    ) -> None:
        peaks = [vehicle.peak for vehicle in astazero.vehicles]
        for name, x, y in (
            ("peak", [p.omega for p in peaks], [p.db for p in peaks]),
            ("crossover", [v.crossover for v in astazero.vehicles], [0.0] * 4),
        ):
            marks = named(figure, name)
            assert (list(marks.x), list(marks.y)) == (x, y)
            assert list(marks.marker.color) == list(figures.colours(ASTAZERO))
            curves = [np.interp(at, named(figure, label).x, named(figure, label).y)
                      for at, label in zip(x, ASTAZERO.labels, strict=True)]  # fmt: skip
            np.testing.assert_allclose(curves, y, atol=0.02)

    def test_every_point_says_whose_it_is(self, figure: go.Figure) -> None:
        lines = [*ASTAZERO.labels, "Leader to last follower"]
        for k, label in enumerate(lines):
            assert set(named(figure, label).customdata) == {k if k < 4 else -1}
            assert "markers" in named(figure, label).mode, "lines alone cannot be clicked"
        assert list(named(figure, "peak").customdata) == [0, 1, 2, 3]
        assert [trace.name for trace in legend(figure)] == lines

    def test_the_amplified_range_is_shaded_from_0_db_up(
        self, figure: go.Figure, astazero: StabilityReport
    ) -> None:
        (area,), (low, high) = rectangles(figure), figure.layout.yaxis.range
        assert (area.y0, area.y1) == (0, high)
        assert low < figures.FLOOR < astazero.platoon.peaks[-1].db < high


@pytest.mark.parametrize("vehicle", [UNDAMPED, NO_REACTION, Parameters(1e-4, 0.01, 0.1)])
def test_extreme_vehicles_stay_in_sight(vehicle: Parameters) -> None:
    pair = ParameterSet("Mine", ("<b>odd</b>", "calm"), row(vehicle, CALM))
    report = stability_report(pair.parameters)
    figure = figures.bode(pair, report)
    assert np.isfinite(figure.layout.yaxis.range).all()
    assert figure.layout.yaxis.range[1] <= figures.CEILING
    for trace in figure.data[:2]:
        assert np.isfinite(trace.y).all()
    plane = figures.stability_map(pair, report, 0, "beta")
    assert np.isfinite(plane.layout.yaxis.range).all()
    for drawn in (figure, plane, figures.criteria_by_vehicle(pair, report)):
        assert "<b>" not in drawn.to_json(), "names from files are no HTML"


class TestCriteria:
    def test_are_those_of_each_vehicle(self, astazero: StabilityReport) -> None:
        figure = figures.criteria_by_vehicle(ASTAZERO, astazero)
        expected = {
            "L₂ criterion": [v.l2.value for v in astazero.vehicles],
            "L∞ criterion of the paper": [v.linf_paper.value for v in astazero.vehicles],
            "Peak of |H|": [v.peak.gain for v in astazero.vehicles],
            "Exact L∞ gain ‖h‖₁": [v.linf_gain for v in astazero.vehicles],
            "|H| from the leader": [peak.gain for peak in astazero.platoon.peaks],
            "‖h‖₁ from the leader": list(astazero.platoon.linf.gain),
        }
        assert {trace.name: list(trace.y) for trace in figure.data} == expected
        assert all(list(trace.x) == [1, 2, 3, 4] for trace in figure.data)
        levels = [shape.y0 for shape in figure.layout.shapes]
        assert levels == [0, 1], "one line a panel between stable and unstable"

    def test_vehicles_go_by_their_labels(self, astazero: StabilityReport) -> None:
        ours = ParameterSet("run", ("X", "Y"), row(CALM, CALM), (3, 4, 5), ("4 X", "5 Y"))
        report = stability_report(ours.parameters)
        assert figures.criteria_by_vehicle(ours, report).layout.xaxis2.ticktext == ours.labels
        axis = figures.criteria_by_vehicle(ASTAZERO, astazero).layout.xaxis2
        assert tuple(name.replace("<br>", " ") for name in axis.ticktext) == ASTAZERO.labels


class TestMap:
    @pytest.mark.parametrize("plane", ["beta", "alpha"])
    @pytest.mark.parametrize("held", [0, 3])
    def test_boundaries_separate_stable_from_unstable(
        self, astazero: StabilityReport, plane: figures.Plane, held: int
    ) -> None:
        def verdicts(vehicle: VehicleStability) -> dict[str, bool]:
            verdicts = (vehicle.l2, vehicle.linf_paper, vehicle.linf_exact)
            return dict(zip(figures.BOUNDARIES, (v.stable for v in verdicts), strict=True))

        figure = figures.stability_map(ASTAZERO, astazero, held, plane)
        kept = ASTAZERO.parameters[held]
        for name in figures.BOUNDARIES:
            line = named(figure, name)
            for x, tau in list(zip(line.x, line.y, strict=True))[20::60]:
                if tau <= 0:
                    continue
                gains = (kept.alpha, x) if plane == "beta" else (x, kept.beta)
                pair = Parameters.of([[*gains, tau * 0.999], [*gains, tau * 1.001]])
                below, above = map(verdicts, stability_report(pair).vehicles)
                assert (below[name], above[name]) == (False, True)

    def test_shows_every_vehicle_and_fills_the_one_it_is_about(
        self, astazero: StabilityReport
    ) -> None:
        figure = figures.stability_map(ASTAZERO, astazero, 1, "beta")
        dots, (_, high) = figure.data[-1], figure.layout.yaxis.range
        assert list(dots.x) == ASTAZERO.parameters.beta.tolist()
        assert list(dots.y) == ASTAZERO.parameters.tau.tolist()
        assert list(dots.marker.symbol) == ["circle-open", "circle", "circle-open", "circle-open"]
        assert max(dots.x) <= figure.layout.xaxis.range[1]
        assert max(*dots.y, astazero.vehicles[1].smallest_tau.linf_exact) <= high
        assert figure.layout.xaxis.title.text == "β, gain on relative speed [1/s]"
        assert [trace.name for trace in legend(figure)] == list(figures.BOUNDARIES)

    def test_areas_do_not_overlap_and_hatch_where_the_paper_differs(
        self, astazero: StabilityReport
    ) -> None:
        figure = figures.stability_map(ASTAZERO, astazero, 3, "beta")
        areas = [np.asarray(trace.y) for trace in figure.data if trace.line.width == 0]
        l2_unstable, only_linf, stable, *hatched = areas[1:]
        assert (l2_unstable <= only_linf + 1e-12).all()
        assert (only_linf <= stable).all()
        assert (hatched[0] <= hatched[1]).all()
        assert (hatched[0] < hatched[1]).any(), "the paper's criterion calls the Tesla stable"


@pytest.fixture(scope="module")
def learned() -> tuple[ParameterSet, Uncertainty]:
    segment = sample(PLATOON).segment
    fit = splines.fit(segment)
    with draws.as_users_have():  # shares of draws need many that differ
        uncertainty = intervals(segment, fit)
    return ParameterSet("Learned", segment.names[1:], fit.parameters), uncertainty


class TestUncertainty:
    def test_bands_hold_nine_tenths_of_the_draws_beneath_the_curves(
        self, learned: tuple[ParameterSet, Uncertainty]
    ) -> None:
        vehicles, uncertainty = learned
        report = stability_report(vehicles.parameters)
        before = figures.bode(vehicles, report)
        figure = figures.bode(vehicles, report, uncertainty)
        assert names(figure)[len(vehicles) :] == names(before)
        assert figure.layout == before.layout
        for k in range(len(vehicles)):
            band = named(figure, f"band {k}")
            (omega, _), (low, high) = (np.reshape(axis, (2, -1)) for axis in (band.x, band.y))
            high = high[::-1]
            drawn = np.abs(response(uncertainty.draws[:, k], omega))
            drawn = 20 * np.log10(drawn)
            # Ends are rounded to 0.001 dB: once what lies so close counts as inside, once not.
            within = ((low - 1e-3 <= drawn) & (drawn <= high + 1e-3)).mean(axis=0)
            deep = ((low + 1e-3 <= drawn) & (drawn <= high - 1e-3)).mean(axis=0)
            assert (within > uncertainty.level - 0.01).all()
            assert (deep < uncertainty.level + 0.01).all()
            assert (high - low > 0.05).any()
        draws = uncertainty.draws.values.copy()
        draws[:, 0] = np.nan
        unknown = replace(uncertainty, draws=Parameters.of(draws))
        assert "band 0" not in names(figures.bode(vehicles, report, unknown))

    @pytest.mark.parametrize(("plane", "column"), [("beta", 1), ("alpha", 0)])
    def test_clouds_are_draws(
        self, learned: tuple[ParameterSet, Uncertainty], plane: figures.Plane, column: int
    ) -> None:
        vehicles, uncertainty = learned
        report = stability_report(vehicles.parameters)
        cloud = named(figures.stability_map(vehicles, report, 0, plane, uncertainty), "cloud 1")
        assert len(cloud.x) <= figures.CLOUD
        drawn = uncertainty.draws.values[:, 1][:, [column, 2]]
        for x, y in zip(cloud.x[:20], cloud.y[:20], strict=True):
            assert np.abs(drawn - [x, y]).sum(axis=1).min() < 1e-3

    def test_draws_that_have_no_place_on_the_map_are_counted(
        self, learned: tuple[ParameterSet, Uncertainty]
    ) -> None:
        vehicles, uncertainty = learned
        chart = figures.stability_map(vehicles, stability_report(vehicles.parameters), 0, "beta")

        def caption(draws: FloatArray) -> str:
            changed = replace(uncertainty, draws=Parameters.of(draws))
            return figures.cloud_caption(chart, changed, "beta")

        draws = uncertainty.draws.values.copy()
        draws[..., 1:] = 0.1, 1.0
        assert "%" not in caption(draws)
        count = len(draws)
        draws[: count // 10, 0, 2] = 99.0
        assert f"{10 / len(vehicles):.0f} % of them lie beyond" in caption(draws)
        assert "%" not in caption(np.full_like(draws, np.nan))


def test_measured_points_with_bars_stand_over_the_models_curve_and_band() -> None:
    measured, audi = measured_gain(sample(PLATOON).segment, 0), ASTAZERO.parameters[0]
    model = figures.Model("Audi", audi, ASTAZERO.parameters)
    figure = figures.measured_bode(measured, "<2> Audi", "#0c7eae", model)
    points, clear = named(figure, "&lt;2&gt; Audi, measured"), measured.coherent
    np.testing.assert_array_equal(points.x, measured.omega[clear])
    np.testing.assert_allclose(points.y, 20 * np.log10(measured.gain[clear]))
    upper = 10 ** ((np.asarray(points.y) + points.error_y.array) / 20)
    np.testing.assert_allclose(upper, measured.upper[clear])
    faint = named(figure, "&lt;2&gt; Audi, measured, not coherent")
    assert len(faint.x) == (~clear).sum()
    assert faint.opacity < points.opacity
    curve = named(figure, "Audi, model")
    gain = np.abs(response(ASTAZERO.parameters[:1], np.asarray(curve.x)))[0]
    np.testing.assert_allclose(curve.y, 20 * np.log10(gain))
    assert len(legend(figure)) == 3
    (area,) = (trace for trace in figure.data if trace.fill == "toself")
    assert np.isfinite(area.y).all()
    alone = figures.measured_bode(measured, "BMW", "#d8660c")
    assert not any(trace.fill or "model" in trace.name for trace in alone.data)
