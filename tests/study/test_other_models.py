"""Models other than the paper's: every way to ask for one, and every place that shows it."""

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from accpinn import fit, report, save, verify
from accpinn.errors import ParameterError
from accpinn.methods.findings import Undetermined
from accpinn.methods.registry import METHODS
from accpinn.model.cthp import Parameters
from accpinn.model.published import ParameterSet
from accpinn.model.registry import FOLLOWING
from accpinn.model.spec import ModelSpec
from accpinn.platoon import simulate_platoon
from accpinn.platoon.leader import Brake, Sinusoid
from accpinn.recordings.files import read
from accpinn.results.cast import Cast
from accpinn.results.documents import parameter_card
from accpinn.results.figures.platoon import profiles
from accpinn.results.messages.platoon import by_linearisation
from accpinn.results.report import training_pictures
from accpinn.segment import Segment
from accpinn.segment.cut import cut
from accpinn.stability import stability_report
from accpinn.study.result import Result
from accpinn.study.snapshot import load, to_bytes
from accpinn.study.vehicles import assessed_vehicles
from tests.support.command import STUDY, Capture, document
from tests.support.following import driven
from tests.support.openacc_files import csv, metadata

IDM = np.array([[1.2, 1.6, 1.1, 3.0, 40.0]])


def file_of(path: Path, key: str, theta: np.ndarray, seconds: float = 120.0) -> Path:
    """A recording of a vehicle that drives by a model behind another one."""
    (run,) = driven(FOLLOWING[key], theta, 3, noise=0.03, seconds=seconds)
    columns = {"Time": run.time, "Speed1": run.speeds[:, 0], "Speed2": run.speeds[:, 1]}
    frame = pd.DataFrame({**columns, "IVS1": run.gaps[:, 0]})
    path.write_bytes(csv(frame, metadata(("Lead", "Car"))))
    return path


@cache
def idm_result(folder: Path) -> Result:
    """An IDM's recording, estimated as one."""
    return fit(file_of(folder / "idm.csv", "idm", IDM), model="idm")


@pytest.fixture(scope="session")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("models")


def test_an_idm_is_found_with_its_intervals(folder: Path) -> None:
    result = idm_result(folder)
    assert (result.analysis.method, result.analysis.has_posterior) == ("simulation", True)
    estimate = result.estimate
    np.testing.assert_allclose(result.parameters.nonlinear, IDM, rtol=0.15)
    assert (estimate.model, estimate.names) == ("idm", FOLLOWING["idm"].names)
    for name, true in zip(estimate.names, IDM[0], strict=True):
        span = estimate.span(name, 0)
        assert span.further_lower < span.lower < true < span.upper < span.further_upper
    for speed in (50 / 3.6, 100 / 3.6):
        true = FOLLOWING["idm"].equilibrium_gaps(IDM[0], speed) / speed
        assert estimate.time_gap(speed, 0).value == pytest.approx(true, rel=0.05)
    assert result.trust[0].is_reproduced
    assert result.evaluation.closed_loop.gap_mae[0] < 0.2
    assert result.evaluation.surrogate is None, "its curves are that simulation"


def test_several_windows_of_an_idm_are_simulated_by_one_set(folder: Path) -> None:
    windows = tuple(driven(FOLLOWING["idm"], IDM, seed, 0.03, 60.0)[0] for seed in (1, 2))
    for fixed in ({}, {"v0": 40.0, "b": 1.6}):
        result = fit(windows, model="idm", fixed=fixed)
        estimate = result.estimate
        np.testing.assert_allclose(estimate.parameters.nonlinear, IDM, rtol=0.15)
        assert estimate.windows.nonlinear.shape == (2, 1, 5)
        assert [curves.time[-1] for curves in estimate.curves] == [60.0, 60.0]
        for name, value in fixed.items():
            span = estimate.span(name, 0)
            assert (span.lower, span.value, span.upper) == pytest.approx((value,) * 3)
        assert not any(isinstance(finding, Undetermined) for finding in result.findings)
        for segment, motion in zip(windows, result.simulated, strict=True):
            assert np.abs(motion.gaps - segment.gaps).mean() < 0.2


def test_whatever_follows_is_that_of_its_linearisation(folder: Path) -> None:
    result = idm_result(folder)
    speed = float(result.estimate.speeds[0])
    near = FOLLOWING["idm"].linearised(result.parameters.nonlinear[0], speed)
    subject = assessed_vehicles(result)
    np.testing.assert_allclose(subject.vehicles.parameters.complete[0], near.complete)
    np.testing.assert_allclose(subject.uncertainty.draws.nonlinear.shape[-1], 5)
    true = FOLLOWING["idm"].linearised(IDM[0], speed)
    lower, upper = subject.uncertainty.lower.complete[0], subject.uncertainty.upper.complete[0]
    inside = (lower <= true.complete) & (true.complete <= upper)
    assert inside[:4].all()
    assert result.stability.vehicles[0].parameters.values == pytest.approx(near.values)
    at_speed = subject.at_speed(15.0)
    slower = FOLLOWING["idm"].linearised(result.parameters.nonlinear[0], 15.0)
    np.testing.assert_allclose(at_speed.vehicles.parameters.complete[0], slower.complete)
    assert at_speed.uncertainty.probability_l2.shape == (1,)


def test_the_margin_is_that_of_the_linearisation_at_the_speed(folder: Path) -> None:
    result = idm_result(folder)
    model, theta = FOLLOWING["idm"], result.parameters.nonlinear[0]
    for speed in (15.0, 25.0):
        (found,) = result.margin(speed).vehicles
        near = model.linearised(theta, speed)
        (said,) = stability_report(near[None]).vehicles
        assert found.time_gap.value == pytest.approx(near.tau + near.s0 / speed)
        assert found.l2.distance.value == pytest.approx(near.tau - said.smallest_tau.l2)
        assert found.l2.distance.lower < found.l2.distance.upper
        there = assessed_vehicles(result).at_speed(speed).margins.vehicles[0]
        assert there.l2.distance.value == pytest.approx(found.l2.distance.value)
    (own,) = result.margin().vehicles
    assert own == assessed_vehicles(result).margins.vehicles[0]
    for speed in (0.0, -3.0, np.nan, 200.0):
        with pytest.raises(ParameterError):
            result.margin(speed)


def test_a_small_disturbance_grows_as_linearised_and_a_large_one_does_not() -> None:
    near = FOLLOWING["idm"].linearisations(IDM.T, 20.0)[[0] * 3]
    small, large = (
        simulate_platoon(near, Sinusoid(0.2, size, 20.0, duration=200), model="idm").amplitudes
        for size in (0.05, 6.0)
    )
    np.testing.assert_allclose(small.measured, small.predicted, rtol=5e-3)
    assert abs(large.measured[-1] / large.predicted[-1] - 1) > 0.02
    braking = simulate_platoon(
        near, Brake(1e-3, 1.0, 6.0, 1.0, speed=20.0, duration=100), model="idm"
    )
    np.testing.assert_allclose(braking.linear.speeds, braking.trajectories.speeds, atol=1e-4)
    cast = Cast(ParameterSet("", tuple("abc"), near, model="idm"), (0, 1, 2))
    drawn = profiles(braking, cast, linear=braking.linear)
    dashed = [line.y for line in drawn.data if line.line.dash == "dash"]
    assert len(dashed) == 6
    np.testing.assert_allclose(dashed[0].min(), braking.linear.speeds[:, 1].min(), rtol=1e-6)
    assert "72 km/h" in by_linearisation(braking)
    with pytest.raises(ParameterError, match="no equilibrium at 60 m/s"):
        simulate_platoon(near, Sinusoid(0.2, 1.0, 60.0), model="idm")


def test_a_snapshot_of_it_is_the_same_and_is_confirmed(folder: Path) -> None:
    result = idm_result(folder)
    place = save(result, folder / "idm.accpinn.zip")
    loaded = load(place)
    assert loaded.parameters == result.parameters
    assert loaded.posterior.typical == result.posterior.typical
    assert loaded.estimate.spec == ModelSpec("idm")
    assert verify(place, folder / "idm.csv").ok
    other = replace(loaded.estimate, parameters=Parameters.of(1.01 * loaded.parameters.everything))
    assert not verify(to_bytes(replace(loaded, estimate=other))).ok
    assert "IDM" in report(result, folder / "idm.html").read_text()
    assert set(result.posterior.to_frame().columns) >= set(FOLLOWING["idm"].names)
    card = parameter_card(result)
    assert "s* = s₀ + v T" in card["model"]["equations"][1]
    values = [card["vehicles"][0][named["name"]]["value"] for named in card["model"]["parameters"]]
    np.testing.assert_array_equal(values, result.parameters.nonlinear[0])
    assert "idm" in repr(result.estimate)
    assert str(result).count("\n") <= 10


def test_the_network_learns_it_where_a_preset_is_named_and_commands_have_its_parameters(
    capsys: Capture, folder: Path
) -> None:
    key = "idm-delay"
    names = FOLLOWING[key].names
    truth, start = np.array([[*IDM[0], 0.4]]), [1, 1, 1, 3, 40, 1]
    path, out = file_of(folder / f"{key}.csv", key, truth, 70.0), folder / f"{key}.accpinn.zip"
    options = ("--model", key, "--preset", "fast", "--fixed", "v0=40")
    options += ("--initial", ",".join(map(str, start)))
    printed = document(capsys, "fit", path, *options, "--out", out)
    assert (printed["model"], printed["method"], printed["intervals"]) == (key, "pinn", None)
    loaded = load(out)
    assert loaded.estimate.model == key
    np.testing.assert_allclose(loaded.parameters.nonlinear, truth, rtol=0.15)
    np.testing.assert_allclose(loaded.history.parameters.nonlinear[0, 0], start)
    assert loaded.history.parameters[-1] == loaded.parameters
    assert [printed["parameters"][0][name] for name in names] == pytest.approx(
        loaded.parameters.nonlinear[0]
    )
    (course,) = training_pictures(loaded)
    titles = {axis.title.text for axis in course.figure.select_yaxes()}
    assert titles >= {f"{p.symbol} [{p.unit}]" for p in FOLLOWING[key].parameters}
    (row,) = printed["parameters"]
    assert {*names, "alpha", "beta", "tau"} <= row.keys()
    assert row["v0"] == pytest.approx(40)
    assert document(capsys, "stability", out)["vehicles"][0]["alpha"] > 0
    swung = document(capsys, "simulate", out, "--vehicles", 3, "--duration", 120)
    assert len(swung["amplitude"]) == 4


@cache
def shifted(by: float = 6.0) -> Segment:
    """A vehicle of the paper's study whose gaps are longer by so many metres."""
    run = cut(read(STUDY), 0, 100, (1, 2))
    return replace(run, gaps=run.gaps + by)


LAG = ModelSpec("cthp-s0-lag", (("lag", 0.5),))


@pytest.mark.parametrize(
    ("method", "spec"),
    [
        *((key, ModelSpec("cthp-s0")) for key in ("least-squares", "savitzky-golay", "splines")),
        *(("pinn", spec) for spec in (ModelSpec("cthp-s0"), LAG, ModelSpec("cthp-s0-delay"))),
    ],
    ids=str,
)
def test_an_intercept_is_what_gaps_are_longer_by(method: str, spec: ModelSpec) -> None:
    longer, near = (METHODS[method].fit(shifted(by), spec=spec) for by in (6.0, 0.0))
    assert longer.model == spec.model
    assert longer.parameters.lag[0] == dict(spec.fixed).get("lag", 0.0)
    assert longer.parameters.s0[0] == pytest.approx(6.0, abs=0.5)
    further = (longer.parameters.complete - near.parameters.complete)[0]
    np.testing.assert_allclose(further, [0, 0, 0, 6.0, 0, 0], atol=0.05)
    for curves in longer.curves:
        assert np.abs(curves.gaps - shifted().gaps).max() < 0.5
