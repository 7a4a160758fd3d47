"""`python -m bench.ablation`: which part of the evidence removes the bias of a PiNN's loss?

On the recordings of `bench.coverage`, the evidence of `accpinn.methods.pinn.evidence` is maximised
over all unknowns, and compared with maximum likelihood and with the truth. Then disturbance and
noise stay where it found them, and α, ατ, β alone are sought again, with the loss that is whitened
by them and with one or both determinants added. The exit status says whether the evidence is
unbiased (4 %), the intervals of its posterior cover the truth as often as they should (of 90 % ones
86 to 94 %, all three at once 70 to 85 %), and it agrees with maximum likelihood (median of 0.3
standard errors).
"""

import json
import sys
import time
from dataclasses import asdict, dataclass

import numpy as np

from accpinn.inference.intervals import LEVEL, interval_ends
from accpinn.inference.posterior import sample_from
from accpinn.methods.likelihood import end_of, natural, search
from accpinn.methods.maximum_likelihood import maxima_of
from accpinn.methods.pinn.evidence import Evidence, Parts, climb
from accpinn.methods.regression import Regression
from accpinn.methods.series import Series, series_of
from accpinn.model.cthp import Parameters
from accpinn.units import FloatArray
from bench.coverage import ALL_THREE, EACH, SETS
from bench.disturbed import Disturbance, disturbed
from bench.run import SYMBOLS, each, options

VARIANTS: dict[str, set[str]] = {
    "loss": {"loss"},
    "loss + log|Λ+A|": {"loss", "posterior"},
    "loss - log|Λ|": {"loss", "prior"},
    "evidence": {"loss", "posterior", "prior"},
}
"""The parts of the evidence that are kept."""
BIAS, AGREEMENT = 0.04, 0.3
STAGES = (100, 100, 400)
"""Proposals of the posterior's sampling; fewer than usual, as a value takes milliseconds."""


@dataclass(frozen=True)
class Ablation:
    """What was found on one recording; three numbers are those of α, β, τ."""

    truth: list[float]
    estimate: list[float]
    """Of the evidence, all unknowns free."""
    likelihood: list[float]
    """Of maximum likelihood."""
    deviations: list[float]
    """Standard errors of their logarithms, by the evidence's curvature."""
    lower: list[float]
    upper: list[float]
    """Of the intervals from the evidence's posterior."""
    variants: dict[str, list[float]]
    """By the determinants kept, disturbance and noise fixed."""
    seconds: float


class Variant(Evidence):
    """Some parts of the evidence, as a function of α, ατ and β alone."""

    def __init__(self, series: Series, kept: set[str], z: FloatArray) -> None:
        """Hold disturbance and noise at coordinates z (P,)."""
        super().__init__(series)
        self._kept = kept
        self.lower[3:] = self.upper[3:] = z[3:]

    def combined(self, parts: Parts) -> float:
        """The sum of the parts kept."""
        return float(sum(getattr(parts, name) for name in self._kept))


def study(seed: int) -> Ablation:
    """One recording."""
    true = SETS[[seed % len(SETS)]]
    segment = disturbed(true, seed, Disturbance())
    series = series_of([segment], "II")
    started = time.perf_counter()
    theta = Regression.of(segment).solve("II").theta
    [maximum] = end_of(climb(Evidence(series), theta))
    seconds = time.perf_counter() - started
    variants = {}
    for name, kept in VARIANTS.items():
        criterion = Variant(series, kept, maximum.coordinates)
        [end] = search(criterion, maximum.coordinates[None], np.zeros(1, int))
        variants[name] = _parameters(end.coordinates)
    draws = sample_from(Evidence(series), [maximum], stages=STAGES)[0].evenly(2000)
    lower, upper = interval_ends(Parameters.from_theta(draws).values, LEVEL)
    return Ablation(
        truth=true.values[0].tolist(),
        estimate=_parameters(maximum.coordinates),
        likelihood=_parameters(maxima_of(segment, "II")[0].coordinates),
        deviations=maximum.errors.tolist(),
        lower=lower.tolist(),
        upper=upper.tolist(),
        variants=variants,
        seconds=seconds,
    )


def _parameters(z: FloatArray) -> list[float]:
    values: list[float] = Parameters.from_theta(natural("cthp", z)[:3]).values.tolist()
    return values


@dataclass(frozen=True)
class Summary:
    """Of all recordings; tuples are of α, β, τ."""

    recordings: int
    bias: dict[str, tuple[float, ...]]
    """Mean error as a share of the truth: of each variant, of the evidence with all unknowns free,
    and of maximum likelihood."""
    rmse: tuple[float, ...]
    """Of the evidence with all unknowns free."""
    covered: tuple[float, ...]
    """Share of the intervals from the evidence's posterior that cover the truth."""
    jointly: float
    """Share of the recordings of which all three do."""
    covered_by_curvature: tuple[float, ...]
    """The same as `covered` for intervals from the curvature."""
    width: tuple[float, ...]
    """Median, of intervals from the posterior, as a share of the truth."""
    agreement: tuple[float, ...]
    """Median distance from maximum likelihood in standard errors."""
    seconds: float
    """Median, of the estimate."""

    @property
    def is_as_required(self) -> bool:
        """Whether it shows what the page on the calibrated PiNN says."""
        return (
            all(abs(one) <= BIAS for one in self.bias["all unknowns free"])
            and all(EACH[0] <= one <= EACH[1] for one in self.covered)
            and ALL_THREE[0] <= self.jointly <= ALL_THREE[1]
            and all(one <= AGREEMENT for one in self.agreement)
        )


def summarise(found: list[Ablation]) -> Summary:
    """The summary of several recordings."""
    truth, estimate, likelihood, deviations, lower, upper = (
        np.array([getattr(one, name) for one in found])
        for name in ("truth", "estimate", "likelihood", "deviations", "lower", "upper")
    )
    errors = {
        name: np.array([one.variants[name] for one in found]) / truth - 1 for name in VARIANTS
    }
    errors["all unknowns free"] = estimate / truth - 1
    errors["maximum likelihood"] = likelihood / truth - 1
    normal = 1.6449  # of a 90 % interval
    covers = (lower <= truth) & (truth <= upper)
    by_curvature = np.abs(np.log(truth / estimate)) <= normal * deviations
    return Summary(
        len(found),
        {name: tuple(error.mean(axis=0).tolist()) for name, error in errors.items()},
        tuple(np.sqrt((errors["all unknowns free"] ** 2).mean(axis=0)).tolist()),
        tuple(covers.mean(axis=0).tolist()),
        float(covers.all(axis=1).mean()),
        tuple(by_curvature.mean(axis=0).tolist()),
        tuple(np.median((upper - lower) / truth, axis=0).tolist()),
        tuple(np.median(np.abs(np.log(estimate / likelihood)) / deviations, axis=0).tolist()),
        float(np.median([one.seconds for one in found])),
    )


def measure(recordings: int = 100, first: int = 0, workers: int | None = None) -> Summary:
    """Run the study.

    Args:
        recordings: how many.
        first: seed of the first one.
        workers: processes; by default one for each core.
    """
    return summarise(list(each(study, range(first, first + recordings), workers)))


def text(summary: Summary) -> str:
    """A table for reading."""
    lines = [f"{summary.recordings} recordings of 300 s; bias in %:", ""]
    lines.append(f"{'':22}" + "".join(f"{symbol:>8}" for symbol in SYMBOLS))
    rows: dict[str, tuple[float, ...]] = summary.bias | {
        "RMSE, all free": summary.rmse,
        "90 % intervals cover": summary.covered,
        "by curvature": summary.covered_by_curvature,
        "median width": summary.width,
    }
    for name, values in rows.items():
        lines.append(f"{name:22}" + "".join(f"{100 * value:+8.1f}" for value in values))
    lines.append(f"All three at once are covered: {100 * summary.jointly:.1f} %.")
    distances = ", ".join(f"{one:.3f}" for one in summary.agreement)
    lines.append(f"Distance from maximum likelihood in standard errors, median: {distances}.")
    lines.append(f"Time of an estimate: {summary.seconds:.2f} s.")
    return "\n".join(lines)


def main(arguments: list[str] | None = None) -> int:
    """Measure and print; see above for the exit status."""
    parser = options("ablation", __doc__)
    parser.add_argument("--first", type=int, default=0, help="seed of the first one (0)")
    parser.add_argument("--json", action="store_true", help="one JSON document")
    given = parser.parse_args(arguments)
    summary = measure(given.recordings, given.first, given.workers)
    print(json.dumps(asdict(summary), indent=2) if given.json else text(summary))
    return int(not summary.is_as_required)


if __name__ == "__main__":
    sys.exit(main())
