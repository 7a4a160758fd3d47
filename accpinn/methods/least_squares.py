"""Batch least squares on finite differences, the simplest honest estimate.

The law is linear in θ = (α, ατ, β), so with dv/dt by central differences of the measured speeds
one 3x3 solve a follower gives, over the instants that the segment does not leave out,

    θ = argmin Σ_t (dv/dt - α p + ατ v - β Δv)²   subject to α, ατ, β ≥ 0.

It works on the measurements themselves: noise in the regressors pulls the gains towards zero.
"""

import time

import numpy as np

from accpinn.methods.fit import Fit, Outcome, bound_notes
from accpinn.methods.method import direct
from accpinn.model.cthp import Case, Parameters, regressors, solve_rows
from accpinn.segment.segment import Segment


def fit(segment: Segment, case: Case = "II") -> Fit:
    """The least-squares parameters of a segment; takes milliseconds."""
    started = time.perf_counter()
    terms = regressors(segment.speeds, segment.gaps)
    acceleration = np.gradient(segment.speeds[:, 1:], segment.sample_time, axis=0)
    solution = solve_rows(terms, acceleration, case, segment.mask)
    return Fit(
        method="least-squares",
        case=case,
        parameters=Parameters.from_theta(solution.theta),
        surrogate=None,
        outcome=Outcome.SOLVED,
        seconds=time.perf_counter() - started,
        config={},
        unconstrained=Parameters.from_theta(solution.unconstrained),
        active_bounds=solution.active,
        notes=bound_notes(segment.vehicles, solution),
    )


METHOD = direct("least-squares", "Least squares", fit, typical_seconds=0.1)
