"""A measured figure with its limits, how it is timed, and the figures of the last release.

A time is the median of several rounds, or the best of them where others share the machine and the
work is a few milliseconds. A busy or slow machine shows in a fixed calculation that is
timed before and after every part: if it takes longer than at the release, everything does.
"""

import hashlib
import os
import platform
import statistics
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
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
FIXED = "fixed calculation"
HASHED = bytes(32_000_000)
BUSY = 1.15
"""Ratio of the fixed calculation's time to that at the release, above which a machine is busy."""
Spent = tuple[Seconds, Seconds]
"""Elapsed time and processor time."""


class Measurement(msgspec.Struct, frozen=True, kw_only=True):
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


Parts = Mapping[str, Sequence[Measurement]]
"""The measurements of each process by the name of its part; the first is `FIXED`."""


class Released(msgspec.Struct, frozen=True):
    """The figures of one version on one machine."""

    version: str
    date: str
    machine: str
    values: dict[str, dict[str, float]]
    """Values by part and name, in the units of the measurements."""

    @classmethod
    def now(cls, parts: Parts) -> "Released":
        """Return the figures of this version, today, on this machine."""
        processor = platform.processor() or platform.machine()
        packages = ", ".join(f"{name} {version(name)}" for name in ("torch", "streamlit"))
        machine = f"{os.cpu_count()} cores ({processor}), Python {platform.python_version()}"
        values = {
            part: {figure.name: float(f"{figure.value:.4g}") for figure in figures}
            for part, figures in parts.items()
        }
        return cls(accpinn.__version__, f"{datetime.now(UTC):%F}", f"{machine}, {packages}", values)

    @classmethod
    def last(cls) -> "Released":
        """Read the figures of the last release."""
        return msgspec.json.decode(RELEASED.read_bytes(), type=cls)

    def keep(self) -> None:
        """Keep the figures as those of the release."""
        RELEASED.write_bytes(msgspec.json.format(msgspec.json.encode(self)) + b"\n")


def show(parts: Parts) -> int:
    """Print figures beside those of the last release.

    Returns:
        The exit status: 1 if a limit is not kept.
    """
    print(table(parts, Released.now(parts), Released.last()))
    return int(not all(figure.within for figures in parts.values() for figure in figures))


def spent_on(work: Callable[[], object]) -> Spent:
    """Time one call in this process."""
    began, processor = time.perf_counter(), time.process_time()
    work()
    return time.perf_counter() - began, time.process_time() - processor


def timed(
    name: str,
    once: Callable[[], Spent],
    at_most: Seconds | None = None,
    rounds: int = ROUNDS,
    of: Callable[[Iterable[Seconds]], Seconds] = statistics.median,
) -> Measurement:
    """Return the median of several rounds, or of them what ``of`` says, as `min`, the best."""
    clock, processor = map(of, zip(*(once() for _ in range(rounds)), strict=True))
    return Measurement(name=name, value=clock, at_most=at_most, processor=processor)


def measured(measure: Callable[[], Iterable[Measurement]]) -> list[Measurement]:
    """Measure a part, with the fixed calculation before and after it."""
    before = _fixed_calculation()
    measurements = list(measure())
    fixed = statistics.median(before + _fixed_calculation())
    return [Measurement(name=FIXED, value=fixed), *measurements]


def _fixed_calculation() -> list[Seconds]:
    """Time digests of the same bytes on every processor at once, several rounds of them."""
    blocks = [HASHED] * (os.cpu_count() or 1)
    with ThreadPoolExecutor(len(blocks)) as pool:
        once = partial(spent_on, lambda: list(pool.map(hashlib.sha256, blocks)))
        return [once()[0] for _ in range(ROUNDS)]


def table(parts: Parts, now: Released, before: Released) -> str:
    """Return a line a measurement, beside the released one, and a note on a busy machine."""
    lines = [f"accpinn {now.version}, {now.date}: {now.machine}"]
    lines.append(f"released {before.version}, {before.date}: {before.machine}")
    lines.append(f"{'':44}{'now':>14}{'processor':>12}{'limit':>14}{'released':>12}{'ratio':>7}")
    for part, (fixed, *figures) in parts.items():
        earlier = before.values.get(part, {})
        lines.append(part)
        lines += [_line(figure, earlier.get(figure.name)) for figure in figures]
        if fixed.value > BUSY * earlier.get(FIXED, fixed.value):
            ratio = f"{fixed.value / earlier[FIXED]:.2f} times as long as at the release"
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
