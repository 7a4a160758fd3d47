"""Whether the methods agree, in words."""

from dataclasses import replace

import numpy as np
import pytest

from accpinn.evaluation.closed_loop import SimulatedCollision
from accpinn.model.cthp import Parameters
from accpinn.results.messages.methods import agreement, colliding_methods
from accpinn.segment.segment import Segment
from accpinn.study.comparison import MethodResult, compare
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


class TestAgreement:
    def test_agreement_is_judged_by_the_interval_of_each_parameter(self, two: Two) -> None:
        _, rows = two
        uncertainty = rows[0].uncertainty
        table = rows[0].fit.parameters.values

        def around(lower: float, upper: float) -> list[MethodResult]:
            ends = {"lower": Parameters.of(lower * table), "upper": Parameters.of(upper * table)}
            return [replace(row, uncertainty=replace(uncertainty, **ends)) for row in rows]

        said = agreement(around(0.5, 1.5), 0)
        assert "yes, all estimates lie within the 90 % intervals. The estimates differ" in said
        said = agreement(around(0.1, 9.0), 0)
        assert "but those of α, β and τ are too wide" in said
        said = agreement(around(1.5, 2.0), 0)
        assert "no: by the 90 % intervals, α is too low for every method; " in said

    def test_those_outside_are_named_the_shorter_way(self, two: Two) -> None:
        _, rows = two
        uncertainty = rows[0].uncertainty
        between = np.sort([row.fit.parameters[0].beta for row in rows])
        upper = np.full_like(uncertainty.upper.values, np.inf)
        upper[0, 1] = between[:2].mean()
        ends = {"lower": Parameters.of(np.zeros_like(upper)), "upper": Parameters.of(upper)}
        judged = [replace(rows[0], uncertainty=replace(uncertainty, **ends))]
        assert "β is too high for all methods but " in agreement([*judged, *rows[1:]], 0)

    def test_data_that_determine_nothing_are_no_measure(self, two: Two) -> None:
        _, rows = two
        nothing = Parameters.of(np.full_like(rows[0].uncertainty.lower.values, np.nan))
        judged = replace(rows[0], uncertainty=replace(rows[0].uncertainty, lower=nothing))
        assert "determine no parameter" in agreement([judged, *rows[1:]], 0)


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
