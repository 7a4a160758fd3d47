"""Who drives in a recording, how a window is rated, and why one is suggested, in words."""

from collections.abc import Mapping

from accpinn.findings import percent
from accpinn.recordings.recording import HUMAN_FLAG, Recording, Window
from accpinn.segment.quality import (
    LARGE_CONDITION,
    MOST_CAR_FOLLOWING,
    Grade,
    Question,
)
from accpinn.segment.segment import LONGEST_TIME_GAP, USUAL
from accpinn.segment.suggestion import Suggestion

FLAGS = {HUMAN_FLAG: "human drivers", 1: "ACC", 2: "mixed"}
"""Meaning of the file's ACC flag, which is for the recording as a whole."""
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
    "following": {
        Grade.GOOD: "Car-following",
        Grade.FAIR: "Not only car-following",
        Grade.POOR: "Little car-following",
    },
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
"""Label of each grade."""
MEANING: Mapping[Question, str] = {
    "complete": "Whether every speed and gap of the window was measured.",
    "excited": (
        "Whether the vehicles accelerate and brake enough to identify α, β and τ. A condition"
        f" number above {LARGE_CONDITION:.0f} means near equilibrium."
    ),
    "following": (
        f"Whether the followers move with a time gap of at most {USUAL:g} times their median, or"
        f" {LONGEST_TIME_GAP[0]:g} s if that is more, where the model is meant to hold; good from"
        f" {percent(MOST_CAR_FOLLOWING)} of the time on."
    ),
    "driver": "Whether ACC controls the followers, by the driver modes in the file.",
    "consistent": (
        "Whether the measured space-gaps (IVS) change as the differences of the speeds demand, by"
        " the correlation of the two over the whole recording; sound data reach 0.8 and more."
    ),
}
"""Meaning of each question."""


def driver_summary(recording: Recording) -> str:
    """Who drives, by name: "Human: 1; ACC: 2, 3"; by the file's flag where it gives no modes."""
    by_mode: dict[str, list[str]] = {}
    for vehicle in recording.vehicles:
        if vehicle.modes and any(vehicle.modes.values()):
            mode = " and ".join(name for name, samples in vehicle.modes.items() if samples)
            by_mode.setdefault(mode, []).append(str(vehicle.index))
    if by_mode:
        return "; ".join(f"{mode}: {', '.join(numbers)}" for mode, numbers in by_mode.items())
    flag = FLAGS.get(recording.acc_flag) if recording.acc_flag is not None else None
    return "driver modes not recorded" + (f" (flagged as {flag})" if flag else "")


def suggestion_reasons(
    suggestion: Suggestion, present: Window | None = None, efficiency: float = 1.0
) -> list[str]:
    """Why a window is suggested, and how the present window compares, if that can be used.

    The efficiency is the relative D-efficiency of the present window against the suggested one.
    """
    window, manual = suggestion.window, suggestion.manual
    choice = "the only complete window"
    if suggestion.candidates != 1:
        choice = (
            f"the best excitation in car-following among {suggestion.candidates} complete windows"
            f" of {window.duration:.0f} s"
        )
    driver = "The file does not say who drives every follower."
    if manual is not None:
        driver = f"At most {percent(manual)} of the time by hand." if manual else "ACC throughout."
    share = percent(suggestion.car_following)
    often = "all the time" if share == percent(1.0) else f"for at least {share} of the time"
    reasons = [f"{window}: {choice}.", f"Every follower is in car-following {often}. {driver}"]
    if suggestion.shortened:
        reasons.append(f"Nothing longer is complete; {suggestion.asked:.0f} s are usual.")
    if present and present != window:
        reasons.append(
            f"The present window, {present}, contains {percent(efficiency)} of the information on"
            " α, β and τ (relative D-efficiency)."
        )
    return reasons
