"""Generalised smoothing with splines: the limit that the PiNN's loss has in any function space.

Speeds and space-gaps are B-splines, y_o(t) = Σ_k w_{k,o} B_k(t), and coefficients and parameters
together minimise the PiNN's loss Ψ = Ψ_F + Ψ_D (see `pinn.loss`, weights 1). For fixed parameters
Ψ is quadratic in the coefficients; ordered knot by knot its normal matrix is banded, as B-splines
overlap only their neighbours:

    A = Σ_residuals (a D + b B)ᵀ(a D + b B) + BᵀB,     bandwidth (degree + 1)(2M + 1) - 1,

and for fixed coefficients the parameters are a 3x3 solve. The two alternate until they converge. At
masked instants there is no residual of dv/dt; all other terms remain.

Source: Ramsay, Hooker, Campbell and Cao, J. R. Statist. Soc. B 69 (2007) 741-796.
"""

from collections.abc import Sequence

import numpy as np
from scipy.linalg import solveh_banded
from scipy.sparse import csr_array, diags_array

from accpinn.errors import SegmentError
from accpinn.methods import PAPERS, Law, direct
from accpinn.methods.fit import Fit, Outcome
from accpinn.methods.least_squares import MODELS, solved
from accpinn.methods.regression import Regression
from accpinn.model.cthp import Case, Trajectories
from accpinn.segment import Segment
from accpinn.units import FloatArray, Mask, Seconds

KNOTS_EVERY: Seconds = 0.5
"""Spacing of the knots; halving it moves the parameters of the reference runs by under 0.01 %."""
LEAST_SAMPLES = 5
"""Samples between knots at least: with fewer the data alone do not determine the spline."""
DEGREE = 4
ROUNDS = 100
TOLERANCE = 1e-9
"""Largest relative change of θ at which the alternation ends."""


def fit(
    segment: Segment,
    case: Case = "II",
    law: Law = PAPERS,
    knots_every: Seconds = KNOTS_EVERY,
) -> Fit:
    """Trajectories and parameters that minimise Ψ over all splines with these knots.

    Raises:
        SegmentError: when there are fewer samples than a single piece of a spline needs.
    """
    if segment.samples <= DEGREE:
        raise SegmentError(
            f"{segment.source}: {segment.samples} samples are too few for a spline; take a window"
            f" of at least {DEGREE + 1}."
        )
    knots_every = max(knots_every, LEAST_SAMPLES * segment.sample_time)
    basis = _Basis(segment, knots_every)
    solution, terms = solved(Regression.of(segment), case, law)
    for rounds in range(1, ROUNDS + 1):  # noqa: B007 (used below)
        shift = np.zeros(segment.followers) if terms is None else np.nan_to_num(terms[:, 0])
        speeds, gaps, rates = basis.smooth(solution.theta, shift)
        before = solution.theta
        regression = Regression.of_motion(speeds, gaps, rates, segment.mask)
        solution, terms = solved(regression, case, law)
        if np.abs(solution.theta - before).max() <= TOLERANCE * np.abs(solution.theta).max():
            break
    return Fit.of(
        "splines",
        segment,
        case,
        solution,
        surrogate=Trajectories(segment.time, speeds, gaps),
        outcome=Outcome.SOLVED if rounds < ROUNDS else Outcome.FINISHED,
        config={"knots_every": knots_every, "degree": DEGREE},
        loss=basis.loss(solution.theta, segment.mask),
        iterations=rounds,
        terms=terms,
    )


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
        """The matrix of a sum of squares, in lower banded form.

        Args:
            forms: (E, O, A) each residual's factors of derivatives 0 to A - 1 of O outputs.
            grams: of these derivatives.

        Returns:
            ((degree + 1) O, O K); the outputs stand side by side at each function.
        """
        outputs = forms.shape[1]
        squares = np.einsum("eoa,epb->poab", forms, forms).reshape(outputs, 1, outputs, -1)
        banded = np.zeros((outputs * len(grams), outputs * self.size), order="F")
        # Below the diagonal an entry (o, o') stands for (o, o') of the functions k + d, k.
        for output, rows in enumerate(squares @ grams):
            banded[: len(banded) - output, output::outputs] = rows.reshape(len(banded), -1)[output:]
        return banded


class _Basis:
    """The B-splines on the segment's instants, and the banded solve for their coefficients."""

    def __init__(self, segment: Segment, knots_every: Seconds) -> None:
        self._splines = SplineBasis(float(segment.time[-1]), knots_every, DEGREE)
        self.value, self.rate = matrices = self._splines.derivatives(segment.time, 1)
        self._given = self._measured = np.hstack([segment.speeds, segment.gaps])
        self._grams = self._splines.grams(matrices, matrices)
        self._dynamic_grams = [self._grams] * segment.followers
        if segment.mask is not None:
            parts = [[matrix[kept] for matrix in matrices] for kept in segment.mask.T]
            self._dynamic_grams = [self._splines.grams(part, part) for part in parts]
        self._coefficients: FloatArray = np.zeros((self._splines.size, 0))

    def smooth(
        self, theta: FloatArray, shift: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Speeds (N, M+1), gaps (N, M) and the followers' dv/dt (N, M) for parameters θ (M, 3).

        The gaps obey the model without the shift s₀ (M,), which is added to them at the end.
        """
        followers = len(theta)
        outputs = 2 * followers + 1
        self._measured = self._given - np.append(np.zeros(followers + 1), shift)
        right = (self.value.T @ self._measured).ravel()
        solved = solveh_banded(self._normal_matrix(theta), right, lower=True, check_finite=False)
        self._coefficients = solved.reshape(-1, outputs)
        values, rates = self._evaluate()
        split = followers + 1
        return values[:, :split], values[:, split:] + shift, rates[:, 1:split]

    def _evaluate(self) -> tuple[FloatArray, FloatArray]:
        values: FloatArray = np.asarray(self.value @ self._coefficients)
        rates: FloatArray = np.asarray(self.rate @ self._coefficients)
        return values, rates

    def _normal_matrix(self, theta: FloatArray) -> FloatArray:
        """Lower banded form; outputs v_0..v_M, p_1..p_M stand side by side at each knot."""
        kinematic, dynamic = _residuals(theta)
        data = np.eye(2 * len(theta) + 1)[:, :, None] * [1.0, 0.0]
        banded = self._splines.banded(np.concatenate([data, kinematic]), self._grams)
        for form, grams in zip(dynamic, self._dynamic_grams, strict=True):
            banded += self._splines.banded(form[None], grams)
        return banded

    def loss(self, theta: FloatArray, mask: Mask | None) -> dict[str, float]:
        """Ψ and its terms at the present coefficients."""
        values, rates = self._evaluate()
        kinematic, dynamic = (
            values @ forms[..., 0].T + rates @ forms[..., 1].T for forms in _residuals(theta)
        )
        counted = dynamic if mask is None else np.where(mask, dynamic, 0.0)
        physics = float((kinematic**2).sum() + (counted**2).sum()) / counted.size
        data = float(((values - self._measured) ** 2).sum()) / counted.size
        return {"total": data + physics, "data": data, "physics": physics}


def _residuals(theta: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Residuals of dp/dt = Δv and of dv/dt = .., (M, 2M+1, 2) each: factors of values and rates."""
    followers = len(theta)
    kinematic, dynamic = np.zeros((2, followers, 2 * followers + 1, 2))
    for follower, (alpha, alpha_tau, beta) in enumerate(theta):
        places = ahead, speed, gap = follower, follower + 1, followers + 1 + follower
        kinematic[follower, [ahead, speed], 0] = -1.0, 1.0
        kinematic[follower, gap, 1] = dynamic[follower, speed, 1] = 1.0
        dynamic[follower, places, 0] = -beta, alpha_tau + beta, -alpha
    return kinematic, dynamic


METHOD = direct(
    "splines", "Splines", fit, MODELS, typical_seconds=0.3,
    summary="smoothing with splines: the limit of the PiNN's loss",
)  # fmt: skip
