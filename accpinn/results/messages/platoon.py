"""A simulated platoon in sentences: how the disturbance grows, and the smallest gap."""

import numpy as np

from accpinn.findings import joined, percent
from accpinn.inference.intervals import LEVEL
from accpinn.platoon import AFTER_COLLISION, PlatoonRun
from accpinn.platoon.leader import Sinusoid
from accpinn.results.cast import Cast
from accpinn.results.messages.stability import MAY_AMPLIFY, three
from accpinn.stability.head_to_tail import head_to_tail_peaks
from accpinn.study.vehicles import AssessedVehicles
from accpinn.units import Quantity

GIVEN_SIMULATION = f"The simulation is that of the CTHP with these parameters; {MAY_AMPLIFY}"
"""What a simulation with such parameters assumes."""
SAME_AMPLITUDE = 0.005
"""Relative difference up to which an amplitude is called as large as the leader's."""
SAME_FREQUENCY = 0.02
"""Relative difference up to which a sinusoid is said to be at the platoon's peak."""


def disturbance(run: PlatoonRun, cast: Cast, growth: Quantity | None = None) -> str:
    """The growth of the disturbance up to the last follower, with its interval where it has one."""
    wave, moved = run.amplitudes, run.largest_deviation
    measured = wave.measured if wave and wave.periods else None
    what = "largest speed deviation" if measured is None else "oscillation"
    what += " so far" if wave and not wave.periods else ""
    if run.collisions:
        first, *others = run.collisions
        hit = f"{cast.label(first.follower)} collides at {first.time:.0f} s"
        if others:
            later = [f"{cast.spoken(other.follower)} at {other.time:.0f} s" for other in others]
            hit += f", then {joined(later)}"
        worst = int(moved.argmax())
        if not (worst and moved[0] > 0):
            return f"{hit}."
        is_ended = worst >= run.survivors
        extent = "at least" if is_ended else "up to"
        most = f"{extent} {three(moved[worst] / moved[0])} times as much as the leader's"
        return f"{hit}; speeds deviate {most} ({cast.spoken(worst)})."
    if wave and run.linear is None and not np.isfinite(wave.predicted).all():
        vehicle = cast.spoken(int(np.isinf(wave.predicted).argmax()))
        return f"The oscillation of {vehicle} grows without limit."
    sizes = moved if measured is None else measured
    if not sizes[0] > 0:
        return "The leader's speed is constant, so there is no disturbance."
    ratio, size = sizes[-1] / sizes[0], f"{three(sizes[-1])} m/s against {three(sizes[0])} m/s"
    if abs(ratio - 1) < SAME_AMPLITUDE:
        return f"The last follower's {what} is as large as the leader's: {size}."
    verb = "grows" if ratio > 1 else "fades"
    largest, times = int(np.argmax(sizes)), f"{three(ratio)}{_interval(growth)} times"
    last = f"{verb} to {times} the leader's at the last follower: {size}."
    if not 0 < largest < len(sizes) - 1:
        return f"The {what} {last}"
    most = f"grows to {three(sizes[largest] / sizes[0])} times the leader's"
    last = f"is {times} at the last follower: {size}."
    return f"The {what} {most} at {cast.spoken(largest)}, and {last}"


def _interval(growth: Quantity | None) -> str:
    """The interval of a growth in brackets, as " (90 %: 1.70–2.60)"; empty without one."""
    if growth is None:
        return ""
    upper = " or more" if np.isinf(growth.upper) else f"–{three(growth.upper)}"
    return f" ({percent(LEVEL)}: {three(growth.lower)}{upper})"


def growth_of(subject: AssessedVehicles, cast: Cast, run: PlatoonRun) -> Quantity | None:
    """The last follower's amplitude by the leader's, with its interval.

    None where no uncertainty is known, behind a leader that is no sinusoid or of which no period
    was measured, and of a nonlinear model, whose response depends on the amplitude.
    """
    leader = run.leader
    if not isinstance(leader, Sinusoid) or run.collisions or run.linear:
        return None
    if run.amplitudes and not run.amplitudes.periods:
        return None
    return subject.growth(cast.order, leader.frequency)


def measured_growth(subject: AssessedVehicles, cast: Cast, run: PlatoonRun) -> str:
    """The growth that was measured at the leader's frequency; empty where none was."""
    leader, growth = run.leader, None
    if isinstance(leader, Sinusoid) and not run.collisions and not run.linear:
        growth = subject.measured_growth(cast.order)
    if growth is None or not isinstance(leader, Sinusoid):
        return ""
    gain = growth.at(leader.frequency)
    return f"Measured: {three(gain.value)}{_interval(gain)} times." if gain else ""


def most_amplified(run: PlatoonRun) -> str:
    """At which frequency the platoon amplifies most, where that is not the leader's; else empty."""
    leader, tops = run.leader, head_to_tail_peaks(run.parameters)
    gain, omega = tops.gain[-1], tops.omega[-1]
    if not isinstance(leader, Sinusoid) or not np.isfinite(gain) or omega == 0:
        return ""
    if abs(omega / leader.frequency - 1.0) < SAME_FREQUENCY:
        return ""
    return (
        f"The leader oscillates at {three(leader.frequency)} rad/s; small disturbances grow most at"
        f" {three(omega)} rad/s, {three(gain)}-fold."
    )


def by_linearisation(run: PlatoonRun) -> str:
    """What the linearisation predicts for the last follower; empty for a linear model."""
    if run.linear is None:
        return ""
    moved = np.abs(run.linear.speeds - run.leader.speed).max(axis=0)
    size = run.amplitudes.predicted[-1] if run.amplitudes else moved[-1]
    what = f"predicts {three(float(size))} m/s for the last follower"
    if not np.isfinite(size):
        what = "has a vehicle whose own motion grows without limit"
    return (
        f"The linearisation at {3.6 * run.leader.speed:.0f} km/h, which holds for small"
        f" disturbances, {what}."
    )


def smallest_gap(run: PlatoonRun, cast: Cast) -> str:
    """The smallest gap of a run, or that a collision ends it."""
    if run.collisions:
        return AFTER_COLLISION
    k = int(run.minimum_gap.argmin())
    gap = round(run.minimum_gap[k], 1) + 0.0
    return (
        f"The smallest gap is {gap:.1f} m, that of {cast.spoken(k + 1)} at"
        f" {run.minimum_gap_time[k]:.0f} s."
    )
