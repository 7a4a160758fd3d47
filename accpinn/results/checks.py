"""Checks of a fit: five questions to be asked before its numbers are quoted, and their answers."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import compress
from typing import Literal

import numpy as np

from accpinn.channels import PARAMETERS
from accpinn.evaluation.whiteness import CorrelatedResidual, ShortResidual, WhitenessFinding
from accpinn.findings import Labelled
from accpinn.inference.identifiability import WIDE, wide_intervals
from accpinn.inference.intervals import Uncertainty
from accpinn.methods.fit import Outcome
from accpinn.study.result import Result

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
CONVERGED = (Outcome.SOLVED, Outcome.CONVERGED, Outcome.FILTERED)
_ANSWERS = {True: "yes", False: "no", None: "not known"}


@dataclass(frozen=True)
class Check:
    """The answer to one question, or one for each parameter."""

    name: CheckName
    answers: Mapping[str, bool | None]
    """By the symbol of the parameter, which is empty for all together; None: it is not known."""
    failing: Mapping[str, tuple[int, ...]] = field(default_factory=dict)
    """Numbers of the followers that fail, likewise; nothing where none does."""

    @property
    def passed(self) -> bool | None:
        """The worst of the answers."""
        return next(worst for worst in (False, None, True) if worst in self.answers.values())

    @property
    def label(self) -> str:
        """Title and answers: "Identified: α no, β yes, τ yes"."""
        said = (f"{symbol} {_ANSWERS[answer]}".strip() for symbol, answer in self.answers.items())
        return f"{QUESTIONS[self.name]}: {', '.join(said)}"

    def reasons(self, about: Labelled) -> list[str]:
        """The followers that fail, a sentence a parameter."""
        return [
            f"{f'{symbol} no' if symbol else 'No'}: {', '.join(map(about.label, vehicles))}."
            for symbol, vehicles in self.failing.items()
        ]


def checks(result: Result) -> tuple[Check, ...]:
    """All checks of a result, in the order in which they are shown."""
    vehicles, uncertainty = result.info.vehicles[1:], result.uncertainty
    evaluation = result.evaluation
    outside = np.logical_not(uncertainty.inside.all(axis=1)).tolist()
    is_determined = bool(np.isfinite(uncertainty.centre.alpha).all())
    colliding = [event.vehicle for event in evaluation.all_findings]
    return (
        Check("converged", {"": result.fit.outcome in CONVERGED}),
        _check("inside", {"": compress(vehicles, outside)}, is_determined),
        _check("identified", _unidentified(vehicles, uncertainty)),
        _check("collision-free", {"": colliding}),
        _explained(evaluation.whiteness.findings),
    )


def _check(name: CheckName, failing: Mapping[str, Iterable[int]], is_known: bool = True) -> Check:
    """A check that some vehicles fail; without any it passes where the answer is known."""
    found = {symbol: tuple(sorted({*vehicles})) for symbol, vehicles in failing.items()}
    answers = {symbol: not them if is_known or them else None for symbol, them in found.items()}
    return Check(name, answers, {symbol: them for symbol, them in found.items() if them})


def _unidentified(vehicles: Sequence[int], uncertainty: Uncertainty) -> dict[str, list[int]]:
    """For each parameter the followers with wide intervals, or none as none is determined."""
    wide: dict[str, list[int]] = {quantity.symbol: [] for quantity in PARAMETERS}
    for k, vehicle in enumerate(vehicles):
        symbols = [interval.symbol for interval in wide_intervals(uncertainty, k)]
        for symbol in wide if np.isnan(uncertainty.centre[k].alpha) else symbols:
            wide[symbol].append(vehicle)
    return wide


def _explained(findings: Sequence[WhitenessFinding]) -> Check:
    failing = [finding.vehicle for finding in findings if isinstance(finding, CorrelatedResidual)]
    is_known = bool(findings) and not any(isinstance(f, ShortResidual) for f in findings)
    return _check("explained", {"": failing}, is_known)
