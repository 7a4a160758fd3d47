"""What speaks for and against a fit: five questions to be asked before its numbers are quoted."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from accpinn.channels import PARAMETERS
from accpinn.evaluation.closed_loop import ClosedLoopFinding
from accpinn.evaluation.whiteness import CorrelatedResidual, ShortResidual, Whiteness
from accpinn.inference.identifiability import wide_intervals
from accpinn.inference.intervals import Uncertainty
from accpinn.methods.fit import Fit, IterationsExhausted, Outcome
from accpinn.segment.segment import SegmentInfo

SYMBOLS = tuple(quantity.symbol for quantity in PARAMETERS)
CheckName = Literal["converged", "inside", "identified", "collision-free", "explained"]


@dataclass(frozen=True)
class Check:
    """The answer to one question."""

    name: CheckName
    passed: bool | None
    """None where it is not known."""
    failing: tuple[int, ...] = ()
    """Numbers of the followers for which it is not passed."""
    symbol: str = ""
    """The parameter that it is about; empty where it is about all."""


def checks(
    info: SegmentInfo,
    fit: Fit,
    uncertainty: Uncertainty | None,
    events: Sequence[ClosedLoopFinding] | None,
    residual: Whiteness | None,
) -> tuple[Check, ...]:
    """All checks of a fit, in the order in which they are shown; three are of identifiability.

    Args:
        info: of the segment with M followers.
        fit: of any method.
        uncertainty: of its parameters.
        events: of its closed-loop simulation; None where nothing was simulated.
        residual: of the model with its parameters.
    """
    return (
        Check("converged", _converged(fit)),
        _inside(info, uncertainty),
        *_identified(info, uncertainty),
        _check("collision-free", events is not None, [one.vehicle for one in events or ()]),
        _explained(residual),
    )


def _check(name: CheckName, known: bool, failing: Iterable[int], symbol: str = "") -> Check:
    vehicles = tuple(sorted({*failing}))
    return Check(name, not vehicles if known else None, vehicles, symbol)


def _converged(fit: Fit) -> bool:
    if fit.outcome in (Outcome.STOPPED, Outcome.DIVERGED):
        return False
    return not any(isinstance(one, IterationsExhausted) for one in fit.findings)


def _inside(info: SegmentInfo, uncertainty: Uncertainty | None) -> Check:
    if uncertainty is None:
        return Check("inside", None)
    outside = ~uncertainty.inside.all(axis=1)
    known = bool(np.isfinite(uncertainty.centre.alpha).all())
    failing = np.array(info.vehicles[1:])[outside].tolist()
    return _check("inside", known or bool(failing), failing)


def _identified(info: SegmentInfo, uncertainty: Uncertainty | None) -> Iterator[Check]:
    wide = [_wide(uncertainty, k) for k in range(info.followers)] if uncertainty else []
    for symbol in SYMBOLS:
        pairs = zip(info.vehicles[1:], wide, strict=False)
        failing = [vehicle for vehicle, symbols in pairs if symbol in symbols]
        yield _check("identified", uncertainty is not None, failing, symbol)


def _wide(uncertainty: Uncertainty, follower: int) -> Sequence[str]:
    """The symbols of parameters with wide intervals; all where the data determine none."""
    if np.isnan(uncertainty.centre[follower].alpha):
        return SYMBOLS
    return [one.symbol for one in wide_intervals(uncertainty, follower)]


def _explained(residual: Whiteness | None) -> Check:
    found = residual.findings if residual else ()
    failing = [one.vehicle for one in found if isinstance(one, CorrelatedResidual)]
    known = bool(found) and not any(isinstance(one, ShortResidual) for one in found)
    return _check("explained", known or bool(failing), failing)
