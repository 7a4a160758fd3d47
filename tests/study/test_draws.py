"""Draws leave: as a table, as a tree and as a file, with the numbers of the answer."""

import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import accpinn
from accpinn.errors import ConfigError
from accpinn.methods.likelihood import Criterion
from accpinn.methods.maximum_likelihood import joint_maxima
from accpinn.methods.series import series_of
from accpinn.study.result import Result
from tests.support import draws
from tests.support.command import PLATOON
from tests.support.snapshots import small


@pytest.fixture(scope="module")
def result() -> Iterator[Result]:
    windows = [(0, 60), (100, 160)]
    with draws.as_users_have():
        yield accpinn.fit(PLATOON, windows=windows, vehicles="1-3", method="maximum-likelihood")


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
        maxima = joint_maxima((segment,), "II", result.answer.model)
        best = Criterion(series, result.answer.model, ()).log_likelihood(
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
