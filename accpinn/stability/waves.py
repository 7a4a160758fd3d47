"""How much a wave of any shape and size grows from car to car, by any model, once it is steady.

Behind a speed u(t) that repeats itself with the frequency ω, so does a follower's steady motion:

    p' = u - v,   v' = f(p, v, u);   behind a lag  λv'' + v' = f;   behind a delay  v'(t) = f(t - d)

At `POINTS` instants of a period derivatives and the delay are matrices (trigonometric collocation),
and with v = u - p' one equation for the gaps p is left, which Newton's method solves with exact
derivatives. The mean of p follows, too: a model that reacts unequally keeps another mean gap in a
wave than in equilibrium.

Of a linear model this is |H|. Of any other the growth depends on the size A of the wave, and a
braking wave (the speed falls below its mean) may grow otherwise than an accelerating one:

    harmonic       |V₁| / A      the describing function, V₁ the first harmonic of v
    braking        -min(v - v̄) / A
    accelerating    max(v - v̄) / A

Sources: Trefethen, Spectral Methods in MATLAB, SIAM 2000, chapter 3, for the matrices; Gelb and
Vander Velde, Multiple-Input Describing Functions, McGraw-Hill 1968.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from accpinn.errors import ParameterError
from accpinn.model.following import COMPLEX_STEP, FollowingModel, Values
from accpinn.units import FloatArray, MetresPerSecond, RadiansPerSecond, frozen

POINTS = 65
"""Instants of a period; odd, so that every harmonic has its sine and cosine."""
ROUNDS, CONVERGED = 60, 1e-10
"""Most steps of Newton's method, and the residual in m/s² at which it ends."""


@dataclass(frozen=True, eq=False)
class WaveGrowth:
    """The growth of a wave from the car ahead to a follower, at frequencies (F,)."""

    omega: FloatArray
    """(F,) in rad/s."""
    harmonic: FloatArray
    """(F,) of the first harmonic."""
    braking: FloatArray
    """(F,) of the largest deviation below the mean speed."""
    accelerating: FloatArray
    """(F,) of the largest deviation above it."""


def wave_growth(
    model: FollowingModel,
    theta: Values,
    speed: MetresPerSecond,
    omega: Sequence[RadiansPerSecond] | FloatArray,
    amplitude: MetresPerSecond = 1.0,
) -> WaveGrowth:
    """The growth of a sinusoid of some amplitude about a speed; nan where there is no steady wave.

    Args:
        model: of the follower.
        theta: (n,) its parameters.
        speed: mean speed.
        omega: (F,) frequencies.
        amplitude: that of the speed ahead.

    Raises:
        ParameterError: without an equilibrium at the speed.
    """
    phase = 2 * np.pi * np.arange(POINTS) / POINTS
    rows = []
    for frequency in omega:
        wave = steady_wave(model, theta, speed, frequency, amplitude * np.sin(phase))
        first = 2 * abs(np.exp(-1j * phase) @ wave) / POINTS
        rows.append((first, -wave.min(), wave.max()))
    harmonic, braking, accelerating = np.array(rows).reshape(-1, 3).T / amplitude
    return WaveGrowth(np.asarray(omega, float), harmonic, braking, accelerating)


def steady_wave(
    model: FollowingModel,
    theta: Values,
    speed: MetresPerSecond,
    omega: RadiansPerSecond,
    ahead: FloatArray,
) -> FloatArray:
    """(`POINTS`,) the follower's deviations of speed from the mean, in m/s, over a period.

    Args:
        model: of the follower.
        theta: (n,) its parameters.
        speed: mean speed.
        omega: frequency of the wave.
        ahead: (`POINTS`,) deviations of the speed ahead at even instants of a period.

    Returns:
        The deviations; nan where Newton's method finds no steady motion.

    Raises:
        ParameterError: without an equilibrium at the speed.
    """
    theta = np.asarray(theta, float)
    gap = float(model.equilibrium_gaps(theta, speed))
    if not np.isfinite(gap):
        raise ParameterError(
            f"{model.title}: these parameters have no equilibrium at {speed:.1f} m/s; choose"
            " another speed."
        )
    slope, leader = omega * _slope(), speed + ahead
    lag, delay = float(model.term(theta, "lag")), float(model.term(theta, "delay"))
    inertia = slope + lag * slope @ slope
    late = _shift(omega * delay) if delay else np.eye(POINTS)

    def residual(gaps: FloatArray) -> FloatArray:
        own = leader - slope @ gaps
        command = np.asarray(model.acceleration(gaps, own, leader, theta, np), float)
        return np.asarray(inertia @ own - late @ command)

    gaps = np.full(POINTS, gap)
    with np.errstate(all="ignore"):  # what leaves the model's domain is not finite
        left = residual(gaps)
        for _ in range(ROUNDS):
            if not np.isfinite(left).all() or abs(left).max() < CONVERGED:
                break
            own = leader - slope @ gaps
            by_gap, by_speed = (
                np.imag(model.acceleration(gaps + h, own + j, leader, theta, np)) / COMPLEX_STEP
                for h, j in ((COMPLEX_STEP * 1j, 0.0), (0.0, COMPLEX_STEP * 1j))
            )
            turn = -inertia @ slope - late @ (np.diag(by_gap) - by_speed[:, None] * slope)
            step = np.linalg.solve(turn, -left)
            for share in 0.5 ** np.arange(8):
                trial = residual(gaps + share * step)
                if np.isfinite(trial).all() and abs(trial).max() < abs(left).max():
                    break
            gaps, left = gaps + share * step, trial
    if not np.isfinite(left).all() or abs(left).max() > CONVERGED**0.5:
        return np.full(POINTS, np.nan)
    return np.asarray(ahead - slope @ gaps)


@lru_cache(maxsize=1)
def _slope() -> FloatArray:
    """(K, K) the derivative of a trigonometric polynomial in its phase."""
    away = np.arange(POINTS)[:, None] - np.arange(POINTS)
    with np.errstate(divide="ignore"):
        slope = 0.5 * (-1.0) ** away / np.sin(np.pi * away / POINTS)
    np.fill_diagonal(slope, 0.0)
    return frozen(slope)


def _shift(angle: float) -> FloatArray:
    """(K, K) the values an angle earlier."""
    harmonics = np.fft.fftfreq(POINTS, 1 / POINTS)
    spectrum = np.fft.fft(np.eye(POINTS), axis=0)
    return np.asarray(np.fft.ifft(np.exp(-1j * harmonics * angle)[:, None] * spectrum, axis=0).real)
