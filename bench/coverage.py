"""`python -m bench.coverage`: how often do 90 % intervals cover the true parameters?

Each recording has its own leader on a motorway, one of the published parameter sets in turn,
disturbances as on real roads (`bench.disturbed`) and the receivers' noise. The intervals are those
of accpinn, those of independent errors, and two block bootstraps (`bench.other_intervals`). Here
the model holds except for zero-mean disturbances; `bench.departures` measures what follows where
it does not.
"""

import argparse
import json
import sys
import time
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
from bench.other_intervals import OTHERS, Smooth

SETS = Parameters.stack(one for group in PUBLISHED for one in group.parameters)
SYMBOLS = tuple(quantity.symbol for quantity in PARAMETERS)
OURS = "accpinn"
SPLINES = "splines"
"""The method whose estimate the intervals belong to; that of the PiNN is the same."""
BIASED = ("least-squares", "simulation")
"""Other methods whose bias is measured."""


@dataclass(frozen=True)
class Coverage:
    """The coverage of one kind of interval; one entry for each of α, β, τ."""

    method: str
    level: float
    """The nominal coverage."""
    recordings: int
    covered: tuple[float, ...]
    """Share of recordings whose interval covers the true value."""
    jointly: float
    """Share of recordings whose three intervals all cover it."""
    width: tuple[float, ...]
    """Median width, as a share of the true value."""


@dataclass(frozen=True)
class CoverageStudy:
    """The coverage of all kinds of intervals, and the bias of the estimates."""

    disturbance: Disturbance
    duration: float
    bias: dict[str, tuple[float, ...]]
    """By method, the mean error of its estimates, as a share of the true value."""
    rows: tuple[Coverage, ...]
    milliseconds: float
    """Median time of accpinn's intervals."""


def measure(
    recordings: int = 100,
    disturbance: Disturbance = Disturbance(),  # noqa: B008 (a frozen value object)
    duration: float = 300.0,
    level: float = LEVEL,
    others: bool = True,
    sets: Parameters = SETS,
) -> CoverageStudy:
    """Run the study; the same arguments give the same coverage.

    Args:
        recordings: how many.
        disturbance: of all followers.
        duration: of each recording in s.
        level: the nominal coverage.
        others: whether other intervals and other methods' bias are measured too.
        sets: the true parameters, one set a recording in turn.
    """
    found: dict[str, list[Interval]] = {name: [] for name in (OURS, *(OTHERS if others else ()))}
    biased = (SPLINES, *(BIASED if others else ()))
    estimates: dict[str, list[FloatArray]] = {name: [] for name in biased}
    truths, times = [], []
    for seed in range(recordings):
        true = sets[[seed % len(sets)]]
        segment = disturbed(true, seed, disturbance, duration=duration)
        fit = METHODS[SPLINES].fit(segment, "II")
        started = time.perf_counter()
        found[OURS].append(_ours(segment, fit, level))
        times.append(time.perf_counter() - started)
        if others:
            smooth, rng = Smooth(segment, fit), np.random.default_rng(seed)
            for name, method in OTHERS.items():
                found[name].append(method(smooth, level, rng))
        truths.append(true.values[0])
        for name, found_so_far in estimates.items():
            estimate = fit if name == SPLINES else METHODS[name].fit(segment, "II")
            found_so_far.append(estimate.parameters.values[0])
    truth = np.array(truths)
    rows = tuple(_coverage(name, level, ends, truth) for name, ends in found.items())
    bias = {
        name: tuple(np.nanmean(np.array(table) / truth - 1.0, axis=0).tolist())
        for name, table in estimates.items()
    }
    return CoverageStudy(disturbance, duration, bias, rows, 1e3 * float(np.median(times)))


def _ours(segment: Segment, fit: Fit, level: float) -> Interval:
    result = intervals(segment, fit, level)
    return Interval(result.lower[0].values, result.upper[0].values)


def _coverage(method: str, level: float, ends: list[Interval], truth: np.ndarray) -> Coverage:
    lower, upper = (np.array([getattr(one, end) for one in ends]) for end in ("lower", "upper"))
    covers = (lower <= truth) & (truth <= upper)
    width = np.median((upper - lower) / truth, axis=0)
    return Coverage(
        method,
        level,
        len(ends),
        tuple(covers.mean(axis=0).tolist()),
        float(covers.all(axis=1).mean()),
        tuple(width.tolist()),
    )


def text(study: CoverageStudy) -> str:
    """A table for reading."""
    disturbance, first = study.disturbance, study.rows[0]
    lines = [
        f"{first.recordings} recordings of {study.duration:.0f} s, disturbances of"
        f" {disturbance.deviation:g} m/s² that last {disturbance.memory:g} s, actuator lag"
        f" {disturbance.lag:g} s",
        f"Share of nominal {100 * first.level:.0f} % intervals that cover the true value, and their"
        " median width in % of it",
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
    for name, bias in study.bias.items():
        errors = ", ".join(f"{s} {100 * b:+.1f} %" for s, b in zip(SYMBOLS, bias, strict=True))
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
        ("memory", "its correlation time in s"),
        ("lag", "time constant of the actuator in s"),
        ("standstill", "standstill distance in m"),
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
