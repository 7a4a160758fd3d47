"""Do parameters describe the same car in another window? `python -m bench.prediction FOLDER`.

Each follower is by itself behind the measured vehicle ahead, in its K windows of 80 to 150 s of
car-following under ACC in one recording. One window is left out, and parameters from others drive
it in closed loop from its first instant on; the error is the RMSE of the gap. Ratios are to the
CTHP by maximum likelihood from one other window (the geometric mean over all of these), as
geometric means over a car's windows, then over cars, with their standard error. Five tables:

Prediction: by source of the parameters the ratio for all other windows, and for the window's own
fit; then, where three other windows or more are there, for one of them (each in turn), for two
(pairs of adjacent windows, the first and the second, the third and the fourth, .., without the one
left out) and for all of them. The last column is the difference of ln RMSE from that of the joint
estimate of the default model. Windows that are missed follow: the error is more than `MISSED` times
that of the parameters of one other window, or of the window's own fit.

All windows: the gap's RMSE over all windows of a follower, by the joint estimate, is at most that
by each single window's estimate; those for which it is not are listed.

Measured gain: in stretches of 250 to 700 s the model's |H| is compared with Welch's estimate, at
the frequencies of `accpinn.inference.gain_check`.

Further windows: the share of left-out windows whose own estimate, and whose measured mean time gap,
lie in the 90 % interval for a further window that the other windows give. Once more for the default
model with a population that was learned without the car; as that interval is of parameters, not of
their estimates, also with the estimate's sampling error in it.

Typical value: the share of followers whose joint estimate lies in its own 90 % interval.
"""

import sys
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from functools import cache, partial
from multiprocessing import get_context
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.stats import sem

from accpinn.inference.coordinates import coordinates_of
from accpinn.inference.gain_check import LEAST, compared, decibels
from accpinn.inference.intervals import LEVEL
from accpinn.inference.population import regularised, sampled_population
from accpinn.inference.window_posterior import window_posterior
from accpinn.methods.estimate import Estimate
from accpinn.methods.joint_likelihood import joint_maxima
from accpinn.methods.registry import METHODS, recommended_method
from accpinn.methods.series import determined_followers
from accpinn.methods.simulation import estimates
from accpinn.model.cthp import Parameters
from accpinn.model.registry import BEST, FOLLOWING, PAPER, simulate, time_gap, value_of
from accpinn.model.spec import ModelSpec
from accpinn.segment import Segment, median_speeds
from accpinn.stability.lagged import frequency_response
from accpinn.stability.measured_gain import measured_gain
from accpinn.study import Analysis, Source
from accpinn.study.judge import LARGEST, LONGEST_STRETCH, STRETCH
from accpinn.study.run import estimate
from accpinn.units import FloatArray, Metres, MetresPerSecond, Seconds, interval_ends
from bench.population import LONGEST, Car, learn, windows_of

SHORTEST: Seconds = 80.0
"""Shortest window that is left out."""
MISSED = 2.0
"""Ratio of errors from which a left-out window is said to be missed."""
ROUNDS, WORKERS = 5, 2
"""Rounds in which a population without one car is learned, and processes."""

Windows = Sequence[Segment]
Estimator = Callable[[Windows, str], Parameters]
"""The parameters (1,) of a model, by its key, from some windows of a follower."""
Drive = Callable[[Segment], FloatArray]
"""The gap (N, 1) in m that is predicted in a window (N,)."""
Predictor = Callable[[Windows], Drive]
"""Predictor of a follower's gap from some of its windows."""
Inside = dict[str, list[float]]
"""Whether values lie in their intervals, 0 or 1, by the quantity's name; nan for an unknown one."""


# What is judged: one function for each source of parameters.


def likelihood(windows: Windows, model: str) -> Parameters:
    """(1,) the parameters of greatest likelihood in all windows together."""
    (maximum,) = joint_maxima(tuple(windows), "II", ModelSpec(model))
    return Parameters.of(maximum.complete[None])


def simulation(windows: Windows, model: str) -> Parameters:
    """(1,) the parameters of the best closed-loop simulation of all windows together."""
    ((_, best),) = estimates(tuple(windows), "II", ModelSpec(model))
    return FOLLOWING[model].linearisations(best.theta[:, None], median_speeds(windows))


def posterior(windows: Windows, model: str) -> tuple[Parameters, Parameters]:
    """(n,) draws of the typical value, and of what a further window has."""
    drawn = estimated(windows, model).posterior
    assert drawn is not None  # as the recommended method of every model has one
    return drawn.typical[:, 0], drawn.further[:, 0]


def estimated(windows: Windows, model: str) -> Estimate:
    """The recommended estimate of a model from some windows, with its posterior."""
    analysis = Analysis(Source(windows[0].source, "", None, ""), windows[0].vehicles, ())
    analysis = replace(analysis, spec=ModelSpec(model)).with_method(recommended_method(model))
    return estimate(replace(analysis, windows=tuple(w.window for w in windows)), tuple(windows))


def joint(windows: Windows, model: str) -> Parameters:
    """(1,) the parameters that maximise the criterion of all windows together."""
    return (likelihood if FOLLOWING[model].is_linear else simulation)(windows, model)


def constant_time_gap(windows: Windows) -> Drive:
    """The median time gap of the windows at the speed ahead."""
    gaps = [window.gaps / np.maximum(window.speeds[:, 1:], 1.0) for window in windows]
    time_gap = np.median(np.concatenate(gaps))
    return lambda window: np.asarray(time_gap * window.speeds[:, :1])


def driven(estimator: Estimator, model: str, windows: Windows) -> Drive:
    """The closed loop by the parameters of a model from some windows."""
    parameters = estimator(windows, model)

    def gaps(window: Segment) -> FloatArray:
        ahead, speed = window.speeds.T
        return simulate(model, parameters, window.time, ahead, speed[:1], window.gaps[0]).gaps

    return gaps


REFERENCE, JOINT = f"{PAPER}, likelihood", f"{BEST}, likelihood"
SOURCES: Mapping[str, Predictor] = {
    "constant time gap": constant_time_gap,
    **{f"{m}, likelihood": partial(driven, likelihood, m) for m in (PAPER, "cthp-s0", BEST)},
    **{
        f"{model}, simulation": partial(driven, simulation, model)
        for model in ("cthp-s0", "unequal", "idm", "fvdm")
    },
}
JOINTS = tuple(name for name in SOURCES if name.endswith(("likelihood", "simulation")))
"""Sources that maximise one criterion of all windows."""
POSTERIORS = BEST, "idm"
"""Models whose intervals are judged."""


class Errors(NamedTuple):
    """RMSE of the gap in m in the K windows of a follower, by parameters from one source."""

    by_one: FloatArray
    """(K, K) in window k by the parameters of window j alone; the window's own on the diagonal."""
    two: FloatArray
    """(K,) the geometric mean over pairs of adjacent windows without k; nan with less than four."""
    others: FloatArray
    """(K,) by all other windows together."""
    whole: FloatArray
    """(K,) by all windows together."""

    @property
    def by_itself(self) -> FloatArray:
        """(K,) by the window itself."""
        return np.asarray(np.diag(self.by_one))

    @property
    def one_other(self) -> FloatArray:
        """(K,) the geometric mean over each single other window."""
        logarithms = np.log(self.by_one)
        np.fill_diagonal(logarithms, np.nan)
        return np.asarray(np.exp(np.nanmean(logarithms, axis=1)))


class Scored(NamedTuple):
    """Errors and coverage in the windows and stretches of one follower in one recording."""

    car: Car
    windows: list[Segment]
    errors: dict[str, Errors]
    """Errors by source; empty with one window."""
    gains: dict[str, list[FloatArray]]
    """Rms and peak error in dB, and log-likelihood above the CTHP's, by source, of each stretch."""
    further: dict[str, Inside]
    """Coverage of left-out windows by the interval from the others, by model and quantity."""
    typical: dict[str, Inside]
    """Coverage of the joint estimate of all windows by its interval, by model and quantity."""
    points: FloatArray
    """(K, 6) estimates of the windows under the default model."""
    drawn: FloatArray
    """(K, n, p) posterior draws of the windows under the default model."""


def score(car: Car, windows: Windows, stretches: Windows) -> Scored:
    """Score the parameters of one follower in one recording."""
    determined = [window for window in windows if determined_followers([window], "II")]
    posteriors = [window_posterior(window, "II", ModelSpec(BEST)) for window in determined]
    several = len(determined) > 1
    gains = defaultdict[str, list[FloatArray]](list)
    for stretch in stretches:
        within = [part for part in determined if stretch.start <= part.start < stretch.window.end]
        for row, figures in _gains(stretch, within):
            gains[row].append(figures)
    return Scored(
        car,
        determined,
        {name: errors_of(determined, source) for name, source in SOURCES.items()}
        if several
        else {},
        gains,
        {model: further_inside(determined, model) for model in POSTERIORS} if several else {},
        {model: typical_inside(determined, model) for model in POSTERIORS} if several else {},
        np.array([part.estimates[0] for part in posteriors]),
        np.array([part.drawn[0] for part in posteriors]),
    )


# Prediction


def rms(errors: FloatArray) -> float:
    """Root mean square."""
    return float(np.sqrt(np.mean(errors**2)))


def rmse(drive: Drive, window: Segment) -> Metres:
    """RMSE of the gap where it was measured; of a simulation that diverges `LARGEST`."""
    errors = np.nan_to_num(drive(window) - window.gaps, nan=LARGEST, posinf=LARGEST)
    return rms(errors[window.counts].clip(-LARGEST, LARGEST))


def errors_by(windows: Windows, source: Predictor) -> Callable[..., FloatArray]:
    """The errors (K,) in all windows by the source's parameters from windows of given numbers."""

    @cache
    def by(*chosen: int) -> FloatArray:
        drive = source([windows[k] for k in chosen])
        return np.array([rmse(drive, window) for window in windows])

    return by


def errors_of(windows: Windows, source: Predictor) -> Errors:
    """The errors in each window by the source's parameters from some of them."""
    indices, by = range(len(windows)), errors_by(windows, source)
    return Errors(
        np.stack([by(k) for k in indices], axis=1),
        two_others(len(windows), by),
        np.array([by(*(j for j in indices if j != k))[k] for k in indices]),
        by(*indices),
    )


def two_others(count: int, by: Callable[..., FloatArray]) -> FloatArray:
    """(K,) the geometric mean error over pairs of adjacent windows without the one left out.

    For ``by`` see `errors_by`. With fewer than four windows two others are all that there are, so
    there is nothing to compare: nan.
    """
    logarithms = np.full((count // 2, count), np.nan)
    for row, first in enumerate(range(0, count - 1, 2) if count > 3 else ()):
        logarithms[row] = np.log(by(first, first + 1))
        logarithms[row, [first, first + 1]] = np.nan
    return np.asarray(np.exp(np.nanmean(logarithms, axis=0))) if count > 3 else logarithms[0]


def over_cars(cars: Sequence[tuple[str, ...]], values: FloatArray) -> tuple[float, float]:
    """Mean over cars of the mean of each one's values (n,), and its standard error."""
    of_cars = [values[[of == car for of in cars]].mean() for car in dict.fromkeys(cars)]
    return float(np.mean(of_cars)), float(sem(of_cars))


def ratio(cars: Sequence[tuple[str, ...]], errors: FloatArray, reference: FloatArray) -> str:
    """The geometric mean over cars of the ratio of two errors (n,), with its standard error."""
    mean, error = over_cars(cars, np.log(errors / reference))
    return f"{np.exp(mean):.3f} ± {np.exp(mean) * error:.3f}"


def print_prediction(runs: Sequence[Scored]) -> None:
    """Print the first table and the windows that are missed."""
    cars = [run.car[:2] for run in runs for _ in run.windows]

    def of_all(name: str, part: str) -> FloatArray:
        return np.concatenate([getattr(run.errors[name], part) for run in runs])

    reference, best = of_all(REFERENCE, "one_other"), of_all(JOINT, "others")
    more = np.isfinite(of_all(REFERENCE, "two"))
    chosen = [car for car, has_more in zip(cars, more, strict=True) if has_more]
    print(f"{len(cars)} windows of {len(set(cars))} cars; with three other windows or more")
    print(f"{len(chosen)} windows of {len(set(chosen))} cars\n")
    print("| parameters | median [m] | all others | own fit | one | two | more | ln RMSE - joint |")
    for name in SOURCES:
        others = of_all(name, "others")
        cells = [ratio(cars, of_all(name, part), reference) for part in ("others", "by_itself")]
        for part in ("one_other", "two", "others"):
            cells.append(ratio(chosen, of_all(name, part)[more], reference[more]))
        mean, error = over_cars(cars, np.log(others / best))
        cells.append(f"{mean:+.3f} ± {error:.3f}")
        print(f"| {name} | {np.median(others):.2f} |", " | ".join(cells), "|")
    print("\n| missed | window | RMSE [m] | one other [m] | own fit [m] |")
    for name in JOINTS:
        for run in runs:
            errors = run.errors[name]
            parts = errors.others, errors.one_other, errors.by_itself
            for window, error, by_one, by_itself in zip(run.windows, *parts, strict=True):
                if error > MISSED * min(by_one, by_itself):
                    where = f"{_named(run.car)}, {window.window}"
                    print(f"| {name} | {where} | {error:.2f} | {by_one:.2f} | {by_itself:.2f} |")


def _named(car: Car) -> str:
    return f"{car[0]} {car[1]}, {Path(car[2]).name}"


def print_whole(runs: Sequence[Scored]) -> None:
    """Print for how many followers the joint estimate is nowhere beaten, and all others."""
    print("\n| joint estimate | followers | at most each single window's RMSE [%] |")
    beaten = list[str]()
    for name in JOINTS:
        shares = []
        for run in runs:
            errors = run.errors[name]
            lengths = np.array([window.counts.sum() for window in run.windows])
            whole = np.sqrt(np.average(errors.whole**2, weights=lengths))
            single = np.sqrt(np.average(errors.by_one**2, axis=0, weights=lengths))
            shares.append(whole <= single.min())
            if not shares[-1]:
                window = run.windows[int(single.argmin())].window
                beaten.append(
                    f"| {name} | {_named(run.car)} | {whole:.2f} | {single.min():.2f} | {window} |"
                    f" {(single < whole).sum()} of {len(single)} |"
                )
        print(f"| {name} | {len(runs)} | {100 * np.mean(shares):.0f} |")
    print("\n| beaten | follower | joint [m] | best single [m] | its window | better ones |")
    print(*beaten, sep="\n")


# Measured gain


def _gains(stretch: Segment, within: Windows) -> Iterator[tuple[str, FloatArray]]:
    """Rows of the table, where the gain is measured at enough frequencies."""
    measured = measured_gain(stretch, 0)
    compared_at = compared(measured)
    omega, reference = measured.omega[compared_at], decibels(measured.gain[compared_at])
    if len(omega) < LEAST or not within:
        return

    def figures(parameters: Parameters, likelihood: float = np.nan) -> FloatArray:
        gain = decibels(np.abs(frequency_response(parameters, omega)[0]))
        return np.array([rms(gain - reference), gain.max() - reference.max(), likelihood])

    yield "least squares", figures(METHODS["least-squares"].fit(stretch).parameters)
    linear = [key for key, model in FOLLOWING.items() if model.is_linear]
    maxima = {model: joint_maxima((stretch,), "II", ModelSpec(model))[0] for model in linear}
    for model, maximum in maxima.items():
        more = maximum.log_likelihood - maxima[PAPER].log_likelihood
        yield model, figures(Parameters.of(maximum.complete[None]), more)
    yield JOINT, figures(likelihood(within, BEST))


def print_gains(runs: Sequence[Scored]) -> None:
    """Print the table of the measured gain."""
    gains = [run.gains for run in runs if run.gains]
    rows = {name: np.array([row for of in gains for row in of[name]]) for name in gains[0]}
    print("\n| |H| | stretches | rms [dB] | mean | peak [dB] | log-likelihood | rms - joint [dB] |")
    for name, figures in rows.items():
        error, peak, more = np.median(figures, axis=0)
        away = figures[:, 0] - rows[JOINT][:, 0]
        print(f"| {name} | {len(figures)} | {error:.2f} | {figures[:, 0].mean():.2f}", end="")
        print(f" | {peak:+.1f} | {more:+.0f} | {away.mean():+.2f} ± {sem(away):.2f} |")


# Intervals


def quantities(model: str, sets: Parameters, speed: MetresPerSecond) -> dict[str, FloatArray]:
    """(..) the parameters and the time gap at a speed, by name, of sets (..)."""
    values = {name: value_of(model, sets, name) for name in FOLLOWING[model].names}
    return values | {"time gap": time_gap(model, sets, speed)}


def is_inside(value: float, drawn: FloatArray) -> float:
    """Whether a value lies in the 90 % interval of draws (n,), 0 or 1; nan for nan."""
    lower, upper = interval_ends(drawn, LEVEL)
    return float(lower <= value <= upper) if np.isfinite(value) else np.nan


def inside(model: str, sets: Parameters, drawn: Parameters, speed: float) -> Inside:
    """Whether each quantity of the sets (1,) lies in the interval of draws (n,)."""
    of_draws = quantities(model, drawn, speed)
    values = quantities(model, sets, speed)
    return {name: [is_inside(value[0], of_draws[name])] for name, value in values.items()}


def gap_inside(model: str, window: Segment, drawn: Parameters) -> Inside:
    """Whether the window's mean measured time gap lies in that of draws (n,) at its speed."""
    of_draws = time_gap(model, drawn, float(median_speeds([window])[0]))
    return {"measured time gap": [is_inside(float(np.nanmean(window.time_gaps)), of_draws)]}


def further_inside(windows: Windows, model: str) -> Inside:
    """Whether left-out windows are in the interval for a further window from the others."""
    scored = list[Inside]()
    for window in windows:
        _, further = posterior([other for other in windows if other is not window], model)
        point, speed = joint([window], model), float(median_speeds([window])[0])
        scored.append(inside(model, point, further, speed) | gap_inside(model, window, further))
    return merged(scored)


def typical_inside(windows: Windows, model: str) -> Inside:
    """Whether the joint estimate is in its own interval of the typical value."""
    typical, _ = posterior(windows, model)
    return inside(model, joint(windows, model), typical, float(median_speeds(windows)[0]))


def merged(parts: Iterable[Inside]) -> Inside:
    """Several windows' or followers' values as one."""
    every = list(parts)
    return {name: [value for part in every for value in part[name]] for name in every[0]}


def unseen(car: tuple[str, ...], runs: Sequence[Scored]) -> list[list[Inside]]:
    """Coverage of a car's windows under the default model, by a population without the car.

    The second of each also holds the sampling error of the window's own estimate.
    """
    drawn = defaultdict[tuple[str, ...], list[FloatArray]](list)
    for run in runs:
        drawn[run.car[:2]] += list(run.drawn)
    taught = [np.array(draws) for name, draws in drawn.items() if draws and name != car]
    space = coordinates_of(BEST)
    priors = [space.log_prior(draws) for draws in taught]
    population = regularised(learn(taught, priors, BEST, ROUNDS))
    rng, scored = np.random.default_rng(0), list[list[Inside]]()
    for run in runs:
        for k, window in enumerate(run.windows if run.car[:2] == car and run.errors else ()):
            others, away = np.delete(run.drawn, k, axis=0), run.drawn[k] - run.drawn[k].mean(axis=0)
            sampled = sampled_population(others, space.log_prior(others), population)
            point, speed = Parameters.of(run.points[k][None]), float(median_speeds([window])[0])
            errors = rng.choice(away, len(sampled.further))
            pair = list[Inside]()
            for phi in (sampled.further, sampled.further + errors):
                further = space.parameters(phi, speed)
                pair.append(inside(BEST, point, further, speed) | gap_inside(BEST, window, further))
            scored.append(pair)
    return scored


def print_shares(title: str, rows: Mapping[str, Inside]) -> None:
    """Print the shares of values in their intervals, one row each."""
    print(f"\n| {title} | number | inside [%] |")
    for name, values in rows.items():
        shares = (f"{which} {100 * np.nanmean(row):.0f}" for which, row in values.items())
        print(f"| {name} | {max(map(len, values.values()))} | {', '.join(shares)} |")


def main() -> None:
    """Print the tables."""
    windows = windows_of(sys.argv[1], LONGEST, SHORTEST)
    stretches = windows_of(sys.argv[1], LONGEST_STRETCH, STRETCH)
    every = sorted(windows | stretches, key=lambda car: -len(windows.get(car, [])))
    given = ([parts.get(car, []) for car in every] for parts in (windows, stretches))
    with ProcessPoolExecutor(WORKERS, mp_context=get_context("spawn")) as pool:
        scored = list(pool.map(score, every, *given))
        runs = [run for run in scored if run.errors]
        print_prediction(runs)
        print_whole(runs)
        print_gains(scored)
        shares = {model: merged(run.further[model] for run in runs) for model in POSTERIORS}
        cars = dict.fromkeys(run.car[:2] for run in runs)
        pairs = [pair for of in pool.map(partial(unseen, runs=scored), cars) for pair in of]
    without, with_error = (merged(part) for part in zip(*pairs, strict=True))
    shares[f"{BEST}, population without the car"] = without
    shares["the same, with the estimate's error"] = with_error
    print_shares("further windows", shares)
    typical = {model: merged(run.typical[model] for run in runs) for model in POSTERIORS}
    print_shares("joint estimate in its own interval", typical)


if __name__ == "__main__":
    main()
