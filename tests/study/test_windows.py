"""One parameter set over several windows, and how far windows differ beyond sampling error."""

from dataclasses import replace

import numpy as np
import pytest

from accpinn.errors import AccpinnError
from accpinn.evaluation.evaluation import part
from accpinn.model.cthp import Parameters
from accpinn.results.tables.estimates import between_table, joint_table, windows_table
from accpinn.segment.segment import Segment
from accpinn.study.result import Result
from accpinn.study.run import fit_windows
from accpinn.study.windows import (
    between_windows,
    differing_windows,
    log_errors,
    random_effects,
)
from bench.disturbed import Disturbance, disturbed
from tests.support.driving import MIXED, driven

TRUTH = Parameters([0.08], [0.2], [1.3])
FAST = Parameters([0.24], [0.2], [1.3])
"""The same vehicle with three times the gain on spacing."""
DURATION = 150.0


def window(seed: int, parameters: Parameters = TRUTH) -> Segment:
    """A recording of its own, so no two of them share samples."""
    return disturbed(parameters, seed, Disturbance(), duration=DURATION)


@pytest.fixture(scope="module")
def same() -> Result:
    return fit_windows([window(seed) for seed in range(4)])


@pytest.fixture(scope="module")
def different() -> Result:
    return fit_windows([window(4), window(5, FAST), window(6), window(7, FAST)])


class TestRandomEffects:
    def test_published_figures_of_the_bcg_trials(self) -> None:
        """13 trials of a vaccine (Colditz et al., JAMA 271, 1994), as the R package metafor has it.

        Its documentation gives Q = 152.233, Paule-Mandel 0.3181, and the Q-profile's 95 % interval
        0.1197 to 1.1115, as variances.
        """
        counts = np.array([
            (4, 119, 11, 128), (6, 300, 29, 274), (3, 228, 11, 209), (62, 13536, 248, 12619),
            (33, 5036, 47, 5761), (180, 1361, 372, 1079), (8, 2537, 10, 619),
            (505, 87886, 499, 87892), (29, 7470, 45, 7232), (17, 1699, 65, 1600),
            (186, 50448, 141, 27197), (5, 2493, 3, 2338), (27, 16886, 29, 17825),
        ], float)  # fmt: skip
        ill, well, ill_control, well_control = counts.T
        groups = ill + well, ill_control + well_control
        log_risk = np.log(ill / groups[0] / (ill_control / groups[1]))
        variance = 1 / ill - 1 / groups[0] + 1 / ill_control - 1 / groups[1]
        found = random_effects(log_risk, np.sqrt(variance), 0.95)
        assert found.q == pytest.approx(152.2330, abs=1e-4)
        assert found.deviation**2 == pytest.approx(0.3181, abs=1e-4)
        assert found.lower**2 == pytest.approx(0.1197, abs=1e-4)
        assert found.upper**2 == pytest.approx(1.1115, abs=1e-4)
        assert found.probability < 1e-20
        assert found.i_squared == pytest.approx(1 - 12 / 152.2330, abs=1e-5)

    @pytest.mark.parametrize("true", [0.0, 0.1, 0.4])
    def test_the_deviation_is_recovered(self, true: float) -> None:
        rng = np.random.default_rng(1)
        errors = rng.uniform(0.05, 0.3, 400)
        found = random_effects(-2.5 + np.hypot(errors, true) * rng.standard_normal(400), errors)
        assert found.deviation == pytest.approx(true, rel=0.15, abs=0.05)
        assert found.lower <= true <= found.upper
        assert abs(found.mean + 2.5) < 4 * found.error
        low, high = np.log(found.further)
        reach = 1.645 * np.hypot(found.deviation, found.error)
        assert high - low == pytest.approx(2 * reach, rel=0.01)

    def test_where_nothing_differs_sampling_error_explains_all(self) -> None:
        """The test has its level and the interval of d its coverage, both 5 and 90 %."""
        rng = np.random.default_rng(2)
        errors = rng.uniform(0.05, 0.3, (1000, 6))
        found = [random_effects(s * rng.standard_normal(6), s) for s in errors]
        assert np.mean([one.probability < 0.05 for one in found]) == pytest.approx(0.05, abs=0.02)
        assert np.mean([one.lower == 0 for one in found]) == pytest.approx(0.95, abs=0.02)

    def test_windows_without_an_estimate_do_not_count(self) -> None:
        few = random_effects([0.1, 0.3, 0.2], [0.1, 0.2, 0.1])
        more = random_effects([0.1, 0.3, 0.2, np.nan, 5.0], [0.1, 0.2, 0.1, 0.1, np.nan])
        assert few == more
        absurd = [0.0, 1e-320, 1e-160, 1e160, np.inf, -0.1]
        assert random_effects([0.1, 0.3, 0.2, *absurd], [0.1, 0.2, 0.1, *absurd]) == few
        for count in range(2):
            found = random_effects([0.1] * count, [0.1] * count)
            assert found.windows == count
            assert np.isnan([found.mean, found.deviation, found.q, *found.further]).all()
        pair = random_effects([0.0, 1.0], [0.1, 0.1])
        assert pair.deviation == pytest.approx(np.sqrt(0.5 - 0.01))
        assert np.isnan(pair.further).all()


class TestJointFit:
    def test_windows_together_say_more_than_one_alone(self, same: Result) -> None:
        def off(parameters: Parameters) -> float:
            return float(np.abs(np.log(parameters[0].values / TRUTH[0].values)).mean())

        assert off(same.parameters) < 0.7 * np.mean([off(o.fit.parameters) for o in same.windows])
        widths = [one.uncertainty.upper.values / one.uncertainty.lower.values
                  for one in (same, *same.windows)]  # fmt: skip
        assert (widths[0] < np.min(widths[1:], axis=0)).all()
        assert same.uncertainty.inside.all()
        assert all(fit.parameters == same.parameters for fit in same.fits)

    def test_equal_truths_do_not_differ(self, same: Result) -> None:
        between = between_windows(same)
        assert differing_windows(between, "II") == ()
        errors = np.median([log_errors(window)[0] for window in same.windows], axis=0)
        for effect, error in zip(between[0].effects, errors, strict=True):
            assert (effect.windows, effect.lower) == (4, 0.0)
            assert effect.deviation < error
        assert between[0].tau.typical == pytest.approx(1.3, rel=0.1)

    def test_truths_that_differ_are_recovered(self, different: Result) -> None:
        """Two windows at 0.08 and two at 0.24 have a deviation of ln 3 / √3."""
        between = between_windows(different)
        alpha = between[0].alpha
        assert alpha.deviation == pytest.approx(np.log(3) / np.sqrt(3), rel=0.4)
        assert alpha.lower > 0
        low, high = alpha.further
        assert low < 0.08 < 0.24 < high
        assert alpha.typical == pytest.approx(np.sqrt(0.08 * 0.24), rel=0.35)
        assert between[0].tau.deviation < 0.15
        [finding] = differing_windows(between, "II")
        assert (finding.vehicle, finding.windows) == (2, 4)
        assert "α" in finding.symbols

    def test_one_set_for_all_followers(self) -> None:
        parts = [driven(MIXED[:2], duration=60.0, noise=0.05) for _ in range(2)]
        parts[1] = replace(parts[1], start=60.0)
        joint = fit_windows(parts, "I")
        assert joint.parameters[0] == joint.parameters[1]
        first, second = between = between_windows(joint)
        assert (first.vehicle, second.vehicle) == (2, 3)
        assert first.effects == second.effects
        assert {one.vehicle for one in differing_windows(between, "I")} <= {0}

    def test_what_bounds_rule_out_is_that_of_all_windows(self) -> None:
        whole = driven(((0.10, -0.04, 1.8),), duration=160.0, noise=0.05)
        windows = part(whole, 0, 801), part(whole, 801, whole.samples)
        found = fit_windows(windows)
        assert found.parameters.beta[0] == 0.0
        one, other = (fit.unconstrained.values[0] for fit in found.fits)
        np.testing.assert_array_equal(one, other)
        assert one[1] == pytest.approx(-0.04, abs=0.02)

    def test_tables_have_each_window_and_each_parameter(self, different: Result) -> None:
        rows = windows_table(different, 0).rows
        assert [row[0] for row in rows] == ["0–150 s"] * 4 + ["all together"]
        assert [cell.value for cell in rows[-1][1:]] == different.parameters.values[0].tolist()
        assert joint_table(different).rows[0][1:] == rows[-1][1:]
        follower = between_windows(different)[0]
        between = between_table(different, follower)
        assert [row[0] for row in between.rows] == ["α [1/s²]", "β [1/s]", "τ [s]"]
        assert between.rows[0][3].value == pytest.approx(100 * follower.alpha.deviation)


def recorded(start: float, **changes: object) -> Segment:
    """A window of one recording; short, as it is to be refused."""
    return replace(driven(), start=start, sha256="one file", **changes)


@pytest.mark.parametrize(
    ("segments", "words"),
    [
        ([], "at least two"),
        ([recorded(0.0)], "at least two"),
        ([recorded(0.0), recorded(59.0)], "0–60 s and 59–119 s overlap"),
        ([driven(), driven()], "0–60 s and 0–60 s overlap"),
        ([recorded(0.0), driven(MIXED[:2])], "2 followers"),
        ([recorded(0.0), driven(step=0.4)], "0.4 s apart"),
        ([recorded(0.0), driven(duration=15.0)], "too short"),
    ],
)
def test_segments_that_cannot_share_a_likelihood(segments: list[Segment], words: str) -> None:
    with pytest.raises(AccpinnError, match=words):
        fit_windows(segments)
