"""`python -m bench.coverage`: how often do 90 % intervals cover the true parameters?

Each recording has its own leader on a motorway, one of the published parameter sets in turn,
disturbances as on real roads (`bench.disturbed`) and the receivers' noise. Measured are the share
of recordings whose interval covers α, β, the time gap and all three, the median width of the
intervals, and the mean error of several methods, the last two in percent of the truth. The time gap
is τ + s₀/v at the window's median speed v, τ for the CTHP. The truth is the CTHP with zero-mean
disturbances unless options add what it lacks; --model estimates under another form. The exit status
is 1 if an interval or an estimate without bias is not as accpinn promises (`EACH`, `ALL_THREE`,
`BIAS`, `WIDEST_GAP`).
"""

import argparse
import os
import sys
from collections.abc import Iterator, Mapping
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from multiprocessing import get_context

import numpy as np
from scipy.stats import bootstrap

from accpinn.inference.intervals import LEVEL, interval_ends, intervals
from accpinn.methods.pinn.config import preset
from accpinn.methods.registry import METHODS
from accpinn.model.cthp import Parameters
from accpinn.model.published import ASTAZERO, CASALE, VICOLUNGO
from accpinn.model.registry import CTHPS, PAPER
from accpinn.model.spec import ModelSpec
from accpinn.units import FloatArray
from bench.disturbed import Disturbance, disturbed
from bench.measurement import Measurement, measured, show

SETS = Parameters.stack(
    parameters for group in (ASTAZERO, VICOLUNGO, CASALE) for parameters in group.parameters
)
SYMBOLS = "α", "β", "time gap"
LIKELIHOOD, CALIBRATED = "maximum-likelihood", "calibrated"
METHODS_MEASURED = (LIKELIHOOD, CALIBRATED, "splines", "least-squares", "simulation")
"""Methods whose bias is measured; that of the preset `fast` is that of the splines. Of a model that
is not the paper's, only the first's is."""
EACH, ALL_THREE = (86.0, 94.0), (70.0, 85.0)
"""Promised coverage of each parameter and of all three, in percent."""
BIAS = {LIKELIHOOD: 3.0, CALIBRATED: 4.0}
"""Largest bias promised, in percent of the truth."""
WIDEST_GAP = 8.0
"""Largest median width promised of the time gap's interval, in percent of the truth."""
EFFECTS = "deviation", "memory", "lag", "delay", "standstill", "slope"
"""Fields of `Disturbance` that are options."""


def record(seed: int, disturbance: Disturbance, model: str = PAPER) -> dict[str, FloatArray]:
    """Simulate one recording and estimate α, β and the time gap.

    Returns:
        (3,) each: the truth, both ends of the intervals of maximum likelihood, and the estimate by
        each method.
    """
    true = SETS[seed % len(SETS)]
    segment = disturbed([true], seed, disturbance)
    fits = {LIKELIHOOD: METHODS[LIKELIHOOD].fit(segment, spec=ModelSpec(model))}
    for name in METHODS_MEASURED[1:] if model == PAPER else ():
        is_calibrated = name == CALIBRATED
        method, settings = ("pinn", preset(name)) if is_calibrated else (name, None)
        fits[name] = METHODS[method].fit(segment, settings=settings)
    draws = intervals(segment, fits[LIKELIHOOD]).draws[:, 0]
    speed = float(np.median(segment.speeds[:, 1]))

    def values(parameters: Parameters) -> FloatArray:
        return np.stack([parameters.alpha, parameters.beta, parameters.time_gap(speed)], axis=-1)

    lower, upper = interval_ends(values(draws), LEVEL)
    truth = values(Parameters(*true.values, disturbance.standstill))
    estimates = {name: values(fit.parameters[0]) for name, fit in fits.items()}
    return {"truth": truth, "lower": lower, "upper": upper, **estimates}


def measure(recordings: int, disturbance: Disturbance, model: str) -> Iterator[Measurement]:
    """Run the study; the same arguments give the same figures."""
    task = partial(record, disturbance=disturbance, model=model)
    with ProcessPoolExecutor(os.cpu_count(), get_context("spawn")) as pool:
        results = list(pool.map(task, range(recordings)))
    of_all = {name: np.array([result[name] for result in results]) for name in results[0]}
    truth = of_all.pop("truth")
    yield from coverage(truth, of_all.pop("lower"), of_all.pop("upper"))
    yield from bias(truth, of_all)


def coverage(truth: FloatArray, lower: FloatArray, upper: FloatArray) -> Iterator[Measurement]:
    """Return share and width of intervals; all arguments are (recordings, 3)."""
    covers = (lower <= truth) & (truth <= upper)
    shares = [*covers.mean(0), covers.all(1).mean()]
    for name, share in zip((*SYMBOLS, "all three"), shares, strict=True):
        low, high = EACH if name in SYMBOLS else ALL_THREE
        error = float(np.sqrt(share * (1.0 - share) / len(truth)))
        yield Measurement(
            name=f"{name} covered", value=100 * float(share), unit="%", error=100 * error,
            at_least=low, at_most=high,
        )  # fmt: skip
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
    for name in EFFECTS:
        parser.add_argument(f"--{name}", type=float, default=getattr(Disturbance, name))
    parser.add_argument("--model", choices=tuple(CTHPS), default=PAPER)
    given = parser.parse_args(arguments)
    disturbance = Disturbance(*(getattr(given, name) for name in EFFECTS))
    study = partial(measure, given.recordings, disturbance, given.model)
    title = f"{given.recordings} recordings, {disturbance}, {given.model}"
    return show({title: measured(study)})


if __name__ == "__main__":
    sys.exit(main())
