"""What limits a simulated platoon, in sentences."""

from accpinn.platoon.amplitude import SETTLED, NeverSettles, TooShort, TransientLeft
from accpinn.platoon.simulation import Collision, Reversal
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
