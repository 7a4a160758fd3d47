"""The recordings of the benchmarks are what they say, and figures are counted right."""

from collections.abc import Iterable
from pathlib import Path

import numpy as np
import pytest

from accpinn.model.cthp import Parameters
from accpinn.recordings.synthetic import LeaderProfile
from bench import __main__ as command_line
from bench import coverage
from bench.disturbed import Disturbance, disturbed
from bench.measurement import FIXED, Measurement, Released, show


def by_name(measurements: Iterable[Measurement]) -> dict[str, Measurement]:
    return {figure.name: figure for figure in measurements}


class TestCoverage:
    def test_counts_shares_and_states_their_standard_errors(self) -> None:
        rng = np.random.default_rng(1)
        truth = np.ones((1600, 3))
        half = rng.gamma(9.0, 1.0, truth.shape)
        lower = 1 - half
        lower[::10, 0] = 2.0  # a tenth of the intervals of α miss it
        few, many = (
            by_name(coverage.coverage(truth[:n], lower[:n], 1 + half[:n])) for n in (100, 1600)
        )
        assert (few["α covered"].value, few["all three covered"].value) == (90.0, 90.0)
        assert few["α covered"].error == pytest.approx(3.0)
        assert few["α covered"].within
        assert not few["β covered"].within, "100 % are too many"
        # Of normal widths the median's error is 1.25 deviations over the root of their number.
        name = "median width of time gap"
        expected = 1.25 * 200 * half[:, 2].std() / 10
        assert few[name].error == pytest.approx(expected, rel=0.3)
        assert many[name].error == pytest.approx(expected / 4, rel=0.3)

    def test_bias_has_a_limit_where_it_is_promised(self) -> None:
        truth = np.ones((4, 3))
        estimates = {coverage.LIKELIHOOD: 1.05 * truth, "splines": 0.8 * truth}
        found = by_name(coverage.bias(truth, estimates))
        assert found["mean error of α, maximum-likelihood"].value == pytest.approx(5.0)
        assert not found["mean error of α, maximum-likelihood"].within
        assert found["mean error of time gap, splines"].value == pytest.approx(-20.0)
        assert found["mean error of time gap, splines"].within


class TestDisturbedRecordings:
    """What lag, delay and disturbance do is seen where they are estimated."""

    def test_equilibrium_gap_has_standstill_distance_and_slope(self) -> None:
        """At a constant speed ahead the gap is τv + s₀ - w/α."""
        parameters = Parameters([0.2], [0.4], [1.2])
        calm = LeaderProfile(20.0, 10.0, 30.0, (500.0, 600.0), (0.4, 1.2), 0.0)
        for standstill, slope in ((0.0, 0.0), (4.0, 0.0), (0.0, -0.1)):
            what = Disturbance(1e-9, 4.0, standstill=standstill, slope=slope)
            segment = disturbed(parameters, 1, what, calm, 120.0, noise=None)
            gap = 1.2 * 20.0 + standstill - slope / 0.2
            assert segment.gaps[-1, 0] == pytest.approx(gap, abs=1e-6)


def test_the_figures_of_the_release_are_readable_and_of_parts_that_there_are() -> None:
    parts = Released.last().values
    assert parts.keys() <= set(command_line.jobs(Path(), ""))


def test_figures_stand_beside_those_released_and_a_limit_that_is_not_kept_shows(
    capsys: pytest.CaptureFixture[str],
) -> None:
    fixed = Measurement(name=FIXED, value=10.0)
    kept = Measurement(name="import accpinn", value=0.1, at_most=0.2, processor=0.05)
    beyond = Measurement(name="memory", value=9.0, unit="MB", at_least=10.0)
    assert show({"start": [fixed, kept]}) == 0
    assert "times as long as at the release" in capsys.readouterr().out, "on a slow machine"
    assert show({"another": [fixed, kept, beyond]}) == 1
    *_, first, second = capsys.readouterr().out.splitlines()
    assert first.split() == ["import", "accpinn", "0.10", "s", "50.0", "ms", "≤", "0.20", "s"]
    assert second.endswith("≥ 10 MB" + 19 * " " + "  beyond its limit")
