"""Whether the methods agree, in words."""

from dataclasses import replace

import numpy as np
import pytest

from accpinn.results.messages.study import agreement, colliding_methods
from accpinn.segment.segment import Segment
from accpinn.study.comparison import MethodResult, compare
from tests.driving import MIXED, driven

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
            ends = {"lower": lower * table, "upper": upper * table}
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
        lower, upper = 0.0 * uncertainty.lower, np.full_like(uncertainty.upper, np.inf)
        upper[0, 1] = between[:2].mean()
        judged = [replace(rows[0], uncertainty=replace(uncertainty, lower=lower, upper=upper))]
        assert "β is too high for all methods but " in agreement([*judged, *rows[1:]], 0)

    def test_data_that_determine_nothing_are_no_measure(self, two: Two) -> None:
        _, rows = two
        nothing = np.full_like(rows[0].uncertainty.lower, np.nan)
        judged = replace(rows[0], uncertainty=replace(rows[0].uncertainty, lower=nothing))
        assert "determine no parameter" in agreement([judged, *rows[1:]], 0)


def test_collisions_name_follower_and_methods(two: Two) -> None:
    segment, rows = two
    first, second = segment.labels[1:3]
    assert colliding_methods(segment.info, rows) == ()
    never = float("nan")
    times = ((5.0, never), (5.0, 7.0), (5.0, never))
    some = [
        replace(row, evaluation=replace(row.evaluation, collisions=np.array(when)))
        for row, when in zip(rows, times, strict=True)
    ]
    assert colliding_methods(segment.info, some) == (
        f"{first}, with the parameters of every method.",
        f"{second}, with the parameters of Splines.",
    )
