"""Do parameters describe the same car in another window? `python -m bench.prediction FOLDER`.

Three tables judge parameters on the recordings of a folder. In all of them each follower is by
itself, behind the measured vehicle ahead.

Prediction: one window of 100 to 150 s is left out, and the parameters from the other windows of the
recording drive it in closed loop, from its first instant on; the error is the RMSE of the gap.
Paired differences are those of ln RMSE, averaged over the windows of a car; their standard error is
that of the mean over cars.

Measured gain: in stretches of 250 to 700 s the model's |H| is compared with Welch's estimate, at
frequencies up to 1 rad/s with a coherence of at least 0.8.

Further windows: the share of left-out windows whose own maximum-likelihood estimate lies in the
90 % interval for a further window, where neither the window nor the car taught the population.
"""

import sys
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field
from functools import partial
from multiprocessing import get_context

import numpy as np

from accpinn.errors import SegmentError
from accpinn.inference.answer import answer, from_features, window_posterior
from accpinn.inference.intervals import LEVEL, interval_ends
from accpinn.inference.population import sampled_population
from accpinn.inference.posterior import AT_SPEED, log_prior_of_features
from accpinn.methods.least_squares import fit as least_squares
from accpinn.methods.likelihood import Maximum
from accpinn.methods.maximum_likelihood import joint_maxima
from accpinn.methods.series import determined_followers
from accpinn.methods.state_space import complete
from accpinn.model.cthp import Parameters, simulate
from accpinn.model.models import BEST, MODELS, PAPER, Model, terms_of
from accpinn.segment.segment import Segment
from accpinn.stability.lagged import lagged_response
from accpinn.stability.measured_gain import measured_gain
from accpinn.units import FloatArray, Metres
from bench.population import Car, learn, windows_of

JOINT: tuple[Model, ...] = ("cthp", "cthp-s0", "cthp-s0-lag", "cthp-s0-delay")
ANSWERS: tuple[Model, ...] = ("cthp", "cthp-s0", "cthp-s0-delay")
ONE, BEST_ROW = "CTHP, one other window", f"answer, {BEST}"
UNSEEN = f"answer, {BEST}, population without the car"
FASTEST, COHERENT, LEAST = 1.0, 0.8, 5
"""Highest frequency in rad/s, least coherence, and least number of such frequencies."""
ROUNDS = 5
"""Rounds in which a population without one car is learned."""
WORKERS = 2


@dataclass
class Judged:
    """What the windows of one follower in one recording gave."""

    car: Car
    errors: dict[str, list[FloatArray]] = field(default_factory=lambda: defaultdict(list))
    """By row of the first table, and for each window: RMSE in m for each source of parameters."""
    segments: list[Segment] = field(default_factory=list)
    """The K windows that determine parameters."""
    own: FloatArray = field(default_factory=lambda: np.zeros((0, 6)))
    """(K, 6) maximum-likelihood estimates under the best model."""
    drawn: FloatArray = field(default_factory=lambda: np.zeros((0, 0, 0)))
    """(K, n, p) posterior draws of the windows under the best model."""
    gains: dict[str, list[FloatArray]] = field(default_factory=lambda: defaultdict(list))
    """By row of the second table: rms and peak error in dB, and log-likelihood over the CTHP's."""


def rmse(parameters: Parameters, segment: Segment) -> Metres:
    """RMSE of the gap in a window that the parameters drive from its first instant on."""
    speeds, gaps = segment.speeds, segment.gaps
    with np.errstate(all="ignore"):
        driven = simulate(parameters, segment.time, speeds[:, 0], speeds[0, 1:], gaps[0])
    return float(np.sqrt(np.mean((driven.gaps - gaps) ** 2)))


def time_gap_rmse(others: Sequence[Segment], segment: Segment) -> Metres:
    """The same of a vehicle that keeps the median time gap of other windows at each instant."""
    time_gaps = [other.gaps / np.maximum(other.speeds[:, 1:], 1.0) for other in others]
    kept = np.median(np.concatenate(time_gaps)) * segment.speeds[:, :1]
    return float(np.sqrt(np.mean((kept - segment.gaps) ** 2)))


def estimate(segments: Sequence[Segment], model: Model) -> tuple[Parameters, Maximum]:
    """The parameters of greatest likelihood in all of some windows together."""
    (maximum,) = joint_maxima(tuple(segments), "II", model)
    values = np.append(maximum.theta, maximum.values[3:])
    return Parameters.of(complete(model, values)[None]), maximum


def judge(car: Car, segments: Sequence[Segment], stretches: Sequence[Segment]) -> Judged:
    """Both tables for one follower in one recording."""
    judged = Judged(car)
    known = [segment for segment in segments if determined_followers((segment,), "II")]
    judged.segments = known
    if known:
        posteriors = [window_posterior(segment, "II", BEST) for segment in known]
        judged.own = np.array([posterior.estimates[0] for posterior in posteriors])
        judged.drawn = np.array([posterior.drawn[0] for posterior in posteriors])
    for left_out in known if len(known) > 1 else ():
        others = [segment for segment in known if segment is not left_out]
        for row, errors in _errors(left_out, others):
            judged.errors[row].append(np.array(errors))
    for stretch in stretches:
        ends = stretch.start - 1.0, stretch.window.end + 1.0
        within = [s for s in known if ends[0] <= s.start and s.window.end <= ends[1]]
        for row, figures in _gains(stretch, within):
            judged.gains[row].append(figures)
    return judged


def _errors(left_out: Segment, others: list[Segment]) -> Iterator[tuple[str, list[Metres]]]:
    """Rows of the first table with the errors in the window that is left out."""
    yield "constant time gap", [time_gap_rmse(others, left_out)]
    solved = [rmse(least_squares(other).parameters, left_out) for other in others]
    yield "least squares, one other window", solved
    for row, model in ((ONE, PAPER), ("cthp-s0, one other window", "cthp-s0")):
        yield row, [rmse(estimate([other], model)[0], left_out) for other in others]
    for model in JOINT:
        yield f"{model}, one likelihood of all others", [rmse(estimate(others, model)[0], left_out)]
    for model in ANSWERS:
        yield f"answer, {model}", [rmse(answer(others, "II", model).parameters, left_out)]
    for model in ("cthp", "cthp-s0", "cthp-s0-delay"):
        yield f"{model}, the window's own fit", [rmse(estimate([left_out], model)[0], left_out)]


def _gains(stretch: Segment, within: Sequence[Segment]) -> Iterator[tuple[str, FloatArray]]:
    """Rows of the second table, where the gain is measured at enough frequencies."""
    try:
        measured = measured_gain(stretch, 0)
    except SegmentError:
        return
    kept = (measured.omega <= FASTEST) & (measured.coherence >= COHERENT)
    if kept.sum() < LEAST or not determined_followers((stretch,), "II"):
        return
    reference = 20.0 * np.log10(measured.gain[kept])

    def compared(parameters: Parameters, likelihood: float) -> FloatArray:
        gain = 20.0 * np.log10(np.abs(lagged_response(parameters, measured.omega[kept])[0]))
        rms = np.sqrt(np.mean((gain - reference) ** 2))
        return np.array([rms, gain.max() - reference.max(), likelihood])

    yield "least squares", compared(least_squares(stretch).parameters, np.nan)
    base = 0.0
    for model in MODELS:
        parameters, maximum = estimate([stretch], model)
        base = maximum.log_likelihood if model == PAPER else base
        yield model, compared(parameters, maximum.log_likelihood - base)
    if within:
        yield BEST_ROW, compared(answer(within, "II", BEST).parameters, np.nan)


def unseen(car: tuple[str, ...], runs: Sequence[Judged]) -> list[tuple[Metres, FloatArray]]:
    """Judge the answer for each window of a car, by a population without that car.

    Returns:
        RMSE in m for each window, and (p,) 1 where its own estimate is inside the interval for a
        further window, 0 where it is not, nan where it has none.
    """
    cars: dict[tuple[str, ...], list[FloatArray]] = defaultdict(list)
    for run in runs:
        if len(run.drawn) and run.car[:2] != car:
            cars[run.car[:2]].append(run.drawn)
    population = learn([np.concatenate(drawn) for drawn in cars.values()], BEST, ROUNDS)
    judged = []
    for run in runs:
        for k, left_out in enumerate(run.segments):
            if run.car[:2] != car or len(run.segments) < 2:
                continue
            others = np.delete(run.drawn, k, axis=0)
            prior = log_prior_of_features(BEST, others)
            sampled = sampled_population(others, prior, population)
            typical = Parameters.of(from_features(BEST, sampled.value.mean(axis=0)[None]))
            lower, upper = interval_ends(sampled.further, LEVEL)
            own = features_of(run.own[k])
            inside = np.where(np.isnan(own), np.nan, (own >= lower) & (own <= upper))
            judged.append((rmse(typical, left_out), inside))
    return judged


def features_of(values: FloatArray) -> FloatArray:
    """(p,) the features of the best model, of complete parameters (6,); nan without a logarithm."""
    parameters = Parameters.of(values)
    shape = [parameters.alpha, parameters.beta, float(parameters.time_gap(AT_SPEED))]
    with np.errstate(divide="ignore"):
        logarithms = np.log(shape)
    terms = [getattr(parameters, term) for term in terms_of(BEST)]
    return np.append(logarithms, terms)


def clustered(differences: Sequence[float], cars: Sequence[tuple[str, ...]]) -> tuple[float, float]:
    """Mean over cars of each one's mean difference, and its standard error."""
    values = np.array(differences)
    means = [values[[car == other for other in cars]].mean() for car in dict.fromkeys(cars)]
    return float(np.mean(means)), float(np.std(means, ddof=1) / np.sqrt(len(means)))


def print_prediction(errors: Mapping[str, list[FloatArray]], cars: list[tuple[str, ...]]) -> None:
    """Print the first table."""
    logarithms = {row: np.array([np.log(e).mean() for e in rows]) for row, rows in errors.items()}
    reference = np.median(np.concatenate(errors[ONE]))
    print(f"Prediction: {len(cars)} windows of {len(set(cars))} cars\n")
    print("| parameters | median [m] | geometric mean [m] | ratio | ln RMSE over the answer's |")
    print("|---|---|---|---|---|")
    for row, rows in errors.items():
        median, typical = np.median(np.concatenate(rows)), np.exp(logarithms[row].mean())
        mean, error = clustered(logarithms[row] - logarithms[BEST_ROW], cars)
        print(f"| {row} | {median:.2f} | {typical:.2f} | {median / reference:.2f} |", end="")
        print(f" {mean:+.2f} ± {error:.2f} |")


def print_gains(gains: Mapping[str, list[FloatArray]]) -> None:
    """Print the second table."""
    print("\nMeasured gain\n\n| parameters | stretches | rms [dB] | peak [dB] | log-likelihood |")
    print("|---|---|---|---|---|")
    for row, rows in gains.items():
        rms, peak, likelihood = np.median(rows, axis=0)
        print(f"| {row} | {len(rows)} | {rms:.2f} | {peak:+.1f} | {likelihood:+.0f} |")


def main() -> None:
    """Print the three tables."""
    windows, stretches = windows_of(sys.argv[1]), windows_of(sys.argv[1], 700.0, 250.0)
    with ProcessPoolExecutor(WORKERS, mp_context=get_context("spawn")) as pool:
        every = list(windows | stretches)
        given = ([of.get(car, []) for car in every] for of in (windows, stretches))
        runs = list(pool.map(judge, every, *given))
        cars = list(dict.fromkeys(run.car[:2] for run in runs if run.errors))
        judged = dict(zip(cars, pool.map(partial(unseen, runs=runs), cars), strict=True))
    errors: dict[str, list[FloatArray]] = defaultdict(list)
    of_windows: list[tuple[str, ...]] = []
    for car in cars:
        for run in runs:
            if run.car[:2] == car and run.errors:
                of_windows += [car] * len(run.segments)
                for row, rows in run.errors.items():
                    errors[row] += rows
        errors[UNSEEN] += [np.array([error]) for error, _ in judged[car]]
    print_prediction(errors, of_windows)
    gains: dict[str, list[FloatArray]] = defaultdict(list)
    for run in runs:
        for row, rows in run.gains.items():
            gains[row] += rows
    print_gains(gains)
    inside = np.array([row for rows in judged.values() for _, row in rows])
    names = ("ln α", "ln β", "ln G", *terms_of(BEST))
    print("\nFurther windows inside the interval\n")
    for name, column in zip(names, inside.T, strict=True):
        print(f"| {name} | {100 * np.nanmean(column):.0f} % of {np.isfinite(column).sum()} |")


if __name__ == "__main__":
    main()
