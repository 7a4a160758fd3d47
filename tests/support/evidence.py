"""The evidence of a surrogate that is linear in its weights, for the parameters of one follower.

A reference for the likelihood by which the preset `calibrated` learns (`joint_likelihood`): another
computation of the same in a basis of splines, without a filter.

For fixed features Φ(t) and fixed unknowns z (parameters, disturbance, noise; see `state_space`) the
surrogate (p, v, u) = Φ W is Gaussian in its output layer W, w = vec W. The physics is its prior:

    wᵀΛw  = ∫ e_r²/q_r + e_g²/q_g + e_u²/q_u dt + terms of the first instant
    e_r   = (T₂ d/dt + 1)(d/dt + 1/T) r,   r = v' - αp + (ατ+β)v - βu,   q_r = 2s²(T + T₂)/T²
    e_g   = p' - u + v,                     q_g as in `state_space`
    e_u   = u'' + u'/3,                     q_u = 2a²/3
    first instant: r ~ N(0, s²), r' ~ N(0, s²/(T T₂)), u' ~ N(0, a²), and p, v, u as there

and the data, one sample each half second, add A = ⊕ ΦᵀΦ/σ². So w is integrated out exactly:

    log p(y | z) = -½ Σ|y - Φŵ|²/σ² - ½ ŵᵀΛŵ - ½ log|Λ + A| + ½ log|Λ| - Σ log σ√(2π)

which is the evidence. An intercept s₀ is taken from the measured gaps.

With a lag λ or a delay d (Padé, as in `model.cthp.add_command`) the acceleration is N(d/dt) q of a
further output q, which follows the command c = α p - (ατ+β)v + βu all but exactly:

    r = v' - N q,   e_q = D q - c,   q_q = `COMMAND_NOISE`
    lag      D = 1 + λs,              N = 1,                     first q - c ~ N(0, .25²)
    delay    D = 1 + ds/2 + d²s²/12,  N = 1 - ds/2 + d²s²/12,    first q - c + dc'/2 ~ N(0, .25²),
                                                                 q' - c' ~ N(0, (.5/d)²)

The loss Ψ has only the first two terms. It lacks ½ log|Λ|, and that biases the estimate: the slope
of log|Λ| with respect to ατ + β tends to half the duration. With features that resolve the motion
the evidence is the Kalman filter's likelihood of the same model, so the search for its maximum is
that of `likelihood`, with the filter's expected information as the curvature to begin with.

Φ are B-splines here, so that Λ and A are banded and a value takes two banded factorisations.

Sources: MacKay, Neural Computation 4 (1992) 415-447 (evidence); Lindgren, Rue and Lindström, J. R.
Statist. Soc. B 73 (2011) 423-498 (the precision of a stochastic equation's solution in a basis).
"""

from collections.abc import Sequence
from functools import lru_cache

import numpy as np
from scipy.linalg import lapack
from scipy.sparse import csr_array, diags_array

from accpinn.methods.kalman import LOG_TWO_PI
from accpinn.methods.likelihood import Criterion, Groups, natural
from accpinn.methods.series import Series
from accpinn.methods.state_space import (
    COMMON,
    FIRST,
    GAP_DRIFT,
    LEADER_MEMORY,
    USUAL_COMMAND,
    Form,
    coordinates,
)
from accpinn.model.registry import FOLLOWING, PAPER
from accpinn.model.spec import PAPER_SPEC, ModelSpec
from accpinn.units import FloatArray, Mask, Metres, Seconds

DEGREE = 5
"""Degree of the splines: e_r has third derivatives of v."""
KNOTS_EVERY: Seconds = 0.25
"""Knots every 0.5 s leave the estimate up to 1.3 standard errors from maximum likelihood where the
disturbance has short memory, knots every 0.25 s up to 0.08."""
OUTPUTS = 3
"""p, v, u, which are measured; q stands behind them."""
COMMAND_NOISE = 1e-5
"""Intensity q_q in m²/s³; the usual disturbance has 2 s² T = .5."""
NOISE = (6, 7)
"""Where σ of the gap and of the speeds stand among the unknowns."""
DIFFERENCE = 4e-3
"""Difference of a coordinate for a slope: small against its deviation, large against rounding."""
METRES = 25.0
"""Factor on it for s₀ in m: the evidence is quadratic in it."""
MOST_WEIGHT = 300.0
"""Largest weight of the residual's second derivative. Cars whose disturbance the recording shows
have about ten; where it shows none, its memory and rise are arbitrary, and with more weight Λ is
singular to working precision."""


class SplineBasis:
    """B-splines on evenly spaced knots over [0, duration]; only neighbours overlap."""

    def __init__(self, duration: Seconds, knots_every: Seconds, degree: int) -> None:
        """Place the knots; the last piece ends with the duration."""
        pieces = max(1, round(duration / knots_every))
        self.breaks: FloatArray = np.linspace(0.0, duration, pieces + 1)
        """(pieces + 1,) the distinct knots."""
        self.degree = degree
        self.knots = np.r_[[0.0] * degree, self.breaks, [duration] * degree]
        self.size = len(self.knots) - degree - 1
        """K."""

    def derivatives(self, instants: FloatArray, order: int) -> list[csr_array]:
        """Matrices (N, K) of the functions and their derivatives up to an order, at instants (N,).

        The derivative of a B-spline is a spline of one degree less on the same knots.
        """
        from scipy.interpolate import BSpline  # takes a second to import, which few need

        matrices = []
        for lost in range(order + 1):
            matrix = csr_array(BSpline.design_matrix(instants, *self._lower(lost)))
            for lower in reversed(range(lost)):
                matrix = csr_array(matrix @ self._difference(lower))
            matrices.append(matrix)
        return matrices

    def _lower(self, lost: int) -> tuple[FloatArray, int]:
        """Knots and degree of a derivative."""
        return self.knots[lost : len(self.knots) - lost], self.degree - lost

    def _difference(self, order: int) -> csr_array:
        """The map from coefficients of a derivative to those of the next one."""
        knots, degree = self._lower(order)
        span = degree / (knots[degree + 1 : -1] - knots[1 : -degree - 1])
        size = len(knots) - degree - 1
        bands = np.stack([-span, span])
        return csr_array(diags_array(bands, offsets=[0, 1], shape=(size - 1, size)))

    def grams(self, left: Sequence[csr_array], right: Sequence[csr_array]) -> FloatArray:
        """(degree + 1, ab, K) entry (k + d, k) of leftᵀ right for matrices (N, K), a and b of each.

        Places that leave the matrix are zero, as are all further from its diagonal.
        """
        products = [one.T @ other for one in left for other in right]
        grams = np.zeros((self.degree + 1, len(products), self.size))
        for offset in range(self.degree + 1):
            for row, product in zip(grams[offset], products, strict=True):
                row[: self.size - offset] = product.diagonal(-offset)
        return grams

    def banded(self, forms: FloatArray, grams: FloatArray) -> FloatArray:
        """((degree + 1) O, O K) the matrix of a sum of squares, in lower banded form.

        The forms (E, O, A) are each residual's factors of derivatives 0 to A - 1 of O outputs,
        ``grams`` those of these derivatives. The outputs stand side by side at each function.
        """
        outputs = forms.shape[1]
        squares = np.einsum("eoa,epb->poab", forms, forms).reshape(outputs, 1, outputs, -1)
        banded = np.zeros((outputs * len(grams), outputs * self.size), order="F")
        # Below the diagonal an entry (o, o') stands for (o, o') of the functions k + d, k.
        for output, rows in enumerate(squares @ grams):
            banded[: len(banded) - output, output::outputs] = rows.reshape(len(banded), -1)[output:]
        return banded


class Basis(SplineBasis):
    """The features: splines with their derivatives' Gram matrices, and their values at samples."""

    def __init__(self, samples: int, step: Seconds, order: int) -> None:
        """Splines for samples at 0, step, 2 step, .. and derivatives up to an order."""
        super().__init__((samples - 1) * step, KNOTS_EVERY, DEGREE)
        nodes, weights = np.polynomial.legendre.leggauss(DEGREE + 1)
        half = float(np.diff(self.breaks)[0]) / 2
        points = ((self.breaks[:-1] + self.breaks[1:]) / 2)[:, None] + half * nodes
        at = self.derivatives(points.ravel(), order)
        weight = diags_array(np.tile(half * weights, len(self.breaks) - 1))
        self.integrals = self.grams([csr_array(weight @ matrix) for matrix in at], at)
        """(d, ab, K): ∫ D^aB_{k+d} D^bB_k dt, a and b from 0 to the order."""
        (self.at_samples,) = self.derivatives(step * np.arange(samples, dtype=np.float64), 0)
        """(N, K) values."""
        # Only the first functions differ from zero at the first instant, up to that derivative.
        start = self.derivatives(np.zeros(1), order - 1)
        self.first = np.stack([matrix.toarray()[0, :order] for matrix in start])
        """(L, L) derivatives 0 to L - 1 of the first L functions, L = order."""


_basis = lru_cache(maxsize=8)(Basis)


def late_of(form: Form) -> str:
    """What stands between a model's command and its acceleration: "lag", "delay" or nothing."""
    return FOLLOWING[form].terms[-1] if FOLLOWING[form].is_late else ""


def size_of(late: str) -> tuple[int, int]:
    """O, the number of outputs, and L, the order of the highest derivative in the equations."""
    return OUTPUTS + bool(late), 4 if late == "delay" else 3


def reaction(late: str, seconds: Seconds) -> tuple[FloatArray, FloatArray]:
    """D and N of the module's head, (3,) each, by powers of s."""
    if late == "lag":
        return np.array([1.0, seconds, 0.0]), np.array([1.0, 0.0, 0.0])
    square = seconds**2 / 12
    return np.array([1.0, seconds / 2, square]), np.array([1.0, -seconds / 2, square])


def physics(values: FloatArray, late: str) -> tuple[FloatArray, FloatArray]:
    """The prior's residuals over the deviations of what drives them, as linear forms.

    Args:
        values: (P,) the unknowns, those of `state_space.COMMON` first, the lag or delay last.
        late: see `late_of`.

    Returns:
        (O, O, L + 1) residual, output, derivative up to L = order, whose squares are integrated,
        and (R, O, L) the same at the first instant.
    """
    alpha, alpha_tau, beta, deviation, memory, rise, _, _, leader = values[:9]
    deviation = max(deviation, memory * rise / (MOST_WEIGHT * np.sqrt(2 * (memory + rise))))
    outputs, order = size_of(late)
    p, v, u = range(OUTPUTS)
    equation = np.zeros((outputs, order + 1))
    equation[p, 0], equation[v, 0], equation[u, 0] = -alpha, alpha_tau + beta, -beta
    running = np.zeros((outputs, outputs, order + 1))
    further = np.zeros((order - 2 if late else 0, outputs, order))
    if late:
        command, equation = -equation, np.zeros_like(equation)
        denominator, numerator = reaction(late, values[-1])
        equation[OUTPUTS, :3] = -numerator
        running[OUTPUTS] = -command
        running[OUTPUTS, OUTPUTS, :3] = denominator
        running[OUTPUTS] /= np.sqrt(COMMAND_NOISE)
        behind = -command
        behind[OUTPUTS, 0] = 1.0
        further[0] = behind[:, :order]
        if late == "delay":
            half = values[-1] / 2
            further[0] += half * _rate(command)[:, :order]
            further[1] = half * _rate(behind)[:, :order]
        further /= USUAL_COMMAND
    equation[v, 1] += 1.0
    slope = _rate(equation)
    running[0] = equation / memory + (1 + rise / memory) * slope + rise * _rate(equation, 2)
    running[0] /= deviation * np.sqrt(2 * (memory + rise)) / memory
    running[1, p, 1], running[1, u, 0], running[1, v, 0] = np.array([1, -1, 1]) / np.sqrt(GAP_DRIFT)
    running[2, u, 1:3] = np.array([1 / LEADER_MEMORY, 1]) / (leader * np.sqrt(2 / LEADER_MEMORY))
    first = np.zeros((6, outputs, order))
    first[0] = equation[:, :order] / deviation
    first[1] = slope[:, :order] * np.sqrt(memory * rise) / deviation
    first[2, u, 1] = 1 / leader
    for row, output in enumerate((p, v, u)):
        first[3 + row, output, 0] = 1 / FIRST[output]
    return running, np.concatenate([first, further])


def _rate(form: FloatArray, times: int = 1) -> FloatArray:
    """(O, L + 1) the time derivative of a form, taken so many times."""
    moved = np.zeros_like(form)
    moved[:, times:] = form[:, : form.shape[1] - times]
    return moved


class Design:
    """The features at the samples of p, v, u that are there."""

    def __init__(self, step: Seconds, known: Mask, late: str = "") -> None:
        """The features of N samples, one each ``step``; ``known`` (N, 3) are those there."""
        self.late, (self.outputs, order) = late, size_of(late)
        self.basis = _basis(len(known), step, order)
        self.rows = [self.basis.at_samples[kept] for kept in known.T]
        self._grams = [self.basis.grams([values], [values])[:, 0] for values in self.rows]

    def factors(self, values: FloatArray) -> tuple[FloatArray, float] | None:
        """The factor of Λ + A in lower banded form, and ½ log|Λ| - ½ log|Λ + A|.

        At unknowns (P,) in their own units; None where Λ is singular.
        """
        prior = self.prior(values)
        factor, fault = lapack.dpbtrf(prior, lower=1)
        posterior, fault_too = lapack.dpbtrf(prior + self.data(values), lower=1, overwrite_ab=1)
        if fault or fault_too:
            return None
        return posterior, float(np.log(factor[0]).sum() - np.log(posterior[0]).sum())

    def prior(self, values: FloatArray) -> FloatArray:
        """Λ (6 O, O K) in lower banded form; the outputs stand side by side at each function."""
        running, first = physics(values, self.late)
        banded = self.basis.banded(running, self.basis.integrals)
        start = np.einsum("eoa,ak->eko", first, self.basis.first).reshape(len(first), -1)
        corner = start.T @ start
        for column in range(len(corner)):
            banded[: len(corner) - column, column] += corner[column:, column]
        return banded

    def data(self, values: FloatArray) -> FloatArray:
        """A (6 O, O K) in lower banded form."""
        size = self.outputs * (DEGREE + 1), self.outputs * self.basis.size
        banded = np.zeros(size, order="F")
        for output, sigma in enumerate(noise_of(values)):
            banded[:: self.outputs, output :: self.outputs] = self._grams[output] / sigma**2
        return banded


def noise_of(values: FloatArray) -> FloatArray:
    """(3,) σ of p, v, u among unknowns (P,)."""
    return values[[*NOISE, NOISE[-1]]]


class LinearEvidence:
    """log p(y | z) of one series, the output layer integrated out."""

    def __init__(self, measured: FloatArray, step: Seconds, form: Form = PAPER) -> None:
        """Sum products of the data p, v, u (N, 3), nan where missing, one sample each ``step``."""
        self._has_intercept = "s0" in FOLLOWING[form].terms
        complete: Mask = np.asarray(~np.isnan(measured).all(axis=1))
        measured = measured[: int(np.flatnonzero(complete)[-1]) + 1]
        known = ~np.isnan(measured)
        self.design = Design(step, known, late_of(form))
        rows = self.design.rows
        data = [column[kept] for column, kept in zip(measured.T, known.T, strict=True)]
        self._right = np.zeros((self.design.basis.size, self.design.outputs))
        for output, (values, y) in enumerate(zip(rows, data, strict=True)):
            self._right[:, output] = values.T @ y
        self._squares = np.array([(y**2).sum() for y in data])
        self._counts = np.array([len(y) for y in data])
        self._gaps = data[0].sum()
        self._shifted = np.asarray(rows[0].T @ np.ones(len(data[0])))

    def _intercept(self, values: FloatArray) -> Metres:
        """s₀ among unknowns (P,); 0 for a model without one."""
        return float(values[len(COMMON)]) if self._has_intercept else 0.0

    def right(self, values: FloatArray) -> tuple[FloatArray, FloatArray]:
        """ΦᵀY/σ² (O K,) and YᵀY (3,); Y is without s₀."""
        intercept = self._intercept(values)
        right, squares = self._right.copy(), self._squares.copy()
        right[:, 0] -= intercept * self._shifted
        right[:, :OUTPUTS] /= noise_of(values) ** 2
        squares[0] += intercept * (intercept * self._counts[0] - 2 * self._gaps)
        return right.ravel(), squares

    def log_evidence(self, values: FloatArray) -> float:
        """The evidence at unknowns (P,) in their own units; -inf where Λ is singular."""
        factors = self.design.factors(values)
        if factors is None:
            return -np.inf
        posterior, log_ratio = factors
        right, own_squares = self.right(values)
        noise = noise_of(values)
        weights, _ = lapack.dpbtrs(posterior, right[:, None], lower=1)
        squares = (own_squares / noise**2).sum() - right @ weights[:, 0]
        constant = 2 * (self._counts * np.log(noise)).sum() + self._counts.sum() * LOG_TWO_PI
        return float(log_ratio - (squares + constant) / 2)


class Evidence(Criterion):
    """log evidence + log prior of every group, in place of the Kalman filter's likelihood."""

    negligible = 3e-4

    def __init__(self, series: Series, spec: ModelSpec = PAPER_SPEC) -> None:
        """For series, each with features of its own length, and one of the CTHPs."""
        super().__init__(series, spec)
        names = [unknown.name for unknown in coordinates(spec.model)]
        self._moves = DIFFERENCE * np.array([METRES if name == "s0" else 1.0 for name in names])
        """(P,) differences of the coordinates."""
        self._terms = [
            LinearEvidence(measured, series.step, spec.model)
            for measured in np.moveaxis(series.measured, -1, 0)
        ]

    def log_likelihood(self, z: FloatArray, groups: Groups) -> FloatArray:
        """(K,) log evidence at coordinates (K, P), each of the group (K,) named with it."""
        return np.array(
            [
                sum(self._terms[k].log_evidence(values) for k in self._members[group])
                for values, group in zip(natural(self.form, z), groups, strict=True)
            ]
        )

    def score(
        self, z: FloatArray, groups: Groups, present: FloatArray | None = None
    ) -> tuple[FloatArray, ...]:
        """Criterion (K,), gradient (K, P) and the filter's expected information (K, P, P).

        The gradient of a row below its ``present`` value (K,) is 0. Slopes are central differences.
        One-sided ones would not do: α and ατ vary almost together, and the error of their slopes
        would move them by a fifth of a standard error.
        """
        value, gradient = np.empty(len(z)), np.zeros(z.shape)
        moves = np.diag(self._moves)
        for k, (row, group) in enumerate(zip(z, groups, strict=True)):
            around = row + np.stack([moves, -moves], axis=1).reshape(-1, self.size)
            value[k] = self._value(row[None], group).item()
            if present is None or value[k] > present[k] - 1e-6:
                above, below = self._value(around, group).reshape(-1, 2).T
                gradient[k] = (above - below) / (2 * self._moves)
        *_, information = super().score(z, groups)
        return value, gradient, information

    def _value(self, z: FloatArray, group: int) -> FloatArray:
        """(K,) the criterion of a group at coordinates (K, P)."""
        return self.log_likelihood(z, np.full(len(z), group)) + self.log_prior(z)
