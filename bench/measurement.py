"""A figure with its limit, how it is timed, and the figures last released.

A time is the median of several rounds. A busy or slower machine shows in a fixed calculation that
is timed before and after every part: where it takes longer than at the release, so does all else.
"""

import hashlib
import os
import statistics
import time
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from datetime import UTC, datetime
from functools import partial
from pathlib import Path

import msgspec
from msgspec.structs import replace

import accpinn
from accpinn.units import Seconds

RELEASED = Path(__file__).with_name("released.json")
ROUNDS = 5
HASHED = bytes(32_000_000)
BUSY = 1.15
"""A fixed calculation that takes so many times as long as at the release tells a busy machine."""
Spent = tuple[Seconds, Seconds]
"""By the clock, and of processor time."""


class Measurement(msgspec.Struct, frozen=True, omit_defaults=True):
    """What was measured, and what it may be on two quiet processors."""

    name: str
    value: float
    unit: str = "s"
    limit: float | None = None
    at_least: bool = False
    """Whether the limit is the least value rather than the largest."""
    processor: Seconds | None = None
    """Where it was measured."""

    @property
    def within(self) -> bool:
        """Whether the limit is kept."""
        if self.limit is None:
            return True
        return self.value >= self.limit if self.at_least else self.value <= self.limit


class Part(msgspec.Struct, frozen=True):
    """What was measured in one process."""

    name: str
    fixed: Seconds
    """What the fixed calculation took meanwhile."""
    measurements: list[Measurement]


class Figures(msgspec.Struct, frozen=True):
    """All figures of one version on one machine."""

    version: str
    date: str
    machine: str
    parts: list[Part]

    @classmethod
    def now(cls, machine: str, parts: list[Part]) -> "Figures":
        """Those of this version, today."""
        return cls(accpinn.__version__, datetime.now(UTC).date().isoformat(), machine, parts)

    @classmethod
    def released(cls, path: Path = RELEASED) -> "Figures | None":
        """Those last released; None where there are none."""
        return msgspec.json.decode(path.read_bytes(), type=cls) if path.exists() else None

    def release(self, path: Path = RELEASED) -> None:
        """Keep them; limits stand in the code alone."""
        bare = [
            replace(part, measurements=[replace(m, limit=None, at_least=False)
                                        for m in part.measurements])
            for part in self.parts
        ]  # fmt: skip
        path.write_bytes(replace(self, parts=bare).to_json())

    def to_json(self) -> bytes:
        """As text that people can read, too."""
        return msgspec.json.format(msgspec.json.encode(self)) + b"\n"

    @property
    def within(self) -> bool:
        """Whether all limits are kept."""
        return all(one.within for part in self.parts for one in part.measurements)


def spent_on(work: Callable[[], object]) -> Spent:
    """What one call takes in this process."""
    began, processor = time.perf_counter(), time.process_time()
    work()
    return time.perf_counter() - began, time.process_time() - processor


def timed(
    name: str, once: Callable[[], Spent], limit: Seconds | None = None, rounds: int = ROUNDS
) -> Measurement:
    """The median of several rounds."""
    clock, processor = map(statistics.median, zip(*(once() for _ in range(rounds)), strict=True))
    return Measurement(name, clock, limit=limit, processor=processor)


def measured(name: str, measure: Callable[[], Iterable[Measurement]]) -> Part:
    """A part, and the fixed calculation before and after it."""
    before = _fixed_calculation()
    found = list(measure())
    return Part(name, statistics.median(before + _fixed_calculation()), found)


def _fixed_calculation() -> list[Seconds]:
    """Digests of the same bytes on every processor at once: how long each round takes."""
    every = [HASHED] * (os.cpu_count() or 1)
    with ThreadPoolExecutor(len(every)) as pool:
        once = partial(spent_on, lambda: list(pool.map(hashlib.sha256, every)))
        return [once()[0] for _ in range(ROUNDS)]


def table(found: Figures, before: Figures | None) -> str:
    """A line a measurement, beside the released one; a note where the machine was busy."""
    earlier = {part.name: part for part in before.parts} if before else {}
    lines = [f"accpinn {found.version}, {found.date}: {found.machine}"]
    if before:
        lines.append(f"released {before.version}, {before.date}: {before.machine}")
    lines.append(f"{'':42}{'now':>12}{'processor':>12}{'limit':>14}{'released':>12}{'ratio':>7}")
    slow = {}
    for part in found.parts:
        lines.append(part.name)
        then = earlier.get(part.name)
        values = {one.name: one.value for one in then.measurements} if then else {}
        lines += [_line(one, values.get(one.name)) for one in part.measurements]
        if then and part.fixed > BUSY * then.fixed:
            slow[part.name] = part.fixed / then.fixed
    lines += [
        f"Busy or slow machine during {name}: a fixed calculation took {ratio:.2f} times as long"
        " as at the release."
        for name, ratio in slow.items()
    ]
    if earlier and not slow:
        lines.append("The machine was as fast as at the release.")
    return "\n".join(lines)


def _line(found: Measurement, before: float | None) -> str:
    cells = [
        (_text(found.value, found.unit), 12),
        (_text(found.processor, "s"), 12),
        (_text(found.limit, found.unit, "≥ " if found.at_least else "≤ "), 14),
        (_text(before, found.unit), 12),
        (f"{found.value / before:.2f}" if before else "", 7),
    ]
    row = f"  {found.name:40}" + "".join(f"{text:>{width}}" for text, width in cells)
    return row if found.within else f"{row}  beyond its limit"


def _text(value: float | None, unit: str, sign: str = "") -> str:
    if value is None:
        return ""
    if unit == "s" and value < 0.1:
        value, unit = 1e3 * value, "ms"
    digits = {"s": 2 if value < 100 else 0, "ms": 1, "%": 2}.get(unit, 0)
    return f"{sign}{value:,.{digits}f} {unit}"
