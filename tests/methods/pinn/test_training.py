"""Training, from request to result: what it recovers, how it ends, and how it goes on."""

import json
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest

from accpinn import METHODS, Case, Estimate, Parameters, PinnConfig, Segment, Store, preset
from accpinn.errors import ConfigError
from accpinn.evaluation.closed_loop import ClosedLoop
from accpinn.methods import splines
from accpinn.methods.estimate import Checkpoint, Outcome, Progress
from accpinn.methods.findings import Continued, HiddenLayersGain, HoldoutLoss
from accpinn.methods.pinn import training
from accpinn.methods.pinn.config import CALIBRATED, FAST, PAPER
from accpinn.methods.pinn.fast import FastTraining
from accpinn.model.registry import FOLLOWING
from tests.support.driving import LAW, MIXED, driven, segment_of
from tests.support.following import CTHPS
from tests.support.methods import WEIGHTED, after, train
from tests.support.snapshots import asked_of, bits

SHORT = replace(PAPER, iterations=20)
"""A `paper` training of about a tenth of a second on a minute of data."""


@cache
def noisy() -> Segment:
    return driven(duration=30.0, noise=0.05)


@cache
def plain(config: PinnConfig = FAST) -> Estimate:
    """One follower, trained without a store."""
    return train(noisy(), "II", config)


@cache
def fitted(case: Case = "II", config: PinnConfig = FAST) -> Estimate:
    """One follower for Case II, three different ones for Case I and II alike."""
    return train(driven(MIXED, noise=0.05), case, config)


def lasting(estimate: Estimate) -> Any:
    """All of it to the last bit, but for the time it took and what was found on the way."""
    history = replace(estimate.history, seconds=np.zeros(0))
    return bits(replace(estimate, seconds=0.0, findings=(), history=history))


class TestRecoversTheTruth:
    @pytest.mark.parametrize("case", ["I", "II"])
    def test_as_well_as_the_limit_of_the_loss(self, case: Case) -> None:
        estimate, limit = fitted(case), splines.METHOD.fit(driven(MIXED, noise=0.05), case)
        distance = np.abs(estimate.parameters.values / limit.parameters.values - 1).max(axis=0)
        assert (distance <= (0.002, 0.005, 0.002)).all()  # α, β, τ; we see a tenth of it
        assert estimate.loss["total"] == pytest.approx(limit.loss["total"], rel=0.02)
        assert len(set(estimate.parameters)) == (1 if case == "I" else 3)
        assert estimate.history.parameters.values.shape[1:] == (len(set(estimate.parameters)), 3)

    def test_from_every_initial_value(self) -> None:
        for initial in ((0.0, 0.0, 0.0), (5.0, 5.0, 5.0)):
            estimate = train(noisy(), "II", preset("fast", initial=Parameters(*initial)))
            np.testing.assert_allclose(estimate.parameters.values[0], LAW, rtol=0.01)


class TestResult:
    def test_loss_is_the_sum_of_its_terms_and_ends_the_history(self) -> None:
        estimate = fitted()
        terms = estimate.loss["data"] + estimate.loss["physics"] + estimate.loss["initial"]
        assert estimate.loss["total"] == pytest.approx(terms, rel=1e-12)
        assert estimate.history.total[-1] == estimate.loss["total"]
        assert estimate.history.parameters[-1] == estimate.parameters
        assert estimate.loss["start"] > estimate.loss["total"]
        weighted = fitted(config=WEIGHTED)
        assert weighted.loss["start"] > weighted.loss["total"]
        assert HiddenLayersGain(estimate.loss["start"], estimate.loss["total"]) in estimate.findings

    def test_initial_condition_binds_the_first_instant_when_weighted(self) -> None:
        def first_error(estimate: Estimate) -> float:
            return float(abs(estimate.curves[0].gaps[0, 0] - noisy().gaps[0, 0]))

        free, bound = plain(), train(noisy(), "II", preset("fast", weight_initial=100.0))
        assert free.loss["initial"] == 0
        assert bound.loss["initial"] > 0
        assert first_error(bound) < 0.1 * first_error(free)


class TestEnds:
    def test_ends_with_the_first_cycle_that_moves_no_parameter(self) -> None:
        estimate = fitted()
        assert estimate.outcome is Outcome.CONVERGED
        history = estimate.history
        cycles = np.flatnonzero(np.diff(history.iteration) == 50) + 1
        values = history.parameters.values
        moved = [np.abs(values[now] / values[now - 1] - 1).max() for now in cycles]
        assert [move <= 1e-3 for move in moved] == [False] * (len(moved) - 1) + [True]

    @pytest.mark.parametrize("config", [FAST, SHORT], ids=["fast", "paper"])
    def test_moves_forward_only_and_finishes_after_the_planned_iterations(
        self, config: PinnConfig
    ) -> None:
        seen: list[Progress] = []
        config = replace(config, initial=Parameters(0.3, 0.4, 1.1), iterations=13)
        estimate = train(noisy(), "II", config, on_progress=seen.append)
        np.testing.assert_allclose(seen[0].parameters.values, [[0.3, 0.4, 1.1]], rtol=1e-12)
        iterations = [moment.iteration for moment in seen]
        assert (np.diff(iterations) > 0).all()
        assert (iterations[0], iterations[-1], estimate.iterations) == (0, 13, 13)
        assert (np.diff([moment.seconds for moment in seen]) >= 0).all()
        assert seen[-1].iterations == 13
        assert all(moment.iteration <= moment.iterations <= 13 for moment in seen)
        assert estimate.outcome is Outcome.FINISHED
        other = train(noisy(), "II", replace(config, seed=1))
        assert other.parameters.values.tobytes() != estimate.parameters.values.tobytes()

    @pytest.mark.parametrize("config", [FAST, SHORT], ids=["fast", "paper"])
    def test_stopped_before_the_first_iteration_has_the_initial_values(
        self, config: PinnConfig
    ) -> None:
        estimate = train(noisy(), "II", config, should_stop=lambda: True)
        assert estimate.outcome is Outcome.STOPPED
        assert estimate.iterations == 0
        assert estimate.parameters.values.tolist() == [[1.0, 1.0, 1.0]]

    @pytest.mark.parametrize("name", ["fast", "calibrated", "paper"])
    def test_numbers_beyond_reckoning_end_as_diverged(self, name: str) -> None:
        sane = noisy()
        absurd = segment_of(sane.time, sane.speeds, sane.gaps * 1e200)
        estimate = train(absurd, "II", preset(name, iterations=20))
        assert estimate.outcome is Outcome.DIVERGED


class TestBounds:
    def test_without_a_gain_on_the_gap_there_is_no_headway(self) -> None:
        segment = driven(((-0.002, 0.5, -5.0),))  # brakes a little, whatever the gap
        estimate = train(segment)
        assert estimate.active_bounds == (("α",),)
        assert estimate.parameters[0].alpha == 0
        assert np.isnan(estimate.parameters[0].tau)
        assert estimate.parameters[0].beta == pytest.approx(0.5, rel=0.01)
        assert ClosedLoop.of(segment, estimate).errors is None

    def test_the_paper_preset_never_leaves_them(self) -> None:
        seen: list[Progress] = []
        config = replace(
            SHORT, initial=Parameters(0.0, 0.01, 0.01), learning_rate=0.05, iterations=100
        )
        estimate = train(driven(((0.08, -0.03, 1.5),)), "II", config, on_progress=seen.append)
        assert all((moment.parameters.values >= 0).all() for moment in seen)
        zero = {"α": estimate.parameters[0].alpha == 0, "β": estimate.parameters[0].beta == 0}
        for name, at_zero in zero.items():
            assert (name in estimate.active_bounds[0]) == at_zero


class TestPaperPreset:
    def test_the_test_part_changes_nothing_and_its_errors_are_reported(self) -> None:
        estimate = plain(SHORT)
        assert estimate.arrays["window0.test"].sum() == round(0.2 * 301)
        assert estimate.arrays["window0.test"][0] == 0, (
            "the first instant stays, as Ψ_R looks at it"
        )
        assert estimate.loss["test_data"] > 0
        assert estimate.loss["test_physics"] >= 0
        losses = estimate.loss["test_data"], estimate.loss["test_physics"]
        assert HoldoutLoss(60, *losses) in estimate.findings
        bent = noisy().gaps.copy()
        bent[estimate.arrays["window0.test"] == 1] += 50.0
        other = train(segment_of(noisy().time, noisy().speeds, bent), "II", SHORT)
        assert other.parameters.values.tobytes() == estimate.parameters.values.tobytes()
        assert other.loss["data"] == estimate.loss["data"]
        assert other.loss["test_data"] > estimate.loss["test_data"] + 1000

    def test_lbfgs_goes_on_searching_after_adam(self) -> None:
        adam = train(noisy(), "II", replace(SHORT, iterations=60))
        both = train(noisy(), "II", replace(SHORT, iterations=60, lbfgs_iterations=40))
        assert both.iterations == 100
        assert both.loss["total"] < 0.3 * adam.loss["total"]
        history = both.history
        second = history.total[history.iteration >= 65]
        assert (np.diff(second) < 0).all(), "each handful of its iterations lowers Ψ"


class TestCheckpoints:
    @pytest.mark.parametrize(
        ("config", "stop", "at"), [(SHORT, 2, 10), (replace(SHORT, lbfgs_iterations=40), 6, 30)]
    )
    def test_stopped_and_continued_is_the_straight_run(
        self, store: Store, config: PinnConfig, stop: int, at: int, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        """In the first phase to the last bit; the second continues there and goes on lower."""
        monkeypatch.setattr(training, "CHECKPOINT_EVERY", 0.0)
        kept = store.checkpoints(asked_of(noisy(), "pinn", config), pytest.fail)
        stopped = train(noisy(), "II", config, checkpoints=kept, should_stop=after(stop))
        assert (stopped.outcome, stopped.iterations) == (Outcome.STOPPED, at)
        continued = train(noisy(), "II", config, checkpoints=kept)
        assert Continued(at) in continued.findings
        assert continued.seconds > stopped.seconds
        if at > SHORT.iterations:
            assert continued.iterations == 60
            assert continued.loss["total"] < stopped.loss["total"]
            return
        assert lasting(continued) == lasting(plain(SHORT))
        longer = replace(SHORT, iterations=60)
        continued = train(noisy(), "II", longer, checkpoints=kept)
        assert Continued(20) in continued.findings
        assert lasting(continued) == lasting(plain(longer))

    @pytest.mark.parametrize(
        "foreign",
        [
            {"history.rows": np.zeros((1, 6))},
            {"history.rows": np.zeros((1, 6)), "history.tables": np.zeros((1, 1, 3))},
        ],
    )
    def test_one_that_no_training_can_use_is_rejected(
        self, store: Store, foreign: Checkpoint
    ) -> None:
        said: list[str] = []
        kept = store.checkpoints(asked_of(noisy(), "pinn", SHORT), said.append)
        kept.save(foreign)
        trained = train(noisy(), "II", SHORT, checkpoints=kept)
        assert lasting(trained) == lasting(plain(SHORT))
        assert len(said) == 1

    @pytest.mark.parametrize(
        "config",
        [
            replace(FAST, iterations=60),
            replace(CALIBRATED, iterations=60),
            replace(SHORT, weight_data=(1e307, 1e307), iterations=50),
        ],
        ids=["fast", "calibrated", "diverged"],
    )
    def test_presets_of_a_second_and_diverged_trainings_have_none(
        self, store: Store, config: PinnConfig
    ) -> None:
        """Weights so large that the second gradient step overflows."""
        asked = asked_of(noisy(), "pinn", config)
        kept, stop = (
            store.checkpoints(asked, pytest.fail),
            after(50 if config.weight_data[0] > 1 else 2),
        )
        estimate = train(noisy(), "II", config, checkpoints=kept, should_stop=stop)
        assert estimate.outcome in (Outcome.STOPPED, Outcome.DIVERGED)
        assert not [*store.folder.glob("*.state.npz")]


class TestSettings:
    @pytest.mark.parametrize(
        ("changes", "sentence"),
        [
            ({"iterations": 0}, "iterations: 0 is not allowed; choose 1 to 1,000,000."),
            ({"seed": -1}, "seed"),
            ({"initial": Parameters(1.0, -0.1, 1.0)}, "three numbers"),
            ({"initial": Parameters(1.0, float("nan"), 1.0)}, "three numbers"),
            ({"initial": Parameters([1.0, 1.0], 1.0, 1.0)}, "three numbers"),
            ({"initial": Parameters(1.0, 1.0, 5.1)}, "τ from 0 to 5"),
            ({"learning_rate": 0.0}, "learning rate"),
            ({"learning_rate": float("nan")}, "learning rate"),
            ({"weight_data": (0.0, 1.0)}, "data weights"),
            ({"weight_physics": (1.0, float("inf"))}, "weights"),
            ({"weight_initial": -1.0}, "weights"),
            ({"batch": 1}, "batch"),
            ({"highest_frequency": 5.0}, "highest frequency"),
            ({"test_share": 0.2}, "paper preset"),
            ({"lbfgs_iterations": 10}, "paper preset"),
        ],
    )
    def test_outside_their_range_are_refused_by_name(
        self, changes: dict[str, Any], sentence: str
    ) -> None:
        with pytest.raises(ConfigError, match=sentence):
            preset("fast", **changes)

    @pytest.mark.parametrize(
        "config", [preset("fast", initial=Parameters(0.5, 1, 2)), PAPER, SHORT]
    )
    def test_come_back_from_json(self, config: PinnConfig) -> None:
        back = PinnConfig.from_json(json.loads(json.dumps(config.to_json())))
        assert back == config
        usual = PAPER if config.preset == "paper" else FAST
        assert PinnConfig.from_json(usual.to_json() | back.changes()) == config
        assert not PinnConfig.from_json(PAPER.to_json()).changes()

    def test_what_is_not_given_is_the_presets(self) -> None:
        paper, fast = PinnConfig("paper"), PinnConfig("fast", seed=3)
        assert (paper.learning_rate, paper.iterations, paper.test_share) == (0.001, 20_000, 0.2)
        assert (fast.learning_rate, fast.iterations, fast.test_share) == (0.01, 600, 0.0)
        assert PinnConfig() == PinnConfig.default() == preset("calibrated")
        assert PinnConfig("paper", iterations=5, test_share=0.0).changes() == {
            "iterations": 5,
            "test_share": 0.0,
        }

    def test_the_preset_decides_what_can_be_estimated_and_whether_a_posterior_is_known(
        self,
    ) -> None:
        pinn = METHODS["pinn"]
        by_default, paper = PinnConfig().to_json(), PAPER.to_json()
        assert pinn.models(by_default)[0] == "cthp-s0-delay"
        assert sorted(pinn.models(by_default)) == sorted(CTHPS)
        assert (pinn.usual_spec().model, pinn.usual_spec(FAST).model) == ("cthp-s0-delay", "cthp")
        assert set(pinn.models(paper)) == set(FOLLOWING)
        assert (pinn.posterior(by_default), pinn.posterior(paper)) == ("likelihood", None)
        assert (pinn.allows_missing(by_default), pinn.allows_missing(paper)) == (True, False)
        windows = (noisy(), driven(duration=90.0))
        lasts = [pinn.expected_seconds((window,), PAPER) for window in windows]
        assert pinn.expected_seconds(windows, PAPER) == pytest.approx(sum(lasts))

    def test_an_unknown_preset_is_refused(self) -> None:
        with pytest.raises(ConfigError, match="choose fast, calibrated or paper"):
            preset("quick")
        with pytest.raises(ConfigError, match="initial = 1 is not allowed"):
            PinnConfig.from_json(FAST.to_json() | {"initial": 1})


def test_a_cycle_that_does_not_lower_the_loss_is_taken_back_and_is_the_last() -> None:
    config = replace(FAST, learning_rate=1.0)
    training = FastTraining((driven(MIXED, noise=0.05),), "II", config)
    while training.progress.phase == "start" and training._starting:
        training.advance()
    before, weights = training.progress, training.estimate().arrays
    training.advance()
    assert training.outcome is Outcome.CONVERGED
    assert training.progress.total == before.total
    assert training.progress.parameters == before.parameters
    for name, values in training.estimate().arrays.items():
        np.testing.assert_array_equal(values, weights[name])
