"""One answer: Python, command line, snapshot, card, draws and pages agree."""

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from pyarrow import parquet

import accpinn
from accpinn import Result, load
from accpinn.errors import ConfigError
from accpinn.inference.window_posterior import sampled
from accpinn.methods.likelihood import Criterion
from accpinn.methods.maximum_likelihood import joint_maxima
from accpinn.methods.series import series_of
from accpinn.model.registry import FOLLOWING
from accpinn.model.spec import ModelSpec
from accpinn.results.tables.answer import answer_table
from accpinn.study.rows import OF_ANSWER
from tests.support.command import PLATOON, STUDY, Capture, document
from tests.support.snapshots import small

WINDOW = ("--start", 10, "--duration", 60)


def test_every_place_gives_the_same_answer_to_six_digits(capsys: Capture, tmp_path: Path) -> None:
    result = accpinn.fit(STUDY, start=10, duration=60)
    expected = {name: result.answer.span(name, 0).value for name in result.answer.names}
    fast = accpinn.fit(STUDY, start=10, duration=60, preset="fast")
    path = tmp_path / "a.accpinn.zip"
    fitted = document(capsys, "fit", STUDY, *WINDOW, "--method", "splines", "--out", path)
    compared = document(capsys, "compare", STUDY, *WINDOW, "--methods", "least-squares,splines")
    vehicle = document(capsys, "stability", path)["vehicles"][0]
    places = {
        "fit by another method": fitted["answer"][0]["parameters"],
        "compare": compared["answer"][0]["parameters"],
        "stability of the snapshot": {name: vehicle[name] for name in expected},
        "snapshot": {n: float(getattr(load(path).answer.parameters, n)[0]) for n in expected},
        "card": accpinn.parameter_card(load(path))["answer"][0]["parameters"],
        "preset fast": {name: fast.answer.span(name, 0).value for name in expected},
    }
    for place, found in places.items():
        assert found == pytest.approx(expected, rel=1e-6), place
    gap = result.answer.time_gap(100 / 3.6, 0)
    assert gap.value == pytest.approx(expected["tau"] + expected["s0"] / (100 / 3.6))
    assert gap.lower < gap.value < gap.upper
    assert gap.further_lower < gap.lower < gap.upper < gap.further_upper
    assert f"{gap.value:.2f}" in answer_table(result.info, result.answer).to_text()


def test_an_answer_from_one_window_and_the_intervals_of_its_fit_are_of_the_same_draws() -> None:
    result = accpinn.fit(STUDY, start=20, duration=60, method="maximum-likelihood")
    before = sampled.cache_info().misses
    assert result.answer.uncertainty.level == result.uncertainty.level
    assert sampled.cache_info().misses == before + 1


def test_the_table_of_a_database_gives_it_too(
    capsys: Capture, tmp_path: Path, cluster: str
) -> None:
    model, out = "idm", tmp_path / "study"
    methods = ("--methods", "least-squares", "--scheduler", cluster, "--model", model)
    document(capsys, "batch", STUDY, "--out", out, "--window", 140, *methods)
    (group,) = document(capsys, "table", out)["groups"]
    windows = ("--windows", "all", "--duration", 140, "--model", model)
    (fitted,) = document(capsys, "fit", STUDY, *windows)["answer"]
    compared = document(capsys, "compare", STUDY, *windows, *methods[:2])
    assert compared["answer"] == [fitted]
    assert len(compared["windows"]) == 2
    assert compared["segment"]["duration"] == 140
    assert group["windows"] == fitted["windows"] == 2
    for name in ("parameters", "intervals", "further_window", "time_gap_intervals"):
        for key, value in group[name].items():
            assert value == pytest.approx(fitted[name][key], rel=1e-6), (name, key)
    names = FOLLOWING[model].names
    assert tuple(group["parameters"]) == names
    spread = group["between_windows"]
    assert len(spread) == len(names)
    assert all(0.0 < part["low"] < part["value"] < part["high"] for part in spread.values())
    rows = pd.read_parquet(out / "results.parquet")
    assert set(rows["answer_model"]) == {model}
    windows = {name for name in OF_ANSWER if rows[f"answer_{name}"].notna().all()}
    assert windows == set(names)
    fields = parquet.read_schema(out / "results.parquet")
    for parameter in FOLLOWING[model].parameters:
        unit = fields.field(f"answer_{parameter.name}").metadata[b"unit"].decode()
        assert unit == parameter.unit


@pytest.fixture(scope="module")
def result() -> Result:
    windows = [(0, 60), (100, 160)]
    return accpinn.fit(PLATOON, windows=windows, vehicles="1-3", method="maximum-likelihood")


def test_the_tree_has_the_answer_and_each_window(result: Result) -> None:
    tree = result.to_datatree()
    typical, table = tree["posterior"], result.draws
    assert len(table) == 2 * typical["tau"].size
    for k, vehicle in enumerate((2, 3)):
        for name in result.answer.names:
            span = result.answer.span(name, k)
            drawn = typical[name].sel(vehicle=vehicle)
            low, high = drawn.quantile([0.05, 0.95]).values
            assert (low, high) == pytest.approx((span.lower, span.upper))
    windows = tree["window_posterior"]
    assert dict(windows.sizes) == {"chain": 1, "draw": 400, "window": 2, "vehicle": 2}
    assert windows["window"].values.tolist() == [0, 100]
    own = windows["tau"].mean(("chain", "draw")).values
    np.testing.assert_allclose(own, result.answer.windows.tau, rtol=0.1)
    assert typical["tau"].attrs == {"units": "s"}


def test_the_log_likelihood_is_that_of_the_windows_data(result: Result) -> None:
    log = result.to_datatree()["window_log_likelihood"]["speeds_and_gaps"]
    for k, segment in enumerate(result.segments):
        series = series_of([segment], "II")
        maxima = joint_maxima((segment,), "II", ModelSpec(result.answer.model))
        best = Criterion(series, ModelSpec(result.answer.model)).log_likelihood(
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
        np.testing.assert_array_equal(tree["posterior"]["tau"][0], result.answer.typical.tau)


def test_without_data_or_library(monkeypatch: pytest.MonkeyPatch) -> None:
    bare = replace(small(), segments=())
    assert set(bare.to_datatree().children) == {"posterior", "further_window"}
    monkeypatch.setitem(sys.modules, "xarray", None)
    with pytest.raises(ConfigError, match="not installed"):
        small().to_datatree()
