"""The preset `calibrated`: parameters by the evidence, the network around them."""

from functools import cache

import numpy as np
import pytest

from accpinn.evaluation.closed_loop import surrogate_errors
from accpinn.methods.fit import Fit, Outcome, Progress
from accpinn.methods.maximum_likelihood import fit as maximum_likelihood
from accpinn.methods.pinn.config import CALIBRATED
from accpinn.model.cthp import Case
from accpinn.segment.segment import Segment
from bench.coverage import SETS
from bench.disturbed import Disturbance, disturbed
from tests.methods.pinn.test_training import after
from tests.support.methods import train

SHORT = 40.0


@cache
def platoon() -> Segment:
    return disturbed(SETS[[0, 1]], 2, Disturbance(), duration=SHORT)


@cache
def fitted(case: Case = "II") -> Fit:
    return train(platoon(), case, CALIBRATED)


class TestResult:
    @pytest.mark.parametrize("case", ["I", "II"])
    def test_parameters_are_those_of_maximum_likelihood(self, case: Case) -> None:
        """Within 0.2 of the standard errors that it states."""
        fit, other = fitted(case), maximum_likelihood(platoon(), case)
        apart = np.log(fit.parameters.values / other.parameters.values)
        assert (np.abs(apart) < 0.2 * fit.arrays["deviations"]).all()
        assert fit.arrays["deviations"].shape == (1 if case == "I" else 2, 3)

    def test_network_follows_the_data(self) -> None:
        errors = surrogate_errors(platoon(), fitted())
        assert errors.gap_mae.max() < 0.2

    def test_converges_to_the_loss_of_its_curves(self) -> None:
        fit = fitted()
        assert fit.outcome is Outcome.CONVERGED
        terms = fit.loss["data"] + fit.loss["physics"] + fit.loss["initial"]
        assert fit.history.total[-1] == fit.loss["total"] == pytest.approx(terms, rel=1e-12)


class TestProgress:
    def test_shows_evidence_and_narrowing_uncertainty(self) -> None:
        seen: list[Progress] = []
        fit = train(platoon(), "II", CALIBRATED, on_progress=seen.append)
        phases = [moment.phase for moment in seen]
        assert phases == ["evidence"] * (len(phases) - 1) + ["curves"]
        assert [moment.iteration for moment in seen] == sorted({m.iteration for m in seen})
        evidence = np.array([moment.evidence for moment in seen])
        assert evidence[-1] > evidence[0]
        np.testing.assert_array_equal(fit.history.evidence, evidence)
        assert fit.history.deviations.shape == (len(seen), 2, 3)
        assert fit.loss["evidence"] == evidence[-1]


@pytest.mark.parametrize("stop", [0, 3])
def test_a_stopped_search_draws_the_curves_of_the_parameters_so_far(stop: int) -> None:
    fit = train(platoon(), "II", CALIBRATED, should_stop=after(stop))
    assert (fit.outcome, fit.iterations) == (Outcome.STOPPED, stop)
    assert fit.parameters == fit.history.parameters[-1]
    assert surrogate_errors(platoon(), fit).gap_mae.max() < 0.5
