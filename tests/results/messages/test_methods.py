"""Whether the methods agree, in words: which estimates lie outside, and whose vehicles collide."""

from dataclasses import replace

import numpy as np
import pytest
from accpinn.results.messages.methods import agreement, colliding_methods

from accpinn.evaluation.closed_loop import SimulatedCollision
from accpinn.model.cthp import Parameters
from accpinn.segment.segment import Segment
from accpinn.study.comparison import MethodResult, compare
from accpinn.units import FloatArray
from tests.support.driving import MIXED, driven

Two = tuple[Segment, list[MethodResult]]


@pytest.fixture(scope="module")
def two() -> Two:
    segment = driven(MIXED[:2], noise=0.1)
    return segment, [
        row
        for row in compare(segment, "II", ("least-squares", "splines", "recursive"))
        if isinstance(row, MethodResult)
    ]


def test_agreement_is_judged_by_the_interval_of_each_parameter(two: Two) -> None:
    _, rows = two
    table, between = rows[0].fit.parameters.values, rows[0].uncertainty

    def judged(lower: FloatArray, upper: FloatArray) -> str:
        ends = replace(between, lower=Parameters.of(lower), upper=Parameters.of(upper))
        return agreement([replace(row, uncertainty=ends) for row in rows], 0)

    assert judged(0.5 * table, 1.5 * table).startswith("yes, all")
    assert "α, β and τ are too wide" in judged(0.1 * table, 9.0 * table)
    assert judged(1.5 * table, 2.0 * table).startswith("no: by the 90 % intervals, α is too low")
    assert "determine no parameter" in judged(np.full_like(table, np.nan), table)
    # Those outside are named the shorter way.
    upper = np.full_like(table, np.inf)
    upper[0, 1] = np.sort([row.fit.parameters[0].beta for row in rows])[:2].mean()
    assert "β is too high for all methods but " in judged(np.zeros_like(table), upper)


def test_collisions_name_follower_and_methods(two: Two) -> None:
    segment, rows = two
    first, second = segment.labels[1:3]
    assert colliding_methods(segment.info, rows) == ()
    some = [
        replace(
            row,
            evaluation=replace(
                row.evaluation,
                findings=tuple(SimulatedCollision(vehicle, 5.0, -1.0) for vehicle in vehicles),
            ),
        )
        for row, vehicles in zip(rows, ((2,), (2, 3), (2,)), strict=True)
    ]
    assert colliding_methods(segment.info, some) == (
        f"{first}, with the parameters of every method.",
        f"{second}, with the parameters of Splines.",
    )
