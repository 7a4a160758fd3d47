"""One network a window and shared parameters: the presets fast and paper, for every model."""

from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest

from accpinn import METHODS, Case, Estimate, Parameters, Store
from accpinn.methods import Segments, TaskContext, forecast
from accpinn.methods.estimate import Outcome, Progress, of_window
from accpinn.methods.findings import Continued, Undetermined
from accpinn.methods.pinn import training
from accpinn.methods.pinn.config import FAST, PAPER, PinnConfig
from accpinn.model.registry import FOLLOWING
from accpinn.model.spec import PAPER_SPEC, ModelSpec
from accpinn.units import FloatArray
from tests.methods.test_simulation import TRUTHS
from tests.support.driving import LAW, MIXED, driven, in_turn, segment_of
from tests.support.following import driven as followed
from tests.support.methods import WEIGHTED, after
from tests.support.snapshots import asked_of, bits

BRIEF = replace(FAST, iterations=20)
SHORT = replace(PAPER, iterations=20)
IDM = ModelSpec("idm")


def fit(
    segments: Segments,
    case: Case = "II",
    config: PinnConfig = FAST,
    spec: ModelSpec = PAPER_SPEC,
    **context: Any,
) -> Estimate:
    return METHODS["pinn"].fit(segments, case, config, TaskContext(**context), spec)


def own_values(estimate: Estimate) -> FloatArray:
    """(M, n) the parameters by their names."""
    return np.column_stack([estimate.values(estimate.parameters, n) for n in estimate.names])


@cache
def windows(case: Case = "II", noise: float = 0.05) -> Segments:
    """Three of one drive, of 40, 60 and 50 s; in the second other parameters hold for a time.

    That time is masked.
    """
    laws = MIXED[:2] if case == "II" else (LAW, LAW)
    others = ((0.3, 0.02, 1.2), (0.02, 0.4, 0.8))
    drive = in_turn((laws, 75.0), (others, 12.0), (laws, 100.0))
    rng = np.random.default_rng(0)
    speeds = drive.speeds + noise * rng.standard_normal(drive.speeds.shape)
    drive = replace(drive, speeds=speeds, gaps=drive.gaps + noise * rng.standard_normal((1871, 2)))
    first, second, third = drive.part(0, 401), drive.part(500, 1101), drive.part(1300, 1801)
    counts = (second.time < 25) | (second.time > 37)
    return first, replace(second, mask=np.tile(counts[:, None], 2)), third


def by_idm(truth: FloatArray) -> Segments:
    """Windows of 80 and 110 s of two vehicles (2, 5) one behind the other."""
    segments = []
    for seed, lasts in ((3, 80.0), (4, 110.0)):
        ahead, behind = followed(FOLLOWING["idm"], truth, seed, noise=0.02, seconds=lasts)
        speeds = np.column_stack([ahead.speeds, behind.speeds[:, 1]])
        gaps = np.column_stack([ahead.gaps, behind.gaps])
        segments.append(segment_of(ahead.time, speeds, gaps))
    return tuple(segments)


class TestTruth:
    @pytest.mark.parametrize(("case", "count"), [("I", 3), ("II", 2)])
    def test_fast_finds_it(self, case: Case, count: int) -> None:
        estimate = fit(windows(case)[:count], case)
        truth = MIXED[:2] if case == "II" else (LAW, LAW)
        np.testing.assert_allclose(estimate.parameters.values, truth, rtol=0.015)
        assert (estimate.case, len(set(estimate.parameters))) == (case, 1 if case == "I" else 2)
        assert estimate.outcome is Outcome.CONVERGED
        for segment, curves in zip(windows(case)[:count], estimate.curves, strict=True):
            np.testing.assert_array_equal(curves.time, segment.time)
            assert np.abs(curves.gaps - segment.gaps).mean() < 0.05

    def test_of_windows_that_differ_it_is_the_limit_of_the_loss(self) -> None:
        """Splines minimise the same Ψ, in which a longer window weighs more."""
        first, second = driven((LAW,), 30.0), driven(((0.1, 0.15, 1.3),), 90.0)
        estimate, limit = fit((first, second)), METHODS["splines"].fit((first, second))
        np.testing.assert_allclose(estimate.parameters.values, limit.parameters.values, rtol=0.005)
        assert estimate.loss["total"] == pytest.approx(limit.loss["total"], rel=0.02)
        for segment in (first, second):
            alone = METHODS["splines"].fit(segment).parameters.values
            assert (np.abs(estimate.parameters.values / alone - 1) > 0.03).any()

    @pytest.mark.parametrize("case", ["I", "II"])
    def test_another_model_finds_it_and_keeps_what_is_fixed(self, case: Case) -> None:
        truth, spec = TRUTHS["idm"][[0, 0 if case == "I" else 1]], IDM
        if case == "I":
            spec = ModelSpec.of("idm", {"b": 1.6})
        estimate = fit(by_idm(truth), case, spec=spec)
        np.testing.assert_allclose(own_values(estimate), truth, rtol=0.06)
        assert estimate.spec == spec
        assert len(np.unique(own_values(estimate), axis=0)) == (1 if case == "I" else 2)
        if case == "I":
            np.testing.assert_allclose(own_values(estimate)[:, 1], 1.6, rtol=1e-12)
            undetermined = [f for f in estimate.findings if isinstance(f, Undetermined)]
            assert all("b" not in finding.symbols for finding in undetermined), "it is given"

    def test_a_fixed_intercept_and_delay_keep_their_values(self) -> None:
        spec = ModelSpec.of("cthp-s0-delay", {"s0": 4.0, "delay": 0.1})
        for config in (BRIEF, SHORT):
            parameters = fit(windows()[:2], config=config, spec=spec).parameters
            np.testing.assert_allclose(parameters.s0, 4.0, rtol=1e-12)
            np.testing.assert_allclose(parameters.delay, 0.1, rtol=1e-12)

    def test_paper_finds_it(self) -> None:
        """In small networks on eight seconds each, for which hundreds of iterations do."""
        drive = in_turn(((LAW,), 60.0), step=0.2)
        drive = replace(drive, gaps=drive.gaps + 4.0)
        config = replace(
            PAPER, iterations=100, lbfgs_iterations=250, learning_rate=0.03, test_share=0.0,
            layers=2, width=10, initial=Parameters(0.2, 0.2, 1.2),
        )  # fmt: skip
        spec = ModelSpec.of("cthp-s0", {"s0": 4.0})
        estimate = fit((drive.part(0, 41), drive.part(150, 191)), config=config, spec=spec)
        np.testing.assert_allclose(estimate.parameters.values, [LAW], rtol=0.1)
        assert estimate.parameters.s0 == pytest.approx(4.0)


class TestWindows:
    @pytest.mark.parametrize(
        "config",
        [BRIEF, replace(WEIGHTED, iterations=20), SHORT],
        ids=["fast", "weighted", "paper"],
    )
    def test_one_that_is_given_twice_counts_as_once(self, config: PinnConfig) -> None:
        segment = windows()[1]
        once, twice = fit((segment,), config=config), fit((segment,) * 2, config=config)
        np.testing.assert_allclose(twice.parameters.values, once.parameters.values, rtol=1e-6)
        for name, value in once.loss.items():
            assert twice.loss[name] == pytest.approx(value, rel=1e-6)
        np.testing.assert_allclose(twice.curves[1].gaps, once.curves[0].gaps, atol=1e-5)

    @pytest.mark.parametrize(
        ("config", "spec"),
        [(BRIEF, PAPER_SPEC), (BRIEF, IDM), (SHORT, PAPER_SPEC)],
        ids=["fast", "idm", "paper"],
    )
    def test_their_order_does_not_matter_and_each_is_redrawn_from_its_own_weights(
        self, config: PinnConfig, spec: ModelSpec
    ) -> None:
        segments = windows()[:2]
        estimate, turned = (fit(s, config=config, spec=spec) for s in (segments, segments[::-1]))
        np.testing.assert_allclose(own_values(turned), own_values(estimate), rtol=1e-6)
        redrawn = METHODS["pinn"].redraw
        for k, (segment, curves) in enumerate(zip(segments, estimate.curves, strict=True)):
            np.testing.assert_allclose(turned.curves[1 - k].gaps, curves.gaps, atol=1e-5)
            again = redrawn(estimate, k, segment.time, segment.window.duration)
            np.testing.assert_allclose(again.gaps, curves.gaps, atol=1e-7)
            np.testing.assert_allclose(again.speeds, curves.speeds, atol=1e-7)

    @pytest.mark.parametrize("stop", [2, 9, 11])
    def test_a_stop_within_a_cycle_leaves_curves_and_weights_that_belong_together(
        self, stop: int, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        monkeypatch.setattr(forecast, "CURVE_EVERY", 0.0)
        monkeypatch.setattr(forecast, "DRAWING_SHARE", np.inf)
        seen: list[Progress] = []
        estimate = fit(windows(), should_stop=after(stop), on_progress=seen.append)
        assert estimate.outcome is Outcome.STOPPED
        assert (np.diff([moment.iteration for moment in seen]) > 0).all()
        assert estimate.loss["total"] == seen[-1].total
        for k, (segment, curves) in enumerate(zip(windows(), estimate.curves, strict=True)):
            again = training.redraw(estimate, k, segment.time, segment.window.duration)
            np.testing.assert_allclose(again.gaps, curves.gaps, atol=1e-7)
        np.testing.assert_array_equal(seen[-1].curves.gaps, estimate.curves[0].gaps)

    def test_paper_keeps_out_instants_of_each_and_goes_on_from_its_checkpoint(
        self, store: Store, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        monkeypatch.setattr(training, "CHECKPOINT_EVERY", 0.0)
        checkpoints = store.checkpoints(asked_of(windows()[0], "pinn", SHORT), pytest.fail)
        straight = fit(windows(), config=SHORT)
        for k, segment in enumerate(windows()):
            split = of_window(straight.arrays, k)["test"]
            assert (split.shape, split.sum()) == (segment.time.shape, round(0.2 * len(split) - 0.2))
        stopped = fit(windows(), config=SHORT, checkpoints=checkpoints, should_stop=after(7))
        assert (stopped.outcome, stopped.iterations) == (Outcome.STOPPED, 7)
        continued = fit(windows(), config=SHORT, checkpoints=checkpoints)
        assert Continued(7) in continued.findings
        assert lasting(continued) == lasting(straight)


def lasting(estimate: Estimate) -> Any:
    """All of it to the last bit, but for the time it took and what was found on the way."""
    history = replace(estimate.history, seconds=np.zeros(0))
    return bits(replace(estimate, seconds=0.0, findings=(), history=history))
