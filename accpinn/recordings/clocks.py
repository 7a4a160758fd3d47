"""Times as people's tables write them, in seconds.

A column of time has a form: numbers in a unit, date and time, a clock, or HHMMSS.SS as satellite
receivers write it. `seconds` reads a column of a given form; `recognised` finds the form from a
column's name and values; `unwrapped` continues a clock across midnight and a week's end.

Texts are read as whole nanoseconds, so differences are exact where an instant, as 1.7e9 s of Unix
time, leaves a floating-point number no digits for them.
"""

import datetime
import re
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from decimal import Decimal, InvalidOperation
from typing import Any

import numpy as np
from numpy.typing import NDArray

from accpinn.units import FloatArray, Seconds

NANOSECONDS = {
    "s": 10**9,
    "ms": 10**6,
    "µs": 10**3,
    "us": 10**3,
    "ns": 1,
    "min": 60 * 10**9,
    "h": 3600 * 10**9,
    "d": 86400 * 10**9,
}
"""Nanoseconds of each unit of numbers that give the time; d counts days, as spreadsheets do."""
DATETIME, CLOCK, HHMMSS, FRAME = "datetime", "clock", "hhmmss", "frame"
FORMS = (*NANOSECONDS, DATETIME, CLOCK, HHMMSS)
"""Forms that `seconds` reads; frames need a rate, and are read elsewhere."""
MISSING = frozenset((
    "", "nan", "-nan", "na", "n/a", "n.a.", "<na>", "nat", "null", "nil", "none", "missing",
    "-", "--", "---", ".", "?", "#n/a", "#n/a n/a", "#na", "#null!", "#div/0!", "#value!", "#ref!",
    "#num!", "inf", "+inf", "-inf", "infinity", "+infinity", "-infinity", "1.#inf", "-1.#inf",
    "1.#qnan", "-1.#ind", "1.#ind",
))  # fmt: skip
"""Words, in small letters, of a cell that holds no value."""
SHORTEST_STEP: Seconds = 1e-3
LONGEST_STEP: Seconds = 5.0
"""Steps of a recording that are possible."""
USUAL_STEPS: tuple[Seconds, Seconds] = (0.01, 0.5)
"""Shortest and longest usual step of a recording."""
WRAPS: tuple[Seconds, ...] = (86400.0, 604800.0)
"""Periods after which clocks begin anew: midnight, and the end of the GPS week."""
WRAP_STEPS = 10
"""Longest step across a wrap, in typical steps."""
LOOKED_AT = 5_000
"""Cells from which a column's form is recognised."""
INCREASING = 0.9
"""Least share of increases among the changes of a time; a table of several runs has falls, too."""


class TimeUnreadable(ValueError):
    """The first cell of a column that its form cannot read."""

    def __init__(self, index: int, cell: str, fault: str, is_date: bool = False) -> None:
        """Keep the cell's place, 0 = first, its text and what is wrong with it."""
        super().__init__(f'cell {index}: "{cell[:40]}" {fault}')
        self.index = index
        self.cell = cell
        self.fault = fault
        self.is_date = is_date
        """Whether it is a cell of the second column, that of dates."""


@dataclass(frozen=True)
class Recognised:
    """The form of a column of time, and why."""

    form: str
    """One of `FORMS`, or "frame"."""
    reason: str
    """A phrase: "ISO 8601", "ms: the name says so", "s: steps of 0.1"."""
    by_name: bool = False
    """Whether the column's name says the form."""
    by_values: bool = False
    """Whether the values leave no other form."""

    @property
    def supported(self) -> bool:
        """Whether name or values decide the form; otherwise it is the likeliest of several."""
        return self.by_name or self.by_values


# Reading


_TIME = (
    r"(?P<hour>\d{1,2}):?(?P<minute>\d{2})(?::?(?P<second>\d{2})(?:[.,:](?P<fraction>\d+))?)?"
    r"\s*(?P<half>[AaPp]\.?[Mm]\.?)?"
)
_ZONE = r"\s*(?P<zone>Z|z|UTC|GMT|[+-]\d{2}(?::?\d{2})?)?"
_DATES = (
    (("ymd",), r"(?P<a>\d{4})(?P<mark>[-/.])(?P<b>\d{1,2})(?P=mark)(?P<c>\d{1,2})"),
    (("ymd",), r"(?P<a>\d{4})(?P<b>\d{2})(?P<c>\d{2})"),
    (("dmy", "mdy"), r"(?P<a>\d{1,2})(?P<mark>[-/.])(?P<b>\d{1,2})(?P=mark)(?P<c>\d{4})"),
    (("dmy", "mdy", "ymd"), r"(?P<a>\d{2})(?P<mark>[-/.]?)(?P<b>\d{2})(?P=mark)(?P<c>\d{2})"),
    (("dmy",), r"(?P<a>\d{1,2})[- ](?P<b>[A-Za-z]{3,9})\.?[- ](?P<c>\d{4})"),
)
"""Orders of year, month and day that a date may have, and its pattern."""
_MOMENTS = tuple(
    (orders, re.compile(rf"{date}(?:(?:\s*[Tt_,]\s*|\s+){_TIME}{_ZONE})?"))
    for orders, date in _DATES
)
_MONTHS = ("jan", "feb", "mar", "apr", "may", "jun", "jul", "aug", "sep", "oct", "nov", "dec")
_CLOCK = re.compile(
    r"(?:(?P<hour>\d{1,4}):)?(?P<minute>\d{1,4}):(?P<second>\d{1,2})(?:[.,:](?P<fraction>\d+))?"
    r"\s*(?P<half>[AaPp]\.?[Mm]\.?)?"
)
_DAY = NANOSECONDS["d"]
_LARGEST = 9 * 10**18
"""Largest count of nanoseconds that 64 bits hold."""


def seconds(
    cells: Sequence[str] | NDArray[Any],
    form: str,
    decimal: str = ".",
    dates: Sequence[str] | None = None,
) -> FloatArray:
    """Seconds from a column's first instant (N,), to a nanosecond; nan where a cell is missing.

    Args:
        cells: (N,) texts, numbers or numpy's datetimes.
        form: one of `FORMS`.
        decimal: the mark in numbers; date and clock may have either.
        dates: (N,) the dates of the cells, where a second column holds them.

    Raises:
        TimeUnreadable: the first cell that cannot be read.
    """
    texts = _texts(cells)
    if form == DATETIME and dates is None:
        counts = _instants(texts)
    elif form == CLOCK or form == DATETIME:
        counts = _counts(texts, _clock)
    elif form == HHMMSS:
        counts = _counts(texts, lambda cell: _hhmmss(_number(cell, decimal)))
    else:
        counts = _numbers(texts, form, decimal)
    if dates is not None:
        days = _instants(_texts(dates), is_date=True)
        counts = [
            None if count is None or day is None else count + day
            for count, day in zip(counts, days, strict=True)
        ]
    first = next((count for count in counts if count is not None), 0)
    return np.array([np.nan if count is None else (count - first) / 1e9 for count in counts])


def unwrapped(time: FloatArray) -> tuple[FloatArray, tuple[int, ...]]:
    """Times (N,) that go on where the clock fell by a day or a week, and where it did so.

    A fall counts only if the step is then a few typical steps; any other fall is left alone.
    """
    known = np.flatnonzero(np.isfinite(time))
    steps = np.diff(time[known])
    typical = float(np.median(steps[steps > 0])) if (steps > 0).any() else 0.0
    continued, wraps = np.array(time, dtype=float), []
    for k in np.flatnonzero(steps < 0):
        for period in WRAPS:
            if 0 < steps[k] + period <= WRAP_STEPS * typical:
                place = int(known[k + 1])
                continued[place:] += period
                wraps.append(place)
                break
    return (np.round(continued, 9) if wraps else continued), tuple(wraps)


def _texts(cells: Sequence[str] | NDArray[Any]) -> list[str]:
    """Cells as stripped texts; a number's text has just the digits that give it back."""
    if isinstance(cells, np.ndarray):
        if cells.dtype.kind == "M":
            return [str(cell) for cell in cells.astype("datetime64[ns]").astype(str)]
        if cells.dtype.kind == "f":  # of its own precision: 0.1, not 0.10000000149
            cells = cells.astype(str)
        return [str(cell).strip() for cell in cells.tolist()]
    return [cell.strip() for cell in cells]


def _is_missing(cell: str) -> bool:
    return len(cell) <= 9 and cell.lower() in MISSING


def _counts(
    texts: Sequence[str], read: Callable[[str], int], fault: str = "is no time"
) -> list[int | None]:
    """Nanoseconds of each cell, None where it is missing."""
    counts: list[int | None] = []
    for k, cell in enumerate(texts):
        if _is_missing(cell):
            counts.append(None)
            continue
        try:
            count = read(cell)
        except (ValueError, ArithmeticError):
            raise TimeUnreadable(k, cell, fault) from None
        if abs(count) > _LARGEST:
            raise TimeUnreadable(k, cell, "is too large for a time")
        counts.append(count)
    return counts


def _numbers(texts: Sequence[str], unit: str, decimal: str) -> list[int | None]:
    scale = NANOSECONDS[unit]
    if decimal == "." and not any("_" in cell for cell in texts):
        try:
            values = np.array(texts, dtype=float)
        except ValueError:
            pass
        else:
            if np.abs(values).max(initial=0.0) * scale < 1e15:  # nan compares as False
                return [int(count) for count in np.rint(values * scale)]
    return _counts(texts, lambda cell: round(_number(cell, decimal) * scale), "is no number")


def _number(cell: str, decimal: str) -> Decimal:
    """The number in a cell, exactly; a ValueError where it is anything else."""
    if not cell.isascii() or "_" in cell or (decimal != "." and "." in cell):
        raise ValueError
    try:
        value = Decimal(cell.replace(decimal, "."))
    except InvalidOperation:
        raise ValueError from None
    if not value.is_finite() or value.adjusted() > 20:  # 10**20 ns are 3000 years
        raise ValueError
    return value


def _clock(cell: str) -> int:
    """Nanoseconds of hh:mm:ss or mm:ss; hours and leading minutes may exceed a day."""
    match = _CLOCK.fullmatch(cell)
    if not match or (match["hour"] and int(match["minute"]) > 59):
        raise ValueError
    hour, minute, second = (int(match[part] or 0) for part in ("hour", "minute", "second"))
    if match["half"] and not match["hour"]:  # "12:35 PM" has no seconds
        hour, minute, second = minute, second, 0
    if match["half"]:
        hour = _hour(hour, match["half"])
    return _of_day(hour, minute, second, match["fraction"])


def _hour(hour: int, half: str) -> int:
    """The hour of the day from that of a half."""
    if not 1 <= hour <= 12:
        raise ValueError
    return hour % 12 + 12 * (half[0] in "pP")


def _of_day(hour: int, minute: int, second: int, fraction: str | None) -> int:
    if second > 59:
        raise ValueError
    nanoseconds = int((fraction or "0")[:9].ljust(9, "0"))
    return ((hour * 60 + minute) * 60 + second) * 10**9 + nanoseconds


def _hhmmss(number: Decimal) -> int:
    """Nanoseconds since midnight of a number HHMMSS.SS."""
    whole = int(number)
    hour, minute, second = whole // 10_000, whole // 100 % 100, whole % 100
    if number < 0 or hour > 23 or minute > 59 or second > 59:
        raise ValueError
    return (hour * 60 + minute) * 60 * 10**9 + round((number - whole + second) * 10**9)


# Date and time


@dataclass(frozen=True)
class _Moment:
    """A cell of date and time before the order of day and month is known."""

    parts: tuple[int, int, int]
    orders: tuple[str, ...]
    of_day: int
    """Nanoseconds since midnight; since that of universal time where the cell has a zone."""
    has_time: bool
    has_zone: bool


def _moment(cell: str) -> _Moment:
    matches = ((orders, pattern.fullmatch(cell)) for orders, pattern in _MOMENTS)
    orders, match = next(((orders, match) for orders, match in matches if match), ((), None))
    if not match:
        raise ValueError
    month = match["b"]
    number = int(month) if month.isdigit() else _MONTHS.index(month[:3].lower()) + 1
    parts = int(match["a"]), number, int(match["c"])
    if not any(_day(parts, order) for order in orders):
        raise ValueError
    if match["hour"] is None:
        return _Moment(parts, orders, 0, False, False)
    hour, minute = int(match["hour"]), int(match["minute"])
    hour = _hour(hour, match["half"]) if match["half"] else hour
    if hour > 23 or minute > 59:
        raise ValueError
    of_day = _of_day(hour, minute, int(match["second"] or 0), match["fraction"])
    zone = match["zone"]
    if zone and zone[0] in "+-":
        offset = int(zone[1:3]) * 60 + int(zone[3:].strip(":") or 0)
        of_day -= (offset if zone[0] == "+" else -offset) * 60 * 10**9
    return _Moment(parts, orders, of_day, True, bool(zone))


def _moments(texts: Sequence[str], is_date: bool = False) -> list[_Moment | None]:
    """The cells of a column; one that has a zone where others have none is refused."""
    moments: list[_Moment | None] = []
    first: _Moment | None = None
    fault = "is no date" if is_date else "is no date with time"
    for k, cell in enumerate(texts):
        if _is_missing(cell):
            moments.append(None)
            continue
        try:
            moment = _moment(cell)
        except ValueError:
            raise TimeUnreadable(k, cell, fault, is_date) from None
        if is_date and moment.of_day:
            raise TimeUnreadable(k, cell, "has a time of its own beside the date", is_date)
        first = first or moment
        if moment.has_zone != first.has_zone:
            raise TimeUnreadable(k, cell, "has a time zone, or none, unlike the first", is_date)
        moments.append(moment)
    return moments


def _instants(texts: Sequence[str], is_date: bool = False) -> list[int | None]:
    """Nanoseconds of date and time, in the order of day and month that the column has."""
    moments = _moments(texts, is_date)
    return _in_order(moments, _order(texts, moments, is_date))


def _order(texts: Sequence[str], moments: Sequence[_Moment | None], is_date: bool = False) -> str:
    """The order of year, month and day that serves the whole column.

    Where several do, and give other differences, the one whose dates increase by at most a day is
    meant; where none or several are so, the first cell of another date is refused.
    """
    orders: tuple[str, ...] = ("ymd", "dmy", "mdy")
    dates: dict[tuple[int, int, int], int] = {}
    for k, moment in enumerate(moments):
        if moment is None or dates.setdefault(moment.parts, k) != k:
            continue
        orders = tuple(o for o in orders if o in moment.orders and _day(moment.parts, o))
        if not orders:
            raise TimeUnreadable(
                k, texts[k], "is no date, or none in the order of those above", is_date
            )
    if len(orders) == 1 or len(dates) == 1:
        return min(orders, key=("dmy", "mdy", "ymd").index)
    readings = {order: [_day(parts, order) for parts in dates] for order in orders}
    steps = {order: tuple(np.diff(days).tolist()) for order, days in readings.items()}
    if len({*steps.values()}) <= 1:
        return orders[0]
    daily = [order for order in orders if all(step == 1 for step in steps[order])]
    if len(daily) != 1:
        change = [*dates.values()][1]
        fault = "may have its day or its month first, and the date changes here"
        raise TimeUnreadable(change, texts[change], fault, is_date)
    return daily[0]


def _day(parts: tuple[int, int, int], order: str) -> int:
    """The day's number in the calendar; 0 where there is no such date."""
    year, month, day = (parts[order.index(letter)] for letter in "ymd")
    if year < 100:
        year += 2000 if year < 70 else 1900
    try:
        return datetime.date(year, month, day).toordinal() if 1700 < year < 2260 else 0
    except ValueError:
        return 0


_EPOCH = datetime.date(1970, 1, 1).toordinal()


def _in_order(moments: Sequence[_Moment | None], order: str) -> list[int | None]:
    """Nanoseconds since 1970 of moments whose dates are in an order."""
    days: dict[tuple[int, int, int], int] = {}
    counts: list[int | None] = []
    for moment in moments:
        if moment is None:
            counts.append(None)
            continue
        if moment.parts not in days:
            days[moment.parts] = (_day(moment.parts, order) - _EPOCH) * _DAY
        counts.append(days[moment.parts] + moment.of_day)
    return counts


# Recognition


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
"""Words that do so only where no other word but those beside them is there."""
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
    texts = [cell for cell in (c.strip() for c in cells[:LOOKED_AT]) if not _is_missing(cell)]
    words = _Name(name)
    if len(texts) < 2 or words.is_other:
        return None
    for text_form in (_as_datetime, _as_clock):
        form = text_form(words, texts)
        if form:
            return form
    try:
        values = np.array([float(_number(cell, decimal)) for cell in texts])
    except ValueError:
        return None
    return _of_numbers(words, texts, values, decimal)


def is_fraction(name: str, values: FloatArray) -> bool:
    """Whether a column holds the nanoseconds beside whole seconds, as messages of ROS do."""
    known = values[np.isfinite(values)]
    in_range = len(known) > 0 and bool(((known >= 0) & (known < NANOSECONDS["s"])).all())
    return in_range and known.max() > 1.0 and _Name(name).unit == "ns"


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
        """The unit that the name says, in brackets or as its last word."""
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
        moments = _moments(texts)
    except TimeUnreadable:
        return None
    if not any(moment and moment.has_time for moment in moments):
        return None
    try:
        order = _order(texts, moments)
    except TimeUnreadable:
        return Recognised(DATETIME, "date and time, of which day or month may come first")
    counts = np.array(_in_order(moments, order), dtype=np.int64)
    if _step((counts - counts[0]) / 1e9) is None:
        return None
    reason = "date and time"
    if order == "ymd":
        reason = "ISO 8601" if "-" in texts[0][:5] else "date and time, year first"
    elif not _order_is_open([moment for moment in moments if moment]):
        reason = f"date and time, {'day' if order == 'dmy' else 'month'} first"
    return Recognised(DATETIME, reason, words.is_time, True)


def _order_is_open(moments: Iterable[_Moment]) -> bool:
    """Whether all cells are of one date that has two readings."""
    dates = {moment.parts for moment in moments}
    return len(dates) == 1 and all(_day(parts, o) for parts in dates for o in ("dmy", "mdy"))


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

    Within a minute it cannot be told from seconds by its values, and need not be: a name decides.
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
