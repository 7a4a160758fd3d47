"""Do parameters describe the same car in another window? `python -m bench.prediction FOLDER`.

Each follower is by itself behind the measured vehicle ahead. Three tables are printed.

Prediction: one window of 100 to 150 s is left out, and the parameters from the other windows of the
recording drive it in closed loop from its first instant on; the error is the RMSE of the gap.
Differences of ln RMSE are means over cars, with their standard error.

Measured gain: in stretches of 250 to 700 s the model's |H| is compared with Welch's estimate, at
the frequencies of `accpinn.inference.gain_check`.

Further windows: the share of left-out windows whose own maximum-likelihood estimate lies in the
90 % interval for a further window; the population is learned without the car. That interval is of
the parameters: the second share is that of the interval with the estimate's sampling error in it.
"""

import sys
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from multiprocessing import get_context
from typing import NamedTuple

import numpy as np
from scipy.stats import sem

from accpinn.inference.answer import answer
from accpinn.inference.gain_check import LEAST, compared, decibels
from accpinn.inference.intervals import LEVEL, interval_ends
from accpinn.inference.population import regularised, sampled_population
from accpinn.inference.posterior import AT_SPEED, log_prior_of_features
from accpinn.inference.window_posterior import parameters_of, window_posterior
from accpinn.methods.least_squares import fit as least_squares
from accpinn.methods.likelihood import Maximum
from accpinn.methods.maximum_likelihood import joint_maxima
from accpinn.model.cthp import Parameters, simulate
from accpinn.model.registry import BEST, CTHPS, FOLLOWING, PAPER
from accpinn.model.spec import ModelSpec
from accpinn.segment import Segment
from accpinn.stability.lagged import frequency_response
from accpinn.stability.measured_gain import measured_gain
from accpinn.units import FloatArray, Metres
from bench.population import Car, learn, windows_of

JOINT: tuple[str, ...] = ("cthp", "cthp-s0", "cthp-s0-lag", "cthp-s0-delay")
ANSWERS: tuple[str, ...] = ("cthp", "cthp-s0", "cthp-s0-delay")
ONE, ANSWER = f"{PAPER}, one other window", f"answer, {BEST}"
ROUNDS, WORKERS = 5, 2
"""Rounds in which a population without one car is learned, and processes."""
Rows = Mapping[str, list[FloatArray]]


class Scored(NamedTuple):
    """What the K windows and the stretches of one follower in one recording gave.

    ``own`` (K, 6) are the estimates under the best model, ``drawn`` (K, n, p) its posterior draws.
    Rows have an array a window, RMSE in m for each source of parameters, or an array a stretch: rms
    and peak error in dB, and log-likelihood above the CTHP's.
    """

    car: Car
    windows: list[Segment]
    own: FloatArray
    drawn: FloatArray
    errors: Rows
    gains: Rows


def rms(errors: FloatArray) -> float:
    """Root mean square."""
    return float(np.sqrt(np.mean(errors**2)))


def rmse(parameters: Parameters, segment: Segment) -> Metres:
    """RMSE of the gap in a window that the parameters drive from its first instant on."""
    speeds, gaps = segment.speeds, segment.gaps
    driven = simulate(parameters, segment.time, speeds[:, 0], speeds[0, 1:], gaps[0])
    return rms(driven.gaps - gaps)


def estimate(segments: Sequence[Segment], model: str) -> tuple[Parameters, Maximum]:
    """The parameters of greatest likelihood in all of some windows together."""
    (maximum,) = joint_maxima(tuple(segments), "II", ModelSpec(model))
    return Parameters.of(maximum.complete[None]), maximum


def score(car: Car, windows: Sequence[Segment], stretches: Sequence[Segment]) -> Scored:
    """Score the parameters of one follower in one recording."""
    posteriors = {window: window_posterior(window, "II", ModelSpec(BEST)) for window in windows}
    known = [window for window in windows if np.isfinite(posteriors[window].drawn).all()]
    own = np.array([posteriors[window].estimates[0] for window in known])
    drawn = np.array([posteriors[window].drawn[0] for window in known])
    errors, gains = (defaultdict[str, list[FloatArray]](list) for _ in range(2))
    for left_out in known if len(known) > 1 else ():
        for row, values in _errors(left_out, [part for part in known if part is not left_out]):
            errors[row].append(np.array(values))
    for stretch in stretches:
        within = [part for part in known if stretch.start <= part.start < stretch.window.end]
        for row, figures in _gains(stretch, within):
            gains[row].append(figures)
    return Scored(car, known, own, drawn, errors, gains)


def _errors(left_out: Segment, others: list[Segment]) -> Iterator[tuple[str, list[Metres]]]:
    """Rows of the first table with the errors in the window that is left out."""
    time_gaps = [other.gaps / np.maximum(other.speeds[:, 1:], 1.0) for other in others]
    kept = np.median(np.concatenate(time_gaps)) * left_out.speeds[:, :1]
    yield "constant time gap", [rms(kept - left_out.gaps)]
    sources = {"least squares": [least_squares(other).parameters for other in others]}
    sources |= {model: [estimate([other], model)[0] for other in others] for model in JOINT[:2]}
    for name, parameters in sources.items():
        yield f"{name}, one other window", [rmse(source, left_out) for source in parameters]
    for model in JOINT:
        yield f"{model}, all others", [rmse(estimate(others, model)[0], left_out)]
    for model in ANSWERS:
        yield f"answer, {model}", [rmse(answer(others, "II", model).parameters, left_out)]
        yield f"{model}, the window's own fit", [rmse(estimate([left_out], model)[0], left_out)]


def _gains(stretch: Segment, within: Sequence[Segment]) -> Iterator[tuple[str, FloatArray]]:
    """Rows of the second table, where the gain is measured at enough frequencies."""
    measured = measured_gain(stretch, 0)
    kept = compared(measured)
    omega, reference = measured.omega[kept], decibels(measured.gain[kept])
    if len(omega) < LEAST or not within:
        return

    def figures(parameters: Parameters, likelihood: float = np.nan) -> FloatArray:
        gain = decibels(np.abs(frequency_response(parameters, omega)[0]))
        return np.array([rms(gain - reference), gain.max() - reference.max(), likelihood])

    yield "least squares", figures(least_squares(stretch).parameters)
    cthp = estimate([stretch], PAPER)[1]
    for model in CTHPS:
        parameters, maximum = estimate([stretch], model)
        yield model, figures(parameters, maximum.log_likelihood - cthp.log_likelihood)
    yield ANSWER, figures(answer(within, "II", BEST).parameters)


def unseen(car: tuple[str, ...], runs: Sequence[Scored]) -> list[tuple[Metres, FloatArray]]:
    """RMSE in m of a car's windows, and (2, p) whether estimates are inside, without the car."""
    drawn = defaultdict[tuple[str, ...], list[FloatArray]](list)
    for run in runs:
        drawn[run.car[:2]] += list(run.drawn)
    taught = [np.array(draws) for name, draws in drawn.items() if draws and name != car]
    priors = [log_prior_of_features(BEST, drawn) for drawn in taught]
    population = regularised(learn(taught, priors, BEST, ROUNDS))
    rng, scored = np.random.default_rng(0), []
    for run in runs:
        for k, left_out in enumerate(run.windows if run.car[:2] == car and run.errors else ()):
            others, away = np.delete(run.drawn, k, axis=0), run.drawn[k] - run.drawn[k].mean(axis=0)
            sampled = sampled_population(others, log_prior_of_features(BEST, others), population)
            typical = parameters_of(BEST, sampled.value.mean(axis=0)[None], AT_SPEED)
            errors = rng.choice(away, len(sampled.further))
            further = np.stack([sampled.further, sampled.further + errors], axis=1)
            (lower, upper), own = interval_ends(further, LEVEL), features_of(run.own[k])
            inside = np.where(np.isnan(own), np.nan, (own >= lower) & (own <= upper))
            scored.append((rmse(typical, left_out), inside))
    return scored


def features_of(values: FloatArray) -> FloatArray:
    """(p,) features of the best model from complete parameters (6,); a gain of 0 counts as 1e-9."""
    parameters = Parameters.of(values)
    shape = [parameters.alpha, parameters.beta, float(parameters.time_gap(AT_SPEED))]
    terms = [getattr(parameters, term) for term in FOLLOWING[BEST].terms]
    return np.append(np.log(np.maximum(shape, 1e-9)), terms)


def merged(parts: Sequence[Rows]) -> dict[str, list[FloatArray]]:
    """The rows of several runs as one."""
    return {row: [values for part in parts for values in part[row]] for row in [*parts, {}][0]}


def print_prediction(errors: Rows, cars: Sequence[tuple[str, ...]]) -> None:
    """Print the first table; the windows of each row are those of the cars."""
    means = {row: np.array([np.log(e).mean() for e in rows]) for row, rows in errors.items()}
    reference = np.median(np.concatenate(errors[ONE]))
    print(f"{len(cars)} windows of {len(set(cars))} cars\n")
    print("| parameters | median [m] | geometric mean [m] | ratio | ln RMSE - the answer's |")
    for row, rows in errors.items():
        median, mean = np.median(np.concatenate(rows)), np.exp(means[row].mean())
        more = means[row] - means[ANSWER]
        of_cars = [more[[car == other for other in cars]].mean() for car in dict.fromkeys(cars)]
        print(f"| {row} | {median:.2f} | {mean:.2f} | {median / reference:.2f} |", end="")
        print(f" {np.mean(of_cars):+.2f} ± {sem(of_cars):.2f} |")


def main() -> None:
    """Print the three tables."""
    windows, stretches = windows_of(sys.argv[1]), windows_of(sys.argv[1], 700.0, 250.0)
    every = sorted(windows | stretches)
    given = ([parts.get(car, []) for car in every] for parts in (windows, stretches))
    with ProcessPoolExecutor(WORKERS, mp_context=get_context("spawn")) as pool:
        runs = list(pool.map(score, every, *given))
        of_windows = [run.car[:2] for run in runs if run.errors for _ in run.windows]
        scores = pool.map(partial(unseen, runs=runs), dict.fromkeys(of_windows))
        scored = [one for of_car in scores for one in of_car]
    errors = merged([run.errors for run in runs if run.errors])
    errors[f"{ANSWER}, population without the car"] = [np.array([error]) for error, _ in scored]
    print_prediction(errors, of_windows)
    print("\n| parameters | stretches | rms [dB] | peak [dB] | log-likelihood |")
    for row, rows in merged([run.gains for run in runs if run.gains]).items():
        error, peak, likelihood = np.median(rows, axis=0)
        print(f"| {row} | {len(rows)} | {error:.2f} | {peak:+.1f} | {likelihood:+.0f} |")
    print("\n| further windows | inside [%] | with the estimate's error [%] |")
    shares = 100.0 * np.nanmean([inside for _, inside in scored], axis=0)
    for name, *share in zip(("ln α", "ln β", "ln G", *FOLLOWING[BEST].terms), *shares, strict=True):
        print(f"| {name} | {share[0]:.0f} | {share[1]:.0f} |")


if __name__ == "__main__":
    main()
