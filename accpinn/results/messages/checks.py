"""The checks of a fit in words: their titles, answers, and what an answer means."""

from collections.abc import Mapping, Sequence

from accpinn.inference.identifiability import WIDE
from accpinn.results.checks import Check, CheckName
from accpinn.results.messages import Labelled

TITLES: Mapping[CheckName, str] = {
    "converged": "Converged",
    "inside": "Inside the interval",
    "identified": "Identified",
    "collision-free": "Simulated without collision",
    "explained": "Residual explained",
}
MEANING: Mapping[CheckName, str] = {
    "converged": (
        "Whether more iterations would still change the estimate. Tab Training shows loss and"
        " parameters over iterations."
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
        "Whether what the model leaves over is no more than noise. Page Compare shows forms of the"
        " model that may leave less."
    ),
}
_WORDS = {True: "yes", False: "no", None: "not known"}


def answer_of(check: Check) -> str:
    """Yes, no or not known; of a parameter after its symbol."""
    return f"{check.symbol} {_WORDS[check.passed]}".strip()


def label_of(group: Sequence[Check]) -> str:
    """Title and answers of the checks of one name: "Identified: α no, β yes, τ yes"."""
    return f"{TITLES[group[0].name]}: {', '.join(map(answer_of, group))}"


def failing_of(check: Check, about: Labelled) -> str:
    """For which followers a check is not passed; empty for none."""
    if not check.failing:
        return ""
    which = ", ".join(map(about.label, check.failing))
    return f"{answer_of(check).capitalize() if not check.symbol else answer_of(check)}: {which}."
