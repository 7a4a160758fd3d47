"""Tables of estimates: the right numbers under the right headings."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from accpinn.evaluation.closed_loop import TrackingErrors
from accpinn.inference.intervals import intervals
from accpinn.methods import least_squares
from accpinn.methods.fit import Fit, Outcome
from accpinn.methods.pinn.config import FAST, PAPER
from accpinn.methods.registry import METHODS
from accpinn.model.cthp import Parameters
from accpinn.results.tables.estimates import (
    EVERY_FOLLOWER,
    PROBABILITY,
    TITLES,
    comparison_table,
    fit_record_table,
    fit_record_title,
    intervals_table,
    method_name,
    methods_table,
    parameter_table,
)
from accpinn.results.tables.recording import quality_table
from accpinn.results.tables.table import Table
from accpinn.segment.cut import cut
from accpinn.segment.quality import Quality, assess_quality
from accpinn.segment.segment import Segment
from accpinn.study.comparison import FitRecord, compare, results_among
from tests.support.openacc_files import recording
from tests.support.samples import PLATOON, sample

LEARNED = Parameters.of([[0.01037, 0.07235, 1.52034], [0.1, 0.2, 1.0]])


@pytest.fixture
def segment() -> Segment:
    return cut(recording(names=("Audi(A8)", "BMW", "Tesla")), 5.0, 30.0)


@pytest.fixture
def quality(segment: Segment) -> Quality:
    return assess_quality(segment)


@pytest.fixture
def fit() -> Fit:
    return Fit("pinn", "II", LEARNED, None, Outcome.FINISHED, 1.0, FAST.to_json())


def errors(scale: float) -> TrackingErrors:
    speeds, gaps = scale * np.array([1.0, 2.0, 3.0]), scale * np.array([4.0, 5.0])
    return TrackingErrors(speeds, gaps, 10 * speeds, 10 * gaps)


def column(table: Table, title: str, group: str = "") -> list[Any]:
    """The cells of the one column of that title and group."""
    (k,) = (k for k, c in enumerate(table.columns) if (c.title, c.group) == (title, group))
    return [row[k] for row in table.rows]


def test_parameters_and_errors_of_both_kinds(segment: Segment, fit: Fit, quality: Quality) -> None:
    table = parameter_table(segment.info, fit, quality, errors(0.01), errors(1.0))
    assert column(table, "Vehicle") == ["1 Audi (A8)", "2 BMW", "3 Tesla"]
    assert column(table, "α") == [None, 0.01037, 0.1]
    assert column(table, "Mean time gap") == [None, *quality.mean_time_gap]
    own, simulated = "Surrogate fit, MAE", "Closed-loop simulation, MAE"
    assert column(table, "p", own) == [None, 0.04, 0.05]
    assert column(table, "v", own) == [0.01, 0.02, 0.03]
    assert column(table, "p", simulated) == [None, 4.0, 5.0]
    assert column(table, "v", simulated) == [None, 2.0, 3.0], "the leader's speed is given"
    assert "run.csv, 5–35 s" in table.caption
    assert "fast preset" in table.caption


def test_without_simulation_the_cells_are_empty_not_zero(
    segment: Segment, fit: Fit, quality: Quality
) -> None:
    lost = replace(fit, parameters=Parameters.of([[0.0, 0.2, np.nan], LEARNED.values[1]]))
    table = parameter_table(segment.info, lost, quality, None, None)
    assert table.to_csv().splitlines()[2].startswith("2 BMW,0.0,0.2,,")
    assert all(row[5:] == (None,) * 4 for row in table.rows)


def test_intervals_stand_beside_the_parameters(
    segment: Segment, fit: Fit, quality: Quality
) -> None:
    lower = Parameters.of([[0.0, 0.05, 1.2], [0.01, 0.1, 1.0]])
    upper = Parameters.of([[0.02, 0.09, np.inf], [0.03, 0.2, 1.3]])
    uncertainty = replace(intervals(segment, fit, draws=10), lower=lower, upper=upper)
    table = parameter_table(segment.info, fit, quality, errors(0.01), errors(1.0), uncertainty)
    group = "Estimate (90 % interval)"
    assert column(table, "τ", group) == [None, (1.52034, 1.2, np.inf), (1.0, 1.0, 1.3)]
    head, leader, first, _ = (line.split(",") for line in table.to_csv().splitlines())
    assert head[1:4] == ["alpha", "alpha_low", "alpha_high"]
    assert (leader[1:4], first[1:4]) == (["", "", ""], ["0.01037", "0.0", "0.02"])
    assert len(set(head)) == len(head) == len(first)
    assert "0.072 (0.050--0.090)" in table.to_latex()
    alone = intervals_table(segment.info, uncertainty)
    likeliest = column(alone, "β", "Maximum likelihood (90 % interval)")
    assert [cell[1:] for cell in likeliest] == [(0.05, 0.09), (0.1, 0.2)]
    shared = replace(fit, case="I", parameters=Parameters.stack([LEARNED[0]] * 2))
    once = parameter_table(segment.info, shared, quality, errors(0.01), errors(1.0), uncertainty)
    beside = comparison_table(segment.info, {"PiNN": LEARNED}, "II", uncertainty)
    assert [c.digits for c in beside.columns] == [None, 3, 3, 2], "as the intervals support"
    labels = ["1 Audi (A8)", EVERY_FOLLOWER, "2 BMW", "3 Tesla"]
    assert column(once, "Vehicle") == labels
    assert [cell is None for cell in column(once, "τ", group)] == [True, False, True, True]
    assert column(once, "p", "Surrogate fit, MAE") == [None, None, 0.04, 0.05]
    assert len(intervals_table(segment.info, uncertainty, "I").rows) == 1
    assert len(comparison_table(segment.info, {"PiNN": LEARNED}, "I").rows) == 1
    shares = np.multiply(100, uncertainty.probability_l2)
    np.testing.assert_allclose(column(alone, "L₂", PROBABILITY), shares)


def test_excluded_regimes_stand_in_every_title(
    segment: Segment, fit: Fit, quality: Quality
) -> None:
    """So that they also stand in an exported table."""
    without = replace(segment, excluded_regimes=("catching up", "manual")).info
    for table in (
        parameter_table(without, fit, quality, None, None),
        comparison_table(without, {"PiNN": LEARNED}),
        quality_table(without, quality, fit),
    ):
        assert "without catching up, manual" in table.caption
    assert "without" not in comparison_table(segment.info, {"PiNN": LEARNED}).caption


def test_preview_of_the_window(segment: Segment, fit: Fit, quality: Quality) -> None:
    table = quality_table(segment.info, quality, fit)
    shares = np.multiply(100, quality.car_following)
    np.testing.assert_allclose(column(table, "Moving, time gap ≤ 2 s"), shares)
    assert column(table, "α", "Least-squares estimate") == LEARNED.alpha.tolist()
    np.testing.assert_array_equal(column(table, "Condition number"), quality.condition)


def test_a_row_a_method() -> None:
    segment = sample(PLATOON).segment
    rows = results_among(compare(segment, "II", ("least-squares", "splines")))
    table = methods_table(segment.info, rows, 1)
    assert column(table, "Method") == ["Least squares", "Splines"]
    assert column(table, "β") == [row.fit.parameters.beta[1] for row in rows]
    gaps, held = "MAE of the space-gap", rows[0].evaluation.holdout
    assert column(table, "Surrogate fit", gaps)[0] is None
    assert column(table, "Hold-out", gaps)[0] == held.gap_mae[1]
    assert column(table, "Outside the window", gaps) == [None, None]


def test_a_method_is_called_by_what_it_was_trained_with() -> None:
    assert set(TITLES) == set(METHODS)
    fast, done = FAST.to_json(), Outcome.FINISHED
    assert method_name("pinn", fast, done) == "PiNN (fast preset)"
    assert method_name("pinn", fast | {"seed": 3}, done) == "PiNN (fast preset, own options)"
    stopped = method_name("pinn", PAPER.to_json(), Outcome.STOPPED)
    assert stopped == "PiNN (paper preset, stopped)"
    assert method_name("splines", {}, Outcome.SOLVED) == "Splines"
    assert method_name("retired", {}, Outcome.SOLVED) == "retired"


def test_an_earlier_fit_beside_the_present_one() -> None:
    segment = sample(PLATOON).segment
    then = FitRecord.of(segment, least_squares.fit(segment))
    now = replace(then, parameters=Parameters.of(then.parameters.values + 0.5), case="I")
    table = fit_record_table([then], {"least-squares": now}, vehicle=3)
    assert column(table, "Earlier fit") == [fit_record_title(then)]
    assert column(table, "α") == [then.parameters.alpha[1]]
    np.testing.assert_allclose(table.rows[0][5:8], 0.5)
    assert column(table, "Differs now in") == ["case: II → I"]
    other = fit_record_table([then], {"splines": now}, vehicle=3).rows[0]
    assert [value is None or np.isnan(value) for value in other[5:]] == [True] * 4
    assert len(fit_record_table([then], {}, vehicle=3).columns) == 5, "nothing to compare with"
    assert fit_record_table([then], {}, vehicle=1).rows == (), "the leader has no parameters"
