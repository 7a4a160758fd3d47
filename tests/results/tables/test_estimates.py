"""Tables of estimates: the right numbers under the right headings."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from accpinn.evaluation.closed_loop import TrackingErrors
from accpinn.inference.intervals import Uncertainty, intervals
from accpinn.methods.fit import Fit, Outcome
from accpinn.methods.pinn.config import FAST, PAPER
from accpinn.methods.registry import METHODS
from accpinn.model.cthp import Parameters
from accpinn.recordings.openacc import read
from accpinn.recordings.recording import Window
from accpinn.results.tables.estimates import (
    EVERY_FOLLOWER,
    PROBABILITY,
    TITLES,
    comparison_table,
    earlier_table,
    earlier_title,
    intervals_table,
    methods_table,
    name_of,
    parameter_table,
)
from accpinn.results.tables.recording import quality_table
from accpinn.results.tables.table import Table
from accpinn.segment.cut import cut
from accpinn.segment.quality import Quality, assess_quality
from accpinn.segment.segment import Segment
from accpinn.study.analysis import Analysis
from accpinn.study.comparison import compare, results_among
from accpinn.study.run import run
from accpinn.units import Estimate
from tests.support.openacc_files import recording
from tests.support.samples import FOLDER, PLATOON

GROUP = "Estimate (90 % interval)"
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


@pytest.fixture
def uncertainty(segment: Segment, fit: Fit) -> Uncertainty:
    lower = Parameters.of([[0.0, 0.05, 1.2], [0.01, 0.1, 1.0]])
    upper = Parameters.of([[0.02, 0.09, np.inf], [0.03, 0.2, 1.3]])
    return replace(intervals(segment, fit, draws=10), lower=lower, upper=upper)


def result(
    segment: Segment, fit: Fit, uncertainty: Uncertainty | None = None, with_errors: bool = True
) -> Any:
    """What a table reads of a result."""
    kinds = (errors(0.01), errors(1.0)) if with_errors else (None, None)
    evaluation = SimpleNamespace(surrogate=kinds[0], closed_loop=kinds[1])
    return SimpleNamespace(
        info=segment.info, fit=fit, quality=assess_quality(segment), evaluation=evaluation,
        uncertainty=uncertainty, infos=(segment.info,),
    )  # fmt: skip


def test_parameters_and_errors_of_both_kinds(segment: Segment, fit: Fit, quality: Quality) -> None:
    table = parameter_table(result(segment, fit), with_intervals=False)
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
    lost = replace(fit, parameters=Parameters.of([[0.0, 0.2, np.nan], LEARNED.values[1]]))
    table = parameter_table(result(segment, lost, with_errors=False), with_intervals=False)
    assert table.to_csv().splitlines()[2].startswith("2 BMW,0.0,0.2,,")
    assert all(row[5:] == (None,) * 4 for row in table.rows), "empty, not zero"


def test_intervals_stand_beside_the_parameters(
    segment: Segment, fit: Fit, uncertainty: Uncertainty
) -> None:
    table = parameter_table(result(segment, fit, uncertainty))
    assert column(table, "τ", GROUP) == [
        None,
        Estimate(1.52034, 1.2, np.inf),
        Estimate(1.0, 1.0, 1.3),
    ]
    head, leader, first, _ = (line.split(",") for line in table.to_csv().splitlines())
    assert head[1:4] == ["alpha", "alpha_low", "alpha_high"]
    assert (leader[1:4], first[1:4]) == (["", "", ""], ["0.01037", "0.0", "0.02"])
    assert len(set(head)) == len(head) == len(first)
    assert "0.072 (0.050--0.090)" in table.to_latex()
    alone = intervals_table(segment.info, uncertainty)
    likeliest = column(alone, "β", "Maximum likelihood (90 % interval)")
    assert [(cell.lower, cell.upper) for cell in likeliest] == [(0.05, 0.09), (0.1, 0.2)]
    shares = np.multiply(100, uncertainty.probability_l2)
    np.testing.assert_allclose(column(alone, "L₂", PROBABILITY), shares)
    beside = comparison_table(segment.info, {"PiNN": LEARNED}, "II", uncertainty)
    assert [c.digits for c in beside.columns] == [None, 3, 3, 2], "as the intervals support"


def test_followers_that_share_their_parameters_have_one_row_for_them(
    segment: Segment, fit: Fit, uncertainty: Uncertainty
) -> None:
    shared = replace(fit, case="I", parameters=Parameters.stack([LEARNED[0]] * 2))
    table = parameter_table(result(segment, shared, uncertainty))
    assert column(table, "Vehicle") == ["1 Audi (A8)", EVERY_FOLLOWER, "2 BMW", "3 Tesla"]
    assert [cell is None for cell in column(table, "τ", GROUP)] == [True, False, True, True]
    assert column(table, "p", "Surrogate fit, MAE") == [None, None, 0.04, 0.05]
    assert len(intervals_table(segment.info, uncertainty, "I").rows) == 1
    assert len(comparison_table(segment.info, {"PiNN": LEARNED}, "I").rows) == 1


def test_excluded_regimes_stand_in_every_title(
    segment: Segment, fit: Fit, quality: Quality
) -> None:
    """So that they also stand in an exported table."""
    without = replace(segment, excluded_regimes=("catching up", "manual"))
    for table in (
        parameter_table(result(without, fit), with_intervals=False),
        comparison_table(without.info, {"PiNN": LEARNED}),
        quality_table(without.info, quality, fit),
    ):
        assert "without catching up, manual" in table.caption
    assert "without" not in comparison_table(segment.info, {"PiNN": LEARNED}).caption


def test_preview_of_the_window(segment: Segment, fit: Fit, quality: Quality) -> None:
    table = quality_table(segment.info, quality, fit)
    shares = np.multiply(100, quality.car_following)
    np.testing.assert_allclose(column(table, "Car-following"), shares)
    assert column(table, "α", "Least-squares estimate") == LEARNED.alpha.tolist()
    np.testing.assert_array_equal(column(table, "Condition number"), quality.condition)


def test_a_row_a_method_and_an_earlier_fit_beside_the_present_one() -> None:
    source = read(FOLDER / f"{PLATOON}.csv")
    asked = Analysis.of(source, (Window(0.0, 60.0),), method="least-squares")
    rows = results_among(compare(asked, source, ("least-squares", "splines")))
    info, then = rows[0].info, rows[0]
    table = methods_table(info, rows, 1)
    assert column(table, "Method") == ["Least squares", "Splines"]
    assert column(table, "β") == [row.parameters.beta[1] for row in rows]
    gaps, held = "MAE of the space-gap", then.evaluation.holdout
    assert column(table, "Surrogate fit", gaps)[0] is None
    assert column(table, "Hold-out", gaps)[0] == held.gap_mae[1]

    now = run(replace(asked, case="I"), source)
    table = earlier_table([then], {"least-squares": now}, vehicle=3)
    assert column(table, "Earlier fit") == [earlier_title(then)]
    assert column(table, "α") == [then.parameters.alpha[1]]
    change = now.parameters[1].values - then.parameters[1].values
    np.testing.assert_allclose(table.rows[0][5:8], change)
    assert "case: II → I" in column(table, "Differs now in")[0]
    other = earlier_table([then], {"splines": now}, vehicle=3).rows[0]
    assert [value is None or np.isnan(value) for value in other[5:]] == [True] * 4
    assert len(earlier_table([then], {}, vehicle=3).columns) == 5, "nothing to compare with"


def test_a_method_is_called_by_what_it_was_trained_with(fit: Fit) -> None:
    assert set(TITLES) == set(METHODS)
    assert name_of(fit) == "PiNN (fast preset)"
    assert name_of(replace(fit, config=fit.config | {"seed": 3})) == (
        "PiNN (fast preset, own options)"
    )
    stopped = replace(fit, config=PAPER.to_json(), outcome=Outcome.STOPPED)
    assert name_of(stopped) == "PiNN (paper preset, stopped)"
    assert name_of(replace(fit, method="splines", config={})) == "Splines"
    assert name_of(replace(fit, method="retired")) == "retired"
