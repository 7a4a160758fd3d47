"""`python -m bench.coverage`: how often do 90 % intervals cover the true parameters?

Each recording has its own leader on a motorway, one of the published parameter sets in turn,
disturbances as on real roads (`bench.disturbed`) and the receivers' noise. The intervals are those
of accpinn, those of independent errors, and two block bootstraps (`bench.other_intervals`). Here
the model holds except for zero-mean disturbances; `bench.departures` measures what follows where
it does not. Below the figures of accpinn's intervals stand their standard errors. The exit status
says whether the coverage of each parameter lies between 86 and 94 %, of all three together between
70 and 85 %, and the bias of maximum likelihood within 3 %.
"""

import json
import sys
from dataclasses import asdict, dataclass
from functools import partial

import numpy as np

from accpinn.inference.intervals import LEVEL, Interval, intervals
from accpinn.methods.registry import METHODS
from accpinn.model.cthp import Parameters
from accpinn.model.published import ASTAZERO, CASALE, VICOLUNGO
from accpinn.units import FloatArray
from bench.disturbed import Disturbance, disturbed
from bench.other_intervals import OTHERS, Smooth
from bench.run import SYMBOLS, each, options

SETS = Parameters.stack(one for group in (ASTAZERO, VICOLUNGO, CASALE) for one in group.parameters)
OURS = "accpinn"
LIKELIHOOD = "maximum-likelihood"
"""The method that the intervals come from."""
OTHER_METHODS = ("splines", "least-squares", "simulation")
"""Methods whose bias is measured; that of the PiNN's preset `fast` is that of the splines."""
RESAMPLED = 500
"""Times that the recordings are drawn again for a standard error."""
EACH, ALL_THREE, BIAS = (0.86, 0.94), (0.70, 0.85), 0.03
"""What the study is to show."""


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
    width_error: tuple[float, ...]
    """Standard error of that, by resampling the recordings."""

    def error_of(self, share: float) -> float:
        """Standard error of a share of so many recordings."""
        return float(np.sqrt(share * (1.0 - share) / self.recordings))


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


@dataclass(frozen=True, eq=False)
class Recorded:
    """What one recording contributes."""

    truth: FloatArray
    """(3,)"""
    ends: dict[str, Interval]
    estimates: dict[str, FloatArray]
    """(3,) by method."""
    seconds: float
    """Time of accpinn's intervals, the estimate included."""


def measure(
    recordings: int = 100,
    disturbance: Disturbance = Disturbance(),  # noqa: B008 (a frozen value object)
    duration: float = 300.0,
    level: float = LEVEL,
    others: bool = True,
    workers: int | None = None,
) -> CoverageStudy:
    """Run the study; the same arguments give the same coverage.

    Args:
        recordings: how many.
        disturbance: of all followers.
        duration: of each recording in s.
        level: the nominal coverage.
        others: whether other intervals and other methods' bias are measured too.
        workers: processes; by default one for each core.
    """
    one = partial(record, disturbance=disturbance, duration=duration, level=level, others=others)
    found = list(each(one, range(recordings), workers))
    truth = np.array([each.truth for each in found])
    rows = tuple(
        _coverage(name, level, [each.ends[name] for each in found], truth) for name in found[0].ends
    )
    bias = {
        name: tuple(
            np.nanmean(np.array([e.estimates[name] for e in found]) / truth - 1, axis=0).tolist()
        )
        for name in found[0].estimates
    }
    milliseconds = 1e3 * float(np.median([each.seconds for each in found]))
    return CoverageStudy(disturbance, duration, bias, rows, milliseconds)


def record(
    seed: int,
    disturbance: Disturbance,
    duration: float,
    level: float,
    others: bool,
) -> Recorded:
    """One recording; the arguments are those of `measure`."""
    true = SETS[[seed % len(SETS)]]
    segment = disturbed(true, seed, disturbance, duration=duration)
    fit = METHODS[LIKELIHOOD].fit(segment, "II")
    result = intervals(segment, fit, level)
    ends = {OURS: Interval(result.lower[0].values, result.upper[0].values)}
    estimates = {LIKELIHOOD: fit.parameters.values[0]}
    if others:
        for name in OTHER_METHODS:
            estimates[name] = METHODS[name].fit(segment, "II").parameters.values[0]
        smooth, rng = Smooth(segment, METHODS["splines"].fit(segment)), np.random.default_rng(seed)
        ends |= {name: method(smooth, level, rng) for name, method in OTHERS.items()}
    return Recorded(true.values[0], ends, estimates, fit.seconds + result.seconds)


def _coverage(method: str, level: float, ends: list[Interval], truth: np.ndarray) -> Coverage:
    lower, upper = (np.array([getattr(one, end) for one in ends]) for end in ("lower", "upper"))
    covers = (lower <= truth) & (truth <= upper)
    widths = (upper - lower) / truth
    again = np.random.default_rng(0).integers(len(widths), size=(RESAMPLED, len(widths)))
    return Coverage(
        method,
        level,
        len(ends),
        tuple(covers.mean(axis=0).tolist()),
        float(covers.all(axis=1).mean()),
        tuple(np.median(widths, axis=0).tolist()),
        tuple(np.median(widths[again], axis=1).std(axis=0).tolist()),
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
        if row is first:
            errors = (row.error_of(share) for share in (*row.covered, row.jointly))
            covered = "".join(f"{100 * error:6.1f}%" for error in errors)
            width = "".join(f"{100 * error:7.1f}%" for error in row.width_error)
            lines.append(f"{'  ± ':14}{covered}        {width}")
    lines.append("")
    for name, bias in study.bias.items():
        errors = ", ".join(f"{s} {100 * b:+.1f} %" for s, b in zip(SYMBOLS, bias, strict=True))
        lines.append(f"Mean error of {name}: {errors}.")
    lines.append(f"Time for estimate and intervals of one recording: {study.milliseconds:.0f} ms.")
    return "\n".join(lines)


def main(arguments: list[str] | None = None) -> int:
    """Measure and print; see above for the exit status."""
    parser = options("coverage", __doc__)
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
    given = parser.parse_args(arguments)
    disturbance = Disturbance(
        given.deviation, given.memory, given.lag, given.standstill, given.slope
    )
    study = measure(given.recordings, disturbance, given.duration, workers=given.workers)
    print(json.dumps(asdict(study), indent=2) if given.json else text(study))
    return int(not is_as_promised(study))


def is_as_promised(study: CoverageStudy) -> bool:
    """Whether the study shows what accpinn promises."""
    ours = study.rows[0]
    return (
        all(EACH[0] <= share <= EACH[1] for share in ours.covered)
        and ALL_THREE[0] <= ours.jointly <= ALL_THREE[1]
        and all(abs(error) <= BIAS for error in study.bias[LIKELIHOOD])
    )


if __name__ == "__main__":
    sys.exit(main())
