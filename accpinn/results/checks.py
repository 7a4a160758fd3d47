"""Checks of a fit: five questions to be asked before its numbers are quoted, and their answers."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import compress
from typing import Literal

import numpy as np

from accpinn.channels import PARAMETERS
from accpinn.evaluation.whiteness import CorrelatedResidual, ShortResidual, WhitenessFinding
from accpinn.findings import Labelled
from accpinn.inference.identifiability import WIDE, wide_intervals
from accpinn.inference.intervals import Uncertainty
from accpinn.methods.fit import Fit, IterationsExhausted, Outcome
from accpinn.study.result import Result

SYMBOLS = tuple(quantity.symbol for quantity in PARAMETERS)
CheckName = Literal["converged", "inside", "identified", "collision-free", "explained"]
QUESTIONS: Mapping[CheckName, str] = {
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
        " the table of the method's estimates."
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
    return f"{QUESTIONS[group[0].name]}: {', '.join(check.answer for check in group)}"


def checks(result: Result) -> tuple[Check, ...]:
    """All checks of a result, in the order in which they are shown; three on identifiability."""
    vehicles, uncertainty = result.info.vehicles[1:], result.uncertainty
    evaluation = result.evaluation
    outside = np.logical_not(uncertainty.inside.all(axis=1)).tolist()
    is_determined = bool(np.isfinite(uncertainty.centre.alpha).all())
    colliding = [event.vehicle for event in evaluation.all_findings]
    return (
        Check("converged", _has_converged(result.fit)),
        _check("inside", compress(vehicles, outside), is_determined),
        *_identified(vehicles, uncertainty),
        _check("collision-free", colliding),
        _explained(evaluation.whiteness.findings),
    )


def _check(
    name: CheckName, failing: Iterable[int], is_known: bool = True, symbol: str = ""
) -> Check:
    """A check that some vehicles fail; without any it passes where the answer is known."""
    vehicles = tuple(sorted({*failing}))
    return Check(name, not vehicles if is_known or vehicles else None, vehicles, symbol)


def _has_converged(fit: Fit) -> bool:
    if fit.outcome in (Outcome.STOPPED, Outcome.DIVERGED):
        return False
    return not any(isinstance(finding, IterationsExhausted) for finding in fit.findings)


def _identified(vehicles: Sequence[int], uncertainty: Uncertainty) -> Iterator[Check]:
    """For each parameter: its intervals are wide, or the data determine none of a follower's."""
    wide = dict[int, Sequence[str]]()
    for k, vehicle in enumerate(vehicles):
        wide[vehicle] = [interval.symbol for interval in wide_intervals(uncertainty, k)]
        if np.isnan(uncertainty.centre[k].alpha):
            wide[vehicle] = SYMBOLS
    for symbol in SYMBOLS:
        failing = (vehicle for vehicle, symbols in wide.items() if symbol in symbols)
        yield _check("identified", failing, symbol=symbol)


def _explained(findings: Sequence[WhitenessFinding]) -> Check:
    failing = [finding.vehicle for finding in findings if isinstance(finding, CorrelatedResidual)]
    is_known = bool(findings) and not any(isinstance(f, ShortResidual) for f in findings)
    return _check("explained", failing, is_known)
