"""Intervals: their parts against brute force, and the cases in which the data say little."""

from dataclasses import replace

import numpy as np
import pytest

from accpinn.errors import ConfigError
from accpinn.inference.instrumental_variables import Equations, solve_iv
from accpinn.inference.intervals import intervals, within
from accpinn.inference.jackknife import block_length, spread
from accpinn.inference.sampling import as_parameters, project, quantile_interval
from accpinn.methods import least_squares
from accpinn.methods.fit import Outcome
from accpinn.model.cthp import Parameters
from accpinn.segment.segment import Segment
from accpinn.stability.vehicle import numbers
from bench.disturbed import Disturbance, disturbed
from tests.support.driving import LAW, driven, standing_still

TRUTH = Parameters(*LAW)


@pytest.fixture(scope="module")
def segment() -> Segment:
    return disturbed((TRUTH, TRUTH), 3, Disturbance(0.25, 4.0))


class TestInstruments:
    def test_find_the_law_where_least_squares_is_pulled_away(self) -> None:
        """Over ten recordings disturbed for seconds; the law holds but for the disturbance."""
        sets = [disturbed((TRUTH,), seed, Disturbance(0.25, 4.0)) for seed in range(10)]
        ours = np.array([solve_iv(one, "II")[0].theta for one in sets])
        theirs = np.array([least_squares.fit(one).parameters[0].theta for one in sets])
        off, pulled = (np.abs(x.mean(axis=0) / TRUTH.theta - 1.0) for x in (ours, theirs))
        assert off[0] < 0.15
        assert pulled[0] > 2 * off[0]

    def test_say_where_nothing_is_determined(self) -> None:
        assert not solve_iv(standing_still(), "II")[0].determined
        assert spread(solve_iv(standing_still(), "II")[0], 0.1) is None


class TestJackknife:
    def test_leaving_a_block_out_is_solving_without_it(self) -> None:
        rng = np.random.default_rng(0)
        count, step = 400, 0.5
        terms, noise = rng.standard_normal((count, 3)), rng.standard_normal(count)
        rates = terms @ TRUTH.theta + noise
        normal = terms[:, :, None] * terms[:, None, :]
        theta = np.linalg.solve(normal.sum(axis=0), terms.T @ rates)
        scores = terms * (rates - terms @ theta)[:, None]
        found = spread(Equations(theta, normal, scores, True), step)
        assert found is not None
        length = round(block_length((count - 1) * step) / step)
        scale = np.zeros((3, 3))
        for first in range(count):
            kept = np.ones(count, bool)
            kept[np.arange(first, first + length) % count] = False
            move = np.linalg.lstsq(terms[kept], rates[kept], rcond=None)[0] - theta
            scale += np.outer(move, move) / length
        np.testing.assert_allclose(found.scale, scale, rtol=1e-8)


class TestSampling:
    def test_the_nearest_allowed_point_is_found(self) -> None:
        """Against a fine grid over the allowed region."""
        rng = np.random.default_rng(1)
        root = rng.standard_normal((3, 3))
        scale = root @ root.T + 0.1 * np.eye(3)
        wanted = rng.standard_normal((20, 3)) - 0.3
        found = project(wanted, scale)
        assert (found >= 0).all()
        axis = np.linspace(0.0, 4.0, 41)
        grid = np.stack(np.meshgrid(axis, axis, axis), axis=-1).reshape(-1, 3)
        metric = np.linalg.inv(scale)
        for one, best in zip(wanted, found, strict=True):
            costs = np.einsum("ki,ij,kj->k", grid - one, metric, grid - one)
            assert (best - one) @ metric @ (best - one) <= costs.min() + 1e-6

    def test_what_is_allowed_stays(self) -> None:
        inside = np.array([[0.1, 0.2, 0.3]])
        np.testing.assert_array_equal(project(inside, np.eye(3)), inside)

    def test_a_headway_without_a_gain_is_any(self) -> None:
        table = as_parameters(np.array([[0.0, 0.0, 0.2], [0.1, 0.15, 0.2]]))
        assert np.isnan(table[0, 2])
        assert table[1].tolist() == pytest.approx([0.1, 0.2, 1.5])
        lower, upper = quantile_interval(table[:, 2], 0.9)
        assert lower == 0.0
        assert upper == np.inf


class TestIntervals:
    def test_are_the_same_every_time_and_wider_for_a_higher_level(self, segment: Segment) -> None:
        fit = least_squares.fit(segment)
        one, two = intervals(segment, fit), intervals(segment, fit)
        np.testing.assert_array_equal(one.draws, two.draws)
        wide = intervals(segment, fit, 0.99)
        assert (wide.lower <= one.lower).all()
        assert (wide.upper >= one.upper).all()
        assert (wide.upper[:, :2] > one.upper[:, :2]).all()

    def test_keep_the_rational_driving_constraints(self, segment: Segment) -> None:
        uncertainty = intervals(segment, least_squares.fit(segment))
        assert (uncertainty.lower >= 0).all()
        assert not (uncertainty.draws < 0).any()
        assert (uncertainty.peak_gain.lower >= 1.0).all()
        assert (uncertainty.linf_gain.lower >= uncertainty.peak_gain.lower - 1e-9).all()
        assert (uncertainty.crossover.lower >= 0.0).all()

    def test_followers_of_case_i_share_narrower_ones(self, segment: Segment) -> None:
        both = intervals(segment, least_squares.fit(segment, "I"))
        np.testing.assert_array_equal(both.lower[0], both.lower[1])
        each = intervals(segment, least_squares.fit(segment))
        width, usual = both.upper - both.lower, each.upper - each.lower
        assert width[0, 1] < usual[:, 1].max()

    def test_estimates_outside_are_named(self, segment: Segment) -> None:
        beside = (Parameters(LAW[0], 9.0, LAW[2]), TRUTH)
        fit = replace(least_squares.fit(segment), parameters=beside)
        uncertainty = intervals(segment, fit)
        assert not uncertainty.inside[0, 1]
        assert any("β = 9.0000" in note and "outside" in note for note in uncertainty.notes)

    @pytest.mark.parametrize(
        ("outcome", "cause"),
        [
            (Outcome.SOLVED, "can pull such estimates"),
            (Outcome.FINISHED, "more iterations may change it"),
            (Outcome.STOPPED, "training was stopped before its end"),
        ],
    )
    def test_why_one_is_outside_depends_on_how_it_ended(
        self, segment: Segment, outcome: Outcome, cause: str
    ) -> None:
        beside = (Parameters(LAW[0], 9.0, 9.0), TRUTH)
        fit = replace(least_squares.fit(segment), parameters=beside, outcome=outcome)
        (note,) = (n for n in intervals(segment, fit).notes if "outside" in n)
        assert cause in note
        assert " lie outside" in note, "β and τ are two"

    def test_an_end_is_no_sharper_than_the_draws(self) -> None:
        lower, upper = np.array([0.44, 1.0]), np.array([0.4441, np.inf])
        width = 0.0041
        just = within(np.array([0.4441 + 0.03 * width, 0.99]), lower - [width, 0.0], upper)
        assert just.tolist() == [True, False]
        assert not within(np.array([0.4441 + 0.1 * width]), lower[:1] - width, upper[:1]).any()

    def test_laws_that_keep_no_gap_are_counted_apart(self) -> None:
        lame = disturbed((Parameters(0.002, 0.3, 1.5),), 3, Disturbance(0.25, 4.0))
        uncertainty = intervals(lame, least_squares.fit(lame))
        alpha = uncertainty.draws[..., 0]
        assert 0.05 < uncertainty.gapless[0] < 0.95
        assert uncertainty.gapless[0] == (alpha == 0).mean()
        assert uncertainty.probability_linf[0] <= uncertainty.probability_l2[0]
        laws = [Parameters(*row) for row in uncertainty.draws[:, 0] if row[0] > 0]
        stable = sum(found.l2_criterion >= 0 for found in numbers(laws)) / len(alpha)
        assert uncertainty.probability_l2[0] == pytest.approx(stable, abs=0.01), (
            "from ten times as many"
        )

    def test_where_nothing_moves_nothing_is_claimed(self) -> None:
        still = standing_still(samples=1201)
        uncertainty = intervals(still, least_squares.fit(still))
        assert np.isnan(uncertainty.probability_l2).all()
        assert np.isnan(uncertainty.gapless).all()
        assert np.isnan(uncertainty.centre).all()
        assert np.isinf(uncertainty.upper).all()
        assert (uncertainty.lower == 0).all()
        assert "too evenly" in " ".join(uncertainty.notes)

    def test_a_short_window_is_called_rough(self) -> None:
        short = driven(noise=0.05)
        assert "60 s long" in intervals(short, least_squares.fit(short)).notes[0]

    @pytest.mark.parametrize("level", [0.0, 1.0, -1.0])
    def test_a_level_must_lie_between(self, segment: Segment, level: float) -> None:
        with pytest.raises(ConfigError, match="level"):
            intervals(segment, least_squares.fit(segment), level)


def test_one_segments_methods_share_the_draws() -> None:
    """What does not depend on the fit is computed once, and judged for each."""
    segment = disturbed((Parameters(0.08, 0.2, 1.4),), 1, Disturbance())
    one = intervals(segment, least_squares.fit(segment))
    far = replace(least_squares.fit(segment), parameters=(Parameters(1.0, 1.0, 3.0),))
    other = intervals(segment, far)
    assert other.draws is one.draws
    assert not other.inside.any()
    assert one.inside[0, 2]
