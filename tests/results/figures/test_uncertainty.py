"""What the data leave open about stability: bands, clouds, table and the switch on the page."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from accpinn.inference.intervals import Uncertainty, intervals
from accpinn.methods import splines
from accpinn.methods.pinn.config import FAST
from accpinn.model.cthp import Parameters
from accpinn.model.published import ParameterSet
from accpinn.recordings.openacc import read
from accpinn.results.figures import uncertainty as figures
from accpinn.results.figures.stability import bode, stability_map
from accpinn.results.tables.stability import stability_interval_table
from accpinn.results.tables.table import between
from accpinn.segment.cut import cut
from accpinn.stability.frequency import response
from accpinn.stability.report import stability_report
from tests.apptest import STABILITY, everything, open_page, with_sample

ROOT = Path(__file__).parent.parent
PAGE = "pages/3_Stability.py"
SWITCH = "stability_doubt"


@pytest.fixture(scope="module")
def learned() -> tuple[ParameterSet, Uncertainty]:
    segment = cut(read(ROOT / "sample_data" / "synthetic_vicolungo_like.csv"))
    fit = splines.fit(segment)
    laws = ParameterSet("Learned", segment.labels[1:], fit.parameters, segment.vehicles[1:])
    return laws, intervals(segment, fit)


def named(figure: Any, name: str) -> Any:
    (trace,) = [trace for trace in figure.data if trace.name == name]
    return trace


class TestBands:
    def test_hold_nine_tenths_of_the_laws_drawn(
        self, learned: tuple[ParameterSet, Uncertainty]
    ) -> None:
        laws, uncertainty = learned
        figure = figures.add_bands(bode(laws, stability_report(laws.parameters)), laws, uncertainty)
        for k in range(len(laws)):
            band = named(figure, f"band {k}")
            count = len(band.x) // 2
            omega = np.asarray(band.x[:count])
            low, high = np.asarray(band.y[:count]), np.asarray(band.y[count:])[::-1]
            drawn = 20 * np.log10(np.abs(responses(uncertainty, k, omega)))
            share = ((low - 1e-3 <= drawn) & (drawn <= high + 1e-3)).mean(axis=0)
            assert (share > uncertainty.level - 0.01).all()
            wide = high - low > 0.05  # where rounding to 0.001 dB lets no draws in
            assert wide.any()
            np.testing.assert_allclose(share[wide], uncertainty.level, atol=0.03)

    def test_lie_beneath_the_curves(self, learned: tuple[ParameterSet, Uncertainty]) -> None:
        laws, uncertainty = learned
        before = bode(laws, stability_report(laws.parameters))
        after = figures.add_bands(before, laws, uncertainty)
        assert len(after.data) == len(before.data) + len(laws)
        assert [trace.fill for trace in after.data[: len(laws)]] == ["toself"] * len(laws)
        assert after.layout == before.layout

    def test_an_undetermined_vehicle_has_none(
        self, learned: tuple[ParameterSet, Uncertainty]
    ) -> None:
        laws, uncertainty = learned
        draws = uncertainty.draws.copy()
        draws[:, 0] = np.nan
        before = bode(laws, stability_report(laws.parameters))
        after = figures.add_bands(before, laws, replace(uncertainty, draws=draws))
        assert len(after.data) == len(before.data) + len(laws) - 1


def responses(uncertainty: Uncertainty, follower: int, omega: np.ndarray) -> np.ndarray:
    drawn = [Parameters(*row) for row in uncertainty.draws[:, follower]]
    return np.asarray(response(drawn, omega))


class TestClouds:
    @pytest.mark.parametrize(("plane", "column"), [("beta", 1), ("alpha", 0)])
    def test_are_draws(
        self, learned: tuple[ParameterSet, Uncertainty], plane: Any, column: int
    ) -> None:
        laws, uncertainty = learned
        chart = stability_map(laws, stability_report(laws.parameters), 0, plane)
        cloud = named(figures.add_clouds(chart, laws, uncertainty, plane), "cloud 1")
        assert len(cloud.x) <= figures.CLOUD
        drawn = uncertainty.draws[:, 1][:, [column, 2]]
        for x, y in zip(cloud.x[:20], cloud.y[:20], strict=True):
            assert np.abs(drawn - [x, y]).sum(axis=1).min() < 1e-3

    def test_what_has_no_place_on_the_map_is_counted(
        self, learned: tuple[ParameterSet, Uncertainty]
    ) -> None:
        laws, uncertainty = learned
        chart = stability_map(laws, stability_report(laws.parameters), 0, "beta")
        draws = uncertainty.draws.copy()
        draws[..., 2] = 1.0
        whole = replace(uncertainty, draws=draws)
        assert figures.cloud_caption(chart, whole, "beta") == (
            "Clouds: laws that the data allow as well."
        )
        draws[:100, :, 0], draws[:100, :, 2] = 0.0, np.nan
        draws[100:300, 0, 2] = 99.0
        said = figures.cloud_caption(chart, replace(uncertainty, draws=draws), "beta")
        assert "not on the map: 5 % keep no gap (α = 0) and have no τ, 3 % lie beyond" in said


class TestTable:
    def test_has_intervals_and_probabilities(
        self, learned: tuple[ParameterSet, Uncertainty]
    ) -> None:
        laws, uncertainty = learned
        table = stability_interval_table(laws, uncertainty)
        first = table.rows[0]
        assert first[0] == laws.labels[0]
        low = 20 * np.log10(uncertainty.peak_gain.lower[0])
        assert str(first[1]).startswith(f"{low:.2f} to ")
        assert first[4] == pytest.approx(100 * uncertainty.probability_l2[0])
        assert first[6] == pytest.approx(100 * uncertainty.gapless[0])
        assert "90 % interval" in {column.group for column in table.columns}

    def test_open_ends_are_words(self) -> None:
        assert between(0.5, 1.25, 2) == "0.50 to 1.25"
        assert between(0.5, float("inf"), 1) == "0.5 or more"
        assert between(float("nan"), float("inf"), 1) == "anything"


@pytest.mark.usefixtures("fresh_server")
class TestPage:
    def test_the_switch_shows_and_hides_it_for_the_fit_only(self) -> None:
        made = with_sample()
        page = open_page(STABILITY, made)
        assert SWITCH not in {toggle.key for toggle in page.toggle}, "published laws have no data"
        made.train(FAST)
        assert made.job is not None
        assert made.job.wait(60)
        page = open_page(STABILITY, made)
        assert page.toggle(key=SWITCH).value is True
        assert "Stable laws" in everything(page)
        page.toggle(key=SWITCH).set_value(False).run()
        assert not page.exception
        assert "Stable laws" not in everything(page)
        assert open_page(STABILITY, made).toggle(key=SWITCH).value is False, (
            "kept when the page is left"
        )
