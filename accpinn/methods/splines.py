"""Generalised smoothing with splines: the limit that the PiNN's loss has in any function space.

Speeds and space-gaps are B-splines, y_o(t) = Σ_k w_{k,o} B_k(t), and coefficients and parameters
together minimise the PiNN's loss Ψ = Ψ_F + Ψ_D (see `pinn.loss`, weights 1). Each window has
splines of its own, and Ψ is the mean over the instants of all. For fixed parameters Ψ is quadratic
in the coefficients; ordered knot by knot its normal matrix is banded, as B-splines overlap only
their neighbours:

    A = Σ_residuals (a D + b B)ᵀ(a D + b B) + BᵀB,     bandwidth (degree + 1)(2M + 1) - 1,

and for fixed coefficients the parameters are a 3x3 solve over all windows. The two alternate until
they converge. At masked instants there is no residual of dv/dt; all other terms remain.

Source: Ramsay, Hooker, Campbell and Cao, J. R. Statist. Soc. B 69 (2007) 741-796.
"""

from collections.abc import Sequence

import numpy as np
from scipy.linalg import solveh_banded
from scipy.sparse import csr_array, diags_array

from accpinn.errors import SegmentError
from accpinn.methods import Segments, direct
from accpinn.methods.estimate import Estimate, Outcome
from accpinn.methods.least_squares import MODELS
from accpinn.methods.pinn.config import FAST
from accpinn.methods.pinn.loss import (
    Motion,
    command_columns,
    loss_terms,
    stack_outputs,
    trajectories,
)
from accpinn.methods.regression import Regression, Solution
from accpinn.model.cthp import Case, Parameters, Trajectories
from accpinn.model.spec import PAPER_SPEC, ModelSpec
from accpinn.segment import Segment
from accpinn.units import FloatArray, Seconds

KNOTS_EVERY: Seconds = 0.5
"""Spacing of the knots; halving it moves the parameters of the reference runs by under 0.01 %."""
LEAST_SAMPLES = 5
"""Samples between knots at least: with fewer the data alone do not determine the spline."""
DEGREE = 4
ROUNDS = 100
TOLERANCE = 1e-9
"""Largest relative change of θ at which the alternation ends."""


def fit(segments: Segments, case: Case = "II", spec: ModelSpec = PAPER_SPEC) -> Estimate:
    """Curves and parameters that minimise Ψ over all splines with these knots.

    Raises:
        SegmentError: when a window has fewer samples than a single piece of a spline needs.
    """
    for segment in segments:
        if segment.samples <= DEGREE:
            raise SegmentError(
                f"{segment.source}: {segment.samples} samples are too few for a spline; take a"
                f" window of at least {DEGREE + 1}."
            )
    windows = [_Window(segment) for segment in segments]
    by_window = [_alternated([window], case, spec) for window in windows]
    solution, rounds = by_window[0] if len(by_window) == 1 else _alternated(windows, case, spec)
    shares = np.array([segment.samples for segment in segments], float)
    shares /= shares.sum()
    losses = [window.loss(solution) for window in windows]
    return Estimate.of(
        "splines",
        segments,
        case,
        spec,
        solution,
        curves=tuple(window.curves for window in windows),
        outcome=Outcome.SOLVED if rounds < ROUNDS else Outcome.FINISHED,
        settings={"knots_every": max(map(_knots_every, segments)), "degree": DEGREE},
        loss={
            name: float(shares @ [loss[name] for loss in losses])
            for name in ("total", "data", "physics")
        },
        iterations=rounds,
        windows=Parameters.of([alone.parameters.everything for alone, _ in by_window]),
    )


def _alternated(windows: Sequence["_Window"], case: Case, spec: ModelSpec) -> tuple[Solution, int]:
    """The parameters (M,) that minimise Ψ with the curves of all windows, and the rounds taken."""
    solution = Regression.of_windows([window.segment for window in windows]).solve(case, spec)
    for rounds in range(1, ROUNDS + 1):  # noqa: B007 (used below)
        before = solution
        for window in windows:
            window.smooth(before)
        rows = Regression.joined([window.regression() for window in windows])
        solution = rows.solve(case, spec)
        change = np.abs(solution.theta - before.theta).max()
        if change <= TOLERANCE * np.abs(solution.theta).max():
            break
    return solution, rounds


def _knots_every(segment: Segment) -> Seconds:
    return max(KNOTS_EVERY, LEAST_SAMPLES * segment.sample_time)


class SplineBasis:
    """B-splines on evenly spaced knots over [0, duration]; only neighbours overlap."""

    def __init__(self, duration: Seconds, knots_every: Seconds, degree: int) -> None:
        """Place the knots; the last piece ends with the duration."""
        breaks = np.linspace(0.0, duration, max(1, round(duration / knots_every)) + 1)
        self.degree = degree
        self.knots = np.r_[[0.0] * degree, breaks, [duration] * degree]
        self.size = len(self.knots) - degree - 1
        """K."""

    def values_and_rates(self, instants: FloatArray) -> list[csr_array]:
        """Matrices (N, K) of the functions and of their derivatives at instants (N,).

        The derivative of a B-spline is a spline of one degree less on the same knots.
        """
        from scipy.interpolate import BSpline  # takes a second to import, which few need

        knots, degree = self.knots, self.degree
        span = degree / (knots[degree + 1 : -1] - knots[1 : -degree - 1])
        shape = (self.size - 1, self.size)
        difference = diags_array(np.stack([-span, span]), offsets=[0, 1], shape=shape)
        lower = csr_array(BSpline.design_matrix(instants, knots[1:-1], degree - 1))
        values = csr_array(BSpline.design_matrix(instants, knots, degree))
        return [values, csr_array(lower @ difference)]

    def grams(self, matrices: list[csr_array]) -> FloatArray:
        """(degree + 1, ab, K) entry (k + d, k) of aᵀb for matrices (N, K), a and b of each.

        Places that leave the matrix are zero, as are all further from its diagonal.
        """
        products = [matrix.T @ other for matrix in matrices for other in matrices]
        grams = np.zeros((self.degree + 1, len(products), self.size))
        for offset in range(self.degree + 1):
            for row, product in zip(grams[offset], products, strict=True):
                row[: self.size - offset] = product.diagonal(-offset)
        return grams

    def banded(self, forms: FloatArray, grams: FloatArray) -> FloatArray:
        """((degree + 1) O, O K) the matrix of a sum of squares, in lower banded form.

        The forms (E, O, 2) are each residual's factors of values and rates of O outputs, ``grams``
        those of values and rates. The outputs stand side by side at each function.
        """
        outputs = forms.shape[1]
        squares = np.einsum("eoa,epb->poab", forms, forms).reshape(outputs, 1, outputs, -1)
        banded = np.zeros((outputs * len(grams), outputs * self.size), order="F")
        # Below the diagonal an entry (o, o') stands for (o, o') of the functions k + d, k.
        for output, rows in enumerate(squares @ grams):
            banded[: len(banded) - output, output::outputs] = rows.reshape(len(banded), -1)[output:]
        return banded


class _Window:
    """A window with its B-splines, and the banded solve for their coefficients."""

    curves: Trajectories
    """The motion that was smoothed last."""

    def __init__(self, segment: Segment) -> None:
        self.segment = segment
        self._splines = SplineBasis(float(segment.time[-1]), _knots_every(segment), DEGREE)
        self._value, self._rate = matrices = self._splines.values_and_rates(segment.time)
        self._grams = self._splines.grams(matrices)
        self._dynamic_grams = [self._grams] * segment.followers
        if segment.mask is not None:
            parts = [[matrix[counted] for matrix in matrices] for counted in segment.mask.T]
            self._dynamic_grams = [self._splines.grams(part) for part in parts]

    def smooth(self, solution: Solution) -> None:
        """Take the curves that minimise Ψ at parameters (M,).

        They obey the model without s₀, which is taken from the gaps and added to them at the end.
        """
        segment, followers = self.segment, self.segment.followers
        s0 = np.broadcast_to(np.nan_to_num(solution.terms[..., 0]), (1, followers))
        shift = stack_outputs(np.zeros((1, followers + 1)), s0)
        self._measured = stack_outputs(segment.speeds, segment.gaps) - shift
        self._motion = self._smoothed(solution.theta)
        self.curves = trajectories(segment.time, self._motion.outputs + shift)

    def regression(self) -> Regression:
        """The rows of the curves."""
        rates = trajectories(self.segment.time, self._motion.rates).speeds[:, 1:]
        curves, mask = self.curves, self.segment.mask
        return Regression.of_motion(curves.speeds, curves.gaps, rates, mask)

    def loss(self, solution: Solution) -> dict[str, float]:
        """Ψ and its terms of the curves, at parameters (M,)."""
        mask = self.segment.mask
        counts = None if mask is None else mask.astype(float)
        return loss_terms(self._motion, self._measured, solution.theta, FAST, counts).values()

    def _smoothed(self, theta: FloatArray) -> Motion:
        """The motion that minimises Ψ at parameters θ (M, 3).

        The outputs stand in the order of `pinn.loss.output_columns`, side by side at each knot.
        """
        measured, rows = self._measured, np.arange(len(theta))
        gaps, speeds, ahead = command_columns(len(theta))
        data = np.eye(measured.shape[1])[:, :, None] * [1.0, 0.0]
        # Residuals of dp/dt = Δv and of dv/dt = ..: factors of values and rates.
        kinematic, dynamic = np.zeros((2, len(theta), measured.shape[1], 2))
        kinematic[rows, speeds, 0], kinematic[rows, ahead, 0], kinematic[rows, gaps, 1] = 1, -1, 1
        alpha, alpha_tau, beta = theta.T
        dynamic[rows, gaps, 0], dynamic[rows, speeds, 0] = -alpha, alpha_tau + beta
        dynamic[rows, ahead, 0], dynamic[rows, speeds, 1] = -beta, 1
        matrix = self._splines.banded(np.concatenate([data, kinematic]), self._grams)
        for form, grams in zip(dynamic, self._dynamic_grams, strict=True):
            matrix += self._splines.banded(form[None], grams)
        right = (self._value.T @ measured).ravel()
        coefficients = solveh_banded(matrix, right, lower=True, check_finite=False)
        coefficients = coefficients.reshape(-1, measured.shape[1])
        return Motion(self._value @ coefficients, self._rate @ coefficients)


METHOD = direct(
    "splines", "Splines", fit, MODELS, typical_seconds=0.3,
    summary="smoothing with splines: the limit of the PiNN's loss",
)  # fmt: skip
