"""Closed-loop simulation least squares, of the CTHP and of the registry's models."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.signal import lfilter

from accpinn.errors import SegmentError
from accpinn.methods import TaskContext, forecast
from accpinn.methods.estimate import Outcome, Progress
from accpinn.methods.findings import Undetermined
from accpinn.methods.registry import METHODS
from accpinn.methods.simulation import Drives, optima
from accpinn.model.cthp import Case
from accpinn.model.registry import FOLLOWING
from accpinn.model.spec import ModelSpec
from accpinn.recordings.openacc import read
from accpinn.segment.cut import cut
from tests.support.driving import LAW, driven
from tests.support.following import driven as followed
from tests.support.methods import after

TRUTHS = {
    "idm": np.array([[1.2, 1.6, 1.1, 3.0, 40.0], [0.8, 2.2, 1.3, 5.0, 38.0]]),
    "fvdm": np.array([[0.15, 0.3, 20.0, 0.05, 18.0], [0.1, 0.5, 17.0, 0.06, 22.0]]),
    "cthp": np.array([[0.08, 0.2, 1.2], [0.15, 0.1, 0.9]]),
    "cthp-s0": np.array([[0.08, 0.2, 1.2, 4.0], [0.15, 0.1, 0.9, 6.0]]),
    "unequal": np.array([[0.06, 2.1, 0.2, 1.3, 1.2, 4.0], [0.12, 0.6, 0.2, 0.9, 0.9, 6.0]]),
    "idm-delay": np.array([[1.0, 1.8, 1.2, 4.0, 40.0, 0.5], [1.0, 1.8, 1.4, 4.0, 40.0, 0.4]]),
}


@pytest.mark.parametrize("key", ["cthp", "cthp-s0", "unequal", "fvdm", "idm-delay"])
def test_the_truth_of_simulated_platoons_is_found(key: str) -> None:
    model, truth = FOLLOWING[key], TRUTHS[key]
    windows = [pair for seed in range(2) for pair in followed(model, truth, seed, 0.03, 100.0)]
    groups = [list(range(k, len(windows), 2)) for k in range(2)]
    for optimum, theta in zip(optima(model, Drives.of(windows, model), groups), truth, strict=True):
        assert optimum.converged
        assert optimum.theta == pytest.approx(theta, rel=0.15)
        near = model.linearised(optimum.theta, 25.0), model.linearised(theta, 25.0)
        assert near[0].values == pytest.approx(near[1].values, rel=0.05)


def test_a_fixed_delay_that_is_shorter_than_a_step_is_kept() -> None:
    model, truth = FOLLOWING["idm-delay"], np.array([[1.0, 1.8, 1.2, 4.0, 40.0, 0.1]])
    windows = followed(model, truth, 1, 0.03, 100.0)
    (optimum,) = optima(model, Drives.of(windows, model), [[0]], fixed=(("delay", 0.1),))
    assert optimum.converged
    assert optimum.theta == pytest.approx(truth[0], rel=0.1)


def test_what_a_steady_drive_cannot_say_is_not_determined() -> None:
    model = FOLLOWING["idm"]
    (window,) = followed(model, TRUTHS["idm"][:1], 7, noise=0.03, seconds=75.0)
    unrest = np.random.default_rng(0).standard_normal(window.speeds.shape)
    gaps = np.full(window.gaps.shape, 36.0)
    steady = replace(window, speeds=25.0 + 0.02 * unrest, gaps=gaps)
    (excited,) = optima(model, Drives.of([window], model), [[0]])
    (optimum,) = optima(model, Drives.of([steady], model), [[0]])
    assert {"b", "v₀"} <= set(optimum.undetermined)
    assert set(excited.undetermined) < set(optimum.undetermined)
    (short,) = followed(model, TRUTHS["idm"][:1], 7, noise=0.03, seconds=31.0)
    (finding,) = METHODS["simulation"].fit(short, spec=ModelSpec("idm")).findings
    assert isinstance(finding, Undetermined)
    assert finding.symbols
    assert (optimum.lower < optimum.theta).all()
    assert (optimum.theta < optimum.upper).all()


def test_intervals_cover_the_truth_under_disturbances_that_last() -> None:
    """Nominal 90 %, over six simulated cars; fewer than 75 % covered would be a fault."""
    model, rng = FOLLOWING["idm"], np.random.default_rng(5)
    theta, disturbed = TRUTHS["idm"][0], []
    for seed in range(100, 124):
        (window,) = followed(model, theta[None], seed, noise=0.03, seconds=75.0)
        draws = 0.1 * rng.standard_normal((window.samples, 1))
        error = lfilter([1.0], [1.0, -np.exp(-0.1 / 6.0)], draws, axis=0)  # lasts 6 s
        disturbed.append(replace(window, gaps=window.gaps + error))
    groups = [list(range(k, k + 4)) for k in range(0, len(disturbed), 4)]
    maxima = optima(model, Drives.of(disturbed, model), groups)
    inside = [(optimum.lower <= theta) & (theta <= optimum.upper) for optimum in maxima]
    assert np.mean(inside) > 0.75


def test_what_is_left_out_moves_nothing() -> None:
    """Half a minute of another driver, which a simulation through it would not forget."""
    model, truth = FOLLOWING["idm-delay"], TRUTHS["idm-delay"]
    windows = followed(model, truth[:1], 3, 0.02, 120.0)
    (window,) = windows
    gaps, mask = window.gaps.copy(), np.ones(window.gaps.shape, bool)
    at = slice(400, 700)
    gaps[at], mask[at] = gaps[at] + 25.0, False
    fits = [
        METHODS["simulation"].fit(replace(window, gaps=other, mask=mask), spec=ModelSpec(model.key))
        for other in (window.gaps, gaps)
    ]
    np.testing.assert_allclose(
        fits[0].parameters.nonlinear, fits[1].parameters.nonlinear, rtol=1e-9
    )


def test_simulations_that_almost_diverge_are_refused(openacc_dir: Path) -> None:
    recording = read(openacc_dir / "ZalaZone" / "dynamic_part10.csv")
    with pytest.raises(SegmentError, match="almost diverge"):
        METHODS["simulation"].fit(
            cut(recording, 120.0, 60.0, (1, 2)), spec=ModelSpec("fvdm", (("kappa", 10.0),))
        )


def test_a_follower_without_a_stretch_is_undetermined_and_the_others_are_estimated() -> None:
    window = driven((LAW, LAW), duration=100.0)
    mask = np.ones(window.gaps.shape, bool)
    mask[::50, 1] = False
    fit = METHODS["simulation"].fit(replace(window, mask=mask), spec=ModelSpec("cthp"))
    np.testing.assert_allclose(fit.parameters.values[0], LAW, rtol=0.01)
    assert np.isnan(fit.parameters.values[1]).all()
    assert [f.vehicle for f in fit.findings if isinstance(f, Undetermined)] == [3]
    with pytest.raises(SegmentError, match="no follower has a stretch of 10 s"):
        METHODS["simulation"].fit(
            replace(window, mask=np.tile(mask[:, 1:], 2)), spec=ModelSpec("cthp")
        )


@pytest.mark.parametrize("case", ["I", "II"])
def test_its_rounds_can_be_watched_and_stopped(case: Case, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(forecast, "CURVE_EVERY", 0.0)
    monkeypatch.setattr(forecast, "DRAWING_SHARE", np.inf)
    windows = tuple(driven((LAW, LAW), duration=seconds) for seconds in (40.0, 60.0))
    method, spec, seen = METHODS["simulation"], ModelSpec("cthp-s0"), list[Progress]()
    found = method.fit(windows, case, None, TaskContext(on_progress=seen.append), spec)
    assert found.outcome is Outcome.CONVERGED
    *seen, last = seen
    assert last.phase == forecast.CURVES
    assert [moment.iteration for moment in seen] == [*range(found.iterations + 1)]
    assert (np.diff(found.history.total) <= 1e-9).all(), "the best of its starts so far"
    sets = 1 if case == "I" else 2
    np.testing.assert_allclose(found.parameters.values, [LAW] * 2, rtol=0.01)
    assert seen[-1].parameters == found.history.parameters[-1]
    np.testing.assert_allclose(seen[-1].parameters.complete, found.parameters.complete[:sets])
    drives = [moment.curves for moment in seen if moment.curves]
    assert len(drives) == len(seen)
    measured = windows[0].gaps[np.searchsorted(windows[0].time, drives[0].time - 1e-6)]
    errors = [np.abs(drive.gaps - measured).mean() for drive in drives]
    assert errors[0] > 1.0 > 0.1 > errors[-1]
    stopped = method.fit(windows, case, None, TaskContext(should_stop=after(2)), spec)
    assert (stopped.outcome, stopped.iterations) == (Outcome.STOPPED, 2)
    np.testing.assert_allclose(stopped.parameters.complete[:sets], seen[2].parameters.complete)
