"""The platoon: learned vehicles in a row behind a leader, simulated exactly."""

from accpinn.platoon.amplitude import SETTLED, Amplitudes
from accpinn.platoon.leader import Brake, Leader, Phase, Recorded, Sinusoid, SpeedStep
from accpinn.platoon.run import AFTERWARDS, Collision, PlatoonRun, simulate

__all__ = [
    "AFTERWARDS",
    "SETTLED",
    "Amplitudes",
    "Brake",
    "Collision",
    "Leader",
    "Phase",
    "PlatoonRun",
    "Recorded",
    "Sinusoid",
    "SpeedStep",
    "simulate",
]
