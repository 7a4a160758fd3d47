"""`python -m bench.coverage`: how often do 90 % intervals cover the true parameters?

Each recording has its own leader on a motorway, one of the published parameter sets in turn,
disturbances as on real roads (`bench.disturbed`) and the receivers' noise. Measured are the share
of recordings whose interval covers α, β, the time gap and all three, the median width of the
intervals, and the mean error of several methods, the last two in percent of the truth. The time gap
is τ + s₀/v at the window's median speed v, τ for the CTHP. The truth is the CTHP with zero-mean
disturbances unless options add what it lacks; --model estimates under another form.

Each car has some such windows, in which α, β and τ differ from its typical values by `BETWEEN`.
Measured are the shares of cars whose interval of the typical value covers that, and whose interval
for a further window covers the parameters of one more, and the mean error of the joint estimate.

The exit status is 1 if an interval or an estimate without bias is not as accpinn promises (`EACH`,
`ALL_THREE`, `BIAS`, `WIDEST_GAP`). Cars must be `MANY` for that, as a share of 90 % of fewer is
within `EACH` or beyond it by chance.
"""

import argparse
import os
import sys
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from multiprocessing import get_context

import numpy as np
from scipy.stats import bootstrap

from accpinn.inference.coordinates import coordinates_of
from accpinn.inference.intervals import LEVEL
from accpinn.inference.window_posterior import window_posterior
from accpinn.methods.registry import METHODS
from accpinn.model.cthp import Parameters
from accpinn.model.published import ASTAZERO, CASALE, VICOLUNGO
from accpinn.model.registry import FOLLOWING, PAPER
from accpinn.model.spec import ModelSpec
from accpinn.segment import Segment, median_speeds
from accpinn.units import FloatArray, Mask, MetresPerSecond, Seconds, interval_ends
from bench.disturbed import Disturbance, disturbed
from bench.measurement import Measurement, measured, show
from bench.prediction import joint, posterior

SETS = Parameters.stack(
    parameters for group in (ASTAZERO, VICOLUNGO, CASALE) for parameters in group.parameters
)
SYMBOLS = "α", "β", "time gap"
METHODS_MEASURED = ("pinn", "splines", "least-squares", "simulation")
"""Methods whose bias is measured; that of the preset `fast` is that of the splines. Of a model that
is not the paper's, only the first's is."""
EACH, ALL_THREE = (86.0, 94.0), (70.0, 85.0)
"""Promised coverage of each parameter and of all three, in percent."""
BIAS = {"pinn": 3.0}
"""Largest bias promised, in percent of the truth."""
WIDEST_GAP = 8.0
"""Largest median width promised of the time gap's interval, in percent of the truth."""
BETWEEN = (0.3, 0.3, 0.08)
"""Standard deviations of ln α, ln β and ln τ between windows of a simulated car."""
WINDOW: Seconds = 200.0
"""Length of these windows."""
MANY = 300
"""Least number of cars whose coverage must be as promised: its standard error is 1.7 %."""
EFFECTS = "deviation", "memory", "lag", "delay", "standstill", "slope"
"""Fields of `Disturbance` that are options."""


def record(seed: int, disturbance: Disturbance, model: str = PAPER) -> dict[str, FloatArray]:
    """Simulate one recording and estimate α, β and the time gap.

    Returns:
        (3,) each: the truth, both ends of the intervals of the window by itself, and the estimate
        by each method.
    """
    true = SETS[seed % len(SETS)]
    segment = disturbed([true], seed, disturbance)
    spec, methods = ModelSpec(model), METHODS_MEASURED if model == PAPER else METHODS_MEASURED[:1]
    fits = {name: METHODS[name].fit(segment, spec=spec) for name in methods}
    speed = float(np.median(segment.speeds[:, 1]))
    alone = window_posterior(segment, "II", spec)
    draws = coordinates_of(model).parameters(alone.drawn[0], speed)
    lower, upper = interval_ends(values(draws, speed), LEVEL)
    truth = values(Parameters(*true.values, disturbance.standstill), speed)
    estimates = {name: values(fit.parameters[0], speed) for name, fit in fits.items()}
    return {"truth": truth, "lower": lower, "upper": upper, **estimates}


def values(parameters: Parameters, speed: MetresPerSecond) -> FloatArray:
    """(.., 3) α, β and the time gap at a speed."""
    return np.stack([parameters.alpha, parameters.beta, parameters.time_gap(speed)], axis=-1)


def windows_of_car(
    seed: int, windows: int, disturbance: Disturbance
) -> tuple[Parameters, Parameters, list[Segment]]:
    """A simulated car's typical parameters, those of a further window, and its windows."""
    typical = SETS[seed % len(SETS)].values
    differ = BETWEEN * np.random.default_rng([seed, 3]).standard_normal((windows + 1, 3))
    further, *driven = (Parameters(*row) for row in typical * np.exp(differ))
    segments = [
        disturbed([parameters], windows * seed + k, disturbance, duration=WINDOW)
        for k, parameters in enumerate(driven)
    ]
    intercept = disturbance.standstill
    truths = Parameters(*typical, intercept), Parameters(*further.values, intercept)
    return *truths, segments


def car(seed: int, windows: int, disturbance: Disturbance, model: str) -> dict[str, FloatArray]:
    """Simulate one car and estimate α, β and the time gap from its windows.

    Returns:
        (3,) each: the typical values, those of a further window, both ends of the intervals of
        both, and the joint estimate.
    """
    *truths, segments = windows_of_car(seed, windows, disturbance)
    speed = float(median_speeds(segments)[0])
    row = {"joint": values(joint(segments, model)[0], speed)}
    drawn = posterior(segments, model)
    for name, truth, draws in zip(("typical", "further"), truths, drawn, strict=True):
        lower, upper = interval_ends(values(draws, speed), LEVEL)
        row |= {name: values(truth, speed), f"{name} lower": lower, f"{name} upper": upper}
    return row


def measure(recordings: int, disturbance: Disturbance, model: str) -> Iterator[Measurement]:
    """Run the study of recordings; the same arguments give the same figures."""
    of_all = simulated(partial(record, disturbance=disturbance, model=model), recordings)
    truth = of_all.pop("truth")
    yield from coverage(truth, of_all.pop("lower"), of_all.pop("upper"))
    yield from bias(truth, of_all)


def measure_cars(
    cars: int, windows: int, disturbance: Disturbance, model: str
) -> Iterator[Measurement]:
    """Run the study of cars; the same arguments give the same figures."""
    of_all = simulated(partial(car, windows=windows, disturbance=disturbance, model=model), cars)
    for name in ("typical", "further"):
        covers = is_covered(*(of_all[name + part] for part in ("", " lower", " upper")))
        for symbol, inside in zip(SYMBOLS, covers.T, strict=True):
            yield covered(f"{name} {symbol}", inside, EACH if cars >= MANY else None)
    yield from bias(of_all["typical"], {"joint estimate": of_all["joint"]})


def simulated(task: Callable[[int], dict[str, FloatArray]], count: int) -> dict[str, FloatArray]:
    """The arrays (count, 3) that a task returns for so many seeds, on all processors."""
    with ProcessPoolExecutor(os.cpu_count(), get_context("spawn")) as pool:
        results = list(pool.map(task, range(count)))
    return {name: np.array([result[name] for result in results]) for name in results[0]}


def is_covered(truth: FloatArray, lower: FloatArray, upper: FloatArray) -> Mask:
    """(..) whether intervals cover the truth (..)."""
    return np.asarray((lower <= truth) & (truth <= upper))


def covered(name: str, covers: Mask, limits: tuple[float, float] | None) -> Measurement:
    """The share of true values with its standard error; limits in percent, None for no promise."""
    share = float(covers.mean())
    error = float(np.sqrt(share * (1.0 - share) / len(covers)))
    low, high = limits or (None, None)
    return Measurement(
        name=f"{name} covered", value=100 * share, unit="%", error=100 * error,
        at_least=low, at_most=high,
    )  # fmt: skip


def coverage(truth: FloatArray, lower: FloatArray, upper: FloatArray) -> Iterator[Measurement]:
    """Return share and width of intervals; all arguments are (recordings, 3)."""
    covers = is_covered(truth, lower, upper)
    for symbol, inside in zip(SYMBOLS, covers.T, strict=True):
        yield covered(symbol, inside, EACH)
    yield covered("all three", np.asarray(covers.all(axis=1)), ALL_THREE)
    widths = 100 * (upper - lower) / truth
    again = bootstrap((widths,), np.median, axis=0, n_resamples=500, method="percentile", rng=0)
    medians = np.median(widths, axis=0), again.standard_error
    for symbol, width, error, most in zip(SYMBOLS, *medians, (None, None, WIDEST_GAP), strict=True):
        yield Measurement(
            name=f"median width of {symbol}", value=float(width), unit="%", error=float(error),
            at_most=most,
        )  # fmt: skip


def bias(truth: FloatArray, estimates: Mapping[str, FloatArray]) -> Iterator[Measurement]:
    """Return the mean error by method; all arrays are (recordings, 3)."""
    for name, values in estimates.items():
        errors = 100 * (values / truth - 1)
        means = np.nanmean(errors, axis=0)
        deviations = np.nanstd(errors, axis=0) / np.sqrt(len(errors))
        most = BIAS.get(name)
        for symbol, mean, error in zip(SYMBOLS, means, deviations, strict=True):
            yield Measurement(
                name=f"mean error of {symbol}, {name}", value=float(mean), unit="%",
                error=float(error), at_most=most, at_least=most and -most,
            )  # fmt: skip


def main(arguments: list[str] | None = None) -> int:
    """Measure and print; the exit status is described above."""
    parser = argparse.ArgumentParser(prog="python -m bench.coverage", description=__doc__)
    parser.add_argument("--recordings", type=int, default=100, help="how many (100)")
    parser.add_argument("--cars", type=int, default=0, help=f"how many (0; a study takes {MANY})")
    parser.add_argument("--windows", type=int, default=8, help="of each car (8)")
    for name in EFFECTS:
        parser.add_argument(f"--{name}", type=float, default=getattr(Disturbance, name))
    linear = [key for key, model in FOLLOWING.items() if model.is_linear]
    parser.add_argument("--model", choices=linear, default=PAPER)
    given = parser.parse_args(arguments)
    disturbance = Disturbance(*(getattr(given, name) for name in EFFECTS))
    under = f"{disturbance}, {given.model}"
    studies: dict[str, Callable[[], Iterator[Measurement]]] = {}
    if given.recordings:
        of_recordings = partial(measure, given.recordings, disturbance, given.model)
        studies[f"{given.recordings} recordings, {under}"] = of_recordings
    if given.cars:
        of_cars = partial(measure_cars, given.cars, given.windows, disturbance, given.model)
        studies[f"{given.cars} cars of {given.windows} windows, {under}"] = of_cars
    return show({title: measured(study) for title, study in studies.items()})


if __name__ == "__main__":
    sys.exit(main())
