"""The form of a column of time, recognised from its name and its values.

A form is certain where the name gives it, or where the values allow no other: a date, a clock whose
numbers jump at full minutes, Unix time, or numbers whose steps are those of a recording in one unit
only. Otherwise the likeliest form is returned, with the reason, for a person to confirm.
"""

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from accpinn.recordings.clocks import (
    CLOCK,
    DATETIME,
    FRAME,
    HHMMSS,
    LONGEST_STEP,
    NANOSECONDS,
    SHORTEST_STEP,
    WRAP_STEPS,
    TimeUnreadable,
    calendar_day,
    date_order,
    exact_number,
    instants_of,
    is_missing,
    moments_of,
    seconds,
    unwrapped,
)
from accpinn.units import FloatArray, Seconds

USUAL_STEPS: tuple[Seconds, Seconds] = (0.01, 0.5)
"""Shortest and longest usual step of a recording."""
LOOKED_AT = 5_000
"""Cells from which a column's form is recognised."""
INCREASING = 0.9
"""Least share of increases among the changes of a time; a table of several runs has falls, too."""


@dataclass(frozen=True)
class Recognised:
    """The form of a column of time, and why."""

    form: str
    """One of `FORMS`, or "frame"."""
    reason: str
    """A phrase: "ISO 8601", "ms: the name says so", "s: steps of 0.1"."""
    by_name: bool = False
    """Whether the column's name gives the form."""
    by_values: bool = False
    """Whether the values allow no other form."""

    @property
    def supported(self) -> bool:
        """Whether name or values decide the form; otherwise it is the likeliest of several."""
        return self.by_name or self.by_values


_UNIT_WORDS = {
    word: unit
    for unit, words in {
        "s": "s sec secs second seconds sekunde sekunden",
        "ms": "ms msec msecs millis millisecond milliseconds millisec",
        "µs": "us usec usecs micros microsecond microseconds microsec",
        "ns": "ns nsec nsecs nanos nanosecond nanoseconds nanosec",
        "min": "min mins minute minutes minuten",
        "h": "h hr hrs hour hours stunden",
        "d": "d days tage",
    }.items()
    for word in words.split()
}
_TIME_WORDS = frozenset(
    "time times timestamp timestamps stamp clock utc epoch zeit zeitstempel uhrzeit datetime tow"
    " timestep temps tiempo tempo tijd nmea hhmmss elapsed".split()
)
"""Words of a column that holds the time."""
_WEAK_WORDS = frozenset(("t", "ts", *_UNIT_WORDS)) - {"s", "h", "d", "min", "mins"}
"""Words of time that count only where all other words are in `_BESIDE`."""
_BESIDE = frozenset(
    "gps gnss utc unix posix local global system sys ros header elapsed total abs absolute rel"
    " relative index idx since from start of day week the in log logger".split()
)
_OTHER_QUANTITIES = frozenset(
    "headway gap thw ttc lap collision reaction delay diff difference delta dt constant tau per"
    " inverse remaining travel response lag loss accuracy error std rate distance speed velocity"
    " acceleration duration cycle".split()
)
"""Words of quantities that are measured in units of time, or over it, but are no clock."""
_CLOCK_WORDS = frozenset(("hhmmss", "utc", "nmea"))
_FRAME_WORDS = frozenset(("frame", "frames", "frameid", "framenumber", "frameindex", "framenr"))


def recognised(name: str, cells: Sequence[str], decimal: str = ".") -> Recognised | None:
    """The form in which a column holds the time; None where it holds none.

    Args:
        name: the column's name; empty, or "column 1", where it has none.
        cells: some or all of its cells, of which the first few thousand are looked at.
        decimal: the mark in its numbers.
    """
    texts = [cell for cell in (c.strip() for c in cells[:LOOKED_AT]) if not is_missing(cell)]
    words = _Name(name)
    if len(texts) < 2 or words.is_other:
        return None
    for text_form in (_as_datetime, _as_clock):
        form = text_form(words, texts)
        if form:
            return form
    try:
        values = np.array([float(exact_number(cell, decimal)) for cell in texts])
    except ValueError:
        return None
    return _of_numbers(words, texts, values, decimal)


def is_fraction(name: str, values: FloatArray) -> bool:
    """Whether a column holds the nanoseconds beside whole seconds, as messages of ROS do."""
    finite = values[np.isfinite(values)]
    in_range = len(finite) > 0 and bool(((finite >= 0) & (finite < NANOSECONDS["s"])).all())
    return in_range and finite.max() > 1.0 and _Name(name).unit == "ns"


class _Name:
    """A column's name, taken apart."""

    def __init__(self, name: str) -> None:
        plain = name.replace("µ", "u").replace("μ", "u")
        bracket = re.search(r"[\[(<{](.*?)[\])>}]", plain)
        self.bracket = bracket[1].strip().lower() if bracket else ""
        outside = re.sub(r"[\[(<{].*?[\])>}]", " ", plain)
        outside = re.sub(r"(?<=[a-z])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z])", " ", outside)
        self.words = _apart(re.findall(r"[a-zäöüß]+", outside.lower()))
        joined = {*self.words, "".join(self.words), self.bracket.replace(":", "")}
        self.is_nameless = not name.strip() or bool(re.fullmatch(r"column \d+", name.strip()))
        self.is_other = not _OTHER_QUANTITIES.isdisjoint(self.words)
        self.is_frame = not _FRAME_WORDS.isdisjoint(joined) and "total" not in self.words
        beside = _TIME_WORDS | _WEAK_WORDS | _BESIDE | _UNIT_WORDS.keys()
        is_weak = not _WEAK_WORDS.isdisjoint(self.words) and beside.issuperset(self.words)
        self.is_time = is_weak or not _TIME_WORDS.isdisjoint(self.words)
        self.is_clock = any(word in _CLOCK_WORDS or word.startswith("hhmmss") for word in joined)

    @property
    def unit(self) -> str | None:
        """The unit that the name gives, in brackets or as its last word."""
        if self.bracket:
            return _UNIT_WORDS.get(self.bracket)
        if not self.words or (len(self.words) > 1 and self.words[-2] == "of"):
            return None
        # As in "Seconds since start", and in "t_ms".
        units = [self.words[-1], *self.words] if "since" in self.words else self.words[-1:]
        return next((_UNIT_WORDS[word] for word in units if word in _UNIT_WORDS), None)


def _apart(words: Iterable[str]) -> list[str]:
    """Words of which "gpstime" is two, and "timems", too."""
    parts: list[str] = []
    for word in words:
        match = re.fullmatch(r"(.*?)(timestamp|time)(.*)", word)
        parts += [part for part in match.groups() if part not in ("", "s")] if match else [word]
    return parts


def _step(time: FloatArray) -> float | None:
    """The typical increase (median) of a column that mostly increases; None of any other."""
    steps = np.diff(time)
    up, changes = steps[steps > 0], np.count_nonzero(steps)
    return float(np.median(up)) if changes and len(up) >= INCREASING * changes else None


def _as_datetime(words: _Name, texts: Sequence[str]) -> Recognised | None:
    """Date and time; None also of a column of dates alone."""
    try:
        moments = moments_of(texts)
    except TimeUnreadable:
        return None
    if not any(moment and moment.has_time for moment in moments):
        return None
    try:
        order = date_order(texts, moments)
    except TimeUnreadable:
        return Recognised(DATETIME, "date and time, of which day or month may come first")
    counts = np.array(instants_of(moments, order), dtype=np.int64)
    if _step((counts - counts[0]) / 1e9) is None:
        return None
    reason, dates = "date and time", {moment.parts for moment in moments if moment}
    # A single date may have two readings.
    is_open = len(dates) == 1 and all(
        calendar_day(parts, order) for parts in dates for order in ("dmy", "mdy")
    )
    if order == "ymd":
        reason = "ISO 8601" if "-" in texts[0][:5] else "date and time, year first"
    elif not is_open:
        reason = f"date and time, {'day' if order == 'dmy' else 'month'} first"
    return Recognised(DATETIME, reason, words.is_time, True)


def _as_clock(words: _Name, texts: Sequence[str]) -> Recognised | None:
    try:
        time = unwrapped(seconds(texts, CLOCK))[0]
    except TimeUnreadable:
        return None
    if _step(time) is None:
        return None
    has_hours = texts[0].count(":") > 1 or texts[0][-1] in "mM."
    reason = f"clock as {'hh:mm:ss' if has_hours else 'mm:ss'}"
    return Recognised(CLOCK, reason, words.is_time, True)


def _of_numbers(
    words: _Name, texts: Sequence[str], values: FloatArray, decimal: str
) -> Recognised | None:
    if not words.is_frame:
        clock = _as_hhmmss(words, texts, values, decimal)
        if clock:
            return clock
    continued = unwrapped(values)[0]
    step = _step(continued)
    if step is None:
        return None
    if words.is_frame:
        steps = np.diff(values)
        is_counter = step == 1 and bool((values == np.rint(values)).all())
        is_counter &= bool(np.mean(steps[steps > 0] == 1) > 0.5)
        return Recognised(FRAME, "frame numbers: the name says so", True) if is_counter else None
    epoch = _as_epoch(values, step)
    if words.is_time and words.unit and _is_possible(step, words.unit):
        agrees = epoch is not None and epoch.form == words.unit
        reason = f"{words.unit}: the name says so"
        return Recognised(words.unit, epoch.reason if epoch and agrees else reason, True, agrees)
    if epoch:
        return Recognised(epoch.form, epoch.reason, False, True)
    if words.is_time:
        return _by_step(words, values, step)
    steps = np.diff(values)
    is_even = bool(np.ptp(steps) < 1e-3 * step)
    if words.is_nameless and is_even and _is_usual(step, "s"):
        return Recognised("s", f"s: even steps of {step:.3g}", False, True)
    return None


def _as_hhmmss(
    words: _Name, texts: Sequence[str], values: FloatArray, decimal: str
) -> Recognised | None:
    """HHMMSS.SS where clock time goes on evenly across the numbers' jumps at full minutes.

    Within a minute its values are those of seconds, and the name decides.
    """
    if values.min() < 0 or values.max() >= 240_000 or (values % 100 >= 60).any():
        return None
    try:
        time = unwrapped(seconds(texts, HHMMSS, decimal))[0]
    except TimeUnreadable:
        return None
    step = _step(time)
    if step is None or not SHORTEST_STEP <= step <= LONGEST_STEP:
        return None
    minutes = np.flatnonzero(np.diff(np.floor(values / 100)))
    ordinary = int(np.count_nonzero(np.abs(np.diff(time)[minutes]) <= WRAP_STEPS * step))
    is_by_values = ordinary >= (1 if words.is_time else 2) and ordinary >= 0.8 * len(minutes)
    is_by_name = words.is_clock and not len(minutes)
    if not is_by_values and not is_by_name:
        return None
    return Recognised(HHMMSS, "clock as HHMMSS.SS", words.is_clock, is_by_values)


def _as_epoch(values: FloatArray, step: float) -> Recognised | None:
    """Seconds since 1970, or parts of them, by their size: 2001 to 2049."""
    middle = float(np.median(values))
    for unit in ("s", "ms", "µs", "ns"):
        scale = NANOSECONDS["s"] / NANOSECONDS[unit]
        if 1.0e9 * scale <= middle <= 2.5e9 * scale and _is_possible(step, unit):
            return Recognised(unit, f"Unix time in {unit}")
    return None


def _by_step(words: _Name, values: FloatArray, step: float) -> Recognised | None:
    """The unit in which the steps are those of a recording; the likeliest, where several are."""
    units = [unit for unit in NANOSECONDS if unit != "us" and _is_possible(step, unit)]
    if not units:
        return None
    if 30_000 < values.min() and values.max() < 800_000 and "d" in units:
        return Recognised("d", "days: a date as a number", False, True)
    usual = [unit for unit in units if _is_usual(step, unit)]
    # An unnamed unit is s before all others, which therefore need that nothing else is possible.
    is_decided = usual == ["s"] or len(units) == 1
    if words.unit and words.unit not in units:
        listed = f"{words.unit}: steps of {_in_seconds(step, words.unit):.2g} s"
        return Recognised(units[0], f"{units[0]}: steps of {step:.3g}, but the name says {listed}")
    is_counter = step == 1 and bool((values == np.rint(values)).all())
    if is_decided and not is_counter:
        return Recognised(units[0], f"{units[0]}: steps of {step:.3g}", False, True)
    shown = " or ".join(f"{unit} (steps of {_in_seconds(step, unit):.2g} s)" for unit in units)
    likeliest = (usual or units)[0]
    return Recognised(likeliest, f"{shown}; or a counter" if is_counter else shown)


def _in_seconds(step: float, unit: str) -> Seconds:
    return step * NANOSECONDS[unit] / 1e9


def _is_possible(step: float, unit: str) -> bool:
    return SHORTEST_STEP * 0.999 <= _in_seconds(step, unit) <= LONGEST_STEP * 1.001


def _is_usual(step: float, unit: str) -> bool:
    return USUAL_STEPS[0] * 0.999 <= _in_seconds(step, unit) <= USUAL_STEPS[1] * 1.001
