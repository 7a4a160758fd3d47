"""A recording and a window of it, in words and tables.

In words: who drives, how a window is rated, why one is suggested. As tables: vehicles, quality and
regimes.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import isinf, isnan

import numpy as np

from accpinn.findings import joined, percent
from accpinn.methods.estimate import Estimate
from accpinn.recordings import FLAGS, Recording, Vehicle, Window
from accpinn.recordings.cures import Cure, Exchange, ReadSpeedAs, Reverse, Shift
from accpinn.recordings.increments import agreement
from accpinn.recordings.mapping import CsvMapping, units_taken
from accpinn.results.tables import ABSENT, Cell, Column, Filled, Table, percent_cells
from accpinn.results.tables.estimates import driver_cells, parameter_cells
from accpinn.segment import LONGEST_TIME_GAP, USUAL, SegmentInfo
from accpinn.segment.cut import DURATION
from accpinn.segment.quality import (
    LARGE_CONDITION,
    MOST_CAR_FOLLOWING,
    REGIMES,
    Grade,
    Quality,
    Question,
    Rating,
    Regimes,
)
from accpinn.segment.windows import Suggestion
from accpinn.study.vehicles import by_hand, where

_LABELS_OF_GRADES: Mapping[Question, Sequence[str]] = {
    "complete": ("Samples complete", "Samples measured", "Samples measured"),
    "excited": ("Excitation sufficient", "Excitation small", "Excitation insufficient"),
    "following": ("Car-following", "Not only car-following", "Little car-following"),
    "driver": ("Driven by ACC", "Driven by ACC", "Driven by ACC", "Driver not recorded"),
    "consistent": ("Gaps consistent with speeds", "Gaps computed from speeds",
                   "Gaps contradict speeds", "Consistency not known"),
}  # fmt: skip
LABELS: Mapping[Question, Mapping[Grade, str]] = {
    question: dict(zip(Grade, labels, strict=False))
    for question, labels in _LABELS_OF_GRADES.items()
}
"""Label of each rating by grade, from good to unknown."""
MEANING: Mapping[Question, str] = {
    "complete": (
        "The share of instants at which every speed and gap was measured: not missing, not bridged,"
        " and not frozen, which is the same value again and again while the vehicle moves."
    ),
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
        "Whether the space-gaps (IVS) are measured and change as the differences of the speeds"
        " demand: by correlation, sign, slope, clocks and jumps."
    ),
}
"""Meaning of each question."""
QUANTITIES: Mapping[Question, Column] = {
    "complete": Column("Samples measured", "%", 1),
    "excited": Column("Condition number", "", 0),
    "following": Column("Car-following", "%", 0),
    "driver": Column("Driven by ACC", "%", 0),
    "consistent": Column("Gap correlation", "", 2),
}
"""The quantity behind each rating; of several followers that of the worst."""


@dataclass(frozen=True)
class RatedWindow:
    """A window for training with its quality."""

    number: int
    """Its place among the windows, from 1."""
    window: Window
    is_used: bool
    """Whether the next training takes it."""
    ratings: tuple[Rating, ...] = ()
    """Empty where it cannot be used."""
    fault: str = ""
    """Why it cannot be used."""

    @property
    def grade(self) -> Grade:
        """The worst that is known of it."""
        if not self.ratings:
            return Grade.POOR
        known_grades = [Grade.GOOD, Grade.FAIR, Grade.POOR]
        grades = [rating.grade for rating in self.ratings if rating.grade in known_grades]
        return max(grades, key=known_grades.index, default=Grade.UNKNOWN)


def quantity_of(rating: Rating) -> str:
    """The quantity of a rating with its unit, as "98.3 %"."""
    column, value = QUANTITIES[rating.question], rating.value
    if isnan(value):
        return ABSENT
    if column.unit != "%":
        return "∞" if isinf(value) else column.shown(value)
    # Only what is whole is 100 %.
    digits = 10.0 ** (column.digits or 0)
    shown = 100 * value if value >= 1.0 else min(100 * value, 100.0 - 1.0 / digits)
    return f"{column.shown(shown)} %"


def windows_table(source: str, rows: Sequence[RatedWindow]) -> Table:
    """One row a window: length, the quantity of each check, and whether it is used."""
    quantities = list[Filled]()
    for place, column in enumerate(QUANTITIES.values()):
        factor = 100 if column.unit == "%" else 1
        values = [row.ratings[place].value if row.ratings else None for row in rows]
        quantities.append((column, [None if v is None else factor * v for v in values]))
    return Table.of(
        f"{source}: windows",
        [
            (Column("Window"), [str(row.window) for row in rows]),
            (Column("Length", "s", 0), [row.window.duration for row in rows]),
            *quantities,
            (Column("In the training"), ["yes" if row.is_used else "no" for row in rows]),
        ],
    )


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


def cure_words(cure: Cure, mapping: CsvMapping, vehicle: int) -> str:
    """A change of a mapping as a button names it: "Shift Speed1 by −1.0 s".

    Args:
        cure: of a finding about the gap behind ``vehicle``.
        mapping: by which the table was read.
        vehicle: number of the vehicle ahead.
    """
    are_several = len(mapping.speeds) > 2
    if isinstance(cure, Exchange) and not mapping.by:
        which = f" of vehicles {cure.vehicle} and {cure.vehicle + 1}" if are_several else ""
        return f"Exchange the speeds{which}"
    if isinstance(cure, Exchange | Reverse):
        which = f" of vehicle {cure.vehicle + 1}" if are_several else ""
        return f"Reverse the sign of the gap{which}"
    if isinstance(cure, Shift):
        seconds = f"{cure.seconds:+.1f}".replace("-", "\N{MINUS SIGN}")
        return f"Shift {cure.channel}{cure.vehicle} by {seconds} s"
    if isinstance(cure, ReadSpeedAs):
        return f"Read the speed of vehicle {cure.vehicle} as {cure.unit}"
    changes = cure.changes(units_taken(mapping, vehicle))
    plural = {"speed": "speeds", "gap": "gaps"}
    return "Read " + joined([f"{plural.get(name, name)} as {unit}" for name, unit in changes])


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
        reasons.append(f"Nothing longer is complete; {DURATION:.0f} s are usual.")
    if present and present != window:
        reasons.append(
            f"The present window, {present}, contains {percent(efficiency)} of the information on"
            " α, β and τ (relative D-efficiency)."
        )
    return reasons


def recording_table(recording: Recording) -> Table:
    """A row for each vehicle with data: driver modes, missing samples, agreement of its gap."""
    present = [vehicle for vehicle in recording.vehicles if vehicle.present]
    ahead = [vehicle.index - 1 for vehicle in present]
    agreements = [agreement(recording.pair(k)) if k in recording.present else None for k in ahead]
    return Table.of(
        f"{recording.source}: vehicles",
        [
            (Column("Vehicle"), [recording.label(vehicle.index) for vehicle in present]),
            (Column("ACC", "%", 0, "Driver"), [_share(vehicle, "ACC") for vehicle in present]),
            (Column("Human", "%", 0, "Driver"), [_share(vehicle, "Human") for vehicle in present]),
            (Column("Speed missing", "%", 1), [100 * v.missing_share for v in present]),
            (Column("Gap ahead: correlation with speeds", "", 2), agreements),
        ],
    )


def _share(vehicle: Vehicle, mode: str) -> Cell:
    """A mode's share of the samples with a mode, in percent; None without any."""
    modes = vehicle.modes or {}
    total = sum(modes.values())
    return 100 * modes[mode] / total if total else None


def quality_table(info: SegmentInfo, quality: Quality, estimate: Estimate) -> Table:
    """One row a follower: the window's figures, and the least-squares estimate from it."""
    return Table.of(
        where(info),
        [
            (Column("Follower"), info.labels[1:]),
            *driver_cells(by_hand(info)),
            *parameter_cells(estimate.parameters, "Least-squares estimate"),
            (Column("Mean time gap", "s", 2), quality.mean_time_gap),
            (Column("Car-following", "%", 0), percent_cells(quality.car_following)),
            (Column("Δv, std.", "m/s", 2), quality.relative_deviation),
            (Column("Condition number", "", 0), quality.condition),
        ],
    )


def regimes_table(infos: Sequence[SegmentInfo], regimes: Sequence[Regimes]) -> Table:
    """One row a follower: its share of the instants of all windows in each regime."""
    shares = np.array([part.shares for part in regimes])
    samples = [info.samples for info in infos]
    together = np.average(shares, axis=0, weights=samples).T
    filled = [
        (Column(name.capitalize(), "%", 0), percent_cells(share))
        for name, share in zip(REGIMES, together, strict=True)
    ]
    followers = (Column("Follower"), infos[0].labels[1:])
    return Table.of(f"Regimes, {where(infos[0], windows=infos)}", [followers, *filled])
