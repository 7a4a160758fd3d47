"""A platoon behind a leader: what was driven, how close it got, and what to think of it.

The law is linear: it knows no limit of acceleration, no standstill and no collision. A run says
where it left what cars can do, and goes on.
"""

from dataclasses import dataclass
from math import isinf

import numpy as np

from accpinn.errors import ParameterError
from accpinn.model import cthp
from accpinn.model.cthp import Parameters, Trajectories
from accpinn.platoon.amplitude import SETTLED, Amplitudes, amplitudes
from accpinn.platoon.leader import Leader, Planned, Recorded, Sinusoid
from accpinn.platoon.motion import deviations
from accpinn.stability.criteria import checked
from accpinn.units import FloatArray, Metres, PerSecond, Seconds, frozen

SAMPLE_TIME: Seconds = 0.1
"""That of the recordings."""
SAMPLES_PER_PERIOD = 24
"""A fast sinusoid gets more samples a second, at least so many a period."""
AFTERWARDS = "what comes after has no meaning, as the law knows no collision."
"""How the warning of a collision ends."""
MOST_SAMPLES = 200_000
FASTEST: PerSecond = 1e6
"""Above this a step of any use loses the slow motion to rounding."""

TOUCH: Metres = 1e-6
"""A gap that rounding alone makes negative is none: behind a leader that stops it ends at 0."""


@dataclass(frozen=True)
class Collision:
    """A follower whose gap is used up."""

    follower: int
    """1 = the one behind the leader."""
    time: Seconds


@dataclass(frozen=True, eq=False)
class PlatoonRun:
    """A simulated drive of M followers behind a leader."""

    parameters: Parameters
    leader: Leader
    trajectories: Trajectories
    minimum_gap: FloatArray
    """(M,) in m, over the samples."""
    minimum_gap_time: FloatArray
    """(M,) in s."""
    largest_deviation: FloatArray
    """(M+1,) in m/s: the peak of |v - speed| until the first collision, leader first."""
    collisions: tuple[Collision, ...]
    """The first of each follower that has one, in order of time."""
    amplitudes: Amplitudes | None
    """Behind a sinusoid only."""
    warnings: tuple[str, ...]
    """Where the run leaves what cars can do or what can be measured; one sentence each."""

    @property
    def meaningful(self) -> int:
        """How many samples there are until the first collision; two at least, all without one."""
        return _until(self.trajectories.time, self.collisions)


def simulate_platoon(
    parameters: Parameters, leader: Leader, sample_time: Seconds | None = None
) -> PlatoonRun:
    """The platoon behind the leader, started in equilibrium; exact at every sample.

    Args:
        parameters: one entry a follower, in their order.
        leader: what the vehicle ahead of them does.
        sample_time: by default 0.1 s, or less for a fast sinusoid; a recorded leader has its own.

    Raises:
        ParameterError: for parameters or settings that cannot be simulated.
    """
    laws = _with_equilibrium(parameters)
    if isinstance(leader, Recorded):
        driven = _behind_recorded(laws, leader)
    else:
        driven = _behind_planned(laws, leader, _instants(leader, sample_time))
    wave = amplitudes(laws, leader, driven) if isinstance(leader, Sinusoid) else None
    collisions = _collisions(driven)
    count = _until(driven.time, collisions)
    return PlatoonRun(
        laws,
        leader,
        driven,
        frozen(driven.gaps.min(axis=0)),
        frozen(driven.time[driven.gaps.argmin(axis=0)]),
        frozen(np.abs(driven.speeds[:count] - leader.speed).max(axis=0)),
        collisions,
        wave,
        tuple(_warnings(driven, collisions, leader, wave)),
    )


def _with_equilibrium(parameters: Parameters) -> Parameters:
    """Checked, with the τ that says where each gap starts, also where α = 0."""
    laws: list[Parameters] = []
    for number, (law, clean) in enumerate(zip(parameters, checked(parameters), strict=True), 1):
        if not (np.isfinite(law.tau) and law.tau >= 0):
            raise ParameterError(
                f"Parameter set {number}: α = 0 leaves the gap open; give τ as well, so that the"
                " simulation can start from the gap τv."
            )
        if clean.alpha * clean.tau + clean.beta + clean.alpha**0.5 > FASTEST:
            raise ParameterError(
                f"Parameter set {number}: it reacts within a microsecond, which cannot be"
                " simulated; give α in 1/s², β in 1/s and τ in s."
            )
        laws.append(Parameters(clean.alpha, clean.beta, law.tau))
    return Parameters.stack(laws)


def _instants(leader: Planned, sample_time: Seconds | None) -> FloatArray:
    """(N,) from 0 to the duration."""
    step = SAMPLE_TIME if sample_time is None else sample_time
    if sample_time is None and isinstance(leader, Sinusoid):
        step = min(step, leader.period / SAMPLES_PER_PERIOD)
    if not 0 < step <= leader.duration:
        raise ParameterError(
            f"Sample time {step:g} s: give more than zero and no more than the duration of"
            f" {leader.duration:g} s."
        )
    count = leader.duration / step
    if count > MOST_SAMPLES:
        raise ParameterError(
            f"The run would have {count:.0f} samples; shorten its duration of {leader.duration:g} s"
            f" to {step * MOST_SAMPLES:.3g} s."
        )
    return np.asarray(np.arange(int(count + 1e-9) + 1) * step)


def _behind_planned(laws: Parameters, leader: Planned, time: FloatArray) -> Trajectories:
    moved = deviations(laws, leader.phases(), time)
    speeds = np.column_stack([moved[:, -1], moved[:, 1:-1:2]])
    return _about(laws, leader.speed, Trajectories(time, speeds, moved[:, 0:-1:2]))


def _behind_recorded(laws: Parameters, leader: Recorded) -> Trajectories:
    still = np.zeros(len(laws))
    time = leader.time - leader.time[0]
    moved = cthp.simulate(laws, time, leader.speeds - leader.speed, still, still)
    return _about(laws, leader.speed, moved)


def _about(laws: Parameters, speed: float, moved: Trajectories) -> Trajectories:
    """Deviations from the equilibrium, added to it."""
    gaps = speed * np.array([law.tau for law in laws])
    return Trajectories(frozen(moved.time), frozen(moved.speeds + speed), frozen(moved.gaps + gaps))


def _collisions(driven: Trajectories) -> tuple[Collision, ...]:
    """Between the samples the gap is taken as straight."""
    found = []
    for follower, gap in enumerate(driven.gaps.T, 1):
        used_up = np.flatnonzero(gap < (-TOUCH if gap[0] > 0 else TOUCH))
        if len(used_up):
            k = int(used_up[0])
            back = gap[k] / (gap[k] - gap[k - 1]) if k else 0.0
            step = driven.time[k] - driven.time[k - 1] if k else 0.0
            found.append(Collision(follower, float(driven.time[k] - back * step)))
    return tuple(sorted(found, key=lambda collision: collision.time))


def _until(time: FloatArray, collisions: tuple[Collision, ...]) -> int:
    """Samples until the first collision."""
    if not collisions:
        return len(time)
    return max(2, int(np.searchsorted(time, collisions[0].time, side="right")))


def _warnings(
    driven: Trajectories,
    collisions: tuple[Collision, ...],
    leader: Leader,
    wave: Amplitudes | None,
) -> list[str]:
    found = []
    if collisions:
        first = collisions[0]
        found.append(
            f"Follower {first.follower} runs into the vehicle ahead at {first.time:.1f} s;"
            f" {AFTERWARDS}"
        )
    backwards = np.argwhere(driven.speeds[: _until(driven.time, collisions)] < 0)
    if len(backwards):
        row, vehicle = backwards[0].tolist()
        who = f"Follower {vehicle}" if vehicle else "The leader"
        found.append(
            f"{who} drives backwards at {driven.time[row]:.1f} s for the first time, as the law"
            " knows no standstill."
        )
    if wave is not None and isinstance(leader, Sinusoid):
        found += _measurement_warnings(leader, wave)
    return found


def _measurement_warnings(leader: Sinusoid, wave: Amplitudes) -> list[str]:
    """Why the measured amplitudes may not be those predicted."""
    last = int(np.argmax(wave.settled))
    needed = leader.settle + float(wave.settled[last]) + leader.period
    if isinf(needed):
        return [f"Follower {last} never settles, so its amplitude never becomes constant."]
    cure = f"a duration of {np.ceil(needed):.0f} s would do."
    if not wave.periods:
        return [f"The amplitudes need a whole period of {leader.period:.3g} s; {cure}"]
    if needed > leader.duration + 1e-9:
        return [
            f"The transient of follower {last} is still above {100 * SETTLED:g} % of its amplitude"
            f" where that is measured; {cure}"
        ]
    return []
