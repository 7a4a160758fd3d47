"""Where samples are missing nothing reads their values, and only what was measured counts."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from accpinn.evaluation.closed_loop import (
    SimulatedCollision,
    closed_loop,
    closed_loop_errors,
    closed_loop_findings,
    surrogate_errors,
)
from accpinn.evaluation.evaluation import cross_validate, evaluate, part
from accpinn.evaluation.whiteness import whiteness
from accpinn.methods import least_squares
from accpinn.methods.fit import Fit
from accpinn.methods.registry import METHODS
from accpinn.methods.regression import Regression
from accpinn.model.cthp import Parameters
from accpinn.segment.quality import assess_quality, label_regimes
from accpinn.segment.segment import Segment
from accpinn.units import Stretch
from tests.support.driving import MIXED, driven
from tests.support.holes import with_holes
from tests.support.snapshots import bits

NOISE = 0.05
BLOCK = Stretch(200, 349)
LEFT = np.r_[0:200, 350:601]
OWN = {1: [BLOCK], 4: [BLOCK], 5: [BLOCK]}
"""Speed of the first follower, and the gaps before and behind it."""


def whole() -> Segment:
    return driven(MIXED, noise=NOISE)


def fit() -> Fit:
    return replace(least_squares.fit(whole()), parameters=Parameters.of(MIXED))


def held_out(segment: Segment) -> object:
    return cross_validate(segment, lambda rest: replace(fit(), findings=()))


READERS: dict[str, Callable[[Segment], object]] = {
    "closed loop": lambda segment: closed_loop_errors(segment, fit()),
    "surrogate": lambda segment: surrogate_errors(
        segment, replace(fit(), method="splines", surrogate=closed_loop(whole(), fit()))
    ),
    "residual": lambda segment: whiteness(segment, fit()),
    "regression": lambda segment: Regression.of(segment).solve("II").theta,
    "hold-out": held_out,
    "quality": assess_quality,
    "regimes": lambda segment: label_regimes(segment).shares,
    "likelihood": lambda segment: METHODS["maximum-likelihood"].fit(segment).parameters,
}


@pytest.mark.parametrize("reader", READERS)
def test_nothing_is_read_of_what_was_not_measured(reader: str) -> None:
    segment = with_holes(whole(), OWN)
    absent = np.split(segment.missing, [len(segment.vehicles)], axis=1)
    speeds, gaps = (
        np.where(missing, -7.0, values)
        for missing, values in zip(absent, (segment.speeds, segment.gaps), strict=True)
    )
    other = replace(segment, speeds=speeds, gaps=gaps)
    one, two = (bits({"found": READERS[reader](each)}) for each in (segment, other))
    assert one == two


class TestClosedLoop:
    def test_errors_are_those_of_the_samples_that_are_left(self) -> None:
        simulated = closed_loop(whole(), fit())
        errors = closed_loop_errors(with_holes(whole(), OWN), fit())
        off = simulated.speeds[:, 1] - whole().speeds[:, 1]
        assert errors.speed_mae[1] == pytest.approx(np.abs(off[LEFT]).mean())
        assert errors.speed_rmse[1] == pytest.approx(np.sqrt((off[LEFT] ** 2).mean()))
        complete = closed_loop_errors(whole(), fit())
        np.testing.assert_allclose(errors.speed_mae[2:], complete.speed_mae[2:])
        np.testing.assert_allclose(errors.gap_mae[2:], complete.gap_mae[2:])

    def test_it_starts_anew_after_a_block_of_the_leader(self) -> None:
        segment = with_holes(whole(), {0: [BLOCK]})
        simulated = closed_loop(segment, fit())
        assert np.isnan(simulated.gaps[BLOCK.rows]).all()
        for piece in (part(whole(), 0, 200), part(whole(), 350, 601)):
            alone = closed_loop(piece, fit())
            first = round(piece.start / piece.sample_time)
            rows = slice(first, first + piece.samples)
            np.testing.assert_allclose(simulated.gaps[rows], alone.gaps)
        errors = closed_loop_errors(segment, fit())
        assert (errors.gap_mae < 0.2).all()
        assert closed_loop_findings(segment, simulated) == ()
        second = closed_loop(with_holes(whole(), {0: [Stretch(200, 209)]}), fit())
        assert np.isfinite(second.gaps).all(), "a second is bridged"
        late = closed_loop(with_holes(whole(), {2: [Stretch(0, 49)]}), fit())
        assert np.isnan(late.gaps[:50]).all()
        np.testing.assert_allclose(late.gaps[50], whole().gaps[50])

    def test_nowhere_without_an_instant_at_which_all_are_measured(self) -> None:
        segment = with_holes(whole(), {1: [Stretch(0, 299)], 2: [Stretch(300, 600)]})
        assert closed_loop(segment, fit()) is None
        found = evaluate(segment, fit())
        assert (found.closed_loop, found.findings) == (None, ())

    def test_no_collision_is_seen_where_the_gap_is_missing(self) -> None:
        crash = replace(fit(), parameters=Parameters.of([[0.05, 0.0, 0.3]]))
        segment = driven(MIXED[:1], noise=NOISE)
        simulated = closed_loop(segment, crash)
        found, *_ = closed_loop_findings(segment, simulated)
        assert isinstance(found, SimulatedCollision)
        hidden = with_holes(segment, {2: [Stretch(round(found.time / 0.1) - 1, 600)]})
        others = closed_loop_findings(hidden, closed_loop(hidden, crash))
        assert not any(isinstance(one, SimulatedCollision) for one in others)


def test_blocks_without_measurements_are_not_held_out() -> None:
    segment = with_holes(whole(), {1: [Stretch(0, 250)]})
    blocks = cross_validate(segment, lambda rest: replace(fit(), findings=()))
    assert [block.window.start for block in blocks] == pytest.approx([20.0, 40.1])
    assert all(block.errors is not None for block in blocks)


def test_quality_leaves_them_out() -> None:
    one = driven(MIXED[:1], noise=0.0)
    found, alone = assess_quality(with_holes(one, {1: [BLOCK], 2: [BLOCK]})), assess_quality(one)
    gaps = (one.gaps[:, 0] / one.speeds[:, 1])[LEFT]
    assert found.mean_time_gap[0] == pytest.approx(gaps.mean())
    relative = (one.speeds[:, 0] - one.speeds[:, 1])[LEFT]
    assert found.relative_deviation[0] == pytest.approx(relative.std())
    assert found.leader_deviation == alone.leader_deviation
    assert found.acceleration_deviation[0] == pytest.approx(
        alone.acceleration_deviation[0], rel=0.2
    )
    assert found.condition[0] == pytest.approx(alone.condition[0], rel=0.3)
    assert found.car_following[0] == (gaps <= 2).mean()
