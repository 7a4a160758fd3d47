"""What becomes of the leader's disturbance in a simulated platoon, in sentences."""

from collections.abc import Sequence

from accpinn.platoon.simulation import AFTERWARDS, PlatoonRun

SAME_AMPLITUDE = 0.005
"""An amplitude that differs by a smaller share is called as large as the leader's."""


def disturbance(run: PlatoonRun) -> str:
    """Whether the disturbance has grown at the last follower."""
    wave, moved = run.amplitudes, run.largest_deviation
    what = "oscillation" if wave else "largest speed deviation"
    if run.collisions:
        first = run.collisions[0]
        end = f"ollower {first.follower} collides at {first.time:.0f} s"
        if not moved[0] > 0:
            return f"F{end}."
        ratio = moved.max() / moved[0]
        return f"Speeds deviate up to {ratio:.3g} times as much as the leader's, until f{end}."
    sizes = wave.measured if wave and wave.periods else moved
    if not sizes[0] > 0:
        return "The leader's speed is constant, so there is no disturbance."
    ratio, size = sizes[-1] / sizes[0], f"{sizes[-1]:.3g} m/s against {sizes[0]:.3g} m/s"
    if abs(ratio - 1) < SAME_AMPLITUDE:
        return f"The last follower's {what} is as large as the leader's: {size}."
    verb = "grows" if ratio > 1 else "fades"
    return f"The {what} {verb} to {ratio:.3g} times the leader's: {size}."


def disturbance_details(run: PlatoonRun, names: Sequence[str]) -> str:
    """The amplitude predicted for a sinusoid, and the smallest gap.

    Args:
        run: the simulation.
        names: of the followers, in their order.
    """
    wave, parts = run.amplitudes, []
    if run.collisions:
        parts.append(f"{AFTERWARDS[0].upper()}{AFTERWARDS[1:]}")
    if wave:
        would = "would reach" if run.collisions else "reaches"
        parts.append(f"By |H| the last follower {would} {wave.predicted[-1]:.3g} m/s.")
    if not run.collisions:
        k = int(run.minimum_gap.argmin())
        gap = round(run.minimum_gap[k], 1) + 0.0
        parts.append(
            f"The smallest gap is {gap:.1f} m, follower {k + 1} ({names[k]}) at"
            f" {run.minimum_gap_time[k]:.0f} s."
        )
    return " ".join(parts)
