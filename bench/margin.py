"""`python -m bench.margin`: how often do 90 % intervals cover the true margin of the time gap?

Cars are those of `bench.coverage`, each with some windows in which α, β and τ differ from its
typical values, with disturbances and the receivers' noise. Unstable ones have published parameters.
The others have their α, a time gap as such cars may have, and the β with which the typical car's L₂
margin is that of a stable car, or of one near the border. Measured are the shares of cars
whose interval of the typical car's margin covers the true one, by L₂ and by the exact L∞ criterion,
the intervals' median width, and the share of intervals beyond zero on the wrong side of it.

The exit status is 1 if a coverage is not as accpinn promises, for `MANY` cars of a kind or more.
"""

import argparse
import sys
from collections.abc import Iterator
from functools import partial

import numpy as np

from accpinn.inference.intervals import LEVEL
from accpinn.model.cthp import Parameters
from accpinn.model.registry import BEST, FOLLOWING
from accpinn.segment import Segment, median_speeds
from accpinn.stability.margin import l2_headways, margins
from accpinn.units import FloatArray, Seconds
from bench.coverage import BETWEEN, EACH, EFFECTS, MANY, SETS, WINDOW, covered, simulated
from bench.disturbed import Disturbance, disturbed
from bench.measurement import Measurement, measured, show
from bench.prediction import posterior

KINDS: dict[str, tuple[tuple[Seconds, Seconds], tuple[Seconds, Seconds]] | None] = {
    "unstable": None,
    "stable": ((1.5, 2.1), (0.2, 0.6)),
    "near the border": ((1.3, 1.9), (-0.15, 0.15)),
}
"""Ends of τ and of the L₂ margin of the typical car; None where these are as published."""
BETAS = np.linspace(0.05, 1.5, 300)
"""β in 1/s of which one is chosen."""
NORMS = "l2", "linf"
TITLES = {"l2": "L₂", "linf": "L∞"}


def windows_of_kind(
    seed: int, kind: str, windows: int, disturbance: Disturbance
) -> tuple[Parameters, list[Segment]]:
    """A simulated car's typical parameters (1,), and its windows."""
    rng, known = np.random.default_rng([seed, 5]), KINDS[kind]
    alpha, beta, tau = SETS[seed % len(SETS)].values
    late = {"lag": disturbance.lag, "delay": disturbance.delay}
    if known:
        tau, margin = (rng.uniform(*ends) for ends in known)
        tried = Parameters(np.full(len(BETAS), alpha), BETAS, np.ones(len(BETAS)), **late)
        away = np.abs(tau - l2_headways(tried).smallest - margin)
        beta = float(BETAS[np.nan_to_num(away, posinf=np.inf).argmin()])
    differ = BETWEEN * rng.standard_normal((windows, 3))
    segments = [
        disturbed([Parameters(*row)], windows * seed + k, disturbance, duration=WINDOW)
        for k, row in enumerate((alpha, beta, tau) * np.exp(differ))
    ]
    return Parameters([alpha], [beta], [tau], disturbance.standstill, **late), segments


def car(
    seed: int, kind: str, windows: int, disturbance: Disturbance, model: str
) -> dict[str, FloatArray]:
    """Simulate one car and estimate its margins.

    Returns:
        By norm (3,): the true margin, and both ends of its interval.
    """
    truth, segments = windows_of_kind(seed, kind, windows, disturbance)
    speed = float(median_speeds(segments)[0])
    typical, _ = posterior(segments, model)
    (true,) = margins(truth, speed).vehicles
    (known,) = margins(truth, speed, typical[:, None], LEVEL).vehicles
    spans = {name: getattr(known, name).distance for name in NORMS}
    return {
        name: np.array([getattr(true, name).distance.value, span.lower, span.upper])
        for name, span in spans.items()
    }


def measure(
    kind: str, cars: int, windows: int, disturbance: Disturbance, model: str
) -> Iterator[Measurement]:
    """Run the study of one kind of cars; the same arguments give the same figures."""
    task = partial(car, kind=kind, windows=windows, disturbance=disturbance, model=model)
    of_all = simulated(task, cars)
    for name, title in TITLES.items():
        truth, lower, upper = of_all[name].T
        covers = (lower <= truth) & (truth <= upper)
        yield covered(f"margin by {title}", covers, EACH if cars >= MANY else None)
        yield Measurement(
            name=f"median width by {title}", value=float(np.median(upper - lower)), unit="s"
        )
        wrong = ((lower > 0) & (truth < 0)) | ((upper < 0) & (truth > 0))
        yield Measurement(name=f"wrong side by {title}", value=100 * wrong.mean(), unit="%")


def main(arguments: list[str] | None = None) -> int:
    """Measure and print; the exit status is described above."""
    parser = argparse.ArgumentParser(prog="python -m bench.margin", description=__doc__)
    parser.add_argument("--cars", type=int, default=MANY, help=f"of each kind ({MANY})")
    parser.add_argument("--windows", type=int, default=4, help="of each car (4)")
    parser.add_argument("--kind", action="append", choices=KINDS, help="this kind (all)")
    for name in EFFECTS:
        usual = {"delay": 0.4, "standstill": 4.0}.get(name, getattr(Disturbance, name))
        parser.add_argument(f"--{name}", type=float, default=usual, help=f"({usual:g})")
    linear = [key for key, model in FOLLOWING.items() if model.is_linear]
    parser.add_argument("--model", choices=linear, default=BEST)
    given = parser.parse_args(arguments)
    disturbance = Disturbance(*(getattr(given, name) for name in EFFECTS))
    under = f"{given.windows} windows, {disturbance}, {given.model}"
    studies = {
        f"{given.cars} cars, {kind}, {under}": measured(
            partial(measure, kind, given.cars, given.windows, disturbance, given.model)
        )
        for kind in given.kind or KINDS
    }
    return show(studies)


if __name__ == "__main__":
    sys.exit(main())
