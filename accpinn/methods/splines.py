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

from accpinn.errors import SegmentError
from accpinn.methods import direct
from accpinn.methods.estimate import Fit, Outcome
from accpinn.methods.least_squares import MODELS, solved
from accpinn.methods.pinn.config import FAST
from accpinn.methods.pinn.evidence import SplineBasis
from accpinn.methods.pinn.loss import (
    Motion,
    command_columns,
    loss_terms,
    stack_outputs,
    trajectories,
)
from accpinn.methods.regression import Regression
from accpinn.model.cthp import Case
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


def fit(
    segment: Segment,
    case: Case = "II",
    spec: ModelSpec = PAPER_SPEC,
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
    knots_every = max(KNOTS_EVERY, LEAST_SAMPLES * segment.sample_time)
    basis, given = _Basis(segment, knots_every), stack_outputs(segment.speeds, segment.gaps)
    solution = solved(Regression.of(segment), case, spec)
    for rounds in range(1, ROUNDS + 1):  # noqa: B007 (used below)
        # The curves obey the model without s₀, which is added to the gaps at the end.
        s0 = np.broadcast_to(np.nan_to_num(solution.terms[..., 0]), (1, segment.followers))
        shift = stack_outputs(np.zeros((1, segment.followers + 1)), s0)
        measured = given - shift
        motion = basis.smoothed(measured, solution.theta)
        before = solution.theta
        curves = trajectories(segment.time, motion.outputs + shift)
        rates = trajectories(segment.time, motion.rates).speeds[:, 1:]
        regression = Regression.of_motion(curves.speeds, curves.gaps, rates, segment.mask)
        solution = solved(regression, case, spec)
        if np.abs(solution.theta - before).max() <= TOLERANCE * np.abs(solution.theta).max():
            break
    mask = None if segment.mask is None else segment.mask.astype(float)
    loss = loss_terms(motion, measured, solution.theta, FAST, mask).values()
    return Fit.of(
        "splines",
        segment,
        case,
        solution,
        surrogate=curves,
        outcome=Outcome.SOLVED if rounds < ROUNDS else Outcome.FINISHED,
        config={"knots_every": knots_every, "degree": DEGREE},
        loss={name: loss[name] for name in ("total", "data", "physics")},
        iterations=rounds,
    )


class _Basis:
    """The B-splines on the segment's instants, and the banded solve for their coefficients."""

    def __init__(self, segment: Segment, knots_every: Seconds) -> None:
        self._splines = SplineBasis(float(segment.time[-1]), knots_every, DEGREE)
        self._value, self._rate = matrices = self._splines.derivatives(segment.time, 1)
        self._grams = self._splines.grams(matrices, matrices)
        self._dynamic_grams = [self._grams] * segment.followers
        if segment.mask is not None:
            parts = [[matrix[kept] for matrix in matrices] for kept in segment.mask.T]
            self._dynamic_grams = [self._splines.grams(part, part) for part in parts]

    def smoothed(self, measured: FloatArray, theta: FloatArray) -> Motion:
        """The curves that minimise Ψ for data (N, 2M+1) and parameters θ (M, 3).

        The outputs stand in the order of `pinn.loss.output_columns`, side by side at each knot.
        """
        each = np.arange(len(theta))
        gaps, own, ahead = command_columns(len(theta))
        data = np.eye(measured.shape[1])[:, :, None] * [1.0, 0.0]
        # Residuals of dp/dt = Δv and of dv/dt = ..: factors of values and rates.
        kinematic, dynamic = np.zeros((2, len(theta), measured.shape[1], 2))
        kinematic[each, own, 0], kinematic[each, ahead, 0], kinematic[each, gaps, 1] = 1, -1, 1
        alpha, alpha_tau, beta = theta.T
        dynamic[each, gaps, 0], dynamic[each, own, 0] = -alpha, alpha_tau + beta
        dynamic[each, ahead, 0], dynamic[each, own, 1] = -beta, 1
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
