"""The evidence of a surrogate that is linear in its weights, for the parameters of one follower.

For fixed features Φ(t) and fixed unknowns z (parameters, disturbance, noise; see `state_space`) the
surrogate (p, v, u) = Φ W is Gaussian in its output layer W, w = vec W. The physics is its prior:

    wᵀΛw  = ∫ e_r²/q_r + e_g²/q_g + e_u²/q_u dt + terms of the first instant
    e_r   = (T₂ d/dt + 1)(d/dt + 1/T) r,   r = v' - αp + (ατ+β)v - βu,   q_r = 2s²(T + T₂)/T²
    e_g   = p' - u + v,                     q_g as in `state_space`
    e_u   = u'' + u'/3,                     q_u = 2a²/3
    first instant: r ~ N(0, s²), r' ~ N(0, s²/(T T₂)), u' ~ N(0, a²), and p, v, u as there

and the data, one sample each half second, add A = ⊕ ΦᵀΦ/σ². So w is integrated out exactly:

    log p(y | z) = -½ Σ|y - Φŵ|²/σ² - ½ ŵᵀΛŵ - ½ log|Λ + A| + ½ log|Λ| - Σ log σ√(2π)

which is the evidence. The loss of a PiNN is its first two terms. What the loss lacks is above all
log|Λ|: its slope with respect to ατ + β tends to half the duration, and without it the estimate
of the parameters is biased. With features that resolve the motion the evidence is the Kalman
filter's likelihood of the same model.

Φ are B-splines here, so that Λ and A are banded and a value takes two banded factorisations.

Sources: MacKay, Neural Computation 4 (1992) 415-447 (evidence); Lindgren, Rue and Lindström, J. R.
Statist. Soc. B 73 (2011) 423-498 (the precision of a stochastic equation's solution in a basis).
"""

from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from scipy.interpolate import BSpline
from scipy.linalg import lapack
from scipy.sparse import csr_array, diags_array

from accpinn.methods.kalman import LOG_TWO_PI
from accpinn.methods.likelihood import Criterion, Groups
from accpinn.methods.series import Series
from accpinn.methods.state_space import FIRST, GAP_DRIFT, LEADER_MEMORY
from accpinn.units import FloatArray, Mask, Seconds

DEGREE = 5
"""Of the splines: e_r has third derivatives of v."""
KNOTS_EVERY: Seconds = 0.5
ORDER = 3
"""Of the highest derivative."""
OUTPUTS = 3
"""p, v, u."""


@dataclass(frozen=True)
class Determinants:
    """Which of the evidence's determinants are kept; studies leave some out."""

    prior: bool = True
    """log|Λ|"""
    posterior: bool = True
    """log|Λ + A|"""


COMPLETE = Determinants()
LOSS = Determinants(prior=False, posterior=False)


class Basis:
    """B-splines on [0, duration], their derivatives' Gram matrices, and their values at instants.

    Functions are numbered 0 to K-1; only neighbours overlap, so matrices are kept by diagonals.
    """

    def __init__(self, samples: int, step: Seconds, knots_every: Seconds = KNOTS_EVERY) -> None:
        """Splines for samples at 0, step, 2 step, ..."""
        duration = (samples - 1) * step
        pieces = max(1, round(duration / knots_every))
        inner = np.linspace(0.0, duration, pieces + 1)
        self.knots = np.r_[[0.0] * DEGREE, inner, [duration] * DEGREE]
        self.size = len(self.knots) - DEGREE - 1
        nodes, weights = np.polynomial.legendre.leggauss(DEGREE + 1)
        half = duration / pieces / 2
        points = ((inner[:-1] + inner[1:]) / 2)[:, None] + half * nodes
        at = [matrix * 1.0 for matrix in self._derivatives(points.ravel())]
        weight = diags_array(np.tile(half * weights, pieces))
        grams = np.empty((DEGREE + 1, ORDER + 1, ORDER + 1, self.size))
        for a, left in enumerate(at):
            weighted = csr_array(left.T @ weight)
            for b, right in enumerate(at):
                grams[:, a, b] = _diagonals(weighted @ right)
        self.grams = grams.reshape(DEGREE + 1, (ORDER + 1) ** 2, self.size)
        """(d, ab, K): G^{ab}_{k,k+d} = ∫ D^aB_k D^bB_{k+d} dt."""
        self.values = csr_array(
            BSpline.design_matrix(step * np.arange(samples), self.knots, DEGREE)
        )
        """(N, K)"""
        # Only the first functions differ from zero at the first instant, up to derivative 2.
        self.first = np.stack([m.toarray()[0, :ORDER] for m in self._derivatives(np.zeros(1))[:3]])
        """(3, 3) derivative 0, 1, 2 of the first three functions."""

    def _derivatives(self, points: FloatArray) -> list[csr_array]:
        """Matrices (points, K) of derivatives 0 to `ORDER`."""
        found = []
        for order in range(ORDER + 1):
            degree, knots = DEGREE - order, self.knots[order : len(self.knots) - order]
            matrix = csr_array(BSpline.design_matrix(points, knots, degree))
            for lower in reversed(range(order)):
                matrix = csr_array(matrix @ self._difference(lower))
            found.append(matrix)
        return found

    def _difference(self, order: int) -> csr_array:
        """From coefficients of derivative ``order`` to those of the next one."""
        degree, knots = DEGREE - order, self.knots[order : len(self.knots) - order]
        span = degree / (knots[degree + 1 : -1] - knots[1 : -degree - 1])
        size = len(knots) - degree - 1
        return csr_array(diags_array([-span, span], offsets=[0, 1], shape=(size - 1, size)))


def _diagonals(matrix: csr_array) -> FloatArray:
    """(DEGREE + 1, K): entry (k, k + d) at [d, k]; 0 outside the matrix."""
    size = matrix.shape[0]
    found = np.zeros((DEGREE + 1, size))
    for offset in range(min(size, DEGREE + 1)):
        found[offset, : size - offset] = matrix.diagonal(offset)
    return found


@lru_cache(maxsize=8)
def _basis(samples: int, step: Seconds, knots_every: Seconds) -> Basis:
    return Basis(samples, step, knots_every)


MOST_WEIGHT = 300.0
"""Of the residual's second derivative. Cars whose disturbance the recording shows have about ten;
where it shows none, its memory and rise are arbitrary, and with more weight Λ is singular to
working precision."""


class Physics(NamedTuple):
    """The prior's residuals as linear forms of (p, v, u) and their derivatives; whitened."""

    running: FloatArray
    """(3, 3, 4): residual, output, derivative; their squares are integrated."""
    first: FloatArray
    """(6, 3, 3): residual, output, derivative 0 to 2, at the first instant."""


def physics(values: FloatArray) -> Physics:
    """The residuals over the deviations of what drives them.

    Args:
        values: (9,) the unknowns in the order of `state_space.COMMON`.
    """
    alpha, alpha_tau, beta, deviation, memory, rise, _, _, leader = values
    deviation = max(deviation, memory * rise / (MOST_WEIGHT * np.sqrt(2 * (memory + rise))))
    p, v, u = range(OUTPUTS)
    law = np.zeros((OUTPUTS, ORDER + 1))
    law[p, 0], law[v, 0], law[u, 0], law[v, 1] = -alpha, alpha_tau + beta, -beta, 1.0
    slope, bend = np.zeros_like(law), np.zeros_like(law)
    slope[:, 1:], bend[:, 2:] = law[:, :-1], law[:, :-2]
    running = np.zeros((3, OUTPUTS, ORDER + 1))
    running[0] = law / memory + (1 + rise / memory) * slope + rise * bend
    running[0] /= deviation * np.sqrt(2 * (memory + rise)) / memory
    running[1, p, 1], running[1, u, 0], running[1, v, 0] = np.array([1, -1, 1]) / np.sqrt(GAP_DRIFT)
    running[2, u, 1:3] = np.array([1 / LEADER_MEMORY, 1]) / (leader * np.sqrt(2 / LEADER_MEMORY))
    first = np.zeros((6, OUTPUTS, ORDER))
    first[0] = law[:, :ORDER] / deviation
    first[1] = slope[:, :ORDER] * np.sqrt(memory * rise) / deviation
    first[2, u, 1] = 1 / leader
    for row, output in enumerate((p, v, u)):
        first[3 + row, output, 0] = 1 / FIRST[output]
    return Physics(running, first)


class LinearEvidence:
    """log p(y | z) of one series, the output layer integrated out."""

    def __init__(
        self,
        measured: FloatArray,
        step: Seconds,
        knots_every: Seconds = KNOTS_EVERY,
        determinants: Determinants = COMPLETE,
    ) -> None:
        """For p, v, u (N, 3), nan where missing, one sample each ``step``."""
        there: Mask = np.asarray(~np.isnan(measured).all(axis=1))
        measured = measured[: int(np.flatnonzero(there)[-1]) + 1]
        self.basis = _basis(len(measured), step, knots_every)
        self.determinants = determinants
        self._measured = measured
        known = [~np.isnan(column) for column in measured.T]
        rows = [self.basis.values[own] for own in known]
        data = [column[own] for column, own in zip(measured.T, known, strict=True)]
        self._grams = np.array([_diagonals(csr_array(one.T @ one)) for one in rows])
        self._right = np.column_stack([one.T @ y for one, y in zip(rows, data, strict=True)])
        self._squares = np.array([(y**2).sum() for y in data])
        self._counts = np.array([len(y) for y in data])

    def prior(self, values: FloatArray) -> FloatArray:
        """Λ (18, 3K) in lower banded form; p, v, u stand side by side at each function."""
        running, first = physics(values)
        squares = np.einsum("eoa,epb->opab", running, running).reshape(OUTPUTS, 1, OUTPUTS, -1)
        banded = self._empty()
        for output, rows in enumerate(squares @ self.basis.grams):
            # Above the diagonal an entry (o, o') stands for (o', o) of the functions k + d, k.
            banded[: len(banded) - output, output::OUTPUTS] = rows.reshape(len(banded), -1)[output:]
        start = np.einsum("eoa,ak->eko", first, self.basis.first).reshape(len(first), -1)
        corner = start.T @ start
        for column in range(len(corner)):
            banded[: len(corner) - column, column] += corner[column:, column]
        return banded

    def _empty(self) -> FloatArray:
        return np.zeros((OUTPUTS * (DEGREE + 1), OUTPUTS * self.basis.size), order="F")

    def data(self, values: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """A (18, 3K) in lower banded form, ΦᵀY/σ² (3K,), and σ (3,)."""
        noise = values[[6, 7, 7]]
        banded = self._empty()
        for output, sigma in enumerate(noise):
            banded[::OUTPUTS, output::OUTPUTS] = self._grams[output] / sigma**2
        return banded, (self._right / noise**2).ravel(), noise

    def __call__(self, values: FloatArray) -> float:
        """The evidence at unknowns (9,) in their own units; -inf where Λ is singular."""
        prior = self.prior(values)
        data, right, noise = self.data(values)
        factor, fault = lapack.dpbtrf(prior + data, lower=1, overwrite_ab=1)
        if fault:
            return -np.inf
        weights, _ = lapack.dpbtrs(factor, right[:, None], lower=1)
        squares = (self._squares / noise**2).sum() - right @ weights[:, 0]
        total = squares + 2 * (self._counts * np.log(noise)).sum() + self._counts.sum() * LOG_TWO_PI
        if self.determinants.posterior:
            total += 2 * np.log(factor[0]).sum()
        if self.determinants.prior:
            own, fault = lapack.dpbtrf(prior, lower=1, overwrite_ab=1)
            if fault:
                return -np.inf
            total -= 2 * np.log(own[0]).sum()
        return float(-0.5 * total)

    def loss(self, values: FloatArray) -> FloatArray:
        """(2,) ½ Σ|y - Φŵ|²/σ² and ½ ŵᵀΛŵ."""
        prior = self.prior(values)
        data, right, noise = self.data(values)
        factor, _ = lapack.dpbtrf(prior + data, lower=1)
        weights = lapack.dpbtrs(factor, right[:, None], lower=1)[0][:, 0]
        errors = self._measured - self.basis.values @ weights.reshape(-1, OUTPUTS)
        misfit = np.nansum((errors / noise) ** 2)
        # The two add up to the minimum, which takes no product with Λ.
        total = (self._squares / noise**2).sum() - right @ weights
        return np.array([misfit, total - misfit]) / 2


class Evidence(Criterion):
    """log evidence + log prior of every group, in place of the Kalman filter's likelihood."""

    def __init__(
        self,
        series: Series,
        knots_every: Seconds = KNOTS_EVERY,
        determinants: Determinants = COMPLETE,
    ) -> None:
        """For series, each of them with features of its own length."""
        super().__init__(series)
        self._terms = [
            LinearEvidence(one, series.step, knots_every, determinants)
            for one in np.moveaxis(series.measured, -1, 0)
        ]

    def log_likelihood(self, z: FloatArray, groups: Groups) -> FloatArray:
        """(K,) log evidence at coordinates (K, P), each of the group (K,) named with it."""
        return np.array(
            [
                sum(self._terms[k](values) for k in self._members[group])
                for values, group in zip(np.exp(z), groups, strict=True)
            ]
        )

    def loss(self, z: FloatArray, group: int) -> FloatArray:
        """(2,) the loss's terms of a group at coordinates z (P,)."""
        found: FloatArray = np.sum(
            [self._terms[k].loss(np.exp(z)) for k in self._members[group]], axis=0
        )
        return found
