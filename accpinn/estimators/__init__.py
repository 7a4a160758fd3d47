"""Every other way to estimate the law, behind one signature: segment and case in, `Fit` out."""

from collections.abc import Callable

from accpinn.cthp import Case
from accpinn.estimators import (
    dual_ukf,
    least_squares,
    particle,
    recursive,
    savitzky_golay,
    simulation,
    splines,
)
from accpinn.fit import Fit
from accpinn.segment import Segment

ESTIMATORS: dict[str, Callable[[Segment, Case], Fit]] = {
    "least-squares": least_squares.fit,
    "savitzky-golay": savitzky_golay.fit,
    "splines": splines.fit,
    "simulation": simulation.fit,
    "recursive": recursive.fit,
    "particle": particle.fit,
    "dual-ukf": dual_ukf.fit,
}
"""By the names that the command line and results use."""
