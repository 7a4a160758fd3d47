"""Batch least squares on finite differences, the simplest estimate.

The model is linear in θ = (α, ατ, β), so with dv/dt by central differences of the measured speeds
one 3x3 solve a follower gives, over the instants in the segment's mask,

    θ = argmin Σ_t (dv/dt - α p + ατ v - β Δv)²   subject to α, ατ, β ≥ 0.

It uses the measurements themselves: noise in the regressors biases the gains towards zero.
"""

import time

from accpinn.methods.fit import Fit, Outcome
from accpinn.methods.method import direct
from accpinn.methods.regression import Regression
from accpinn.model.cthp import Case
from accpinn.segment.segment import Segment


def fit(segment: Segment, case: Case = "II") -> Fit:
    """The least-squares parameters of a segment; takes milliseconds."""
    started = time.perf_counter()
    solution = Regression.of(segment).solve(case)
    return Fit.of(
        "least-squares",
        segment,
        case,
        solution,
        outcome=Outcome.SOLVED,
        seconds=time.perf_counter() - started,
        config={},
    )


METHOD = direct(
    "least-squares", "Least squares", fit, typical_seconds=0.1,
    summary="batch least squares on finite differences of the speeds",
)  # fmt: skip
