"""Checks of a fit: five questions to be asked before its numbers are quoted, and their answers."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from accpinn.channels import PARAMETERS
from accpinn.evaluation.closed_loop import ClosedLoopFinding
from accpinn.evaluation.whiteness import CorrelatedResidual, ShortResidual, Whiteness
from accpinn.findings import Labelled
from accpinn.inference.identifiability import WIDE, wide_intervals
from accpinn.inference.intervals import Uncertainty
from accpinn.methods.fit import Fit, IterationsExhausted, Outcome
from accpinn.segment.segment import SegmentInfo

SYMBOLS = tuple(quantity.symbol for quantity in PARAMETERS)
CheckName = Literal["converged", "inside", "identified", "collision-free", "explained"]
TITLES: Mapping[CheckName, str] = {
    "converged": "Converged",
    "inside": "Inside the interval",
    "identified": "Identified",
    "collision-free": "Simulated without collision",
    "explained": "Residual explained",
}
MEANING: Mapping[CheckName, str] = {
    "converged": (
        "Whether the estimate has stopped changing. Tab Training shows loss and parameters over"
        " iterations."
    ),
    "inside": (
        "Whether the estimates of α, β and τ lie inside their intervals, which stand beside them in"
        " the table."
    ),
    "identified": (
        f"Whether a parameter's interval spans less than a factor of {WIDE:g}. Page Compare shows"
        " the profiles of the loss."
    ),
    "collision-free": (
        "Whether the closed-loop simulation behind the measured leader ends without a collision,"
        " reversing or divergence. The chart shows it beside the data."
    ),
    "explained": (
        "Whether the model's residual is no more than noise. Page Compare shows forms of the model"
        " with a smaller residual."
    ),
}
_ANSWERS = {True: "yes", False: "no", None: "not known"}


@dataclass(frozen=True)
class Check:
    """The answer to one question."""

    name: CheckName
    passed: bool | None
    """None where it is not known."""
    failing: tuple[int, ...] = ()
    """Numbers of the followers that fail."""
    symbol: str = ""
    """The parameter in question; empty for a check of all."""

    @property
    def answer(self) -> str:
        """Yes, no or not known, after the symbol of the parameter."""
        return f"{self.symbol} {_ANSWERS[self.passed]}".strip()

    def reason(self, about: Labelled) -> str:
        """The followers that fail, as a sentence; empty if none does."""
        if not self.failing:
            return ""
        answer = self.answer if self.symbol else self.answer.capitalize()
        return f"{answer}: {', '.join(map(about.label, self.failing))}."


def label_of(group: Sequence[Check]) -> str:
    """Title and answers of the checks of one name: "Identified: α no, β yes, τ yes"."""
    return f"{TITLES[group[0].name]}: {', '.join(check.answer for check in group)}"


def checks(
    info: SegmentInfo,
    fit: Fit,
    uncertainty: Uncertainty | None,
    events: Sequence[ClosedLoopFinding] | None,
    residual: Whiteness | None,
) -> tuple[Check, ...]:
    """All checks of a fit, in the order in which they are shown; three are on identifiability.

    Args:
        info: the description of the segment with M followers.
        fit: the fit of any method.
        uncertainty: the uncertainty of its parameters.
        events: the findings of its closed-loop simulation; None where nothing was simulated.
        residual: the residual of the model with its parameters.
    """
    colliding = [event.vehicle for event in events or ()]
    return (
        Check("converged", _converged(fit)),
        _inside(info, uncertainty),
        *_identified(info, uncertainty),
        _check("collision-free", events is not None, colliding),
        _explained(residual),
    )


def _check(name: CheckName, is_known: bool, failing: Iterable[int], symbol: str = "") -> Check:
    vehicles = tuple(sorted({*failing}))
    return Check(name, not vehicles if is_known else None, vehicles, symbol)


def _converged(fit: Fit) -> bool:
    if fit.outcome in (Outcome.STOPPED, Outcome.DIVERGED):
        return False
    return not any(isinstance(finding, IterationsExhausted) for finding in fit.findings)


def _inside(info: SegmentInfo, uncertainty: Uncertainty | None) -> Check:
    if uncertainty is None:
        return Check("inside", None)
    outside = ~uncertainty.inside.all(axis=1)
    is_known = bool(np.isfinite(uncertainty.centre.alpha).all())
    failing = np.array(info.vehicles[1:])[outside].tolist()
    return _check("inside", is_known or bool(failing), failing)


def _identified(info: SegmentInfo, uncertainty: Uncertainty | None) -> Iterator[Check]:
    wide = [_wide(uncertainty, k) for k in range(info.followers)] if uncertainty else []
    for symbol in SYMBOLS:
        pairs = zip(info.vehicles[1:], wide, strict=False)
        failing = [vehicle for vehicle, symbols in pairs if symbol in symbols]
        yield _check("identified", uncertainty is not None, failing, symbol)


def _wide(uncertainty: Uncertainty, follower: int) -> Sequence[str]:
    """The symbols of parameters with wide intervals; all if the data determine none."""
    if np.isnan(uncertainty.centre[follower].alpha):
        return SYMBOLS
    return [interval.symbol for interval in wide_intervals(uncertainty, follower)]


def _explained(residual: Whiteness | None) -> Check:
    findings = residual.findings if residual else ()
    failing = [finding.vehicle for finding in findings if isinstance(finding, CorrelatedResidual)]
    is_known = bool(findings) and not any(isinstance(f, ShortResidual) for f in findings)
    return _check("explained", is_known or bool(failing), failing)
