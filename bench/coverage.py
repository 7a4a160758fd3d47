"""`python -m bench.coverage`: do intervals that say 90 % cover the truth 90 % of the time?

Each recording has its own leader on a motorway, one of the published laws in turn, disturbances as
on real roads (`bench.disturbed`) and receivers' noise. The intervals are those of the default
method; beside them the naive ones, and two block bootstraps (`bench.rivals`). The truth is the law
and nothing but zero-mean disturbances: `bench.departures` says what happens where it is not.
"""

import argparse
import json
import sys
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass

import numpy as np

from accpinn.channels import PARAMETERS
from accpinn.inference.intervals import LEVEL, Interval, intervals
from accpinn.methods.fit import Fit
from accpinn.methods.registry import METHODS
from accpinn.model.cthp import Parameters
from accpinn.model.published import PUBLISHED
from accpinn.segment.segment import Segment
from accpinn.units import FloatArray
from bench.disturbed import Disturbance, disturbed
from bench.rivals import RIVALS, Smooth

SYMBOLS = tuple(one.symbol for one in PARAMETERS)
LAWS = tuple(law for group in PUBLISHED for law in group.parameters)
OURS = "accpinn"
SPLINES = "splines"
"""Whose estimate the intervals judge; the PiNN finds the same."""
PULLED = ("least-squares", "simulation")
"""Methods whose mean error is measured beside that."""


@dataclass(frozen=True)
class Coverage:
    """How one kind of interval did; one entry for each of α, β, τ."""

    method: str
    level: float
    """What the intervals claim."""
    recordings: int
    covered: tuple[float, ...]
    """Share of recordings whose interval holds the truth."""
    jointly: float
    """Share of recordings in which all three hold the truth."""
    width: tuple[float, ...]
    """Median width, as a share of the true value."""


@dataclass(frozen=True)
class Study:
    """Everything that was measured."""

    disturbance: Disturbance
    duration: float
    pull: dict[str, tuple[float, ...]]
    """By method, how far its estimate is from the truth in the mean, as a share of it."""
    rows: tuple[Coverage, ...]
    milliseconds: float
    """Median time of the default method's intervals."""


def measure(
    recordings: int = 100,
    disturbance: Disturbance = Disturbance(),  # noqa: B008 (a frozen value object)
    duration: float = 300.0,
    level: float = LEVEL,
    rivals: bool = True,
    laws: Sequence[Parameters] = LAWS,
) -> Study:
    """Run the study; the same arguments give the same coverage."""
    found: dict[str, list[Interval]] = {name: [] for name in (OURS, *(RIVALS if rivals else ()))}
    pulled = (SPLINES, *(PULLED if rivals else ()))
    estimates: dict[str, list[FloatArray]] = {name: [] for name in pulled}
    truths, times = [], []
    for seed in range(recordings):
        law = laws[seed % len(laws)]
        segment = disturbed((law,), seed, disturbance, duration=duration)
        fit = METHODS[SPLINES].fit(segment, "II")
        started = time.perf_counter()
        found[OURS].append(_ours(segment, fit, level))
        times.append(time.perf_counter() - started)
        if rivals:
            smooth, rng = Smooth(segment, fit), np.random.default_rng(seed)
            for name, method in RIVALS.items():
                found[name].append(method(smooth, level, rng))
        truths.append(_row(law))
        for name, found_so_far in estimates.items():
            estimate = fit if name == SPLINES else METHODS[name].fit(segment, "II")
            found_so_far.append(estimate.table()[0])
    true = np.array(truths)
    rows = tuple(_coverage(name, level, ends, true) for name, ends in found.items())
    pull = {
        name: tuple(np.nanmean(np.array(table) / true - 1.0, axis=0).tolist())
        for name, table in estimates.items()
    }
    return Study(disturbance, duration, pull, rows, 1e3 * float(np.median(times)))


def _ours(segment: Segment, fit: Fit, level: float) -> Interval:
    result = intervals(segment, fit, level)
    return Interval(result.lower[0].values, result.upper[0].values)


def _row(law: Parameters) -> list[float]:
    return [law.alpha, law.beta, law.tau]


def _coverage(method: str, level: float, ends: list[Interval], true: np.ndarray) -> Coverage:
    lower, upper = (np.array([getattr(one, end) for one in ends]) for end in ("lower", "upper"))
    holds = (lower <= true) & (true <= upper)
    width = np.median((upper - lower) / true, axis=0)
    return Coverage(
        method,
        level,
        len(ends),
        tuple(holds.mean(axis=0).tolist()),
        float(holds.all(axis=1).mean()),
        tuple(width.tolist()),
    )


def text(study: Study) -> str:
    """A table for reading."""
    disturbance, first = study.disturbance, study.rows[0]
    lines = [
        f"{first.recordings} recordings of {study.duration:.0f} s, disturbances of"
        f" {disturbance.deviation:g} m/s² that last {disturbance.memory:g} s, actuator lag"
        f" {disturbance.lag:g} s",
        f"Share of nominal {100 * first.level:.0f} % intervals that hold the truth, and median"
        " width in % of the true value",
        "",
        f"{'':14}"
        + "".join(f"{symbol:>7}" for symbol in (*SYMBOLS, "all"))
        + "  widths"
        + "".join(f"{symbol:>8}" for symbol in SYMBOLS),
    ]
    for row in study.rows:
        covered = "".join(f"{100 * share:6.0f}%" for share in (*row.covered, row.jointly))
        width = "".join(f"{100 * share:7.1f}%" for share in row.width)
        lines.append(f"{row.method:14}{covered}        {width}")
    lines.append("")
    for name, pull in study.pull.items():
        errors = ", ".join(f"{s} {100 * p:+.1f} %" for s, p in zip(SYMBOLS, pull, strict=True))
        lines.append(f"Mean error of {name}: {errors}.")
    lines.append(f"Time for the intervals of one recording: {study.milliseconds:.0f} ms.")
    return "\n".join(lines)


def main(arguments: list[str] | None = None) -> int:
    """Measure and print; exit status 1 when a coverage is not between 85 and 95 %."""
    parser = argparse.ArgumentParser(prog="python -m bench.coverage", description=__doc__)
    parser.add_argument("--recordings", type=int, default=100, help="how many (100)")
    parser.add_argument("--duration", type=float, default=300.0, help="seconds of each recording")
    for name, what in (
        ("deviation", "standard deviation of the disturbance in m/s²"),
        ("memory", "how long it lasts in s"),
        ("lag", "time constant of the actuator in s"),
        ("standstill", "distance kept on top of τv in m"),
        ("slope", "mean of the disturbance in m/s²"),
    ):
        parser.add_argument(f"--{name}", type=float, default=getattr(Disturbance, name), help=what)
    parser.add_argument("--json", action="store_true", help="one JSON document")
    options = parser.parse_args(arguments)
    if options.recordings < 1:
        parser.error("--recordings: give at least 1")
    disturbance = Disturbance(
        options.deviation, options.memory, options.lag, options.standstill, options.slope
    )
    study = measure(options.recordings, disturbance, options.duration)
    print(json.dumps(asdict(study), indent=2) if options.json else text(study))
    return int(not all(0.85 <= share <= 0.95 for share in study.rows[0].covered))


if __name__ == "__main__":
    sys.exit(main())
