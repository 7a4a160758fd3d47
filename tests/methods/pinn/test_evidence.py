"""What `calibrated` maximises, held against the evidence of a surrogate in a basis of splines."""

import numpy as np
import pytest
from scipy.interpolate import BSpline

from accpinn.methods.joint_likelihood import joint_maxima
from accpinn.methods.likelihood import Criterion, search
from accpinn.methods.series import Series, series_of
from accpinn.methods.state_space import GAP_DRIFT, LEADER_MEMORY, coordinates
from accpinn.model.cthp import Case
from accpinn.model.spec import ModelSpec
from accpinn.segment import Segment
from accpinn.units import FloatArray
from bench.disturbed import Disturbance, disturbed
from tests.support.evidence import DEGREE, OUTPUTS, Evidence, LinearEvidence
from tests.support.vehicles import AUDI, BMW, row

VALUES = np.array([0.08, 0.12, 0.2, 0.25, 4.0, 0.5, 0.03, 0.05, 0.5])


def recording(duration: float) -> Segment:
    """Two followers."""
    return disturbed(row(AUDI, BMW), 1, Disturbance(), duration=duration)


def short() -> Series:
    return series_of([recording(40.0)], "II")


def dense(banded: FloatArray) -> FloatArray:
    """The symmetric matrix of a lower banded form."""
    size = banded.shape[1]
    matrix = np.zeros((size, size))
    for offset, diagonal in enumerate(banded):
        matrix += np.diag(diagonal[: size - offset], -offset)
    return np.asarray(matrix + np.tril(matrix, -1).T)


def test_the_prior_is_the_integral_of_the_squared_residuals() -> None:
    """By quadrature of the equations as they are written, for random weights."""
    series = short()
    evidence = LinearEvidence(series.measured[:, :, 0], series.step)
    weights = np.random.default_rng(1).standard_normal((evidence.design.basis.size, OUTPUTS))
    curve = BSpline(evidence.design.basis.knots, weights, DEGREE)
    end = evidence.design.basis.knots[-1]
    time = np.linspace(0.0, end, 400_001)
    (p, v, u), (dp, dv, du), (ddp, ddv, ddu), (_, dddv, _) = (curve(time, k).T for k in range(4))
    alpha, alpha_tau, beta, s, memory, rise, _, _, leader = VALUES
    r = dv - alpha * p + (alpha_tau + beta) * v - beta * u
    dr = ddv - alpha * dp + (alpha_tau + beta) * dv - beta * du
    ddr = dddv - alpha * ddp + (alpha_tau + beta) * ddv - beta * ddu
    # (T₂ d/dt + 1)(d/dt + 1/T) r
    whitened = rise * ddr + dr + (r + rise * dr) / memory
    running = whitened**2 / (2 * s**2 * (memory + rise) / memory**2)
    running += (dp - u + v) ** 2 / GAP_DRIFT
    running += (ddu + du / LEADER_MEMORY) ** 2 / (2 * leader**2 / LEADER_MEMORY)
    first = r[0] ** 2 / s**2 + dr[0] ** 2 * memory * rise / s**2 + du[0] ** 2 / leader**2
    first += p[0] ** 2 / 100**2 + v[0] ** 2 / 50**2 + u[0] ** 2 / 50**2
    expected = np.trapezoid(running, time) + first
    w = weights.ravel()
    assert w @ dense(evidence.design.prior(VALUES)) @ w == pytest.approx(expected, rel=1e-6)


@pytest.mark.parametrize("late", [0.05, 0.3, 1.0])
@pytest.mark.parametrize("form", ["cthp-lag", "cthp-s0-delay"])
def test_behind_a_lag_or_a_delay_it_is_the_filter_s_likelihood_but_for_a_constant(
    form: str, late: float
) -> None:
    """The constant is that of the features; between near parameters it cancels."""
    series = series_of([recording(100.0)], "II", [0])
    evidence, likelihood = Evidence(series, ModelSpec(form)), Criterion(series, ModelSpec(form))
    moves = np.random.default_rng(2).uniform(-0.1, 0.1, (8, evidence.size))
    z = evidence.start + np.append(0.0 * moves[:1], moves, axis=0)
    z[:, -1] = late * (1.0 + moves[0, 0])
    groups = np.zeros(len(z), int)
    apart = evidence.log_likelihood(z, groups) - likelihood.log_likelihood(z, groups)
    assert np.ptp(likelihood.log_likelihood(z, groups)) > 20
    assert np.ptp(apart) < 0.5


@pytest.mark.parametrize("missing", [False, True], ids=["complete", "missing"])
def test_the_evidence_is_the_density_of_the_data_with_the_weights_integrated_out(
    missing: bool,
) -> None:
    """The data are N(0, Φ Λ⁻¹ Φᵀ + σ²), computed densely."""
    series = short()
    measured = series.measured[:, :, 0].copy()
    if missing:
        measured[20:30, 0] = np.nan
        measured[25:35] = np.nan
    evidence = LinearEvidence(measured, series.step)
    features = np.kron(evidence.design.basis.at_samples.toarray(), np.eye(OUTPUTS))
    prior = np.linalg.inv(dense(evidence.design.prior(VALUES)))
    noise = np.tile(VALUES[[6, 7, 7]] ** 2, len(measured))
    y, present = measured.ravel(), ~np.isnan(measured.ravel())
    covariance = (features @ prior @ features.T + np.diag(noise))[np.ix_(present, present)]
    whitened = np.linalg.solve(covariance, y[present])
    determinant = np.linalg.slogdet(2 * np.pi * covariance)[1]
    assert evidence.log_evidence(VALUES) == pytest.approx(
        -0.5 * (y[present] @ whitened + determinant), abs=1e-3
    )


@pytest.mark.parametrize("model", ["cthp", "cthp-s0", "cthp-lag", "cthp-s0-delay"])
@pytest.mark.parametrize("case", ["I", "II"])
def test_its_maximum_is_that_of_the_filter_s_likelihood(case: Case, model: str) -> None:
    """Within .15 standard errors, the gap's noise and a delay within .5.

    The splines bend less than the gap's own drift does, which they take for noise, and hardly as
    fast as a command behind a delay.
    """
    segment, spec = recording(40.0), ModelSpec(model)
    maxima = joint_maxima((segment,), case, spec)
    evidence = Evidence(series_of([segment], case), spec)
    expected = np.array([maximum.coordinates for maximum in maxima])
    rng = np.random.default_rng(3)
    starts = expected + 0.2 * rng.standard_normal(expected.shape)
    ours = search(evidence, starts, np.arange(len(maxima)))
    names = [unknown.name for unknown in coordinates(model)]
    near = np.array([0.5 if name in ("gap_noise", "delay") else 0.15 for name in names])
    for our_maximum, maximum in zip(ours, maxima, strict=True):
        assert our_maximum.converged
        apart = our_maximum.coordinates - maximum.coordinates
        errors = np.sqrt(np.diag(np.linalg.inv(maximum.curvature)))
        assert (np.abs(apart) < near * errors).all(), apart / errors
