"""Bands of the Bode magnitude and clouds of parameter sets."""

from dataclasses import replace
from typing import Any

import numpy as np
import plotly.graph_objects as go
import pytest

from accpinn.inference.intervals import Uncertainty, intervals
from accpinn.methods import splines
from accpinn.model.cthp import Parameters
from accpinn.model.published import ParameterSet
from accpinn.results.figures import stability as figures
from accpinn.results.figures.stability import Plane, bode, stability_map
from accpinn.stability.frequency import response
from accpinn.stability.report import stability_report
from tests.support.samples import PLATOON, sample


@pytest.fixture(scope="module")
def vehicles() -> ParameterSet:
    segment = sample(PLATOON).segment
    return ParameterSet("Learned", segment.names[1:], splines.fit(segment).parameters)


@pytest.fixture(scope="module")
def uncertainty() -> Uncertainty:
    segment = sample(PLATOON).segment
    return intervals(segment, splines.fit(segment))


@pytest.fixture(scope="module")
def before(vehicles: ParameterSet) -> go.Figure:
    return bode(vehicles, stability_report(vehicles.parameters))


def named(figure: go.Figure, name: str) -> Any:
    (trace,) = [trace for trace in figure.data if trace.name == name]
    return trace


class TestBands:
    def test_hold_nine_tenths_of_the_draws(
        self, vehicles: ParameterSet, uncertainty: Uncertainty, before: go.Figure
    ) -> None:
        figure = figures.add_bands(before, vehicles, uncertainty)
        for k in range(len(vehicles)):
            band = named(figure, f"band {k}")
            count = len(band.x) // 2
            omega = np.asarray(band.x[:count])
            low, high = np.asarray(band.y[:count]), np.asarray(band.y[count:])[::-1]
            draws = Parameters.of(uncertainty.draws.values[:, k])
            drawn = 20 * np.log10(np.abs(response(draws, omega)))
            share = ((low - 1e-3 <= drawn) & (drawn <= high + 1e-3)).mean(axis=0)
            assert (share > uncertainty.level - 0.01).all()
            wide = high - low > 0.05  # where rounding to 0.001 dB lets no draws in
            assert wide.any()
            np.testing.assert_allclose(share[wide], uncertainty.level, atol=0.03)

    def test_lie_beneath_the_curves_of_determined_vehicles(
        self, vehicles: ParameterSet, uncertainty: Uncertainty, before: go.Figure
    ) -> None:
        after = figures.add_bands(before, vehicles, uncertainty)
        assert len(after.data) == len(before.data) + len(vehicles)
        assert {trace.fill for trace in after.data[: len(vehicles)]} == {"toself"}
        assert after.layout == before.layout
        draws = uncertainty.draws.values.copy()
        draws[:, 0] = np.nan
        after = figures.add_bands(
            before, vehicles, replace(uncertainty, draws=Parameters.of(draws))
        )
        assert len(after.data) == len(before.data) + len(vehicles) - 1


class TestClouds:
    @pytest.mark.parametrize(("plane", "column"), [("beta", 1), ("alpha", 0)])
    def test_are_draws(
        self, vehicles: ParameterSet, uncertainty: Uncertainty, plane: Plane, column: int
    ) -> None:
        chart = stability_map(vehicles, stability_report(vehicles.parameters), 0, plane)
        cloud = named(figures.add_clouds(chart, vehicles, uncertainty, plane), "cloud 1")
        assert len(cloud.x) <= figures.CLOUD
        drawn = uncertainty.draws.values[:, 1][:, [column, 2]]
        for x, y in zip(cloud.x[:20], cloud.y[:20], strict=True):
            assert np.abs(drawn - [x, y]).sum(axis=1).min() < 1e-3

    def test_draws_that_have_no_place_on_the_map_are_counted(
        self, vehicles: ParameterSet, uncertainty: Uncertainty
    ) -> None:
        chart = stability_map(vehicles, stability_report(vehicles.parameters), 0, "beta")
        draws = uncertainty.draws.values.copy()
        draws[..., 1:] = 0.1, 1.0
        caption = figures.cloud_caption(
            chart, replace(uncertainty, draws=Parameters.of(draws)), "beta"
        )
        assert "not on the map" not in caption
        count = len(draws)
        draws[: count // 20, :, 0], draws[: count // 20, :, 2] = 0.0, np.nan
        draws[count // 20 : 3 * count // 20, 0, 2] = 99.0
        caption = figures.cloud_caption(
            chart, replace(uncertainty, draws=Parameters.of(draws)), "beta"
        )
        assert "5 % have no gap control (α = 0)" in caption
        assert f"{10 / len(vehicles):.0f} % lie beyond" in caption
        draws[:] = np.nan
        figures.cloud_caption(chart, replace(uncertainty, draws=Parameters.of(draws)), "beta")
