"""Bode magnitude, computed and measured, criteria along the platoon and maps: what they draw."""

from dataclasses import replace

import numpy as np
import plotly.graph_objects as go
import pytest

from accpinn.inference.intervals import Uncertainty, gain_band
from accpinn.model.cthp import Parameters
from accpinn.model.published import ASTAZERO, ParameterSet
from accpinn.model.registry import FOLLOWING
from accpinn.results.figures import comparison as models
from accpinn.results.figures import control
from accpinn.results.figures import stability as figures
from accpinn.stability import stability_at, stability_report
from accpinn.stability.criteria import response
from accpinn.stability.measured_gain import measured_gain
from accpinn.stability.region import AXES, Plane, stable_region
from accpinn.study.vehicles import AssessedVehicles, assessed_vehicles
from accpinn.units import FloatArray
from tests.support.figures import legend, named, names, rectangles
from tests.support.samples import PLATOON, sample
from tests.support.snapshots import recommended, result_for
from tests.support.vehicles import CALM, NO_REACTION, UNDAMPED, row

REPORT = stability_report(ASTAZERO.parameters)
LABELS = ASTAZERO.labels
IDM = np.array([0.6, 1.6, 0.9, 3.0, 45.0])


def decibels(vehicles: Parameters, omega: object) -> FloatArray:
    return 20 * np.log10(np.abs(response(vehicles, np.asarray(omega))))


@pytest.fixture(scope="module")
def figure() -> go.Figure:
    return figures.bode(AssessedVehicles(ASTAZERO))


def test_bode_curves_are_the_magnitude_in_db_with_their_vehicle(figure: go.Figure) -> None:
    curves = [named(figure, label) for label in LABELS]
    np.testing.assert_allclose(
        curves[0].y, decibels(ASTAZERO.parameters[:1], curves[0].x)[0], atol=1e-9
    )
    whole = named(figure, "All cars in order")
    np.testing.assert_allclose(whole.y, np.sum([curve.y for curve in curves], axis=0), atol=1e-9)
    assert [{*curve.customdata} for curve in (*curves, whole)] == [{0}, {1}, {2}, {3}, {-1}]
    assert [trace.name for trace in legend(figure)] == [*LABELS, whole.name]


def test_peaks_and_crossovers_are_marked_on_the_curves_and_amplification_is_shaded(
    figure: go.Figure,
) -> None:
    peaks = [vehicle.peak for vehicle in REPORT.vehicles]
    for name, x, y in (
        ("peak", [p.omega for p in peaks], [p.db for p in peaks]),
        ("crossover", [v.crossover for v in REPORT.vehicles], [0.0] * 4),
    ):
        marks = named(figure, name)
        assert (list(marks.x), list(marks.y)) == (x, y)
        curves = [np.interp(at, named(figure, label).x, named(figure, label).y)
                  for at, label in zip(x, LABELS, strict=True)]  # fmt: skip
        np.testing.assert_allclose(curves, y, atol=0.02)
    (area,), (low, high) = rectangles(figure), figure.layout.yaxis.range
    assert (area.y0, area.y1) == (0, high)
    assert low < figures.FLOOR < REPORT.platoon.peaks[-1].db < high


@pytest.mark.parametrize("vehicle", [UNDAMPED, NO_REACTION, Parameters(1e-4, 0.01, 0.1)])
def test_extreme_vehicles_stay_in_sight(vehicle: Parameters) -> None:
    pair = ParameterSet("Mine", ("odd", "calm"), row(vehicle, CALM))
    figure = figures.bode(AssessedVehicles(pair))
    plane = figures.stability_map(AssessedVehicles(pair), 0, "beta")
    assert figure.layout.yaxis.range[1] <= figures.CEILING
    drawn = [trace.y for trace in figure.data[:2]]
    for shown in (*drawn, figure.layout.yaxis.range, plane.layout.yaxis.range):
        assert np.isfinite(shown).all()


def test_criteria_are_those_of_each_vehicle() -> None:
    figure = figures.criteria_by_vehicle(AssessedVehicles(ASTAZERO))
    assert {trace.name: list(trace.y) for trace in figure.data} == {
        "L₂ criterion": [v.l2.value for v in REPORT.vehicles],
        "L∞ criterion of the paper": [v.linf_paper.value for v in REPORT.vehicles],
        "Peak of |H|": [v.peak.gain for v in REPORT.vehicles],
        "Exact L∞ gain ‖h‖₁": [v.linf_gain for v in REPORT.vehicles],
        "|H| from the leader": [peak.gain for peak in REPORT.platoon.peaks],
        "‖h‖₁ from the leader": list(REPORT.platoon.linf.gain),
    }
    shown = figure.layout.xaxis2.ticktext
    assert tuple(name.replace("<br>", " ") for name in shown) == LABELS


@pytest.mark.parametrize("plane", AXES)
@pytest.mark.parametrize("delay", [0.0, 0.5])
def test_boundaries_are_those_of_the_region(plane: Plane, delay: float) -> None:
    """Which the verdicts on either side of it confirm, see `tests.stability.test_region`."""
    late = replace(ASTAZERO, parameters=Parameters(*ASTAZERO.parameters.values.T, delay=delay))
    figure = figures.stability_map(AssessedVehicles(late), 3, plane)
    (_, right), (_, top) = figure.layout.xaxis.range, figure.layout.yaxis.range
    region = stable_region(late.parameters[3], plane, right, top)
    for name, limits in (
        ("L₂", region.l2), ("L∞, paper", region.paper), ("L∞, exact", region.linf)
    ):  # fmt: skip
        line = named(figure, name)
        np.testing.assert_array_equal(line.x, region.across)
        np.testing.assert_array_equal(line.y, limits.lower)
    held = figure.layout.annotations[-1].text
    assert ("d 0.5 s" in held) == (delay > 0)
    assert LABELS[3] in held


def test_margins_and_poles_are_those_of_the_vehicles() -> None:
    subject = AssessedVehicles(ASTAZERO)
    forest, places = control.margin_forest(subject), control.pole_map(subject)
    for label, margin, modes in zip(LABELS, subject.margins.vehicles, subject.modes, strict=True):
        for norm, one in (("L₂", margin.l2), ("L∞, exact", margin.linf)):
            assert named(forest, f"{label}, {norm}").x[0] == one.distance.value
        assert list(named(places, f"{label}, pole").x) == list(modes.poles.real)
    never = ParameterSet("Mine", ("late", "calm"), row(Parameters(0.1, 0.4, 1.2, delay=2.0), CALM))
    forest = control.margin_forest(AssessedVehicles(never))
    mark = named(forest, "late, L₂")
    assert mark.marker.symbol == "triangle-left"
    assert mark.x[0] == forest.layout.xaxis.range[0]


@pytest.fixture(scope="module")
def learned() -> tuple[ParameterSet, Uncertainty]:
    subject = assessed_vehicles(recommended())
    return subject.vehicles, subject.uncertainty


def test_bands_are_those_of_the_gain_beneath_the_curves(
    learned: tuple[ParameterSet, Uncertainty],
) -> None:
    vehicles, uncertainty = learned
    before, figure = (
        figures.bode(AssessedVehicles(vehicles, known)) for known in (None, uncertainty)
    )
    assert names(figure)[len(vehicles) :] == names(before)
    for k in range(len(vehicles)):
        band = named(figure, f"band {k}")
        (omega, _), (low, high) = (np.reshape(axis, (2, -1)) for axis in (band.x, band.y))
        expected = gain_band(uncertainty, k, omega)
        np.testing.assert_allclose(low, 20 * np.log10(expected.lower), atol=1e-3)
        np.testing.assert_allclose(high[::-1], 20 * np.log10(expected.upper), atol=1e-3)
    unknown = uncertainty.draws.values.copy()
    unknown[:, 0] = np.nan
    unknown = replace(uncertainty, draws=Parameters.of(unknown))
    assert "band 0" not in names(figures.bode(AssessedVehicles(vehicles, unknown)))


@pytest.mark.parametrize(("plane", "column"), [("beta", 1), ("alpha", 0)])
def test_clouds_are_draws_and_those_without_a_place_on_the_map_are_counted(
    learned: tuple[ParameterSet, Uncertainty], plane: Plane, column: int
) -> None:
    vehicles, uncertainty = learned
    figure = figures.stability_map(AssessedVehicles(vehicles, uncertainty), 0, plane)
    cloud, drawn = named(figure, "cloud 1"), uncertainty.draws.values[:, 1][:, [column, 2]]
    assert len(cloud.x) <= figures.CLOUD
    for x, y in zip(cloud.x[:20], cloud.y[:20], strict=True):
        assert np.abs(drawn - [x, y]).sum(axis=1).min() < 1e-3

    def caption(draws: FloatArray) -> str:
        changed = replace(uncertainty, draws=Parameters.of(draws))
        return figures.cloud_caption(figure, changed, plane)

    moved = uncertainty.draws.values.copy()
    moved[..., column], moved[..., 2] = 0.1, 1.0
    assert "%" not in caption(moved)
    moved[: len(moved) // 10, 0, 2] = 99.0
    assert f"{10 / len(vehicles):.0f} % of them lie beyond" in caption(moved)
    assert "%" not in caption(np.full_like(moved, np.nan))


def test_measured_points_with_bars_stand_over_the_models_curve_and_band() -> None:
    measured = measured_gain(sample(PLATOON).segment, 0)
    figure = figures.measured_bode(measured, "2 Audi", "#0c7eae", AssessedVehicles(ASTAZERO))
    points, clear = named(figure, "2 Audi, measured"), measured.coherent
    np.testing.assert_array_equal(points.x, measured.omega[clear])
    np.testing.assert_allclose(points.y, 20 * np.log10(measured.gain[clear]))
    upper = 10 ** ((np.asarray(points.y) + points.error_y.array) / 20)
    np.testing.assert_allclose(upper, measured.upper[clear])
    faint = named(figure, "2 Audi, measured, not coherent")
    assert len(faint.x) == (~clear).sum()
    curve = named(figure, "Audi A6, model")
    np.testing.assert_allclose(curve.y, decibels(ASTAZERO.parameters[:1], curve.x)[0])


def test_the_measured_gain_of_a_points_vehicles_is_drawn_at_recorded_speeds_alone() -> None:
    subject = assessed_vehicles(result_for(sample(PLATOON).segment))
    shown = figures.measured_of(subject)
    assert [label for label, _, _ in shown] == [*subject.vehicles.labels]
    assert figures.measured_of(replace(subject, speed=20.0)) == []
    assert f"{subject.vehicles.labels[0]}, measured" in names(figures.bode(subject))


def test_the_peak_gain_over_speed_has_its_band_and_the_recorded_speeds() -> None:
    """Each is that of the model's linearisation at the speed."""
    idm = FOLLOWING["idm"]
    drawn = IDM * np.exp(0.05 * np.random.default_rng(0).standard_normal((200, 5)))
    follower = models.Follower("A", "#0c7eae", idm, IDM, drawn)
    figure = models.peak_over_speed([follower], (15.0, 25.0), 20.0)
    band, curve = figure.data
    lower, upper = band.y[: models.SPEEDS], band.y[models.SPEEDS :][::-1]
    assert ((lower <= curve.y) & (curve.y <= upper)).all()
    assert lower[0] < curve.y[0] < upper[0]
    peaks = [stability_at(idm, IDM, kmh / 3.6).peak.db for kmh in curve.x[::6]]
    np.testing.assert_allclose(curve.y[::6], peaks)
    (recorded,) = rectangles(figure)
    np.testing.assert_allclose([recorded.x0, recorded.x1], [54.0, 90.0])
