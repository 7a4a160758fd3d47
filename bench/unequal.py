"""`python -m bench.unequal`: are unequal gains found where they are, and only there?

Each simulated car has some windows behind leaders on a motorway (`bench.disturbed`). Its q and k
are drawn between `LEAST` and `MOST`, or are 1: then it is symmetric. One thing at a time departs
from that: α, β, τ, q and k differ between windows by `BETWEEN` of `bench.coverage` and `APART`,
disturbances are larger, or the car has what the model lacks: a slope, a lag, a delay or limits of
the acceleration. Estimated are q and k of the CTHP with unequal gains, also behind a lag or a
delay, by the recommended method from all windows of a car.

Measured are the shares of cars whose 90 % interval of the typical value covers q and k, and the
median of the joint estimate, relative to the truth, with the quartiles: 1 without bias.

With `--recorded FOLDER` the joint estimate of each recorded follower stands beside those of its
symmetric twins: the CTHP with s₀ and the parameters that its closed-loop simulation has, behind the
recorded vehicle ahead in the same windows, without limits and with the limits that the follower's
own acceleration shows, its quantiles at `RARE` and 1 - `RARE`. What is unequal with the follower
alone is no matter of the drive, nor of such limits.
"""

import argparse
import sys
from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from scipy.ndimage import uniform_filter1d

from accpinn.inference.intervals import LEVEL
from accpinn.model.cthp import Parameters, Term
from accpinn.model.registry import value_of
from accpinn.model.unequal_gains import UNEQUAL_GAINS
from accpinn.recordings.synthetic import SIMULATION_STEP
from accpinn.segment import Segment
from accpinn.units import FloatArray, interval_ends
from bench.coverage import BETWEEN, EACH, MANY, SETS, covered, is_covered, simulated
from bench.disturbed import Disturbance, disturbed
from bench.measurement import Measurement, measured, show
from bench.population import LONGEST, windows_of
from bench.prediction import SHORTEST, Windows, estimated, simulation

NAMES = "q", "k"
LEAST, MOST = 0.7, 3.0
"""Ends of q of cars with unequal gains; k is half as far from 1 on a logarithmic scale."""
APART = 0.15
"""Standard deviation of ln q and ln k between windows of a car with unequal gains."""
RARE, FEW = 0.001, 4
"""Share of the time in which a limit counts as reached, and least number of windows of a car."""
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
    "equal, at most .8 m/s²": _symmetric(limits=(-np.inf, 0.8)),
    "equal, at most .5 m/s²": _symmetric(limits=(-np.inf, 0.5)),
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


def twin(windows: Windows, disturbance: Disturbance) -> list[Segment]:
    """The windows of a follower, driven by its symmetric twin."""
    near, segments = simulation(windows, "cthp-s0"), []
    disturbance = replace(disturbance, standstill=float(near.s0[0]))
    for seed, window in enumerate(windows):
        time = window.time - window.time[0]
        fine = np.arange(0.0, time[-1] + SIMULATION_STEP / 2, SIMULATION_STEP)
        ahead = np.interp(fine, time, window.speeds[:, 0])
        parameters = [Parameters(*near.values[0])]
        segments.append(disturbed(parameters, seed, disturbance, ahead, duration=fine[-1]))
    return segments


def limits_of(windows: Windows) -> tuple[float, float]:
    """The limits in m/s² that the follower's acceleration in means over 1 s shows."""
    rates = []
    for window in windows:
        width = max(1, round(1.0 / window.sample_time))
        smooth = uniform_filter1d(window.speeds[:, 1], width)
        rates.append(np.gradient(smooth, window.sample_time))
    low, high = np.quantile(np.concatenate(rates), (RARE, 1.0 - RARE)).tolist()
    return low, high


def print_twins(folder: str) -> None:
    """Print q and k of each follower with `FEW` windows or more, and of its symmetric twins."""
    model, calm = UNEQUAL_GAINS.key, Kind().disturbance
    print("| follower | windows | q, k | twin's | limits [m/s²] | twin's with limits |")
    for car, windows in windows_of(folder, LONGEST, SHORTEST).items():
        if len(windows) < FEW:
            continue
        limits = limits_of(windows)
        limited = replace(calm, limits=limits)
        sets = (windows, twin(windows, calm), twin(windows, limited))
        q_and_k = [_values(model, simulation(part, model)[0]) for part in sets]
        cells = [f"{q:.2f}, {k:.2f}" for q, k in q_and_k]
        cells.insert(2, f"{limits[0]:.1f}, {limits[1]:.1f}")
        print(f"| {car[0]} {car[1]} | {len(windows)} |", " | ".join(cells), "|", flush=True)


def main(arguments: list[str] | None = None) -> int:
    """Measure and print; the exit status is that of `bench.coverage`."""
    parser = argparse.ArgumentParser(prog="python -m bench.unequal", description=__doc__)
    parser.add_argument("--cars", type=int, default=100, help="of each kind (100)")
    parser.add_argument("--windows", type=int, default=4, help="of each car (4)")
    parser.add_argument("--kinds", nargs="*", choices=[*KINDS], default=[*KINDS])
    parser.add_argument("--recorded", metavar="FOLDER", help="followers beside symmetric twins")
    given = parser.parse_args(arguments)
    if given.recorded:
        print_twins(given.recorded)
        return 0
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
