"""One estimate: Python, command line, snapshot, batch, table and draws have the same numbers."""

import sys
from dataclasses import astuple, replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from pyarrow import parquet

from accpinn import fit, save
from accpinn.errors import ConfigError
from accpinn.methods.joint_likelihood import joint_maxima
from accpinn.methods.likelihood import Criterion
from accpinn.methods.registry import VARIANTS
from accpinn.methods.series import series_of
from accpinn.methods.simulation import Drives, optima
from accpinn.model.registry import FOLLOWING
from accpinn.model.spec import ModelSpec
from accpinn.platoon import simulate_platoon
from accpinn.platoon.leader import Sinusoid
from accpinn.results.documents import parameter_card
from accpinn.results.tables.estimates import parameter_table
from accpinn.stability import stability_report
from accpinn.study.result import Result
from accpinn.study.snapshot import load
from tests.support.command import PLATOON, STUDY, Capture, document
from tests.support.driving import driven
from tests.support.estimates import estimated, point
from tests.support.openacc_files import csv, metadata
from tests.support.samples import frame
from tests.support.snapshots import small, two_windows

QUICK = {"pinn-fast": 20, "pinn-paper": 20}
"""Iterations of trainings that take long, or would differ from processor to processor."""


def chosen(name: str) -> dict[str, Any]:
    """A method as the arguments of `fit` name it."""
    method, _, preset = name.partition("-") if name.startswith("pinn") else (name, "", "")
    given: dict[str, Any] = {"method": method, "model": "cthp"}
    return given | ({"preset": preset} if preset else {})


@pytest.mark.parametrize("name", VARIANTS)
def test_every_place_has_the_parameters_of_the_method(
    capsys: Capture, tmp_path: Path, name: str
) -> None:
    rounds = {"settings": {"iterations": QUICK[name]}} if name in QUICK else {}
    result = fit(STUDY, start=10, duration=40, **chosen(name), **rounds)
    assert result.parameters is result.estimate.parameters
    expected = result.parameters.complete[0]
    path = save(result, tmp_path / "a.accpinn.zip")
    loaded = load(path)
    options = [f"--{option}={value}" for option, value in chosen(name).items()]
    options += [f"--iterations={QUICK[name]}"] if name in QUICK else []
    fitted = document(capsys, "fit", STUDY, "--start", 10, "--duration", 40, *options)
    vehicle = document(capsys, "stability", path)["vehicles"][0]
    names = ("alpha", "beta", "tau")
    places = {
        "snapshot": loaded.parameters.complete[0],
        "stability of the snapshot": [vehicle[key] for key in (*names, "s0", "lag", "delay")],
        "stability in Python": loaded.stability.vehicles[0].parameters.complete,
        "fit": [*(fitted["parameters"][0][key] for key in names), 0.0, 0.0, 0.0],
        "card": [*(parameter_card(loaded)["vehicles"][0][key]["value"] for key in names), 0, 0, 0],
    }
    for place, shown in places.items():
        np.testing.assert_allclose(np.asarray(shown), expected, rtol=1e-9, err_msg=place)
    assert loaded.stability == stability_report(result.parameters)
    swung = document(capsys, "simulate", path, "--vehicles", 2, "--duration", 100)
    run = simulate_platoon(result.parameters[[0, 0]], Sinusoid(duration=100))
    assert swung["predicted_amplitude"] == pytest.approx(run.amplitudes.predicted.tolist())
    assert (fitted["intervals"] is None) == (result.posterior is None)
    assert f"{expected[2]:.2f}"[:4] in parameter_table(result).to_text()


def test_the_point_is_the_joint_maximum_of_all_windows() -> None:
    estimate, segments = two_windows().estimate, two_windows().segments
    (maximum,) = joint_maxima(segments, "II", estimate.spec)
    np.testing.assert_allclose(estimate.parameters.complete[0], maximum.complete, rtol=1e-3)
    alone = [joint_maxima((segment,), "II", estimate.spec)[0].complete for segment in segments]
    np.testing.assert_allclose(estimate.windows.complete[:, 0], alone, rtol=1e-9)
    assert (abs(np.mean(alone, axis=0) - maximum.complete) > 1e-3).any(), "no mean of theirs"


def test_the_point_of_a_nonlinear_model_is_the_best_drive_of_all_windows() -> None:
    """And neither draws nor their level move it."""
    drive = driven(duration=80.0, noise=0.05)
    segments, model = (drive.part(0, 401), drive.part(401, drive.samples)), FOLLOWING["idm"]
    (best,) = optima(model, Drives.of(segments, model), [[0, 1]])
    without_draws = point(segments, model="idm")
    np.testing.assert_array_equal(without_draws.parameters.nonlinear[0], best.theta)
    for level in (0.5, 0.99):
        estimate = estimated(segments, model="idm", level=level)
        assert estimate.parameters == without_draws.parameters
        assert estimate.posterior.level == level
    assert estimate.windows.nonlinear.shape == (2, 1, 5)


@pytest.fixture
def drive(tmp_path: Path) -> Path:
    """A recording of 130 s."""
    path = tmp_path / "drive.csv"
    path.write_bytes(csv(frame(1301), metadata(("Lead", "Car"))))
    return path


def test_a_row_of_a_batch_is_the_run_of_its_window(
    capsys: Capture, tmp_path: Path, cluster: str, drive: Path
) -> None:
    out, methods = tmp_path / "study", ("pinn", "simulation", "least-squares")
    options = ("--methods", ",".join(methods), "--scheduler", cluster)
    document(capsys, "batch", drive, "--out", out, "--window", 130, "--model", "cthp-s0", *options)
    rows = pd.read_parquet(out / "results.parquet")
    assert set(rows["method"]) == set(methods)
    for method, row in rows.set_index("method").iterrows():
        spec = {"method": method, "model": "cthp-s0"}
        result = fit(drive, start=row["start"], duration=row["duration"], **spec)
        estimate, uncertainty = result.estimate, result.uncertainty
        assert row["following_model"] == estimate.model
        for name in ("alpha", "beta", "tau", "s0"):
            assert row[name] == getattr(estimate.parameters, name)[0], (method, name)
        assert pd.isna(row["delay"])
        ends = [row[f"{name}_{end}"] for end in ("low", "high") for name in ("alpha", "tau")]
        if uncertainty is None:
            assert pd.isna([*ends, row["p_l2_stable"], row["level"]]).all()
            continue
        (margin,) = result.margin().vehicles
        distance = [row[f"margin_l2{end}"] for end in ("", "_low", "_high")]
        assert distance == [*astuple(margin.l2.distance)]
        lower, upper = uncertainty.lower[0], uncertainty.upper[0]
        assert ends == [lower.alpha, lower.tau, upper.alpha, upper.tau]
        assert (row["p_l2_stable"], row["level"]) == (
            uncertainty.probability_l2[0],
            uncertainty.level,
        )
    fields = parquet.read_schema(out / "results.parquet")
    for parameter in FOLLOWING["cthp-s0-delay"].parameters:
        unit = fields.field(parameter.name).metadata[b"unit"].decode()
        assert unit == parameter.unit


def test_a_table_of_a_database_has_the_intervals_of_all_windows_together(
    capsys: Capture, tmp_path: Path, cluster: str, drive: Path
) -> None:
    out, model = tmp_path / "study", "cthp-s0"
    options = ("--methods", "pinn,least-squares", "--scheduler", cluster, "--model", model)
    document(capsys, "batch", drive, "--out", out, "--window", 65, *options)
    (group,) = document(capsys, "table", out)["groups"]
    windows = ("--windows", "all", "--duration", 65, "--model", model)
    (answer,) = document(capsys, "fit", drive, *windows)["answer"]
    assert group["windows"] == answer["windows"] == 2
    for name in ("intervals", "further_window", "time_gap_intervals"):
        for key, value in group[name].items():
            assert value == pytest.approx(answer[name][key], rel=1e-6), (name, key)
    assert tuple(group["parameters"]) == FOLLOWING[model].names
    spread = group["between_windows"]
    assert all(0.0 < part["low"] < part["value"] < part["high"] for part in spread.values())


@pytest.fixture(scope="module")
def result() -> Result:
    return fit(PLATOON, windows=[(0, 60), (100, 160)], vehicles="1-3")


def test_the_tree_has_the_posterior_and_each_window(result: Result) -> None:
    tree = result.to_datatree()
    typical, table = tree["posterior"], result.posterior.to_frame()
    assert len(table) == 2 * typical["tau"].size
    for k, vehicle in enumerate((2, 3)):
        for name in result.estimate.names:
            span = result.estimate.span(name, k)
            drawn = typical[name].sel(vehicle=vehicle)
            low, high = drawn.quantile([0.05, 0.95]).values
            assert (low, high) == pytest.approx((span.lower, span.upper))
    windows = tree["window_posterior"]
    assert dict(windows.sizes) == {"chain": 1, "draw": 400, "window": 2, "vehicle": 2}
    assert windows["window"].values.tolist() == [0, 100]
    by_window = windows["tau"].mean(("chain", "draw")).values
    np.testing.assert_allclose(by_window, result.estimate.windows.tau, rtol=0.1)
    assert typical["tau"].attrs == {"units": "s"}


def test_the_log_likelihood_is_that_of_the_windows_data(result: Result) -> None:
    log = result.to_datatree()["window_log_likelihood"]["speeds_and_gaps"]
    spec = ModelSpec(result.estimate.model)
    for k, segment in enumerate(result.segments):
        maxima = joint_maxima((segment,), "II", spec)
        best = Criterion(series_of([segment], "II"), spec).log_likelihood(
            np.array([maximum.coordinates for maximum in maxima]), np.arange(2)
        )
        for follower in range(2):
            away = best[follower] - log.isel(window=k, vehicle=follower).values
            # Half of χ² with as many degrees of freedom as unknowns, but for the priors.
            assert -1 < away.min()
            assert 1 < np.median(away) < 15


def test_the_file_is_read_again(result: Result, tmp_path: Path) -> None:
    import xarray

    (tmp_path / "draws.nc").write_bytes(result.to_netcdf())
    with xarray.open_datatree(tmp_path / "draws.nc", engine="h5netcdf") as tree:
        assert tree.attrs["sha256"] == result.info.sha256
        np.testing.assert_array_equal(tree["posterior"]["tau"][0], result.posterior.typical.tau)


def test_a_point_has_no_draws_and_says_what_has(
    result: Result, monkeypatch: pytest.MonkeyPatch
) -> None:
    for use in (small().to_datatree, small().to_netcdf):
        with pytest.raises(ConfigError, match=r"least-squares has none; choose the PiNN's preset"):
            use()
    assert small().uncertainty is None
    monkeypatch.setitem(sys.modules, "xarray", None)
    with pytest.raises(ConfigError, match="not installed"):
        replace(result).to_datatree()
