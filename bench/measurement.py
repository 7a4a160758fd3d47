"""A measured figure with its limits, how it is timed, and the figures of the last release.

A time is the median of several rounds. A busy or slow machine shows in a fixed calculation that is
timed before and after every part: if it takes longer than at the release, everything does.
"""

import hashlib
import os
import platform
import statistics
import time
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from datetime import UTC, datetime
from functools import partial
from importlib.metadata import version
from pathlib import Path

import msgspec

import accpinn
from accpinn.units import Seconds

RELEASED = Path(__file__).with_name("released.json")
ROUNDS = 5
HASHED = bytes(32_000_000)
BUSY = 1.15
"""Ratio of the fixed calculation's time to that at the release, above which a machine is busy."""
Spent = tuple[Seconds, Seconds]
"""Elapsed time and processor time."""


class Measurement(msgspec.Struct, frozen=True, omit_defaults=True, kw_only=True):
    """A figure, and its limits on two quiet processors."""

    name: str
    value: float
    unit: str = "s"
    at_most: float | None = None
    at_least: float | None = None
    error: float | None = None
    """Standard error."""
    processor: Seconds | None = None
    """Processor time; None if it was not measured."""

    @property
    def within(self) -> bool:
        """Whether the limits are kept."""
        low, high = self.at_least, self.at_most
        return (low is None or self.value >= low) and (high is None or self.value <= high)


class Part(msgspec.Struct, frozen=True):
    """The measurements of one process."""

    name: str
    fixed: Seconds
    """Time of the fixed calculation before and after them."""
    measurements: list[Measurement]


class Figures(msgspec.Struct, frozen=True):
    """All figures of one version on one machine."""

    version: str
    date: str
    machine: str
    parts: list[Part]

    @classmethod
    def now(cls, parts: list[Part]) -> "Figures":
        """Return the figures of this version, today, on this machine."""
        processor = platform.processor() or platform.machine()
        packages = ", ".join(f"{name} {version(name)}" for name in ("torch", "streamlit"))
        machine = f"{os.cpu_count()} cores ({processor}), Python {platform.python_version()}"
        today = datetime.now(UTC).date().isoformat()
        return cls(accpinn.__version__, today, f"{machine}, {packages}", parts)

    @classmethod
    def released(cls) -> "Figures":
        """Read the figures of the last release."""
        return msgspec.json.decode(RELEASED.read_bytes(), type=cls)

    def release(self) -> None:
        """Keep the figures as those of the release."""
        RELEASED.write_bytes(msgspec.json.format(msgspec.json.encode(self)) + b"\n")

    def show(self) -> int:
        """Print the figures beside those of the last release.

        Returns:
            The exit status: 1 if a limit is not kept.
        """
        print(table(self, Figures.released()))
        return int(not all(figure.within for part in self.parts for figure in part.measurements))


def spent_on(work: Callable[[], object]) -> Spent:
    """Time one call in this process."""
    began, processor = time.perf_counter(), time.process_time()
    work()
    return time.perf_counter() - began, time.process_time() - processor


def timed(
    name: str, once: Callable[[], Spent], at_most: Seconds | None = None, rounds: int = ROUNDS
) -> Measurement:
    """Return the median of several rounds."""
    clock, processor = map(statistics.median, zip(*(once() for _ in range(rounds)), strict=True))
    return Measurement(name=name, value=clock, at_most=at_most, processor=processor)


def measured(name: str, measure: Callable[[], Iterable[Measurement]]) -> Part:
    """Measure a part, with the fixed calculation before and after it."""
    before = _fixed_calculation()
    measurements = list(measure())
    return Part(name, statistics.median(before + _fixed_calculation()), measurements)


def _fixed_calculation() -> list[Seconds]:
    """Time digests of the same bytes on every processor at once, several rounds of them."""
    blocks = [HASHED] * (os.cpu_count() or 1)
    with ThreadPoolExecutor(len(blocks)) as pool:
        once = partial(spent_on, lambda: list(pool.map(hashlib.sha256, blocks)))
        return [once()[0] for _ in range(ROUNDS)]


def table(now: Figures, before: Figures) -> str:
    """Return a line a measurement, beside the released one, and a note on a busy machine."""
    earlier = {part.name: part for part in before.parts}
    lines = [f"accpinn {now.version}, {now.date}: {now.machine}"]
    lines.append(f"released {before.version}, {before.date}: {before.machine}")
    lines.append(f"{'':44}{'now':>14}{'processor':>12}{'limit':>14}{'released':>12}{'ratio':>7}")
    for part in now.parts:
        lines.append(part.name)
        then = earlier.get(part.name, Part(part.name, part.fixed, []))
        values = {figure.name: figure.value for figure in then.measurements}
        lines += [_line(figure, values.get(figure.name)) for figure in part.measurements]
        if part.fixed > BUSY * then.fixed:
            ratio = f"{part.fixed / then.fixed:.2f} times as long as at the release"
            lines.append(f"  Busy or slow machine: a fixed calculation took {ratio}.")
    return "\n".join(lines)


def _line(figure: Measurement, before: float | None) -> str:
    unit, error = figure.unit, figure.error
    low, high = figure.at_least, figure.at_most
    limit = _text(low, unit, "≥ ") if high is None else _text(high, unit, "≤ ")
    if low is not None and high is not None:
        limit = f"{low:g} to {high:g} {unit}"
    value = _text(figure.value, unit) if error is None else f"{figure.value:.1f} ± {error:.1f} %"
    ratio = f"{figure.value / before:.2f}" if before else ""
    row = (
        f"  {figure.name:42}{value:>14}{_text(figure.processor, 's'):>12}{limit:>14}"
        f"{_text(before, unit):>12}{ratio:>7}"
    )
    return row if figure.within else f"{row}  beyond its limit"


def _text(value: float | None, unit: str, sign: str = "") -> str:
    if value is None:
        return ""
    if unit == "s" and value < 0.1:
        value, unit = 1e3 * value, "ms"
    digits = {"s": 2 if value < 100 else 0, "ms": 1, "%": 2}.get(unit, 0)
    return f"{sign}{value:,.{digits}f} {unit}"
