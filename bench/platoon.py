"""Which model predicts the growth along a platoon? `python -m bench.platoon FOLDER`.

String stability is a statement about platoons, so this is its judge. Of each recorded platoon of
two followers or more one window of `WINDOW` seconds is left out; every candidate is estimated from
the other windows of the platoon and predicts the head-to-tail gain from the leader's speed to that
of the last car. It is compared with the gain measured in the window left out (Welch's method) at
frequencies from `SLOWEST` to `FASTEST` whose coherence is at least `COHERENT`: rms difference in
dB, and that of the largest gain. Candidates are

    product       of the cars' |H|, linearised at their median speeds
    chain         the platoon simulated behind the recorded leader, by the same estimator of a gain
    response      a linear response with few terms that is fitted to the cars' measured complex H
    measured      product of the cars' measured gains in the other windows
    consistency   the same in the window left out: no prediction, but whether gains multiply
"""

import sys
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import suppress
from dataclasses import replace
from functools import cache, partial
from multiprocessing import get_context
from typing import NamedTuple

import numpy as np
from scipy.optimize import least_squares
from scipy.signal import csd

from accpinn.errors import AccpinnError
from accpinn.model.cthp import Parameters
from accpinn.model.registry import BEST, simulate
from accpinn.recordings.files import read
from accpinn.segment import Segment
from accpinn.segment.cut import cut
from accpinn.stability.criteria import response
from accpinn.stability.measured_gain import MeasuredGain, measured_gain
from accpinn.study.plan import files_of, plan
from accpinn.units import FloatArray, RadiansPerSecond, Seconds
from bench.prediction import WORKERS, joint, likelihood, over_cars, simulation

WINDOW, SHORTEST = 300.0, 140.0
"""Longest and shortest window that is left out, in s."""
SLOWEST: RadiansPerSecond = 0.06
FASTEST: RadiansPerSecond = 0.8
COHERENT = 0.6
LEAST = 4
"""Fewest frequencies that are compared."""
PIECE: Seconds = 60.0
"""Length of a piece where complex responses are measured."""
Windows = Sequence[Segment]
Gain = Callable[[Segment, FloatArray], FloatArray]
"""(K,) the head-to-tail gain in a window at frequencies (K,)."""
Candidate = Callable[[Windows], Gain]


def head_to_tail(window: Segment, speeds: FloatArray | None = None) -> MeasuredGain:
    """The measured gain from the leader to the last car, of recorded or other speeds (N, M+1)."""
    pair = window.pair(0)
    ends = (window.speeds if speeds is None else speeds)[:, [0, -1]]
    return measured_gain(replace(pair, speeds=ends), 0)


def cars_of(
    windows: Windows, estimator: Callable[[Windows, str], Parameters], model: str
) -> Parameters:
    """(M,) the parameters of each follower from some windows."""
    sets = [
        estimator([window.pair(k) for window in windows], model)
        for k in range(windows[0].followers)
    ]
    return Parameters.of(np.concatenate([part.everything for part in sets]))


def product(estimator: Callable[[Windows, str], Parameters], model: str, windows: Windows) -> Gain:
    """The product of the cars' |H|."""
    parameters = cars_of(windows, estimator, model)
    return lambda _, omega: np.asarray(np.abs(response(parameters, omega)).prod(axis=0))


def chain(estimator: Callable[[Windows, str], Parameters], model: str, windows: Windows) -> Gain:
    """The gain of the platoon that is simulated behind the recorded leader."""
    parameters = cars_of(windows, estimator, model)

    def gain(window: Segment, omega: FloatArray) -> FloatArray:
        first = window.speeds[0, 1:], window.gaps[0]
        run = simulate(model, parameters, window.time, window.speeds[:, 0], *first)
        measured = head_to_tail(window, run.speeds)
        return np.interp(omega, measured.omega, measured.gain)

    return gain


def measured(windows: Windows) -> Gain:
    """The product of the cars' measured gains."""
    gains = [measured_gain(tuple(windows), k) for k in range(windows[0].followers)]
    return lambda _, omega: np.asarray(
        np.prod([np.interp(omega, gain.omega, gain.gain) for gain in gains], axis=0)
    )


def consistency(_: Windows) -> Gain:
    """The product of the cars' measured gains in the window left out itself."""
    return lambda window, omega: measured([window])(window, omega)


# Linear responses that are fitted to the measured complex H.


def with_delay(s: FloatArray, x: FloatArray) -> FloatArray:
    """H of the CTHP behind a delay; x are ln α, ln β, ln τ, ln d."""
    alpha, beta, tau, delay = np.exp(x)
    late = np.exp(-delay * s)
    return np.asarray(
        (beta * s + alpha) * late / (s**2 + (alpha * tau + beta) * late * s + alpha * late)
    )


def with_lag_and_delay(s: FloatArray, x: FloatArray) -> FloatArray:
    """The same behind a lag, too; the last of x is ln λ."""
    alpha, beta, tau, delay, lag = np.exp(x)
    late = np.exp(-delay * s) / (1 + lag * s)
    return np.asarray(
        (beta * s + alpha) * late / (s**2 + (alpha * tau + beta) * late * s + alpha * late)
    )


def with_feed_forward(s: FloatArray, x: FloatArray) -> FloatArray:
    """The CTHP behind a delay with a gain on the acceleration ahead, the last of x."""
    (alpha, beta, tau, delay), forward = np.exp(x[:4]), x[4]
    late = np.exp(-delay * s)
    above = (forward * s**2 + beta * s + alpha) * late
    return np.asarray(above / (s**2 + (alpha * tau + beta) * late * s + alpha * late))


def third_order(s: FloatArray, x: FloatArray) -> FloatArray:
    """A free response of third order behind a delay, with gain 1 at ω = 0."""
    delay, (b2, b1, a3, a2, a1) = np.exp(x[0]), x[1:]
    return np.asarray((b2 * s**2 + b1 * s + 1) * np.exp(-delay * s)
                      / (np.exp(a3) * s**3 + a2 * s**2 + a1 * s + 1))  # fmt: skip


RESPONSES: dict[str, tuple[Callable[[FloatArray, FloatArray], FloatArray], tuple[float, ...]]] = {
    "delay": (with_delay, (-2.5, -1.6, 0.2, -0.5)),
    "lag and delay": (with_lag_and_delay, (-2.5, -1.6, 0.2, -1.0, -1.0)),
    "feed-forward and delay": (with_feed_forward, (-2.5, -1.6, 0.2, -0.5, 0.0)),
    "third order and delay": (third_order, (-0.5, 10.0, 5.0, 2.0, 15.0, 8.0)),
}


def complex_response(windows: Windows, follower: int) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Frequencies, the measured complex H of a follower, and the weight of each."""
    parts = []
    for window in windows:
        rate = 1 / window.sample_time
        size = min(round(PIECE * rate), window.samples // 2)
        ahead, own = np.diff(window.speeds[:, follower : follower + 2], axis=0).T
        size = round(PIECE * rate) if window.samples > PIECE * rate else size
        pairs = ((ahead, ahead), (ahead, own), (own, own))
        spectra = [csd(x, y, rate, nperseg=size, nfft=round(PIECE * rate)) for x, y in pairs]
        parts.append(window.samples * np.array([density for _, density in spectra]))
        omega = 2 * np.pi * spectra[0][0]
    ahead, cross, own = np.sum(parts, axis=0)
    kept = (omega >= SLOWEST) & (omega <= FASTEST)
    coherence = abs(cross) ** 2 / (ahead.real * own.real)
    weight = np.sqrt(coherence / np.maximum(1 - coherence, 0.02))
    return omega[kept], (cross / ahead)[kept], weight[kept]


def fitted(name: str, windows: Windows) -> Gain:
    """The product of responses that are fitted to each car's measured complex H."""
    form, start = RESPONSES[name]
    found = []
    for k in range(windows[0].followers):
        omega, wanted, weight = complex_response(windows, k)

        def apart(
            x: FloatArray, omega: FloatArray = omega, wanted: FloatArray = wanted,
            weight: FloatArray = weight,
        ) -> FloatArray:  # fmt: skip
            with np.errstate(all="ignore"):
                error = weight * (form(1j * omega, x) / wanted - 1)
            return np.nan_to_num(np.concatenate([error.real, error.imag]), nan=1e3)

        found.append(least_squares(apart, start, loss="soft_l1").x)

    return lambda _, omega: np.asarray(np.prod([abs(form(1j * omega, x)) for x in found], axis=0))


CANDIDATES: dict[str, Candidate] = {
    f"product, {BEST}": partial(product, likelihood, BEST),
    "product, cthp-s0-lag, simulation": partial(product, simulation, "cthp-s0-lag"),
    "product, idm-delay": partial(product, joint, "idm-delay"),
    f"chain, {BEST}": partial(chain, likelihood, BEST),
    "chain, cthp-s0-delay, simulation": partial(chain, simulation, BEST),
    "chain, idm": partial(chain, joint, "idm"),
    "chain, fvdm": partial(chain, joint, "fvdm"),
    "chain, unequal": partial(chain, joint, "unequal"),
    "chain, unequal-delay": partial(chain, joint, "unequal-delay"),
    **{f"response, {name}": partial(fitted, name) for name in RESPONSES},
    "measured": measured,
    "consistency": consistency,
}


class Compared(NamedTuple):
    """A candidate's prediction beside what was measured in a window left out."""

    rms: float
    """In dB."""
    peak: float
    """Largest gain beyond the measured one in dB."""


def compared(gain: Gain, window: Segment) -> Compared:
    """A prediction in a window left out; nan where too few frequencies are coherent."""
    truth = head_to_tail(window)
    at = (truth.omega >= SLOWEST) & (truth.omega <= FASTEST) & (truth.coherence >= COHERENT)
    if at.sum() < LEAST:
        return Compared(np.nan, np.nan)
    levels = 20 * np.log10([gain(window, truth.omega[at]), truth.gain[at]])
    return Compared(
        float(np.sqrt(np.mean((levels[0] - levels[1]) ** 2))),
        float(levels[0].max() - levels[1].max()),
    )


def platoons_of(folder: str) -> dict[tuple[str, str], list[Segment]]:
    """The windows of each recorded platoon of two followers or more, by file and vehicles."""
    platoons: dict[tuple[str, str], list[Segment]] = {}
    for path in files_of(folder):
        with suppress(AccpinnError):  # a file that cannot be read has no windows
            recording = read(path)
            for planned in plan(recording, WINDOW):
                if len(planned.vehicles) > 2 and planned.window.duration >= SHORTEST:
                    window = planned.window
                    segment = cut(recording, window.start, window.duration, planned.vehicles)
                    key = path.name, "-".join(map(str, planned.vehicles))
                    platoons.setdefault(key, []).append(segment)
    return {key: windows for key, windows in platoons.items() if len(windows) > 1}


def judged(windows: Windows, place: int) -> dict[str, Compared]:
    """All candidates in one window left out."""
    others = [window for k, window in enumerate(windows) if k != place]
    found = {}
    for name, candidate in CANDIDATES.items():
        try:
            found[name] = compared(candidate(others), windows[place])
        except (AccpinnError, ValueError, np.linalg.LinAlgError):
            found[name] = Compared(np.nan, np.nan)
    return found


@cache
def _columns() -> str:
    return "| candidate | rms [dB] | peak [dB] | rms − that of the first [dB] |\n|---|---|---|---|"


def main() -> None:
    """Print the table."""
    platoons = platoons_of(sys.argv[1])
    tasks = [(key, windows, k) for key, windows in platoons.items() for k in range(len(windows))]
    with ProcessPoolExecutor(WORKERS, mp_context=get_context("spawn")) as pool:
        rows = list(pool.map(judged, *zip(*[task[1:] for task in tasks], strict=True)))
    keys = [key for key, *_ in tasks]
    print(f"{len(tasks)} windows of {len(platoons)} platoons: {', '.join(map(' '.join, platoons))}")
    print(_columns())
    first = np.array([row[next(iter(CANDIDATES))].rms for row in rows])
    for name in CANDIDATES:
        rms, peak = np.array([row[name] for row in rows]).T
        seen = np.isfinite(rms) & np.isfinite(first)
        if not seen.any():
            continue
        chosen = [key for key, is_seen in zip(keys, seen, strict=True) if is_seen]
        mean, error = over_cars(chosen, (rms - first)[seen])
        print(
            f"| {name} | {np.median(rms[seen]):.2f} | {np.median(peak[seen]):+.1f}"
            f" | {mean:+.2f} ± {error:.2f} |"
        )


if __name__ == "__main__":
    main()
