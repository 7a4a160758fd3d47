"""Times in the forms that tables write them in, read in seconds.

A column of time has a form: numbers in a unit, date and time, a clock, or HHMMSS.SS as satellite
receivers write it. `seconds` reads a column of a given form, and `unwrapped` continues a clock
across midnight and a week's end; time_forms.py finds the form.

Texts are read as whole nanoseconds, so differences are exact where an instant, as 1.7e9 s of Unix
time, leaves a floating-point number no digits for them.
"""

import datetime
import re
from collections.abc import Callable, Sequence
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
WRAPS: tuple[Seconds, ...] = (86400.0, 604800.0)
"""Periods after which clocks begin anew: midnight, and the end of the GPS week."""
WRAP_STEPS = 10
"""Longest step across a wrap, in typical steps."""


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
        counts = _counts(texts, lambda cell: _hhmmss(exact_number(cell, decimal)))
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
    filled = np.flatnonzero(np.isfinite(time))
    steps = np.diff(time[filled])
    typical = float(np.median(steps[steps > 0])) if (steps > 0).any() else 0.0
    continued, wraps = np.array(time, dtype=float), []
    for k in np.flatnonzero(steps < 0):
        for period in WRAPS:
            if 0 < steps[k] + period <= WRAP_STEPS * typical:
                place = int(filled[k + 1])
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


def is_missing(cell: str) -> bool:
    """Whether a cell holds one of the words for a missing value."""
    return len(cell) <= 9 and cell.lower() in MISSING


def _counts(
    texts: Sequence[str], read: Callable[[str], int], fault: str = "is no time"
) -> list[int | None]:
    """Nanoseconds of each cell, None where it is missing."""
    counts: list[int | None] = []
    for k, cell in enumerate(texts):
        if is_missing(cell):
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
    return _counts(texts, lambda cell: round(exact_number(cell, decimal) * scale), "is no number")


def exact_number(cell: str, decimal: str) -> Decimal:
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
class Moment:
    """A cell of date and time before the order of day and month is known."""

    parts: tuple[int, int, int]
    orders: tuple[str, ...]
    of_day: int
    """Nanoseconds since midnight; since that of universal time where the cell has a zone."""
    has_time: bool
    has_zone: bool


def _moment(cell: str) -> Moment:
    matches = ((orders, pattern.fullmatch(cell)) for orders, pattern in _MOMENTS)
    orders, match = next(((orders, match) for orders, match in matches if match), ((), None))
    if not match:
        raise ValueError
    month = match["b"]
    number = int(month) if month.isdigit() else _MONTHS.index(month[:3].lower()) + 1
    parts = int(match["a"]), number, int(match["c"])
    if not any(calendar_day(parts, order) for order in orders):
        raise ValueError
    if match["hour"] is None:
        return Moment(parts, orders, 0, False, False)
    hour, minute = int(match["hour"]), int(match["minute"])
    hour = _hour(hour, match["half"]) if match["half"] else hour
    if hour > 23 or minute > 59:
        raise ValueError
    of_day = _of_day(hour, minute, int(match["second"] or 0), match["fraction"])
    zone = match["zone"]
    if zone and zone[0] in "+-":
        offset = int(zone[1:3]) * 60 + int(zone[3:].strip(":") or 0)
        of_day -= (offset if zone[0] == "+" else -offset) * 60 * 10**9
    return Moment(parts, orders, of_day, True, bool(zone))


def moments_of(texts: Sequence[str], is_date: bool = False) -> list[Moment | None]:
    """The cells of a column; one that has a zone where others have none is refused."""
    moments: list[Moment | None] = []
    first: Moment | None = None
    fault = "is no date" if is_date else "is no date with time"
    for k, cell in enumerate(texts):
        if is_missing(cell):
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
    moments = moments_of(texts, is_date)
    return instants_of(moments, date_order(texts, moments, is_date))


def date_order(
    texts: Sequence[str], moments: Sequence[Moment | None], is_date: bool = False
) -> str:
    """The order of year, month and day that serves the whole column.

    Where several do, and differ in their steps, the one whose dates increase day by day is taken;
    where none or several do so, the first cell of another date is refused.
    """
    orders: tuple[str, ...] = ("ymd", "dmy", "mdy")
    dates: dict[tuple[int, int, int], int] = {}
    for k, moment in enumerate(moments):
        if moment is None or dates.setdefault(moment.parts, k) != k:
            continue
        orders = tuple(o for o in orders if o in moment.orders and calendar_day(moment.parts, o))
        if not orders:
            raise TimeUnreadable(
                k, texts[k], "is no date, or none in the order of those above", is_date
            )
    if len(orders) == 1 or len(dates) == 1:
        return min(orders, key=("dmy", "mdy", "ymd").index)
    readings = {order: [calendar_day(parts, order) for parts in dates] for order in orders}
    steps = {order: tuple(np.diff(days).tolist()) for order, days in readings.items()}
    if len({*steps.values()}) <= 1:
        return orders[0]
    daily = [order for order in orders if all(step == 1 for step in steps[order])]
    if len(daily) != 1:
        change = [*dates.values()][1]
        fault = "may have its day or its month first, and the date changes here"
        raise TimeUnreadable(change, texts[change], fault, is_date)
    return daily[0]


def calendar_day(parts: tuple[int, int, int], order: str) -> int:
    """The day's number in the calendar; 0 where there is no such date."""
    year, month, day = (parts[order.index(letter)] for letter in "ymd")
    if year < 100:
        year += 2000 if year < 70 else 1900
    try:
        return datetime.date(year, month, day).toordinal() if 1700 < year < 2260 else 0
    except ValueError:
        return 0


_EPOCH = datetime.date(1970, 1, 1).toordinal()


def instants_of(moments: Sequence[Moment | None], order: str) -> list[int | None]:
    """Nanoseconds since 1970 of moments whose dates are in an order."""
    days: dict[tuple[int, int, int], int] = {}
    counts: list[int | None] = []
    for moment in moments:
        if moment is None:
            counts.append(None)
            continue
        if moment.parts not in days:
            days[moment.parts] = (calendar_day(moment.parts, order) - _EPOCH) * _DAY
        counts.append(days[moment.parts] + moment.of_day)
    return counts
