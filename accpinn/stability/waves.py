"""How much a wave of any shape and size grows from car to car, by any model, once it is steady.

Behind a speed u(t) that repeats itself with the frequency ω, so does a follower's steady motion:

    p' = u - v,   v' = f(p, v, u);   behind a lag  λv'' + v' = f;   behind a delay  v'(t) = f(t - d)

At `POINTS` instants of a period derivatives and the delay are matrices (trigonometric collocation),
and with v = u - p' one equation for the gaps p is left, which Newton's method solves with exact
derivatives. The mean of p follows, too: a model that reacts unequally keeps another mean gap in a
wave than in equilibrium.

Of a linear model this is |H|. Of any other the growth depends on the size A of the wave, and of a
sinusoid ahead the lower half (braking) may grow otherwise than the upper half (accelerating), each
relative to A:

    harmonic       |V₁| / A      the describing function, V₁ the first harmonic of v
    braking        -min(v - v̄) / A
    accelerating    max(v - v̄) / A

All are infinite where a small deviation from the equilibrium does not decay. Whether the steady
motion of a wave of finite size is itself stable is not checked. One in which a vehicle drives
backwards or hits the one ahead counts as none.

Sources: Trefethen, Spectral Methods in MATLAB, SIAM 2000, chapter 3, for the matrices; Gelb and
Vander Velde, Multiple-Input Describing Functions, McGraw-Hill 1968.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from accpinn.display import Displayed
from accpinn.errors import ParameterError
from accpinn.model.following import COMPLEX_STEP, FollowingModel, Values
from accpinn.stability.criteria import peaks
from accpinn.stability.margin import is_damped
from accpinn.units import FloatArray, MetresPerSecond, RadiansPerSecond, frozen

if TYPE_CHECKING:
    from pandas import DataFrame

POINTS = 65
"""Instants of a period; odd, so that every harmonic has its sine and cosine."""
ROUNDS, CONVERGED = 60, 1e-7
"""Most steps of Newton's method, and the residual in m/s² below which it has found a motion.

Rounding leaves up to 5e-8 behind a lag at high frequencies.
"""
FINER = 16
"""Instants a trigonometric polynomial is taken at for its peaks, per instant of `POINTS`."""
SIZES = (0.5, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0)
"""Amplitudes in m/s at which growth is taken, up to `LARGEST` of the mean speed."""
LARGEST = 0.4
SLOWEST, FASTEST, COARSE = 0.06, 1.0, 12
"""Frequencies in rad/s over which a wave's growth is the largest, and how many are taken."""
NEAR_PEAK = (0.8, 0.9, 1.0, 1.12, 1.25)
"""Those that are taken besides, by the frequency at which a small wave grows most."""
USUAL: MetresPerSecond = 3.0
"""Size of a wave that is told in words, where so large ones are taken."""
PARTS = "amplitude", "harmonic", "braking", "accelerating"
"""What a frame holds of each size."""


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
    """The growth of a sinusoid of some amplitude about a speed.

    It is nan where there is no steady wave, and infinite where small deviations do not decay.

    Args:
        model: of the follower.
        theta: (n,) its parameters.
        speed: mean speed.
        omega: (F,) frequencies.
        amplitude: that of the speed ahead.

    Raises:
        ParameterError: without an equilibrium at the speed.
    """
    omega, phase = np.asarray(omega, float), 2 * np.pi * np.arange(POINTS) / POINTS
    _equilibrium(model, theta, speed)
    if not is_damped(model.linearised(theta, speed)[None])[0]:
        infinite = np.full(len(omega), np.inf)
        return WaveGrowth(omega, infinite, infinite, infinite)
    rows = []
    for frequency in omega:
        wave = steady_wave(model, theta, speed, frequency, amplitude * np.sin(phase))
        spectrum = np.fft.rfft(wave)
        between = FINER * np.fft.irfft(spectrum, FINER * POINTS)
        rows.append((2 * abs(spectrum[1]) / POINTS, -between.min(), between.max()))
    harmonic, braking, accelerating = np.array(rows).reshape(-1, 3).T / amplitude
    return WaveGrowth(omega, harmonic, braking, accelerating)


@dataclass(frozen=True, eq=False)
class LargestGrowth:
    """The largest growth of waves over all frequencies, by their size, of one vehicle."""

    speed: MetresPerSecond
    """Mean speed."""
    amplitude: FloatArray
    """(A,) in m/s; all below are nan where a frequency has no steady wave, so that the largest
    growth is not known, and infinite where small deviations do not decay."""
    harmonic: FloatArray
    """(A,) of the first harmonic."""
    braking: FloatArray
    """(A,) of the largest deviation below the mean speed."""
    accelerating: FloatArray
    """(A,) of the largest deviation above it."""
    by_frequency: WaveGrowth
    """The growth of waves of the size `usual` over their frequency."""

    @property
    def usual(self) -> MetresPerSecond:
        """The size of a wave that is told in words."""
        return float(self.amplitude[_nearest_usual(self.amplitude)])

    def at(self, amplitude: MetresPerSecond) -> tuple[float, float]:
        """The growth of the braking and of the accelerating half of a size between those taken."""
        braking, accelerating = (
            float(np.interp(amplitude, self.amplitude, part))
            for part in (self.braking, self.accelerating)
        )
        return braking, accelerating


@dataclass(frozen=True, eq=False)
class Waves(Displayed):
    """The growth of waves by their size and direction, of each follower at a mean speed."""

    vehicles: tuple[LargestGrowth, ...]
    names: tuple[str, ...]
    """(M,) of the vehicles."""
    numbers: tuple[int, ...]
    """(M,) in the recording."""

    def __str__(self) -> str:
        """A line a vehicle."""
        lines = ["Growth of both halves of a sinusoid ahead, at the frequency of the largest"]
        for name, vehicle in zip(self.names, self.vehicles, strict=True):
            braking, accelerating = vehicle.at(vehicle.usual)
            lines.append(
                f"  {name}, ±{3.6 * vehicle.usual:.0f} km/h about {3.6 * vehicle.speed:.0f} km/h:"
                f" lower (braking) {braking:.2f}-fold, upper (accelerating) {accelerating:.2f}-fold"
            )
        return "\n".join([*lines, "More: .to_frame(), .vehicles[0].harmonic"])

    def to_frame(self) -> "DataFrame":
        """A row a vehicle and size: mean speed and amplitude in m/s, and the three growths."""
        from pandas import DataFrame

        rows = zip(self.numbers, self.names, self.vehicles, strict=True)
        return DataFrame(
            [
                {"vehicle": number, "name": name, "speed": vehicle.speed}
                | {part: float(getattr(vehicle, part)[k]) for part in PARTS}
                for number, name, vehicle in rows
                for k in range(len(vehicle.amplitude))
            ]
        )


def waves(
    model: FollowingModel,
    theta: FloatArray,
    speeds: FloatArray,
    names: tuple[str, ...],
    numbers: tuple[int, ...],
) -> Waves:
    """The growth of waves by M vehicles.

    Args:
        model: of all vehicles.
        theta: (M, n) their parameters; nan of one that is not determined.
        speeds: (M,) mean speeds in m/s.
        names: (M,) of the vehicles.
        numbers: (M,) of the vehicles in the recording.

    Raises:
        ParameterError: for a vehicle without an equilibrium at its speed.
    """
    rows = zip(theta.tolist(), speeds.tolist(), strict=True)
    found = (largest_growth(model, tuple(row), speed) for row, speed in rows)
    return Waves(tuple(found), names, numbers)


@lru_cache(maxsize=64)  # pages ask for the same again and again
def largest_growth(
    model: FollowingModel, theta: tuple[float, ...], speed: MetresPerSecond
) -> LargestGrowth:
    """The growth of waves of several sizes about a speed, each at the frequency of its largest.

    Raises:
        ParameterError: without an equilibrium at the speed.
    """
    sizes = np.array([size for size in SIZES if size <= max(LARGEST * speed, SIZES[0])])
    omega = np.geomspace(SLOWEST, FASTEST, COARSE)
    if not np.isfinite(theta).all():
        none = np.full(len(omega), np.nan)
        of_sizes, by_frequency = np.full(len(sizes), np.nan), WaveGrowth(omega, none, none, none)
        return LargestGrowth(speed, sizes, of_sizes, of_sizes, of_sizes, by_frequency)
    top = float(peaks(model.linearised(theta, speed)[None]).omega[0])
    if 0 < top < np.inf:
        omega = np.sort(np.append(omega, top * np.array(NEAR_PEAK)))
    found = [wave_growth(model, theta, speed, omega, size) for size in sizes]
    parts = np.array([[row.harmonic, row.braking, row.accelerating] for row in found])
    harmonic, braking, accelerating = parts.max(axis=2).T
    usual = found[_nearest_usual(sizes)]
    return LargestGrowth(speed, sizes, harmonic, braking, accelerating, usual)


def _nearest_usual(sizes: FloatArray) -> int:
    return int(np.abs(sizes - USUAL).argmin())


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
        The deviations; nan where Newton's method finds no steady motion with gaps and speeds of 0
        or more.

    Raises:
        ParameterError: without an equilibrium at the speed.
    """
    theta = np.asarray(theta, float)
    gap = _equilibrium(model, theta, speed)
    slope, leader = omega * _slope(), speed + ahead
    lag, delay = float(model.term(theta, "lag")), float(model.term(theta, "delay"))
    inertia = slope + lag * slope @ slope
    late = _shift(omega * delay) if delay else np.eye(POINTS)

    def residual(gaps: FloatArray) -> FloatArray:
        speeds = leader - slope @ gaps
        command = np.asarray(model.acceleration(gaps, speeds, leader, theta, np), float)
        return np.asarray(inertia @ speeds - late @ command)

    gaps = np.full(POINTS, gap)
    with np.errstate(all="ignore"):  # what leaves the model's domain is not finite
        left = residual(gaps)
        for _ in range(ROUNDS):
            if not np.isfinite(left).all() or abs(left).max() < CONVERGED:
                break
            speeds = leader - slope @ gaps
            by_gap, by_speed = (
                np.imag(model.acceleration(gaps + h, speeds + j, leader, theta, np)) / COMPLEX_STEP
                for h, j in ((COMPLEX_STEP * 1j, 0.0), (0.0, COMPLEX_STEP * 1j))
            )
            turn = -inertia @ slope - late @ (np.diag(by_gap) - by_speed[:, None] * slope)
            step = np.linalg.solve(turn, -left)
            for share in 0.5 ** np.arange(8):
                trial = residual(gaps + share * step)
                if np.isfinite(trial).all() and abs(trial).max() < abs(left).max():
                    break
            gaps, left = gaps + share * step, trial
    wave = ahead - slope @ gaps
    is_found = np.isfinite(left).all() and abs(left).max() < CONVERGED
    if not (is_found and gaps.min() >= 0 and speed + wave.min() >= 0):
        return np.full(POINTS, np.nan)
    return np.asarray(wave)


def _equilibrium(model: FollowingModel, theta: Values, speed: MetresPerSecond) -> float:
    """The equilibrium gap in m."""
    gap = float(model.equilibrium_gaps(np.asarray(theta, float), speed))
    if not np.isfinite(gap):
        raise ParameterError(
            f"{model.title}: these parameters have no equilibrium at {speed:.1f} m/s; choose"
            " another speed."
        )
    return gap


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
