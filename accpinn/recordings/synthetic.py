"""Synthetic recordings in OpenACC's format, whose true parameters are known: `sample_data`.

A leader drives a seeded random profile. Its followers obey the CTHP exactly, with
parameters published in Apostolakis and Ampountolas (IEEE TVT 2024, sections V.C and V.D, Table
III), or the CTHP with an intercept s₀ and a delay, with parameters as ACC cars have. What is
written is what receivers would have recorded of it (see `Noise`).

A truth file, as ``synthetic_motorway.truth.json``, says what determines the recording beside it.
``python -m accpinn.recordings.synthetic FOLDER`` writes the recordings of all truth files in a
folder again.
"""

import sys
from dataclasses import dataclass
from pathlib import Path

import msgspec
import numpy as np

from accpinn.channels import DRIVER, GAP, METADATA, SPEED, TIME
from accpinn.errors import RecordingError
from accpinn.model.cthp import Parameters, Trajectories, simulate
from accpinn.units import FloatArray, Metres, MetresPerSecond, Seconds

SAMPLE_TIME: Seconds = 0.1
"""Step between the samples of an OpenACC file."""

REPORT_TIME: Seconds = 0.25
"""Time between two reports of a receiver; OpenACC's notes say 3-5 Hz, then splined to 10 Hz."""

SIMULATION_STEP: Seconds = 0.05
"""Largest step whose instants include those of both rates above."""

FIRST_TIME: Seconds = 1.0
"""The Time of the first sample; AstaZero's files start at 1, too."""

SUFFIX = ".truth.json"
"""Ending of a truth file."""

DATE = (1, 1, 2024)
"""A day on which no campaign of OpenACC drove; the synthetic files have no date of their own."""


@dataclass(frozen=True)
class Noise:
    """Errors that receivers add, per vehicle: standard deviations of zero-mean Gaussians.

    The sizes are those of u-blox M8 and F9 receivers under open sky. Their data sheets give the
    Doppler speed as good to 0.05 m/s; the residuals of real recordings about a smooth curve are
    a little larger than what that gives here. The position error is metres for one receiver, but
    two receivers of a platoon share nearly all of it (orbits, clocks, atmosphere), so that it
    cancels in the space-gap. What stays is multipath, which wanders by decimetres over a minute
    (here a first-order Gauss-Markov process), and the receiver's own noise, about a centimetre as
    the carrier phase smooths the position. Errors arise at the receivers' reports; the file's 10 Hz
    come from cubic splines through them, as OpenACC's notes say of the real data.
    """

    speed: MetresPerSecond = 0.05
    """White error of each speed."""
    position: Metres = 0.01
    """White error of each position along the lane."""
    drift: Metres = 0.1
    """Wandering error of each position along the lane; two of them make a space-gap's."""
    drift_time: Seconds = 60.0
    """Time after which the drift's correlation has fallen to 1/e."""


@dataclass(frozen=True)
class LeaderProfile:
    """The leader's drive: set speeds held and changed smoothly, and a wobble on top."""

    first: MetresPerSecond
    """Speed at the first instant, before the wobble."""
    slowest: MetresPerSecond
    fastest: MetresPerSecond
    hold: tuple[Seconds, Seconds]
    """Shortest and longest time of a set speed."""
    acceleration: tuple[float, float]
    """Smallest and largest peak of a change, in m/s²."""
    wobble: MetresPerSecond
    """Root mean square of the foot's unrest, between 0.05 and 0.5 rad/s."""


@dataclass(frozen=True)
class Truth:
    """Everything that determines a synthetic recording; a truth file holds it as JSON."""

    description: str
    vehicles: tuple[str, ...]
    """Names, leader first."""
    parameters: Parameters
    """Parameters, one entry a follower, in the file's order."""
    leader: LeaderProfile
    noise: Noise | None
    seed: int
    duration: Seconds
    initial: tuple[Metres, MetresPerSecond] | None
    """Space-gap and speed of every follower at first; without it, equilibrium."""


def truth_path(recording: Path) -> Path:
    """The path of a synthetic recording's truth file, which lies beside it."""
    return recording.with_name(recording.stem + SUFFIX)


def load_truth(path: Path) -> Truth:
    """Read a truth file.

    Raises:
        RecordingError: when it is not there or not one.
    """

    def parameters_of(_: type, entries: list[dict[str, float]]) -> Parameters:
        return Parameters.stack(Parameters(**entry) for entry in entries)

    try:
        return msgspec.json.decode(path.read_bytes(), type=Truth, dec_hook=parameters_of)
    except FileNotFoundError:
        fault = "there is no such truth file; copy the folder of samples again"
    except (ValueError, msgspec.ValidationError) as error:
        fault = f"not a truth file ({error}); copy the folder of samples again"
    raise RecordingError(f"{path.name}: {fault}.")


def leader_speed(profile: LeaderProfile, time: FloatArray, rng: np.random.Generator) -> FloatArray:
    """The leader's speed at each instant, (N,) in m/s, twice continuously differentiable."""
    speed = np.full(len(time), profile.first)
    now, clock = profile.first, time[0] + rng.uniform(*profile.hold)
    middle = (profile.slowest + profile.fastest) / 2
    while clock < time[-1]:
        # The other half of the range, so that every change is one.
        half = (profile.slowest, middle) if now > middle else (middle, profile.fastest)
        target = rng.uniform(*half)
        # The steepest slope of s³(10 - 15s + 6s²) is 15/8.
        length = 15 / 8 * abs(target - now) / rng.uniform(*profile.acceleration)
        s = np.clip((time - clock) / length, 0, 1)
        speed += (target - now) * s**3 * (10 - 15 * s + 6 * s**2)
        now, clock = target, clock + length + rng.uniform(*profile.hold)
    frequencies = np.geomspace(0.05, 0.5, 12)  # rad/s
    phases = rng.uniform(0, 2 * np.pi, len(frequencies))
    waves: FloatArray = np.sin(np.outer(time, frequencies) + phases).sum(axis=1)
    speed += profile.wobble * waves / np.sqrt(len(frequencies) / 2)
    return speed


def true_trajectories(truth: Truth) -> Trajectories:
    """The true motion, every `SIMULATION_STEP`."""
    time = np.linspace(0, truth.duration, round(truth.duration / SIMULATION_STEP) + 1)
    ahead = leader_speed(truth.leader, time, np.random.default_rng(truth.seed))
    if truth.initial:
        gap, speed = truth.initial
        gaps = np.full(len(truth.parameters), gap)
    else:
        speed = float(ahead[0])
        gaps = truth.parameters.time_gap(speed) * speed
    return simulate(truth.parameters, time, ahead, np.full(len(gaps), speed), gaps)


def record(true: Trajectories, noise: Noise | None, seed: int) -> Trajectories:
    """The motion as receivers record it, every `SAMPLE_TIME`; exact where there is no noise."""
    from scipy.interpolate import CubicSpline  # takes a second to import, which few need

    sampled = slice(None, None, round(SAMPLE_TIME / SIMULATION_STEP))
    time = true.time[sampled]
    if noise is None:
        return Trajectories(time, true.speeds[sampled], true.gaps[sampled])
    reported = slice(None, None, round(REPORT_TIME / SIMULATION_STEP))
    reports = true.time[reported]
    # Apart from the leader's draws, so that the noise may change while the motion stays.
    rng = np.random.default_rng([seed, 1])
    shape = true.speeds[reported].shape
    positions = noise.position * rng.standard_normal(shape)
    positions += noise.drift * gauss_markov(shape, REPORT_TIME, noise.drift_time, rng)
    speeds = true.speeds[reported] + noise.speed * rng.standard_normal(shape)
    gaps = true.gaps[reported] + positions[:, :-1] - positions[:, 1:]
    return Trajectories(time, CubicSpline(reports, speeds)(time), CubicSpline(reports, gaps)(time))


def gauss_markov(
    shape: tuple[int, ...], step: Seconds, memory: Seconds, rng: np.random.Generator
) -> FloatArray:
    """Draw a stationary first-order Gauss-Markov process of deviation 1 along the first axis.

    Its correlation has fallen to 1/e after ``memory``.
    """
    from scipy.signal import lfilter  # takes a second to import, which few need

    correlation = np.exp(-step / memory)
    steps = rng.standard_normal(shape)
    steps[1:] *= np.sqrt(1 - correlation**2)
    return np.asarray(lfilter([1.0], [1.0, -correlation], steps, axis=0))


def to_csv(truth: Truth, recorded: Trajectories) -> bytes:
    """The recording as an OpenACC file, byte for byte: CRLF, SI units, tenths of a millimetre."""
    count = len(truth.vehicles)
    values = ((*map(str, DATE),), truth.vehicles, (str(count),), ("1",), ("min",))
    lines = [",".join((key, *cells)) for key, cells in zip(METADATA, values, strict=True)]
    followers = range(2, count + 1)
    names = [TIME.column]
    names += [SPEED.of(number) for number in range(1, count + 1)]
    names += [GAP.of(number) for number in range(1, count)]
    names += [DRIVER.of(number) for number in followers]
    lines.append(",".join(names))
    modes = ["ACC"] * len(followers)
    for instant, speeds, gaps in zip(
        FIRST_TIME + recorded.time, recorded.speeds, recorded.gaps, strict=True
    ):
        numbers = [f"{value:.4f}" for value in (*speeds, *gaps)]
        lines.append(",".join([f"{instant:.1f}", *numbers, *modes]))
    return ("\r\n".join(lines) + "\r\n").encode()


def main(arguments: list[str]) -> int:
    """Write the recording of every truth file in the folder named on the command line."""
    if len(arguments) != 1:
        print("usage: python -m accpinn.recordings.synthetic FOLDER", file=sys.stderr)
        return 2
    for path in sorted(Path(arguments[0]).glob(f"*{SUFFIX}")):
        truth = load_truth(path)
        recorded = record(true_trajectories(truth), truth.noise, truth.seed)
        written = path.with_name(path.name.replace(SUFFIX, ".csv"))
        written.write_bytes(to_csv(truth, recorded))
        print(f"{written.name}: {written.stat().st_size / 1000:.0f} kB. {truth.description}")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
