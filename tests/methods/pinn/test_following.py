"""The network's presets with the residual of any model of the registry."""

from dataclasses import replace

import numpy as np
import pytest

from accpinn.methods.findings import Undetermined
from accpinn.methods.pinn.config import FAST, PAPER
from accpinn.methods.pinn.following import FollowingFast
from accpinn.methods.registry import METHODS
from accpinn.model.registry import FOLLOWING, value_of
from accpinn.model.spec import ModelSpec
from tests.methods.test_simulation import TRUTHS
from tests.support.driving import MIXED, segment_of
from tests.support.driving import driven as cthp_driven
from tests.support.following import driven
from tests.support.methods import train


@pytest.mark.parametrize("key", ["idm", "fvdm"])
def test_fast_finds_the_truth_of_a_simulated_vehicle(key: str) -> None:
    (window,) = driven(FOLLOWING[key], TRUTHS[key][:1], 3, noise=0.03, seconds=240.0)
    estimate = METHODS["pinn"].fit(window, settings=FAST, spec=ModelSpec(key))
    np.testing.assert_allclose(estimate.parameters.nonlinear, TRUTHS[key][:1], rtol=0.05)
    assert estimate.history.parameters[-1] == estimate.parameters
    again = METHODS["pinn"].redraw(estimate, 0, window.time, window.window.duration)
    np.testing.assert_allclose(again.gaps, estimate.curves[0].gaps, atol=1e-9)


@pytest.mark.parametrize("key", ["idm-lag", "cthp-s0-delay"])
def test_fast_finds_lags_and_delays_that_are_not_typical(key: str) -> None:
    """Those are 0.4 s and 0.6 s; of two followers."""
    base = TRUTHS[key.rpartition("-")[0]]
    truth = np.column_stack([base, [0.3, 0.8]])
    ahead, behind = driven(FOLLOWING[key], truth, 3, noise=0.01, seconds=120.0)
    platoon = segment_of(
        ahead.time,
        np.column_stack([ahead.speeds, behind.speeds[:, 1]]),
        np.column_stack([ahead.gaps, behind.gaps]),
    )
    estimate = METHODS["pinn"].fit(platoon, settings=FAST, spec=ModelSpec(key))
    values = np.column_stack([value_of(key, estimate.parameters, n) for n in FOLLOWING[key].names])
    np.testing.assert_allclose(values[:, :-1], truth[:, :-1], rtol=0.06)
    np.testing.assert_allclose(values[:, -1], truth[:, -1], rtol=0.1)
    assert not any(isinstance(finding, Undetermined) for finding in estimate.findings)
    assert estimate.history.parameters[-1] == estimate.parameters


@pytest.mark.parametrize("case", ["I", "II"])
def test_the_cthp_is_a_special_case(case: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Where priors say nothing, as the exact solution has none."""
    model = FOLLOWING["cthp"]
    wide = tuple(replace(parameter, spread=30.0) for parameter in model.parameters)
    monkeypatch.setitem(FOLLOWING, "cthp", replace(model, parameters=wide))
    segment = cthp_driven(MIXED, noise=0.05)
    training = FollowingFast((segment,), case, FAST, 1, ModelSpec("cthp"))
    while training.outcome is None:
        training.advance()
    exact = train(segment, case).parameters.values
    np.testing.assert_allclose(training.estimate().parameters.values, exact, rtol=1e-3)


@pytest.mark.parametrize("key", ["idm", "idm-lag", "idm-delay"])
def test_paper_moves_from_typical_values_and_keeps_what_is_held(key: str) -> None:
    (window,) = driven(FOLLOWING["idm"], TRUTHS["idm"][:1], 3, noise=0.03, seconds=60.0)
    spec = ModelSpec(key, (("v0", 40.0),))
    estimate = METHODS["pinn"].fit(window, settings=replace(PAPER, iterations=30), spec=spec)
    first, last = estimate.history.parameters.nonlinear[[0, -1], 0]
    free = np.array(FOLLOWING[key].names) != "v0"
    np.testing.assert_allclose(first[free], FOLLOWING[key].typical[free])
    assert (last[free] != first[free]).all()
    assert last[~free] == pytest.approx(40.0)
    assert estimate.history.total[-1] < estimate.history.total[0]
