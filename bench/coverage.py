"""`python -m bench.coverage`: do intervals that say 90 % cover the truth 90 % of the time?

Each recording has its own leader on a motorway, one of the published laws in turn, disturbances as
on real roads (`bench.disturbed`) and receivers' noise. The intervals are those of the default
method; beside them the naive ones, and two block bootstraps (`bench.rivals`).
"""

import argparse
import json
import sys
import time
from dataclasses import asdict, dataclass

import numpy as np

from accpinn.cthp import Parameters
from accpinn.estimators import splines
from accpinn.fit import Fit
from accpinn.published import PUBLISHED
from accpinn.segment import Segment
from accpinn.uncertainty import LEVEL, intervals
from accpinn.uncertainty.intervals import SYMBOLS, Interval
from bench.disturbed import Disturbance, disturbed
from bench.rivals import RIVALS, Smooth

LAWS = tuple(law for group in PUBLISHED for law in group.parameters)
OURS = "accpinn"


@dataclass(frozen=True)
class Coverage:
    """How one kind of interval did; one entry for each of α, β, τ."""

    method: str
    level: float
    """What the intervals claim."""
    recordings: int
    covered: tuple[float, ...]
    """Share of recordings whose interval holds the truth."""
    width: tuple[float, ...]
    """Median width, as a share of the true value."""


@dataclass(frozen=True)
class Study:
    """Everything that was measured."""

    disturbance: Disturbance
    duration: float
    pull: tuple[float, ...]
    """How far the spline estimate is from the truth in the mean, as a share of it."""
    rows: tuple[Coverage, ...]
    milliseconds: float
    """Median time of the default method's intervals."""


def measure(
    recordings: int = 100,
    disturbance: Disturbance = Disturbance(),  # noqa: B008 (a frozen value object)
    duration: float = 300.0,
    level: float = LEVEL,
    rivals: bool = True,
) -> Study:
    """Run the study; the same arguments give the same coverage."""
    found: dict[str, list[Interval]] = {name: [] for name in (OURS, *(RIVALS if rivals else ()))}
    truths, estimates, times = [], [], []
    for seed in range(recordings):
        law = LAWS[seed % len(LAWS)]
        segment = disturbed((law,), seed, disturbance, duration=duration)
        fit = splines.fit(segment)
        started = time.perf_counter()
        found[OURS].append(_ours(segment, fit, level))
        times.append(time.perf_counter() - started)
        if rivals:
            smooth, rng = Smooth(segment, fit), np.random.default_rng(seed)
            for name, method in RIVALS.items():
                found[name].append(method(smooth, level, rng))
        truths.append(_row(law))
        estimates.append(fit.table()[0])
    true = np.array(truths)
    rows = tuple(_coverage(name, level, ends, true) for name, ends in found.items())
    pull = (np.array(estimates) / true - 1.0).mean(axis=0)
    return Study(disturbance, duration, tuple(pull.tolist()), rows, 1e3 * float(np.median(times)))


def _ours(segment: Segment, fit: Fit, level: float) -> Interval:
    result = intervals(segment, fit, level)
    return Interval(result.lower[0], result.upper[0])


def _row(law: Parameters) -> list[float]:
    return [law.alpha, law.beta, law.tau]


def _coverage(method: str, level: float, ends: list[Interval], true: np.ndarray) -> Coverage:
    lower, upper = (np.array([getattr(one, end) for one in ends]) for end in ("lower", "upper"))
    covered = ((lower <= true) & (true <= upper)).mean(axis=0)
    width = np.median((upper - lower) / true, axis=0)
    return Coverage(method, level, len(ends), tuple(covered.tolist()), tuple(width.tolist()))


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
        + "".join(f"{symbol:>7}" for symbol in SYMBOLS)
        + "   width".join(f"{symbol:>8}" for symbol in SYMBOLS),
    ]
    for row in study.rows:
        covered = "".join(f"{100 * share:6.0f}%" for share in row.covered)
        width = "".join(f"{100 * share:7.1f}%" for share in row.width)
        lines.append(f"{row.method:14}{covered}        {width}")
    pull = ", ".join(f"{s} {100 * p:+.1f} %" for s, p in zip(SYMBOLS, study.pull, strict=True))
    lines += ["", f"Mean error of the spline estimate: {pull}."]
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
    ):
        parser.add_argument(f"--{name}", type=float, default=getattr(Disturbance, name), help=what)
    parser.add_argument("--json", action="store_true", help="one JSON document")
    options = parser.parse_args(arguments)
    if options.recordings < 1:
        parser.error("--recordings: give at least 1")
    disturbance = Disturbance(options.deviation, options.memory, options.lag)
    study = measure(options.recordings, disturbance, options.duration)
    print(json.dumps(asdict(study), indent=2) if options.json else text(study))
    return int(not all(0.85 <= share <= 0.95 for share in study.rows[0].covered))


if __name__ == "__main__":
    sys.exit(main())
