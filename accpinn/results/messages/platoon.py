"""What becomes of the disturbance in a simulated platoon, and what limits it, in sentences."""

from collections.abc import Sequence

from accpinn.platoon.amplitude import SETTLED, NeverSettles, TooShort, TransientLeft
from accpinn.platoon.simulation import Collision, PlatoonRun, Reversal
from accpinn.results.messages import Labelled, message


class _Places:
    """Names the vehicles of a platoon by their place, 0 for the leader."""

    source = "platoon"

    def label(self, number: int) -> str:
        """As at the beginning of a sentence."""
        return f"Follower {number}" if number else "The leader"


PLACES = _Places()
"""What the findings of a `PlatoonRun` are about."""
AFTER_COLLISION = "The model has no collisions: the motion simulated after one has no meaning."
SAME_AMPLITUDE = 0.005
"""An amplitude that differs by a smaller share is called as large as the leader's."""


@message.register
def _(finding: Collision, about: Labelled) -> str:
    who = about.label(finding.follower)
    return f"{who} collides with the vehicle ahead at {finding.time:.1f} s. {AFTER_COLLISION}"


@message.register
def _(finding: Reversal, about: Labelled) -> str:
    return (
        f"{about.label(finding.follower)} drives backwards from {finding.time:.1f} s on, as the"
        " model has no standstill."
    )


@message.register
def _(finding: NeverSettles, about: Labelled) -> str:
    who = about.label(finding.follower)
    return f"{who} never settles, so its amplitude never becomes constant."


@message.register
def _(finding: TooShort, about: Labelled) -> str:
    return (
        "The run is too short to measure amplitudes over a whole period of"
        f" {finding.period:.3g} s; a duration of {finding.duration:.0f} s is enough."
    )


@message.register
def _(finding: TransientLeft, about: Labelled) -> str:
    return (
        f"{about.label(finding.follower)} is still in its transient, above {100 * SETTLED:g} % of"
        " its amplitude, where that is measured; a duration of"
        f" {finding.duration:.0f} s is enough."
    )


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
        parts.append(AFTER_COLLISION)
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
