"""Methods without settings on one window and on several, with every Case and model."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from accpinn.errors import ConfigError
from accpinn.methods import Method, Segments, dual_ukf, least_squares, particle, recursive, splines
from accpinn.methods.estimate import Outcome
from accpinn.methods.regression import Regression
from accpinn.model.cthp import Case
from accpinn.model.spec import PAPER_SPEC, ModelSpec
from accpinn.segment import Segment
from tests.support.driving import LAW, MIXED, driven, in_turn

INTERCEPT = 4.0
WITH_INTERCEPT = ModelSpec("cthp-s0")
FIXED = ModelSpec.of("cthp-s0", {"s0": INTERCEPT})
BATCH = (least_squares.METHOD, least_squares.SMOOTHED, splines.METHOD)
METHODS = (*BATCH, recursive.METHOD, particle.METHOD, dual_ukf.METHOD)
NEAR = {"particle": (0.25, 0.1, 0.02), "dual-ukf": (0.03, 0.02, 1e-3)}
"""Largest relative errors of α, β and τ of the filters, which take the model to be inexact."""
NEAR_OTHERS = 5e-4
"""Largest relative error of the other methods: central differences shorten sines by so much."""

each_method = pytest.mark.parametrize("method", METHODS, ids=lambda method: method.key)
each_batch_method = pytest.mark.parametrize("method", BATCH, ids=lambda method: method.key)


@cache
def windows(case: Case, spec: ModelSpec = PAPER_SPEC) -> Segments:
    """Three of one drive, of 40, 60 and 50 s; in the second other parameters hold for a time.

    That time is masked, with 3 s on either side, into which smoothing reaches.
    """
    laws = laws_of(case)
    others = [(0.3, 0.02, 1.2)] * len(laws)
    drive = in_turn((laws, 75.0), (others, 12.0), (laws, 100.0))
    if spec.model != PAPER_SPEC.model:
        drive = replace(drive, gaps=drive.gaps + INTERCEPT)
    first, second, third = drive.part(0, 401), drive.part(500, 1101), drive.part(1300, 1801)
    counts = (second.time < 22) | (second.time > 40)
    return first, replace(second, mask=np.tile(counts[:, None], len(laws))), third


def laws_of(case: Case) -> tuple[tuple[float, float, float], ...]:
    return (LAW, LAW) if case == "I" else MIXED[:2]


@each_method
@pytest.mark.parametrize("spec", [PAPER_SPEC, WITH_INTERCEPT, FIXED], ids=lambda s: s.in_words)
@pytest.mark.parametrize("case", ["I", "II"])
@pytest.mark.parametrize("count", [1, 3])
def test_finds_the_truth_or_says_what_can(
    method: Method, spec: ModelSpec, case: Case, count: int
) -> None:
    segments = windows(case, spec)[1:2] if count == 1 else windows(case, spec)
    if method not in BATCH and spec != PAPER_SPEC:
        sentence = rf"model: {method.key} cannot estimate cthp-s0; it can cthp\. For .* choose"
        with pytest.raises(ConfigError, match=sentence):
            method.fit(segments, case, spec=spec)
        return
    estimate = method.fit(segments, case, spec=spec)
    assert (estimate.method, estimate.spec, estimate.case) == (method.key, spec, case)
    truth = np.array(laws_of(case))
    near = NEAR.get(method.key, NEAR_OTHERS)
    assert (abs(estimate.parameters.values / truth - 1) <= near).all(), estimate.parameters
    if spec == PAPER_SPEC:
        assert (estimate.parameters.s0 == 0).all()
    else:
        tolerance = 0.0 if spec.fixed else 0.03
        np.testing.assert_allclose(estimate.parameters.s0, INTERCEPT, atol=tolerance)
    if case == "I":
        assert len(set(estimate.parameters)) == 1
    for segment, curves in zip(segments, estimate.curves, strict=bool(estimate.curves)):
        np.testing.assert_array_equal(curves.time, segment.time)
        counts = segment.counts.all(axis=1)
        assert abs(curves.gaps - segment.gaps)[counts].max() < 0.01
        assert abs(curves.speeds - segment.speeds)[counts].max() < 0.01
    assert (estimate.windows is None) == (method not in BATCH)
    if estimate.windows:
        assert estimate.windows.values.shape == (count, 2, 3)
        assert (abs(estimate.windows.values / truth - 1) <= near).all()


@each_method
def test_takes_windows_in_any_order(method: Method) -> None:
    """Filters take them in the order of time, whatever the order in which they are given."""
    given = method.fit(windows("II"))
    turned = method.fit(windows("II")[::-1])
    np.testing.assert_allclose(turned.parameters.values, given.parameters.values, rtol=1e-9)
    for curve, other in zip(given.curves, reversed(turned.curves), strict=True):
        np.testing.assert_allclose(curve.gaps, other.gaps, rtol=1e-9)
    if given.windows:
        by_window = turned.windows.values[::-1]
        np.testing.assert_allclose(by_window, given.windows.values, rtol=1e-9)


@each_method
def test_two_parts_of_a_window_say_what_the_whole_does(method: Method) -> None:
    whole = driven(MIXED[:2], duration=120.0, noise=0.05)
    parts = whole.part(0, 301), whole.part(301, whole.samples)
    near = 4e-3
    of_whole, of_parts = method.fit(whole), method.fit(parts)
    np.testing.assert_allclose(of_parts.parameters.values, of_whole.parameters.values, rtol=near)
    if of_parts.windows:  # which the short part alone does not
        short = of_parts.windows.values[0]
        assert (abs(short / of_whole.parameters.values - 1) > near).any()


def apart() -> Segments:
    """Windows whose followers differ from one another and from window to window."""
    laws, others = (LAW, (0.09, 0.15, 1.45)), ((0.07, 0.15, 1.45), (0.1, 0.2, 1.4))
    first, second = driven(laws, noise=0.01), driven(others, duration=100.0, noise=0.01)
    return first, replace(second, start=300.0)


@pytest.mark.parametrize("case", ["I", "II"])
def test_an_intercept_is_the_constant_of_the_rows_of_all_windows(case: Case) -> None:
    """The linear regression with a column of ones, which shares it between windows as θ."""
    estimate = least_squares.METHOD.fit(apart(), case, spec=WITH_INTERCEPT)
    rows = Regression.of_windows(apart())
    x = np.concatenate([rows.terms, np.full((*rows.rates.shape, 1), -1.0)], axis=2)
    y = rows.rates
    if case == "I":
        x, y = x.reshape(1, -1, 4), y.reshape(1, -1)
    for k in range(2):
        at = 0 if case == "I" else k
        alpha, alpha_tau, beta, alpha_s0 = np.linalg.lstsq(x[at], y[at])[0]
        expected = (alpha, beta, alpha_tau / alpha, alpha_s0 / alpha)
        np.testing.assert_allclose(estimate.parameters.complete[k, :4], expected, rtol=1e-8)


@each_batch_method
def test_each_windows_own_estimate_is_that_of_the_window_alone(method: Method) -> None:
    segments = apart()
    together = method.fit(segments, spec=WITH_INTERCEPT)
    for k, segment in enumerate(segments):
        alone = method.fit(segment, spec=WITH_INTERCEPT)
        np.testing.assert_array_equal(alone.windows.complete[0], alone.parameters.complete)
        np.testing.assert_array_equal(together.windows.complete[k], alone.parameters.complete)


@each_batch_method
def test_a_fixed_intercept_is_taken_from_the_gaps(method: Method) -> None:
    spec = ModelSpec.of("cthp-s0", {"s0": -3.0})
    shorter = tuple(replace(s, gaps=s.gaps + 3.0) for s in apart())
    estimate, expected = method.fit(apart(), spec=spec), method.fit(shorter)
    np.testing.assert_allclose(estimate.parameters.values, expected.parameters.values, rtol=1e-8)
    np.testing.assert_array_equal(estimate.parameters.s0, [-3.0, -3.0])
    np.testing.assert_array_equal(estimate.windows.s0, np.full((2, 2), -3.0))
    for curves, other in zip(estimate.curves, expected.curves, strict=True):
        np.testing.assert_allclose(curves.gaps, other.gaps - 3.0, rtol=1e-8)


def test_the_loss_of_splines_is_the_mean_over_all_instants() -> None:
    """Windows of one law can share θ at hardly any loss; those of different ones cannot."""

    def of(segments: tuple[Segment, ...]) -> tuple[float, float]:
        alone = [splines.METHOD.fit(segment).loss["total"] for segment in segments]
        lengths = [segment.samples for segment in segments]
        return splines.METHOD.fit(segments).loss["total"], float(np.average(alone, weights=lengths))

    whole = driven(MIXED[:2], duration=120.0, noise=0.05)
    together, alone = of((whole.part(0, 401), whole.part(401, whole.samples)))
    assert alone < together < 1.001 * alone
    together, alone = of(apart())
    assert together > 1.2 * alone


def test_a_window_in_which_a_filter_diverges_leaves_no_estimate() -> None:
    """By jumps that no vehicle makes, as in `test_online`."""
    rng, good = np.random.default_rng(0), driven(duration=80.0)
    wild = replace(
        good, speeds=rng.uniform(-200, 200, (801, 2)), gaps=rng.uniform(-9999, 9999, (801, 1))
    )
    estimate = dual_ukf.METHOD.fit((replace(good, start=100.0), wild))
    assert estimate.outcome is Outcome.DIVERGED
    assert np.isnan(estimate.parameters.values).all()
    assert estimate.curves == ()
