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

    def diagonals(self, left: csr_array, right: csr_array) -> list[FloatArray]:
        """Sub-diagonals 0 to degree of leftᵀ right (K, K) for matrices (N, K); the rest is zero."""
        product = left.T @ right
        return [product.diagonal(-offset) for offset in range(self.degree + 1)]


_Bands = tuple[list[FloatArray], ...]
"""Sub-diagonals 0..degree of DᵀD, DᵀB, BᵀD and BᵀB (K, K), of basis values B and rates D."""
_Residual = tuple[FloatArray, FloatArray]
"""(2M+1,) a and b of one equation's residual Σ_o (a_o D + b_o B) w_o."""


class _Basis:
    """The B-splines on the segment's instants, and the banded solve for their coefficients."""

    def __init__(self, segment: Segment, knots_every: Seconds) -> None:
        splines = SplineBasis(float(segment.time[-1]), knots_every, DEGREE)
        self.value, self.rate = splines.derivatives(segment.time, 1)
        self.size, mask = splines.size, segment.mask
        self._given = self._measured = np.hstack([segment.speeds, segment.gaps])

        def bands(rows: slice | Mask) -> _Bands:
            value, rate = self.value[rows], self.rate[rows]
            pairs = ((rate, rate), (rate, value), (value, rate), (value, value))
            return tuple(splines.diagonals(left, right) for left, right in pairs)

        self._bands = bands(slice(None))
        everywhere = [self._bands] * segment.followers
        self._dynamic_bands = everywhere if mask is None else [bands(kept) for kept in mask.T]
        self._coefficients: FloatArray = np.zeros((self.size, 0))

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
        self._coefficients = solved.reshape(self.size, outputs)
        values, rates = self._evaluate()
        split = followers + 1
        return values[:, :split], values[:, split:] + shift, rates[:, 1:split]

    def _evaluate(self) -> tuple[FloatArray, FloatArray]:
        values: FloatArray = np.asarray(self.value @ self._coefficients)
        rates: FloatArray = np.asarray(self.rate @ self._coefficients)
        return values, rates

    def _normal_matrix(self, theta: FloatArray) -> FloatArray:
        """Lower banded form; outputs v_0..v_M, p_1..p_M stand side by side at each knot."""
        outputs = 2 * len(theta) + 1
        banded = np.zeros(((DEGREE + 1) * outputs, self.size * outputs))
        kinematic, dynamic = _residuals(theta)
        self._add_squares(banded, self._bands, kinematic, np.eye(outputs))
        for bands, residual in zip(self._dynamic_bands, dynamic, strict=True):
            self._add_squares(banded, bands, [residual], np.zeros((outputs, outputs)))
        return banded

    def _add_squares(
        self, banded: FloatArray, bands: _Bands, residuals: list[_Residual], data: FloatArray
    ) -> None:
        """The normal matrix of some residuals, and of ``data`` (2M+1, 2M+1), on the instants."""
        # How often DᵀD, DᵀB and BᵀB stand between each pair of outputs, each (2M+1, 2M+1).
        rr, rv, vv = np.zeros_like(data), np.zeros_like(data), data.copy()
        for rate, value in residuals:
            rr += np.outer(rate, rate)
            rv += np.outer(rate, value)
            vv += np.outer(value, value)
        rate_rate, rate_value, value_rate, value_value = bands
        outputs = len(vv)
        for row, column in np.argwhere((rr != 0) | (rv != 0) | (rv.T != 0) | (vv != 0)):
            for offset in range(DEGREE + 1):
                below = offset * outputs + row - column
                if below >= 0:
                    banded[below, column::outputs][: self.size - offset] += (
                        rr[row, column] * rate_rate[offset]
                        + rv[row, column] * rate_value[offset]
                        + rv[column, row] * value_rate[offset]
                        + vv[row, column] * value_value[offset]
                    )

    def loss(self, theta: FloatArray, mask: Mask | None) -> dict[str, float]:
        """Ψ and its terms at the present coefficients."""
        values, rates = self._evaluate()
        kinematic, dynamic = (
            np.stack([rates @ rate + values @ value for rate, value in residuals], axis=1)
            for residuals in _residuals(theta)
        )
        counted = dynamic if mask is None else np.where(mask, dynamic, 0.0)
        physics = float((kinematic**2).sum() + (counted**2).sum()) / counted.size
        data = float(((values - self._measured) ** 2).sum()) / counted.size
        return {"total": data + physics, "data": data, "physics": physics}


def _residuals(theta: FloatArray) -> tuple[list[_Residual], list[_Residual]]:
    """Residuals of dp/dt = Δv and of dv/dt = .., one of each for every follower."""
    followers = len(theta)
    unit = np.eye(2 * followers + 1)
    kinematic, dynamic = [], []
    for follower, (alpha, alpha_tau, beta) in enumerate(theta):
        ahead, speed, gap = unit[follower], unit[follower + 1], unit[followers + 1 + follower]
        kinematic.append((gap, speed - ahead))
        damping = alpha_tau + beta
        dynamic.append((speed, -alpha * gap + damping * speed - beta * ahead))
    return kinematic, dynamic


METHOD = direct(
    "splines", "Splines", fit, MODELS, typical_seconds=0.3,
    summary="smoothing with splines: the limit of the PiNN's loss",
)  # fmt: skip
