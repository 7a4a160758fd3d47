"""The promises of every method: the truth recovered, bounds reported, an answer to bad data."""

import json
from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from accpinn.errors import ConfigError, SegmentError
from accpinn.methods.estimate import Estimate, Outcome
from accpinn.methods.findings import BoundActive, FilterUncertain, Undetermined, WeaklyDetermined
from accpinn.methods.pinn.config import CALIBRATED, FAST, PAPER, PinnConfig
from accpinn.methods.registry import (
    METHODS,
    VARIANTS,
    method_of,
    recommended_method,
    variant_name,
    variant_of,
)
from accpinn.methods.series import measured_of
from accpinn.model.cthp import Case
from accpinn.model.registry import FOLLOWING
from accpinn.model.spec import PAPER_SPEC
from accpinn.segment import Segment
from accpinn.segment.cut import cut
from tests.support.driving import LAW, MIXED, driven, segment_of, standing_still
from tests.support.methods import RIVALS, train
from tests.support.openacc_files import platoon, recording
from tests.support.samples import NOISE_FREE, NOISY, PLATOON, VICOLUNGO, sample

Estimator = Callable[[Segment, Case], Estimate]

FILTERS = ("particle", "dual-ukf")
"""They assume a large model error, so they are less certain than batch methods."""
DIRECT = ("least-squares", "savitzky-golay", "splines")
"""They find numbers in anything, and say nothing of it."""
ESTIMATORS = RIVALS | {"simulation": partial(RIVALS["simulation"], spec=PAPER_SPEC)}
PRESETS = {config.preset: partial(train, config=config) for config in (FAST, CALIBRATED)}
ALL = ESTIMATORS | PRESETS
BATCH = {NOISY: 0.02, PLATOON: 0.03, VICOLUNGO: 0.03}
STUDIES = {
    "savitzky-golay": BATCH,
    "simulation": BATCH,
    "recursive": BATCH,
    "dual-ukf": {NOISE_FREE: (0.005, 0.01, 0.001), PLATOON: (0.03, 0.08, 0.015)},
    "particle": {NOISE_FREE: (0.05, 0.08, 0.005), PLATOON: (0.12, 0.12, 0.015)},
    "fast": {NOISE_FREE: 0.005, NOISY: 0.03, PLATOON: 0.03},
    "calibrated": {NOISY: 0.015},
}
"""Largest relative error of α, β and τ by method and sample recording."""

every_method = pytest.mark.parametrize("estimate", ESTIMATORS.values(), ids=list(ESTIMATORS))


class TestEvery:
    @pytest.mark.parametrize(
        ("key", "name"), [(key, name) for key, names in STUDIES.items() for name in names]
    )
    def test_recovers_the_studies(self, key: str, name: str) -> None:
        study = sample(name)
        fit = ALL[key](study.segment, "II")
        error = abs(fit.parameters.values / study.truth - 1)
        assert (error <= STUDIES[key][name]).all(), error.round(4)
        if key in FILTERS:
            misses = (fit.track.parameters.values - study.truth) / fit.track.deviation
            assert (abs(misses[fit.track.time > 60]) < 2).all()

    @pytest.mark.parametrize("key", ["least-squares", "savitzky-golay", "splines"])
    @pytest.mark.parametrize("step", [0.05, 0.5, 1.0])
    def test_samples_may_stand_at_other_distances(self, key: str, step: float) -> None:
        fit = ALL[key](driven(step=step, duration=100.0), "II")
        np.testing.assert_allclose(fit.parameters.values, [LAW], rtol=0.05)

    @pytest.mark.parametrize("key", [*DIRECT, "calibrated", "fast"])
    def test_holds_the_bounds_and_reports_them(self, key: str) -> None:
        fit = ALL[key](driven(((0.08, -0.03, 1.5), LAW)), "II")
        assert fit.active_bounds == (("β",), ())
        assert fit.parameters[0].beta == 0
        free = fit.unconstrained[0]
        assert (free.alpha, free.beta, free.tau) == pytest.approx((0.08, -0.03, 1.5), rel=0.1)
        (finding,) = [finding for finding in fit.findings if isinstance(finding, BoundActive)]
        assert (finding.vehicle, finding.names) == (2, ("β",))
        assert finding.unconstrained[2] == free.beta

    @pytest.mark.parametrize(
        "config", [FAST, CALIBRATED, PAPER], ids=lambda settings: settings.preset
    )
    def test_a_network_survives_data_without_motion(self, config: PinnConfig) -> None:
        fit = train(standing_still(0.0), "II", replace(config, iterations=60))
        assert np.isfinite(fit.loss["total"])

    @every_method
    def test_names_itself_and_its_end_and_is_the_same_every_time(self, estimate: Estimator) -> None:
        fit, again = (estimate(driven(duration=30.0, noise=0.05), "II") for _ in range(2))
        assert fit.parameters.values.tobytes() == again.parameters.values.tobytes()
        assert (fit.findings, fit.loss, fit.iterations) == (
            again.findings,
            again.loss,
            again.iterations,
        )
        assert json.loads(json.dumps(fit.settings)) == fit.settings
        assert ESTIMATORS[fit.method] is estimate
        assert fit.outcome in (Outcome.SOLVED, Outcome.CONVERGED, Outcome.FILTERED)
        assert fit.case == "II"
        assert fit.seconds > 0

    @every_method
    @pytest.mark.parametrize("speed", [0.0, 20.0])
    def test_survives_data_without_motion(self, estimate: Estimator, speed: float) -> None:
        fit = estimate(standing_still(speed), "II")
        assert fit.outcome is not Outcome.DIVERGED
        assert not (fit.parameters.values[:, :2] < 0).any()
        is_reported = any(
            isinstance(finding, WeaklyDetermined | FilterUncertain | Undetermined)
            for finding in fit.findings
        )
        assert is_reported == (fit.method not in DIRECT)

    @every_method
    @pytest.mark.parametrize("samples", [2, 4, 5])
    def test_survives_tiny_windows(self, estimate: Estimator, samples: int) -> None:
        whole = driven(MIXED)
        tiny = segment_of(whole.time[:samples], whole.speeds[:samples], whole.gaps[:samples])
        if estimate is ESTIMATORS["simulation"]:
            with pytest.raises(SegmentError, match="choose a window of at least 30 s"):
                estimate(tiny, "II")
        elif samples < 5 and estimate is ESTIMATORS["splines"]:
            with pytest.raises(SegmentError, match="too few for a spline; take a window of"):
                estimate(tiny, "II")
        else:
            assert (estimate(tiny, "II").parameters.values[:, :2] >= 0).all()

    @every_method
    def test_survives_a_recording_of_noise(self, estimate: Estimator) -> None:
        rng = np.random.default_rng(0)
        values = 100 * rng.standard_normal((301, 5))
        fit = estimate(segment_of(0.1 * np.arange(301), values[:, :3], values[:, 3:]), "II")
        assert not (fit.parameters.values < 0).any()


@pytest.mark.parametrize("name", [name for name in VARIANTS if name != "pinn"])
def test_every_other_method_refuses_them_in_one_sentence(name: str) -> None:
    frame = platoon()
    frame.loc[150:209, ["Speed2", "IVS1", "IVS2"]] = np.nan
    segment = cut(recording(frame), allow_missing=True)
    key, settings = variant_of(name)
    with pytest.raises(SegmentError) as caught:
        METHODS[key].fit(segment, settings=settings)
    sentence = str(caught.value)
    assert sentence.startswith("run.csv: Speed2 is missing at 15–20.9 s")
    assert sentence.endswith("take a window without it, or choose the preset calibrated.")


def test_bridged_samples_serve_every_method_but_not_the_likelihood() -> None:
    frame = platoon()
    frame.loc[150:154, "Speed2"] = np.nan
    segment = cut(recording(frame))
    assert METHODS["least-squares"].fit(segment).parameters
    assert np.isnan(measured_of(segment)[30, 1, 0])
    assert np.isnan(measured_of(segment)).sum() == 2  # as own speed and as speed ahead


class TestNames:
    def test_each_says_whether_its_estimates_have_intervals(self) -> None:
        for key, config in VARIANTS.values():
            settings = config.to_json() if config else {}
            method = METHODS[key]
            has_posterior = method.posterior(settings) is not None
            assert ("with intervals" in method.described(settings)) == has_posterior
            assert not (has_posterior and method.minimises_papers_loss(settings))

    def test_a_variant_is_a_method_with_settings_and_the_reverse(self) -> None:
        for name in VARIANTS:
            key, settings = variant_of(name)
            assert variant_name(key, settings.to_json() if settings else {}) == name
        assert variant_of("pinn") == ("pinn", CALIBRATED)
        assert VARIANTS.keys() == {"pinn", "pinn-fast", "pinn-paper"} | METHODS.keys()

    @pytest.mark.parametrize("former", ["maximum-likelihood", "pinn-calibrated"])
    def test_former_names_still_mean_the_recommended_method(self, former: str) -> None:
        assert method_of(former) is METHODS["pinn"]
        assert variant_of(former) == ("pinn", CALIBRATED)

    def test_unknown_ones_are_refused_with_those_that_there_are(self) -> None:
        for use, names in ((method_of, METHODS), (variant_of, VARIANTS)):
            with pytest.raises(ConfigError, match="magic is not known") as fault:
                use("magic")
            assert all(name in str(fault.value) for name in names)

    def test_the_recommended_method_has_intervals_for_every_model(self) -> None:
        assert recommended_method() == "pinn"
        for model in FOLLOWING:
            method = METHODS[recommended_method(model)]
            settings = method.settings.default().to_json() if method.settings else {}
            assert method.key == ("pinn" if FOLLOWING[model].is_linear else "simulation")
            assert model in method.models(settings)
            assert method.posterior(settings) is not None
