"""`python -m bench.unequal`: are unequal gains found where they are, and only there?

Each simulated car has some windows behind leaders on a motorway (`bench.disturbed`). Its q and k
are drawn between `LEAST` and `MOST`, or are 1: then it is symmetric. One thing at a time departs
from that: α, β, τ, q and k differ between windows by `BETWEEN` of `bench.coverage` and `APART`,
disturbances are larger, or the car has what the model lacks: a slope, a lag, a delay or limits of
the acceleration. Estimated are q and k of the CTHP with unequal gains, also behind a lag or a
delay, by the recommended method from all windows of a car.

Measured are the shares of cars whose 90 % interval of the typical value covers q and k, and the
median of the joint estimate, relative to the truth, with the quartiles: 1 without bias.
"""

import argparse
import sys
from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from accpinn.inference.intervals import LEVEL
from accpinn.model.cthp import Parameters, Term
from accpinn.model.registry import value_of
from accpinn.model.unequal_gains import UNEQUAL_GAINS
from accpinn.segment import Segment
from accpinn.units import FloatArray, interval_ends
from bench.coverage import BETWEEN, EACH, MANY, SETS, covered, is_covered, simulated
from bench.disturbed import Disturbance, disturbed
from bench.measurement import Measurement, measured, show
from bench.prediction import estimated

NAMES = "q", "k"
LEAST, MOST = 0.7, 3.0
"""Ends of q of cars with unequal gains; k is half as far from 1 on a logarithmic scale."""
APART = 0.15
"""Standard deviation of ln q and ln k between windows of a car with unequal gains."""
STANDSTILL, DURATION = 6.0, 150.0
"""s₀ of all cars in m, and length of a window in s."""


class Kind(NamedTuple):
    """Cars of one kind, and the model that is estimated."""

    model: str = UNEQUAL_GAINS.key
    is_symmetric: bool = True
    disturbance: Disturbance = Disturbance(deviation=0.1, standstill=STANDSTILL)
    between: float = 0.0
    """How much windows differ, by `BETWEEN` and `APART`."""


def _symmetric(**departure: Any) -> Kind:
    """Symmetric cars with what the model lacks."""
    return Kind(disturbance=replace(Kind().disturbance, **departure))


def _estimated_late(term: Term, is_symmetric: bool, **departure: Any) -> Kind:
    """Cars with a lag or a delay that the model has, too."""
    return Kind(f"{UNEQUAL_GAINS.key}-{term}", is_symmetric, _symmetric(**departure).disturbance)


KINDS = {
    "unequal": Kind(is_symmetric=False),
    "equal": Kind(),
    "unequal, windows differ": Kind(is_symmetric=False, between=1.0),
    "equal, windows differ": Kind(between=1.0),
    "unequal, disturbances of .25 m/s²": _symmetric(deviation=0.25)._replace(is_symmetric=False),
    "equal, disturbances of .25 m/s²": _symmetric(deviation=0.25),
    "equal, delay of .6 s": _symmetric(delay=0.6),
    "equal, lag of .8 s": _symmetric(lag=0.8),
    "equal, 2 % uphill": _symmetric(slope=-0.2),
    "equal, 2 % downhill": _symmetric(slope=0.2),
    "equal, at most 1.2 m/s²": _symmetric(limits=(-np.inf, 1.2)),
    "equal, at most .8 m/s²": _symmetric(limits=(-np.inf, 0.8)),
    "equal, -.8 to .8 m/s²": _symmetric(limits=(-0.8, 0.8)),
    "unequal, delay of .6 s, estimated": _estimated_late("delay", False, delay=0.6),
    "equal, delay of .6 s, estimated": _estimated_late("delay", True, delay=0.6),
    "equal, lag of .8 s, estimated": _estimated_late("lag", True, lag=0.8),
}
"""Cars by what they are."""


def windows_of_car(seed: int, windows: int, kind: Kind) -> tuple[FloatArray, list[Segment]]:
    """The typical q and k (2,) of a simulated car, and its windows."""
    rng, segments = np.random.default_rng([seed, 4]), []
    is_symmetric = kind.is_symmetric
    log_q = 0.0 if is_symmetric else rng.uniform(np.log(LEAST), np.log(MOST))
    typical = np.array([log_q, log_q / 2])
    for number in range(windows * seed, windows * (seed + 1)):
        differ, apart = kind.between * rng.standard_normal(3), kind.between * rng.standard_normal(2)
        theta = SETS[seed % len(SETS)].values * np.exp(BETWEEN * differ)
        q, k = np.exp(typical + (0.0 if is_symmetric else APART) * apart).tolist()
        disturbance = replace(kind.disturbance, q=q, k=k)
        segments.append(disturbed([Parameters(*theta)], number, disturbance, duration=DURATION))
    return np.exp(typical), segments


def car(seed: int, windows: int, kind: Kind) -> dict[str, FloatArray]:
    """Simulate one car and estimate q and k from its windows.

    Returns:
        (2,) each: the typical values, both ends of their intervals, and the joint estimate.
    """
    truth, segments = windows_of_car(seed, windows, kind)
    estimate = estimated(segments, kind.model)
    assert estimate.posterior is not None  # as the recommended method of every model has one
    drawn = _values(kind.model, estimate.posterior.typical[:, 0])
    lower, upper = interval_ends(drawn, LEVEL)
    point = _values(kind.model, estimate.parameters[0])
    return {"truth": truth, "lower": lower, "upper": upper, "joint": point}


def _values(model: str, sets: Parameters) -> FloatArray:
    """(.., 2) q and k of sets (..)."""
    return np.stack([value_of(model, sets, name) for name in NAMES], axis=-1)


def measure(cars: int, windows: int, kind: Kind) -> Iterator[Measurement]:
    """Run the study of cars of one kind; the same arguments give the same figures."""
    of_all = simulated(partial(car, windows=windows, kind=kind), cars)
    truth, covers = of_all["truth"], is_covered(*(of_all[p] for p in ("truth", "lower", "upper")))
    ratio = of_all["joint"] / truth
    limits = EACH if cars >= MANY and kind in (KINDS["equal"], KINDS["unequal"]) else None
    for k, name in enumerate(NAMES):
        yield covered(name, covers[:, k], limits)
        for share, word in ((0.25, "lower quartile"), (0.5, "median"), (0.75, "upper quartile")):
            value = float(np.quantile(ratio[:, k], share))
            yield Measurement(name=f"estimate of {name} by the truth, {word}", value=value, unit="")
        width = float(np.median(of_all["upper"][:, k] / of_all["lower"][:, k]))
        yield Measurement(name=f"upper by lower end of {name}, median", value=width, unit="")


def main(arguments: list[str] | None = None) -> int:
    """Measure and print; the exit status is that of `bench.coverage`."""
    parser = argparse.ArgumentParser(prog="python -m bench.unequal", description=__doc__)
    parser.add_argument("--cars", type=int, default=100, help="of each kind (100)")
    parser.add_argument("--windows", type=int, default=4, help="of each car (4)")
    parser.add_argument("--kinds", nargs="*", choices=[*KINDS], default=[*KINDS])
    given = parser.parse_args(arguments)
    return show(
        {
            f"{given.cars} cars of {given.windows} windows, {name}": measured(
                partial(measure, given.cars, given.windows, KINDS[name])
            )
            for name in given.kinds
        }
    )


if __name__ == "__main__":
    sys.exit(main())
