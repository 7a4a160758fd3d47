"""Which model predicts the growth along a platoon? `python -m bench.platoon FOLDER ..`.

String stability is a statement about platoons, so this is its judge. Of each recorded platoon of
two followers or more one window of up to `WINDOW` seconds is left out; every candidate is estimated
from the other windows of the platoon and predicts the gain from the speed of one of its vehicles to
that of another at least two places behind: of all cars together, and of every chain within. It is
compared with the gain measured in the window left out, at frequencies from `SLOWEST` to `FASTEST`
whose coherence is at least `COHERENT`. The gain is measured beside a reference (see
`accpinn.stability.measured_gain`), the likeliest parameters of that window itself.

A measured gain has a random error σ in dB, so a frequency weighs 1/(1 + σ²): the rms difference is
the weighted one, and the last row is what σ alone would leave. The peak is the largest gain at
these frequencies. Candidates are

    product       of the cars' |H|, linearised at their median speeds
    chain         the platoon simulated behind the recorded leader, by the same estimator of a gain
    response      a linear response with few terms that is fitted to the cars' measured complex H
    measured      product of the cars' measured gains in the other windows
    corrected     the same, drawn towards the cars' |H| where a gain is hardly measured
    consistency   measured in the window left out: no prediction, but whether gains multiply
"""

import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import suppress
from dataclasses import replace
from functools import cache, partial
from multiprocessing import get_context
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from accpinn.errors import AccpinnError
from accpinn.inference.gain_check import decibels
from accpinn.inference.measured_growth import corrected_gains
from accpinn.model.cthp import Parameters
from accpinn.model.registry import BEST, simulate
from accpinn.recordings.files import read
from accpinn.segment import Segment
from accpinn.segment.cut import cut
from accpinn.segment.windows import plan
from accpinn.stability.criteria import response
from accpinn.stability.measured_gain import MeasuredGain, head_to_tail_gain, measured_gain
from accpinn.study.plan import files_of
from accpinn.units import FloatArray, RadiansPerSecond, Seconds
from bench import prediction
from bench.prediction import over_cars

WINDOW: Seconds = 300.0
"""Longest window that is left out."""
SHORTEST: Seconds = 80.0
"""Shortest window that is left out."""
SLOWEST: RadiansPerSecond = 0.06
FASTEST: RadiansPerSecond = 0.8
COHERENT = 0.6
LEAST = 3
"""Fewest frequencies that are compared."""
WORKERS = 1
Windows = tuple[Segment, ...]
Gain = Callable[[Segment, FloatArray], FloatArray]
"""(K,) the gain of a chain in a window at frequencies (K,)."""
Candidate = Callable[[Windows], Gain]


class Chain(NamedTuple):
    """Some consecutive vehicles of a recorded platoon in its windows."""

    platoon: tuple[str, str]
    """File, and numbers of all vehicles."""
    is_whole: bool
    windows: Windows


@cache
def of_followers(window: Segment, first: int, last: int) -> Segment:
    """The same window with followers ``first`` to ``last`` alone, 0 for the first."""
    ahead, behind, count = slice(first, last + 2), slice(first, last + 1), window.followers + 1
    missing = window.missing
    if missing is not None:
        missing = np.column_stack([missing[:, ahead], missing[:, count:][:, behind]])
    return replace(
        window,
        vehicles=window.vehicles[ahead],
        names=window.names[ahead],
        speeds=window.speeds[:, ahead],
        gaps=window.gaps[:, behind],
        mask=None if window.mask is None else window.mask[:, behind],
        missing=missing,
        longest_time_gaps=window.longest_time_gaps[behind],
    )


def pairs_of(windows: Windows) -> list[Windows]:
    """(M,) the windows of each follower behind the recorded vehicle ahead."""
    count = windows[0].followers
    return [tuple(of_followers(window, k, k) for window in windows) for k in range(count)]


@cache
def car(windows: Windows, model: str, estimator: str) -> Parameters:
    """(1,) the parameters of a follower from its windows."""
    return getattr(prediction, estimator)(windows, model)


def cars(windows: Windows, model: str = BEST, estimator: str = "joint") -> Parameters:
    """(M,) the parameters of each follower."""
    sets = [car(pair, model, estimator) for pair in pairs_of(windows)]
    return Parameters.of(np.concatenate([part.everything for part in sets]))


@cache
def truth(window: Segment) -> MeasuredGain:
    """The gain of a chain that is measured in a window."""
    return head_to_tail_gain((window,), reference=cars((window,)))


def product(model: str, estimator: str, windows: Windows) -> Gain:
    """The product of the cars' |H|."""
    parameters = cars(windows, model, estimator)
    return lambda _, omega: np.asarray(np.abs(response(parameters, omega)).prod(axis=0))


def chain(model: str, estimator: str, windows: Windows) -> Gain:
    """The gain of the platoon that is simulated behind the recorded leader."""
    parameters = cars(windows, model, estimator)

    def gain(window: Segment, omega: FloatArray) -> FloatArray:
        first = window.speeds[0, 1:], window.gaps[0]
        run = simulate(model, parameters, window.time, window.speeds[:, 0], *first)
        driven = replace(window, speeds=run.speeds, missing=None)
        measured = head_to_tail_gain((driven,), reference=cars((window,)))
        return at(measured, omega, cars((window,)))

    return gain


def at(measured: MeasuredGain, omega: FloatArray, model: Parameters) -> FloatArray:
    """A measured gain at other frequencies: its ratio to a model's changes little between them."""
    ratio = np.log(measured.gain / np.abs(response(model, measured.omega)).prod(axis=0))
    between = np.interp(np.log(omega), np.log(measured.omega), ratio)
    return np.asarray(np.exp(between) * np.abs(response(model, omega)).prod(axis=0))


@cache
def gain_of(windows: Windows, reference: str) -> MeasuredGain:
    """The measured gain of a follower from its windows, beside a model by its key, or none."""
    model = car(windows, reference, "joint") if reference else None
    return measured_gain(windows, 0, reference=model)


def gains_of(windows: Windows, reference: str = BEST) -> list[MeasuredGain]:
    """The measured gain of each follower."""
    return [gain_of(pair, reference) for pair in pairs_of(windows)]


def measured(windows: Windows) -> Gain:
    """The product of the cars' measured gains."""
    model, pairs = cars(windows), gains_of(windows)
    return lambda _, omega: np.asarray(
        np.prod([at(pair, omega, model[[k]]) for k, pair in enumerate(pairs)], axis=0)
    )


def plain(windows: Windows) -> Gain:
    """The same without a reference."""
    pairs = gains_of(windows, "")
    return lambda _, omega: np.asarray(
        np.prod([np.interp(omega, pair.omega, pair.gain) for pair in pairs], axis=0)
    )


def corrected(model: str, estimator: str, windows: Windows) -> Gain:
    """The product of measured gains that are drawn towards those of a model."""
    parameters, pairs = cars(windows, model, estimator), gains_of(windows)

    def gain(_: Segment, omega: FloatArray) -> FloatArray:
        mean, _ = corrected_gains(pairs, parameters, omega)
        return np.asarray(np.exp(mean.sum(axis=0)))

    return gain


def consistency(_: Windows) -> Gain:
    """The product of the cars' measured gains in the window left out itself."""
    return lambda window, omega: measured((window,))(window, omega)


# Linear responses that are fitted to the measured complex H.

Complex = NDArray[np.complex128]


def with_delay(s: Complex, x: FloatArray) -> Complex:
    """H of the CTHP behind a delay; x are ln α, ln β, ln τ, ln d."""
    alpha, beta, tau, delay = np.exp(x)
    late = np.exp(-delay * s)
    return np.asarray(
        (beta * s + alpha) * late / (s**2 + (alpha * tau + beta) * late * s + alpha * late)
    )


def with_lag_and_delay(s: Complex, x: FloatArray) -> Complex:
    """The same behind a lag, too; the last of x is ln λ."""
    alpha, beta, tau, delay, lag = np.exp(x)
    late = np.exp(-delay * s) / (1 + lag * s)
    return np.asarray(
        (beta * s + alpha) * late / (s**2 + (alpha * tau + beta) * late * s + alpha * late)
    )


def with_feed_forward(s: Complex, x: FloatArray) -> Complex:
    """The CTHP behind a delay with a gain on the acceleration ahead, the last of x."""
    (alpha, beta, tau, delay), forward = np.exp(x[:4]), x[4]
    late = np.exp(-delay * s)
    above = (forward * s**2 + beta * s + alpha) * late
    return np.asarray(above / (s**2 + (alpha * tau + beta) * late * s + alpha * late))


def third_order(s: Complex, x: FloatArray) -> Complex:
    """A free response of third order behind a delay, with gain 1 at ω = 0."""
    delay, (b2, b1, a3, a2, a1) = np.exp(x[0]), x[1:]
    return np.asarray((b2 * s**2 + b1 * s + 1) * np.exp(-delay * s)
                      / (np.exp(a3) * s**3 + a2 * s**2 + a1 * s + 1))  # fmt: skip


def with_pole_and_zero(s: Complex, x: FloatArray) -> Complex:
    """The CTHP behind a delay with a further zero and pole, the last of x as ln of their times."""
    zero, pole = np.exp(x[4:])
    return with_delay(s, x[:4]) * (1 + zero * s) / (1 + pole * s)


Form = Callable[[Complex, FloatArray], Complex]
CTHP_START = (-2.5, -1.6, 0.2, -0.5)
RESPONSES: Mapping[str, tuple[Form, tuple[float, ...]]] = {
    "delay": (with_delay, CTHP_START),
    "lag and delay": (with_lag_and_delay, (*CTHP_START, -1.0)),
    "feed-forward and delay": (with_feed_forward, (*CTHP_START, 0.0)),
    "pole, zero and delay": (with_pole_and_zero, (*CTHP_START, 0.0, 0.0)),
    "third order and delay": (third_order, (-0.5, 10.0, 5.0, 2.0, 15.0, 8.0)),
}


@cache
def fitted_terms(name: str, windows: Windows) -> FloatArray:
    """The terms of a response that is fitted to a follower's measured complex H."""
    form, start = RESPONSES[name]
    pair = gain_of(windows, BEST)
    used = (pair.omega >= SLOWEST) & (pair.omega <= FASTEST)
    s, wanted, coherence = 1j * pair.omega[used], pair.response[used], pair.coherence[used]
    weight = np.sqrt(coherence / np.maximum(1 - coherence, 0.02))

    def apart(x: FloatArray) -> FloatArray:
        with np.errstate(all="ignore"):
            error = weight * (form(s, x) / wanted - 1)
        return np.nan_to_num(np.concatenate([error.real, error.imag]), nan=1e3)

    return np.asarray(least_squares(apart, start, loss="soft_l1", max_nfev=200).x)


def fitted(name: str, windows: Windows) -> Gain:
    """The product of responses that are fitted to each car's measured complex H."""
    form, _ = RESPONSES[name]
    sets = [fitted_terms(name, pair) for pair in pairs_of(windows)]
    return lambda _, omega: np.asarray(np.prod([abs(form(1j * omega, x)) for x in sets], axis=0))


CANDIDATES: dict[str, Candidate] = {
    f"product, {BEST}": partial(product, BEST, "joint"),
    f"product, {BEST}, simulation": partial(product, BEST, "simulation"),
    "product, cthp-s0-lag, simulation": partial(product, "cthp-s0-lag", "simulation"),
    "product, idm": partial(product, "idm", "joint"),
    "product, fvdm": partial(product, "fvdm", "joint"),
    f"chain, {BEST}": partial(chain, BEST, "joint"),
    f"chain, {BEST}, simulation": partial(chain, BEST, "simulation"),
    "chain, cthp-s0-lag, simulation": partial(chain, "cthp-s0-lag", "simulation"),
    "chain, idm": partial(chain, "idm", "joint"),
    "chain, fvdm": partial(chain, "fvdm", "joint"),
    "chain, unequal": partial(chain, "unequal", "joint"),
    **{f"response, {name}": partial(fitted, name) for name in RESPONSES},
    "measured, without reference": plain,
    "measured": measured,
    f"corrected, {BEST}": partial(corrected, BEST, "joint"),
    f"corrected, {BEST}, simulation": partial(corrected, BEST, "simulation"),
    "corrected, fvdm": partial(corrected, "fvdm", "joint"),
    "consistency": consistency,
}
"""Candidates by name, the reference of the paired differences first."""


class Compared(NamedTuple):
    """A candidate's prediction beside what was measured in a window left out."""

    rms: float
    """In dB."""
    peak: float
    """Largest gain beyond the measured one in dB."""


NOTHING = Compared(np.nan, np.nan)


def compared(gain: Gain, window: Segment) -> Compared:
    """A prediction in a window left out; nan where too few frequencies are coherent."""
    measured = truth(window)
    used = (measured.omega >= SLOWEST) & (measured.omega <= FASTEST)
    used &= measured.coherence >= COHERENT
    if used.sum() < LEAST:
        return NOTHING
    weights = 1 / (1 + decibels(np.exp(measured.error[used])) ** 2)
    levels = decibels(np.array([gain(window, measured.omega[used]), measured.gain[used]]))
    square = np.average((levels[0] - levels[1]) ** 2, weights=weights)
    return Compared(float(np.sqrt(square)), float(levels[0].max() - levels[1].max()))


def noise(window: Segment) -> float:
    """The rms difference that the random error of the measured gain leaves, in dB."""
    measured = truth(window)
    used = (measured.omega >= SLOWEST) & (measured.omega <= FASTEST)
    used &= measured.coherence >= COHERENT
    sigma = decibels(np.exp(measured.error[used]))
    return float(np.sqrt(np.average(sigma**2, weights=1 / (1 + sigma**2)))) if used.any() else 0.0


def chains_of(folder: str) -> Iterator[Chain]:
    """Each recorded platoon with two windows or more, and every chain of two followers within."""
    for path in files_of(folder):
        platoons: dict[tuple[int, ...], list[Segment]] = {}
        with suppress(AccpinnError):  # a file that cannot be read has no windows
            recording = read(path)
            for planned in plan(recording, WINDOW):
                if len(planned.vehicles) > 2 and planned.window.duration >= SHORTEST:
                    window = planned.window
                    segment = cut(recording, window.start, window.duration, planned.vehicles)
                    platoons.setdefault(planned.vehicles, []).append(segment)
        for vehicles, windows in platoons.items():
            count = len(vehicles) - 1
            for first in range(count - 1 if len(windows) > 1 else 0):
                for last in range(first + 1, count):
                    parts = tuple(of_followers(window, first, last) for window in windows)
                    is_whole = last - first + 1 == count
                    yield Chain((path.name, "-".join(map(str, vehicles))), is_whole, parts)


def judged(chain: Chain, place: int) -> dict[str, Compared]:
    """All candidates in one window left out."""
    window = chain.windows[place]
    others = tuple(other for other in chain.windows if other is not window)
    scores = {}
    for name, candidate in CANDIDATES.items():
        try:
            scores[name] = compared(candidate(others), window)
        except (AccpinnError, ValueError, np.linalg.LinAlgError):
            scores[name] = NOTHING
    return scores


def print_table(chains: Sequence[Chain], scores: Sequence[dict[str, Compared]]) -> None:
    """Print a row a candidate: medians over windows, and the paired difference."""
    first = np.array([row[next(iter(CANDIDATES))].rms for row in scores])
    print("| candidate | windows | rms [dB] | peak [dB] | \\|peak\\| [dB] | rms − first [dB] |")
    print("|---|---|---|---|---|---|")
    for name in CANDIDATES:
        rms, peak = np.array([row[name] for row in scores]).T
        seen = np.isfinite(rms) & np.isfinite(first)
        if not seen.any():
            continue
        keys = [chain.platoon for chain, is_seen in zip(chains, seen, strict=True) if is_seen]
        mean, error = over_cars(keys, (rms - first)[seen])
        print(
            f"| {name} | {seen.sum()} | {np.median(rms[seen]):.2f} | {np.median(peak[seen]):+.1f}"
            f" | {np.median(abs(peak[seen])):.1f} | {mean:+.2f} ± {error:.2f} |"
        )


def main() -> None:
    """Print both tables: of whole platoons, and of all chains within them."""
    chains = [chain for folder in sys.argv[1:] for chain in chains_of(folder)]
    tasks = [(chain, place) for chain in chains for place in range(len(chain.windows))]
    if WORKERS > 1:
        with ProcessPoolExecutor(WORKERS, mp_context=get_context("spawn")) as pool:
            scores = list(pool.map(judged, *zip(*tasks, strict=True)))
    else:
        scores = [judged(*task) for task in tasks]
    for title, chosen in (
        ("Whole platoons", [k for k, (chain, _) in enumerate(tasks) if chain.is_whole]),
        ("All chains of two followers or more", [*range(len(tasks))]),
    ):
        rows, parts = [scores[k] for k in chosen], [tasks[k] for k in chosen]
        print(f"{title}: {len({chain.platoon for chain, _ in parts})} platoons\n")
        print_table([chain for chain, _ in parts], rows)
        left = [noise(chain.windows[place]) for chain, place in parts]
        print(f"| random error alone | {len(left)} | {np.median(left):.2f} | | | |\n")


if __name__ == "__main__":
    main()
