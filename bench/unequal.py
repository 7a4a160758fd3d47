"""`python -m bench.unequal`: are unequal gains found where they are, and only there?

Each simulated car has some windows, in which α, β and τ differ from its typical values by
`BETWEEN` of `bench.coverage`, q and k by `APART`. Its typical q and k are drawn between `LEAST` and
`MOST`, or are 1: then the car is symmetric. What else it has that the model lacks is one thing at a
time: a slope, a lag, a delay, limits of the acceleration. Estimated are q and k of the CTHP with
unequal gains, also behind a lag or a delay, by the recommended method from all windows of a car.

Measured are the shares of cars whose 90 % interval of the typical value covers q and k, and the
median of the joint estimate, relative to the truth, with the quartiles: 1 without bias.
"""

import argparse
import sys
from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from typing import NamedTuple

import numpy as np

from accpinn.inference.intervals import LEVEL
from accpinn.model.cthp import Parameters
from accpinn.model.registry import value_of
from accpinn.model.unequal_gains import UNEQUAL_GAINS
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
    disturbance: Disturbance = Disturbance(standstill=STANDSTILL)


LATE = Disturbance(standstill=STANDSTILL, delay=0.6)
SLOW = Disturbance(standstill=STANDSTILL, lag=0.8)
KINDS = {
    "unequal": Kind(is_symmetric=False),
    "equal": Kind(),
    "equal, delay of .6 s": Kind(disturbance=LATE),
    "unequal, delay of .6 s, estimated": Kind("unequal-delay", False, LATE),
    "equal, delay of .6 s, estimated": Kind("unequal-delay", True, LATE),
    "equal, lag of .8 s": Kind(disturbance=SLOW),
    "equal, lag of .8 s, estimated": Kind("unequal-lag", True, SLOW),
    "equal, 2 % uphill": Kind(disturbance=Disturbance(standstill=STANDSTILL, slope=-0.2)),
    "equal, 2 % downhill": Kind(disturbance=Disturbance(standstill=STANDSTILL, slope=0.2)),
    **{
        f"equal, at most {most} m/s²": Kind(
            disturbance=Disturbance(standstill=STANDSTILL, limits=(-np.inf, most))
        )
        for most in (1.2, 0.8)
    },
    "equal, -.8 to .8 m/s²": Kind(
        disturbance=Disturbance(standstill=STANDSTILL, limits=(-0.8, 0.8))
    ),
}
"""Cars by what they are."""


def car(seed: int, windows: int, kind: Kind) -> dict[str, FloatArray]:
    """Simulate one car and estimate q and k from its windows.

    Returns:
        (2,) each: the typical values, both ends of their intervals, and the joint estimate.
    """
    rng = np.random.default_rng([seed, 4])
    is_symmetric = kind.is_symmetric
    log_q = 0.0 if is_symmetric else rng.uniform(np.log(LEAST), np.log(MOST))
    typical = np.array([log_q, log_q / 2])
    segments = []
    for k in range(windows):
        theta = SETS[seed % len(SETS)].values * np.exp(BETWEEN * rng.standard_normal(3))
        apart = np.zeros(2) if is_symmetric else APART * rng.standard_normal(2)
        q, closing = np.exp(typical + apart).tolist()
        disturbance = replace(kind.disturbance, q=q, k=closing)
        number = windows * seed + k
        segments.append(disturbed([Parameters(*theta)], number, disturbance, duration=DURATION))
    estimate = estimated(segments, kind.model)
    assert estimate.posterior is not None  # as the recommended method of every model has one
    drawn = _values(kind.model, estimate.posterior.typical[:, 0])
    lower, upper = interval_ends(drawn, LEVEL)
    joint = _values(kind.model, estimate.parameters[0])
    return {"truth": np.exp(typical), "lower": lower, "upper": upper, "joint": joint}


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
