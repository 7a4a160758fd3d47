"""The common looks: colours on both themes and to all eyes, thinning, ticks, legends."""

import tomllib
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from accpinn.results.figures import style

THEME = tomllib.loads(
    (Path(__file__).parents[3] / ".streamlit" / "config.toml").read_text(encoding="utf-8")
)["theme"]
VEHICLES = (style.LEADER, *style.FOLLOWERS)


SEEN = {
    "normal": np.eye(3),
    "red-blind": np.array([[0.152, 1.053, -0.205], [0.115, 0.786, 0.099], [-0.004, -0.048, 1.052]]),
    "green-blind": np.array(
        [[0.367, 0.861, -0.228], [0.280, 0.673, 0.047], [-0.012, 0.043, 0.969]]
    ),
}
"""What linear RGB becomes without one kind of cone (Machado, Oliveira and Fernandes 2009)."""


class TestColours:
    def test_every_vehicle_has_one_and_the_leader_its_own(self) -> None:
        colours = [style.vehicle_colour(number, 1) for number in range(1, 12)]
        assert colours[0] == style.LEADER
        assert len(set(colours)) == 11
        assert style.vehicle_colour(3, 3) == style.LEADER
        assert style.vehicle_colour(4, 3) == style.vehicle_colour(4, 1)

    @pytest.mark.parametrize("side", ["light", "dark"])
    def test_are_seen_and_read_on_both_themes(self, side: str) -> None:
        for colour in (*VEHICLES, *style.SERIES, style.MODEL):
            assert contrast(colour, THEME[side]["backgroundColor"]) >= 3
        assert THEME[side]["chartCategoricalColors"] == list(VEHICLES)
        for background in ("backgroundColor", "secondaryBackgroundColor"):
            assert contrast(THEME[side]["textColor"], THEME[side][background]) > 7
            assert contrast(THEME[side]["linkColor"], THEME[side][background]) > 4.5

    @pytest.mark.parametrize("vision", SEEN)
    def test_of_a_platoon_of_six_differ(self, vision: str) -> None:
        colours = [lab(colour, vision) for colour in VEHICLES[:6]]
        least = min(float(np.linalg.norm(a - b)) for a, b in combinations(colours, 2))
        assert least > 11, "a difference of 2.3 is just seen side by side"


@given(
    st.lists(st.one_of(st.floats(-50, 50), st.just(float("nan"))), min_size=1, max_size=400),
    st.integers(4, 60),
)
def test_thinning_keeps_extremes_order_and_holes(values: list[float], points: int) -> None:
    time, series = np.arange(float(len(values))), np.array(values)
    x, y = style.thinned(time, series, points)
    assert (np.diff(x) > 0).all()
    np.testing.assert_array_equal(y, series[x.astype(int)])
    assert np.isnan(y).any() == np.isnan(series).any()
    if np.isfinite(series).any():
        assert (np.nanmin(y), np.nanmax(y)) == (np.nanmin(series), np.nanmax(series))
    assert len(x) <= max(points, len(values) if len(values) <= points else 1.5 * points + 2)


class TestAxes:
    @pytest.mark.parametrize(
        "ends",
        [(0.0588, 0.0972), (0.0, 0.2), (-0.002, 0.031), (1.149, 1.181), (1.15, 1.23), (0.78, 1.47),
         (0.0, 10.0), (0.9999, 1.0001)],
    )  # fmt: skip
    def test_short_ones_have_two_or_three_round_ticks(self, ends: tuple[float, float]) -> None:
        found = style.ticks(ends)
        values, shown = found["tickvals"], found["ticktext"]
        assert 2 <= len(values) <= 3
        assert ends[0] <= min(values) < max(values) <= ends[1]
        np.testing.assert_allclose([float(text) for text in shown], values, atol=1e-12)

    def test_limits_hold_all_that_is_finite(self) -> None:
        assert style.limits(np.array([1.0, np.nan, 2.0, np.inf])) == pytest.approx([0.92, 2.08])
        low, high = style.limits(np.array([3.0]))
        assert low < 3 < high
        assert style.limits(np.array([np.nan])) == []


@pytest.mark.parametrize("title", ["", "Loss"])
def test_a_legend_names_what_has_a_name_and_does_not_refuse(title: str) -> None:
    points = {"x": [0, 1], "y": [0, 1]}
    chart = style.Chart("x", 200, title={"text": title})
    chart.add(**points)
    assert not style.with_legend(chart.figure()).layout.showlegend
    chart.add(**points, name="shown")
    chart.add(**points, name="refuses", showlegend=False)
    shown = style.with_legend(chart.figure())
    assert [t.name for t in shown.data if t.showlegend is not False] == ["shown"]
    assert (shown.layout.height > 200) == bool(title), "room for it below a figure with a title"


def contrast(one: str, other: str) -> float:
    """Contrast ratio of two #rrggbb colours (WCAG 2)."""
    dark, light = sorted(float(linear(c) @ [0.2126, 0.7152, 0.0722]) for c in (one, other))
    return (light + 0.05) / (dark + 0.05)


def linear(colour: str) -> np.ndarray:
    channels = np.array([int(colour[i : i + 2], 16) for i in (1, 3, 5)]) / 255
    return np.where(channels <= 0.04045, channels / 12.92, ((channels + 0.055) / 1.055) ** 2.4)


def lab(colour: str, vision: str) -> np.ndarray:
    """CIELAB coordinates, in which distance is difference as seen."""
    seen = np.clip(SEEN[vision] @ linear(colour), 0, 1)
    to_xyz = np.array(
        [[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]]
    )
    f = np.cbrt(to_xyz @ seen / [0.9505, 1.0, 1.089])
    return np.array([116 * f[1] - 16, 500 * (f[0] - f[1]), 200 * (f[1] - f[2])])
