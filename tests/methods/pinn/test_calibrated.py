"""The preset `calibrated`: parameters by the evidence, the network around them."""

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from accpinn.methods.store import Store

from accpinn.errors import ConfigError
from accpinn.evaluation.closed_loop import surrogate_errors
from accpinn.methods.fit import Continued, Fit, HiddenLayersGain, Outcome, Progress
from accpinn.methods.maximum_likelihood import fit as maximum_likelihood
from accpinn.methods.pinn import training
from accpinn.methods.pinn.calibrated import CalibratedTraining
from accpinn.methods.pinn.config import CALIBRATED, PinnConfig, preset
from accpinn.methods.pinn.evidence_output import OutputLayer
from accpinn.methods.pinn.network import FourierFeatures, HiddenLayers, stack_outputs
from accpinn.methods.pinn.request import WarmStart
from accpinn.model.cthp import Case
from accpinn.segment.segment import Segment
from accpinn.units import FloatArray
from bench.coverage import SETS
from bench.disturbed import Disturbance, disturbed
from tests.methods.pinn.test_training import after, assert_same_result
from tests.support.methods import train
from tests.support.samples import NOISE_FREE, NOISY, sample

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

    @pytest.mark.parametrize("name", [NOISE_FREE, NOISY])
    def test_recovers_the_truth_where_nothing_disturbs(self, name: str) -> None:
        """Memory and rise of a disturbance that is not there are arbitrary."""
        study = sample(name)
        fit = train(study.segment, "II", CALIBRATED)
        assert fit.outcome in (Outcome.CONVERGED, Outcome.FINISHED)
        np.testing.assert_allclose(fit.parameters.values, study.truth, rtol=0.015)

    def test_network_follows_the_data(self) -> None:
        errors = surrogate_errors(platoon(), fitted())
        assert errors.gap_mae.max() < 0.1

    def test_converges_and_states_what_the_hidden_layers_contributed(self) -> None:
        fit = fitted()
        assert fit.outcome is Outcome.CONVERGED
        assert HiddenLayersGain(fit.loss["start"], fit.loss["total"]) in fit.findings
        assert fit.loss["total"] <= fit.loss["start"]

    def test_masked_instants_do_not_count(self) -> None:
        segment = platoon()
        mask = np.ones((segment.samples, 2), bool)
        mask[200:260, 0] = False
        fit = train(replace(segment, mask=mask), "II", CALIBRATED)
        assert fit.outcome is Outcome.CONVERGED
        assert fit.parameters[0] != fitted().parameters[0]
        assert fit.parameters[1] == fitted().parameters[1]


class TestProgress:
    def test_shows_evidence_and_narrowing_uncertainty(self) -> None:
        seen: list[Progress] = []
        fit = train(platoon(), "II", CALIBRATED, on_progress=seen.append)
        phases = [moment.phase for moment in seen]
        assert phases == sorted(phases, key=["evidence", "start", "Adam"].index)
        assert [moment.iteration for moment in seen] == sorted({m.iteration for m in seen})
        evidence = np.array([moment.evidence for moment in seen])
        assert evidence[-1] > evidence[0] + 10
        np.testing.assert_array_equal(fit.history.evidence, evidence)
        assert fit.history.deviations.shape == (len(seen), 2, 3)
        assert fit.loss["evidence"] == evidence[-1]

    def test_curves_are_drawn_as_soon_as_there_is_an_output_layer(
        self, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        monkeypatch.setattr(training, "CURVE_EVERY", 0.0)  # as on a machine that is slow
        seen: list[Progress] = []
        fit = train(platoon(), "II", CALIBRATED, on_progress=seen.append)
        drawn = [moment.surrogate is not None for moment in seen[:-1]]
        assert drawn == [moment.phase != "evidence" for moment in seen[:-1]]
        (first, *_) = [moment.surrogate for moment in seen if moment.surrogate]
        np.testing.assert_allclose(first.speeds, fit.surrogate.speeds, atol=0.05)


class TestGoesOn:
    @pytest.mark.parametrize("stop", [3, 22])
    def test_a_stopped_training_goes_on_as_if_it_had_not_been(
        self, tmp_path: Path, stop: int
    ) -> None:
        store = Store(tmp_path)
        stopped = train(platoon(), "II", CALIBRATED, store=store, should_stop=after(stop))
        assert stopped.outcome is Outcome.STOPPED
        assert stopped.surrogate is not None
        continued = train(platoon(), "II", CALIBRATED, store=store)
        assert any(isinstance(one, Continued) for one in continued.findings)
        assert_same_result(continued, fitted())
        again = train(platoon(), "II", CALIBRATED, store=store)
        assert again.cached
        assert_same_result(again, fitted())

    def test_warm_start_begins_at_the_parameters(self) -> None:
        seen: list[Progress] = []
        warm = WarmStart.of(fitted(), "snapshot")
        fit = train(platoon(), "II", CALIBRATED, warm=warm, on_progress=seen.append)
        np.testing.assert_allclose(seen[0].parameters.values, fitted().parameters.values, rtol=1e-9)
        apart = np.log(fit.parameters.values / fitted().parameters.values)
        assert (np.abs(apart) < 0.1 * fit.arrays["deviations"]).all()


class TestSettings:
    def test_weights_are_those_of_the_evidence(self) -> None:
        with pytest.raises(ConfigError, match="weights"):
            preset("calibrated", weight_data=(2.0, 1.0))

    def test_come_back_from_json(self) -> None:
        changed = preset("calibrated", seed=3)
        assert PinnConfig.from_json(changed.to_json()) == changed
        assert changed.changes() == {"seed": 3}


class TestOutputLayer:
    @pytest.mark.parametrize("masked", [False, True])
    def test_weights_minimise_the_loss(self, masked: bool) -> None:
        """Any other weights have a larger one."""
        segment = platoon()
        mask = np.random.default_rng(4).random(segment.gaps.shape) < 0.7 if masked else None
        values = np.tile([0.08, 0.12, 0.2, 0.25, 4.0, 0.5, 0.03, 0.05, 0.5], (2, 1))
        values[1, 0] = 0.05
        fourier = FourierFeatures.up_to(0.3, 0.55 * SHORT)
        measured = stack_outputs(segment.speeds, segment.gaps)
        layer = OutputLayer(measured, 5, segment.sample_time, mask, fourier, values)
        hidden = HiddenLayers(fourier, CALIBRATED.hidden, 0, 3)
        active, at_samples = hidden(layer.on_grid), hidden(layer.at_samples)[0]
        best = layer.solve(active, at_samples)

        def loss(weights: FloatArray) -> float:
            orders = np.concatenate([layer.orders, active], axis=2) @ weights
            outputs = np.hstack([layer.at_samples, at_samples]) @ weights
            return sum(layer.terms(orders, outputs))

        for seed in range(5):
            away = 1e-3 * np.random.default_rng(seed).standard_normal(best.shape)
            ahead, behind = loss(best + away), loss(best - away)
            rise = (ahead + behind) / 2 - loss(best)
            assert rise > 0
            assert abs(ahead - behind) / 2 < 1e-3 * rise

    @pytest.mark.parametrize("masked", [False, True])
    def test_adams_gradient_is_that_of_the_loss(self, masked: bool) -> None:
        """On average over minibatches."""
        segment = platoon()
        if masked:
            mask = np.ones(segment.gaps.shape, bool)
            mask[100:200, 0] = False
            segment = replace(segment, mask=mask)
        training = CalibratedTraining(segment, "II", CALIBRATED)
        while training._layer is None:
            training.advance()
        layer, descent, found = training._layer, training._descent, list[FloatArray]()
        # Away from the optimum of the output layer, where the gradient nearly vanishes.
        away = np.random.default_rng(0).standard_normal(descent.hidden.values.size)
        descent.hidden.values += 1e-3 * away.astype(np.float32)
        descent.adam.step = lambda gradient, _: found.append(gradient)
        for training._iteration in range(30):
            training._descend(20)
        size, seen = training._fourier.size, training._seen

        def loss(values: FloatArray) -> float:
            hidden = descent.hidden.with_values(values)
            active, at_samples = hidden(layer.on_grid[:, :seen]), hidden(layer.at_samples[:, :seen])
            orders = layer.orders @ training._weights[:size] + active @ training._weights[size:]
            outputs = layer.at_samples @ training._weights[:size]
            data, physics, _ = layer.terms(
                orders, outputs + at_samples[0] @ training._weights[size:]
            )
            return data + physics

        values, gradients = descent.doubled().values, np.array(found, float)
        for direction in np.random.default_rng(3).standard_normal((5, len(values))):
            slope = (loss(values + 1e-6 * direction) - loss(values - 1e-6 * direction)) / 2e-6
            drawn = gradients @ direction
            assert drawn.mean() == pytest.approx(slope, abs=4 * drawn.std() / len(drawn) ** 0.5)
