"""The recordings of the benchmarks are what they say, and figures are counted right."""

from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from accpinn.model.cthp import Parameters
from accpinn.recordings.synthetic import LeaderProfile
from accpinn.segment import Segment
from bench import __main__ as command_line
from bench import coverage, prediction, unequal
from bench.disturbed import Disturbance, disturbed
from bench.measurement import FIXED, Measurement, Released, show
from tests.support.driving import MIXED, driven


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
        estimates = {"pinn": 1.05 * truth, "splines": 0.8 * truth}
        found = by_name(coverage.bias(truth, estimates))
        assert found["mean error of α, pinn"].value == pytest.approx(5.0)
        assert not found["mean error of α, pinn"].within
        assert found["mean error of time gap, splines"].value == pytest.approx(-20.0)
        assert found["mean error of time gap, splines"].within

    def test_fewer_cars_than_many_have_no_limit(self) -> None:
        assert coverage.covered("typical α", np.zeros(20, bool), None).within
        assert not coverage.covered("typical α", np.zeros(20, bool), coverage.EACH).within

    def test_windows_of_a_car_differ_about_its_typical_values(self) -> None:
        calm = Disturbance(1e-9, 4.0)
        typical, further, segments = coverage.windows_of_car(0, 2, calm)
        assert typical.values == pytest.approx(coverage.SETS.values[0])
        estimates = [prediction.joint([segment], "cthp") for segment in segments]
        for values in (*estimates, further):
            away = np.log(values.values / typical.values) / coverage.BETWEEN
            assert np.all((np.abs(away) > 0.01) & (np.abs(away) < 4.0))


def test_unequal_gains_of_cars_that_nothing_disturbs_are_found() -> None:
    kind = unequal.KINDS["unequal"]
    kind = kind._replace(disturbance=replace(kind.disturbance, deviation=1e-9))
    for seed in range(2):
        truth, segments = unequal.windows_of_car(seed, 1, kind)
        found = prediction.joint(segments, "unequal").nonlinear[0, [1, 3]]
        np.testing.assert_allclose(found, truth, rtol=0.1)


class TestPrediction:
    """Windows are predicted by parameters from others, and means are those over cars."""

    WINDOWS = tuple(replace(driven(), start=100.0 * k) for k in range(5))

    @staticmethod
    def known(windows: Sequence[Segment]) -> prediction.Drive:
        """Misses each of these windows by 1 m, any other by 2 m and 1 m for each of these."""
        starts = {window.start for window in windows}
        return lambda w: w.gaps + (1.0 if w.start in starts else 2.0 + len(starts))

    def test_a_left_out_window_is_predicted_by_the_others_alone(self) -> None:
        errors = prediction.errors_of(self.WINDOWS, self.known)
        for part, value in (
            ("by_itself", 1.0), ("whole", 1.0), ("one_other", 3.0), ("two", 4.0), ("others", 6.0)
        ):  # fmt: skip
            assert getattr(errors, part) == pytest.approx(np.full(5, value)), part

    def test_two_of_two_other_windows_are_no_row_of_their_own(self) -> None:
        assert np.isnan(prediction.errors_of(self.WINDOWS[:3], self.known).two).all()

    def test_one_other_window_is_the_geometric_mean_over_all(self) -> None:
        one = np.array([[7.0, 1.0, 4.0], [3.0, 7.0, 3.0], [2.0, 8.0, 7.0]])
        errors = prediction.Errors(one, *np.full((3, 3), np.nan))
        assert errors.one_other == pytest.approx([2.0, 3.0, 4.0])
        assert errors.by_itself == pytest.approx([7.0, 7.0, 7.0])

    def test_each_car_counts_once(self) -> None:
        cars = [("A", "x")] * 3 + [("B", "x")]
        values = np.array([1.0, 1.0, 1.0, 3.0])
        assert prediction.over_cars(cars, values) == pytest.approx((2.0, 1.0))
        assert prediction.ratio(cars, np.exp(values), np.ones(4)) == "7.389 ± 7.389"

    def test_what_is_excluded_does_not_count_and_what_diverges_counts_as_the_largest(self) -> None:
        mask = np.ones_like(driven().gaps, bool)
        mask[:300] = False
        window = replace(driven(), mask=mask)
        step = np.where(np.arange(window.samples) < 300, 50.0, 2.0)[:, None]
        assert prediction.rmse(lambda w: w.gaps + step, window) == pytest.approx(2.0)
        assert prediction.rmse(lambda w: w.gaps * np.nan, window) == prediction.LARGEST

    @pytest.mark.parametrize("source", [prediction.likelihood, prediction.simulation])
    def test_a_car_that_obeys_the_model_is_predicted_by_its_other_window(
        self, source: prediction.Estimator
    ) -> None:
        first, second = (driven(MIXED[:1], 120.0).part(k, k + 600) for k in (0, 600))
        drive = prediction.driven(source, "cthp", [first])
        assert prediction.rmse(drive, second) < 0.05
        assert prediction.rmse(prediction.constant_time_gap([first]), second) > 0.5

    def test_the_measured_time_gap_is_held_against_a_further_windows(self) -> None:
        window = driven()
        mean = float(np.nanmean(window.time_gaps))
        for gap, expected in ((mean, True), (mean + 0.2, False)):
            draws = Parameters(*np.ones((2, 400)), np.linspace(gap - 0.1, gap + 0.1, 400))
            assert prediction.gap_inside("cthp", window, draws) == {"measured time gap": [expected]}


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
