"""A window's ratings, and the window that is suggested, in words."""

from collections.abc import Mapping, Sequence

from accpinn.recordings.recording import Window
from accpinn.results.messages import Labelled, messages, percent
from accpinn.segment.quality import CAR_FOLLOWING, LARGE_CONDITION, Grade, Question, Rating
from accpinn.segment.suggestion import Suggestion

WORDS: Mapping[Question, Mapping[Grade, str]] = {
    "complete": {
        Grade.GOOD: "Samples complete",
        Grade.FAIR: "Samples bridged",
        Grade.POOR: "Samples missing",
    },
    "excited": {
        Grade.GOOD: "Excitation sufficient",
        Grade.FAIR: "Excitation small",
        Grade.POOR: "Excitation insufficient",
    },
    "following": {Grade.GOOD: "Car-following", Grade.POOR: "Little car-following"},
    "driver": {
        Grade.GOOD: "Driven by ACC",
        Grade.FAIR: "Not ACC throughout",
        Grade.POOR: "Driven by hand",
        Grade.UNKNOWN: "Driver not recorded",
    },
    "consistent": {
        Grade.GOOD: "Gaps consistent with speeds",
        Grade.POOR: "Gaps contradict speeds",
        Grade.UNKNOWN: "Consistency not known",
    },
}
"""What stands beside the mark of a grade."""
MEANING: Mapping[Question, str] = {
    "complete": "Whether every speed and gap of the window was measured.",
    "excited": (
        "Whether the vehicles accelerate and brake enough to identify α, β and τ. A condition"
        f" number above {LARGE_CONDITION:.0f} means near equilibrium."
    ),
    "following": (
        f"Whether the followers move with a time gap of at most {CAR_FOLLOWING:g} s, where the"
        " model is meant to hold."
    ),
    "driver": "Whether ACC controls the followers, by the driver modes in the file.",
    "consistent": (
        "Whether each measured space-gap (IVS) changes as the difference of the speeds demands, by"
        " the correlation of the two over the whole recording; sound data reach 0.8 and more."
    ),
}


def rating_label(rating: Rating) -> str:
    """The answer in a few words."""
    return WORDS[rating.question][rating.grade]


def rating_reasons(rating: Rating, about: Labelled) -> tuple[str, ...]:
    """What the answer rests on: a figure, and every finding."""
    figure = _figure(rating)
    return (*((figure,) if figure else ()), *messages(rating.findings, about))


def _figure(rating: Rating) -> str:
    values = [value for value in rating.values if value == value]
    if not values:
        return ""
    low, high = min(values), max(values)
    match rating.question:
        case "complete":
            return f"Missing or bridged: {percent(high)} of the instants."
        case "excited":
            return f"Condition number: {_span(f'{low:.0f}', f'{high:.0f}')}."
        case "following":
            return f"In car-following: {_span(percent(low), percent(high))} of the time."
        case "driver":
            return f"Driven by hand: at most {percent(high)} of the time."
        case "consistent":
            return f"Correlation: {_span(f'{low:.2f}', f'{high:.2f}')}."


def _span(low: str, high: str) -> str:
    return low if low == high else f"{low} to {high}"


def suggestion_reasons(
    found: Suggestion, present: Window | None = None, efficiency: float = 1.0
) -> Sequence[str]:
    """Why a window is suggested, and what the present one is worth beside it.

    Args:
        found: the suggestion.
        present: the window that is chosen now, if it can be used.
        efficiency: its relative D-efficiency against the suggested one.
    """
    length = f"{found.window.duration:.0f} s"
    among = "the only complete window" if found.candidates == 1 else (
        f"of {found.candidates} complete windows of {length}, the one with the best excitation in"
        " car-following"
    )  # fmt: skip
    who = "The file does not say who drives every follower."
    if found.manual is not None:
        by_hand = f"{percent(found.manual)} of the time by hand"
        who = f"At most {by_hand}." if found.manual else "ACC throughout."
    said = [
        f"{found.window}: {among}.",
        f"Every follower is in car-following for at least {percent(found.car_following)} of the"
        f" time. {who}",
    ]
    if found.shortened:
        said.append(f"Nothing longer is complete; {found.asked:.0f} s are usual.")
    if present and present != found.window:
        said.append(
            f"The present window, {present}, holds {percent(efficiency)} of its information on"
            " α, β and τ (relative D-efficiency)."
        )
    return said
