"""The checks of a fit: what passes, what fails for whom, and what is not known."""

from dataclasses import replace

import numpy as np
import pytest

from accpinn.evaluation.closed_loop import SimulatedCollision
from accpinn.inference.intervals import Uncertainty
from accpinn.methods.fit import IterationsExhausted, Outcome
from accpinn.model.cthp import Parameters
from accpinn.results.checks import MEANING, TITLES, Check, checks, label_of
from tests.support.samples import PLATOON, sample
from tests.support.snapshots import whole

INFO = sample(PLATOON).segment.info


@pytest.fixture
def known() -> Uncertainty:
    """Followers 3 to 5 are narrow and inside; follower 2 is outside, and its α wide."""
    uncertainty = whole().uncertainty
    lower, upper = np.full((4, 3), 0.9), np.full((4, 3), 1.1)
    lower[0, 0] = 0.01
    inside = np.ones((4, 3), bool)
    inside[0, 1] = False
    ends = {"lower": Parameters.of(lower), "upper": Parameters.of(upper)}
    return replace(uncertainty, centre=Parameters.of(0 * lower + 1), inside=inside, **ends)


def test_each_check_names_the_followers_that_fail(known: Uncertainty) -> None:
    fit = replace(whole().fit, outcome=Outcome.CONVERGED, findings=())
    found = checks(INFO, fit, known, (SimulatedCollision(4, 12.0, -1.0),), None)
    assert found == (
        Check("converged", True),
        Check("inside", False, (2,)),
        Check("identified", False, (2,), "α"),
        Check("identified", True, (), "β"),
        Check("identified", True, (), "τ"),
        Check("collision-free", False, (4,)),
        Check("explained", None),
    )
    assert label_of(found[2:5]).endswith(": α no, β yes, τ yes")
    assert INFO.label(4) in found[5].reason(INFO)
    assert found[0].reason(INFO) == ""
    assert {check.name for check in found} == set(TITLES) == set(MEANING)


@pytest.mark.parametrize("outcome", [Outcome.STOPPED, Outcome.DIVERGED, Outcome.FINISHED])
def test_what_did_not_converge(outcome: Outcome, known: Uncertainty) -> None:
    exhausted = (IterationsExhausted(20),) if outcome is Outcome.FINISHED else ()
    fit = replace(whole().fit, outcome=outcome, findings=exhausted)
    assert checks(INFO, fit, known, (), None)[0].passed is False


def test_nothing_passes_that_is_not_known() -> None:
    found = checks(INFO, whole().fit, None, None, None)
    assert [check.passed for check in found[1:]] == [None] * 6
