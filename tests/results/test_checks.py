"""The checks of a fit: what passes, what fails for whom, and what is not known."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from accpinn.evaluation.closed_loop import SimulatedCollision
from accpinn.inference.intervals import Uncertainty, intervals
from accpinn.methods import least_squares
from accpinn.methods.fit import IterationsExhausted, Outcome
from accpinn.model.cthp import Parameters
from accpinn.results.checks import MEANING, TITLES, Check, checks, label_of
from tests.support.samples import PLATOON, sample

SEGMENT = sample(PLATOON, 60.0).segment
INFO = SEGMENT.info


@pytest.fixture(scope="module")
def known() -> Uncertainty:
    """Followers 3 to 5 are narrow and inside; follower 2 is outside, and its α wide."""
    uncertainty = intervals(SEGMENT, least_squares.fit(SEGMENT), draws=10)
    lower, inside = np.full((4, 3), 0.9), np.ones((4, 3), bool)
    lower[0, 0], inside[0, 1] = 0.01, False
    return replace(
        uncertainty, centre=Parameters.of(np.ones((4, 3))), lower=Parameters.of(lower),
        upper=Parameters.of(np.full((4, 3), 1.1)), inside=inside,
    )  # fmt: skip


def checked(
    uncertainty: Uncertainty, outcome: Outcome = Outcome.CONVERGED, found: Any = (), hits: Any = ()
) -> tuple[Check, ...]:
    fit = SimpleNamespace(outcome=outcome, findings=found)
    evaluation = SimpleNamespace(all_findings=hits, whiteness=SimpleNamespace(findings=()))
    parts: Any = {"fit": fit, "uncertainty": uncertainty, "evaluation": evaluation, "info": INFO}
    return checks(SimpleNamespace(**parts))


def test_each_check_names_the_followers_that_fail(known: Uncertainty) -> None:
    answers = checked(known, hits=(SimulatedCollision(4, 12.0, -1.0),))
    assert answers == (
        Check("converged", True),
        Check("inside", False, (2,)),
        Check("identified", False, (2,), "α"),
        Check("identified", True, (), "β"),
        Check("identified", True, (), "τ"),
        Check("collision-free", False, (4,)),
        Check("explained", None),
    )
    assert label_of(answers[2:5]).endswith(": α no, β yes, τ yes")
    assert INFO.label(4) in answers[5].reason(INFO)
    assert answers[0].reason(INFO) == ""
    assert {check.name for check in answers} == set(TITLES) == set(MEANING)


@pytest.mark.parametrize("outcome", [Outcome.STOPPED, Outcome.DIVERGED, Outcome.FINISHED])
def test_what_did_not_converge(outcome: Outcome, known: Uncertainty) -> None:
    exhausted = (IterationsExhausted(20),) if outcome is Outcome.FINISHED else ()
    assert checked(known, outcome, exhausted)[0].passed is False


def test_what_the_data_do_not_determine_is_not_known(known: Uncertainty) -> None:
    centre = known.centre.values.copy()
    centre[1] = np.nan
    unknown = replace(known, centre=Parameters.of(centre), inside=np.ones((4, 3), bool))
    inside, alpha, beta = checked(unknown)[1:4]
    assert inside.passed is None
    assert (alpha.failing, beta.failing) == ((2, 3), (3,))
