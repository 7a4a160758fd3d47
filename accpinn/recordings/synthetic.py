"""Synthetic recordings in OpenACC's format, whose true parameters are known: `sample_data`.

A leader drives a seeded profile of our own making. Its followers obey the CTHP exactly, with
parameters published in Apostolakis and Ampountolas (IEEE TVT 2024, sections V.C and V.D, Table
III), or the CTHP with an intercept s₀ and a delay, with parameters as ACC cars have. What is
written is what receivers would have recorded of it (see `Noise`).

``python -m accpinn.recordings.synthetic FOLDER`` writes every recording with its truth file.
"""

import json
import sys
from dataclasses import dataclass, replace
from pathlib import Path

import msgspec
import numpy as np

from accpinn.channels import DRIVER, GAP, METADATA, SPEED, TIME, by_key
from accpinn.errors import RecordingError
from accpinn.model.cthp import TERMS, Parameters, Trajectories, simulate
from accpinn.model.published import ASTAZERO, VICOLUNGO
from accpinn.units import FloatArray, Metres, MetresPerSecond, Seconds

GENERATOR_VERSION = 1
"""Version of the generator, raised whenever a scenario would give other numbers."""

SAMPLE_TIME: Seconds = 0.1
"""Step between the samples of an OpenACC file."""

REPORT_TIME: Seconds = 0.25
"""Time between two reports of a receiver; OpenACC's notes say 3-5 Hz, then splined to 10 Hz."""

SIMULATION_STEP: Seconds = 0.05
"""Largest step whose instants include those of both rates above."""

FIRST_TIME: Seconds = 1.0
"""The Time of the first sample; AstaZero's files start at 1, too."""

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
class Scenario:
    """A synthetic recording: everything that determines its bytes."""

    name: str
    """File name without its ending."""
    description: str
    vehicles: tuple[str, ...]
    """Names, leader first."""
    parameters: Parameters
    """Parameters, one entry a follower."""
    leader: LeaderProfile
    noise: Noise | None
    seed: int
    duration: Seconds = 400.0
    initial: tuple[Metres, MetresPerSecond] | None = None
    """Space-gap and speed of every follower at first; without it, equilibrium."""


@dataclass(frozen=True)
class Truth:
    """The origin of a synthetic recording, which a truth file holds as JSON."""

    description: str
    parameters: Parameters
    """Parameters, one entry a follower, in the file's order."""
    noise: Noise | None
    seed: int
    generator: int
    """`GENERATOR_VERSION` when the recording was written."""


def truth_path(recording: Path) -> Path:
    """The path of a synthetic recording's truth file, which lies beside it."""
    return recording.with_name(f"{recording.stem}.truth.json")


def load_truth(path: Path) -> Truth:
    """Read a truth file.

    Raises:
        RecordingError: when it is not there or not one.
    """
    try:
        return msgspec.json.decode(path.read_bytes(), type=Truth, dec_hook=_parameters)
    except FileNotFoundError:
        fault = "there is no such truth file; write the samples again with make samples"
    except (ValueError, msgspec.ValidationError) as error:
        fault = f"not a truth file ({error}); write the samples again with make samples"
    raise RecordingError(f"{path.name}: {fault}.")


def _parameters(_: type, entries: list[dict[str, float]]) -> Parameters:
    return Parameters.stack(Parameters(**entry) for entry in entries)


def _entries(parameters: Parameters) -> list[dict[str, float]]:
    return [
        by_key(row[:3]) | {name: value for name, value in zip(TERMS, row[3:], strict=True) if value}
        for row in parameters.complete.tolist()
    ]


MOTORWAY = LeaderProfile(28.0, 20.0, 34.0, (8.0, 25.0), (0.4, 1.2), 0.15)
_CASALE = LeaderProfile(21.2, 18.0, 32.0, (8.0, 25.0), (0.4, 1.2), 0.15)
_TRACK = LeaderProfile(22.0, 17.0, 27.0, (15.0, 35.0), (0.5, 1.1), 0.03)

_PAPER_STUDY = Scenario(
    name="synthetic_paper_study",
    description=(
        "The paper's synthetic study (section V.C): one follower that starts far too close, and"
        " a leader of our own making in place of the recorded one. With a receiver's noise."
    ),
    vehicles=("Synthetic(leader)", "Synthetic(ACC)"),
    parameters=Parameters([0.08], [0.12], [1.5]),
    leader=_CASALE,
    noise=Noise(),
    seed=1,
    duration=300.0,
    initial=(20.3, 21.3),
)

_NOISE_FREE = replace(
    _PAPER_STUDY,
    name="synthetic_paper_study_noise_free",
    description="The same drive as synthetic_paper_study.csv, as it truly was: without noise.",
    noise=None,
)

_ASTAZERO = Scenario(
    name="synthetic_astazero_like",
    description=(
        "Four followers with the paper's Case II parameters of the AstaZero platoon (Table III);"
        " the leader drives steps between set speeds, as on the test track. The noise is that of"
        " the other campaigns' receivers, coarser than the equipment used there."
    ),
    vehicles=(
        "Audi(A8-like)",
        "Audi(A6-like)",
        "BMW(X5-like)",
        "Mercedes(AClass-like)",
        "Tesla(Model3-like)",
    ),
    parameters=ASTAZERO.parameters,
    leader=_TRACK,
    noise=Noise(),
    seed=19,
)

_VICOLUNGO = Scenario(
    name="synthetic_vicolungo_like",
    description=(
        "Three followers with the paper's Case II parameters of the Ispra-Vicolungo platoon"
        " (Table III; its last car was driven by hand and is left out), on a motorway."
    ),
    vehicles=(
        "Mitsubishi(SpaceStar-like)",
        "Ford(S-Max-like)",
        "Peugeot(5008-like)",
        "KIA(Niro-like)",
    ),
    parameters=VICOLUNGO.parameters,
    leader=MOTORWAY,
    noise=Noise(),
    seed=2,
)

_MOTORWAY_CARS = Scenario(
    name="synthetic_motorway",
    description=(
        "Three followers on a motorway that keep a gap s₀ + τv and respond after a delay, with"
        " parameters such as the ACC cars of published recordings have. With a receiver's noise."
    ),
    vehicles=(
        "Synthetic(Van)",
        "Synthetic(Hatchback)",
        "Synthetic(Saloon)",
        "Synthetic(Estate)",
    ),
    parameters=Parameters(
        [0.08, 0.06, 0.10], [0.30, 0.40, 0.25], [0.80, 1.00, 0.70],
        s0=[6.0, 5.0, 8.0], delay=[0.50, 0.35, 0.70],
    ),
    leader=MOTORWAY,
    noise=Noise(),
    seed=5,
    duration=600.0,
)  # fmt: skip

SCENARIOS = (_MOTORWAY_CARS, _PAPER_STUDY, _NOISE_FREE, _ASTAZERO, _VICOLUNGO)
"""Every recording of `sample_data`."""


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


def true_trajectories(scenario: Scenario) -> Trajectories:
    """The true motion, every `SIMULATION_STEP`."""
    time = np.linspace(0, scenario.duration, round(scenario.duration / SIMULATION_STEP) + 1)
    ahead = leader_speed(scenario.leader, time, np.random.default_rng(scenario.seed))
    if scenario.initial:
        gap, speed = scenario.initial
        gaps = np.full(len(scenario.parameters), gap)
    else:
        speed = float(ahead[0])
        gaps = scenario.parameters.time_gap(speed) * speed
    return simulate(scenario.parameters, time, ahead, np.full(len(gaps), speed), gaps)


def record(true: Trajectories, noise: Noise | None, seed: int) -> Trajectories:
    """The motion as receivers record it, every `SAMPLE_TIME`; exact where there is no noise."""
    from scipy.interpolate import CubicSpline  # takes a second to import, which few need

    kept = slice(None, None, round(SAMPLE_TIME / SIMULATION_STEP))
    time = true.time[kept]
    if noise is None:
        return Trajectories(time, true.speeds[kept], true.gaps[kept])
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

    Args:
        shape: (N, ..)
        step: between its samples.
        memory: time after which the correlation has fallen to 1/e.
        rng: draws it.
    """
    from scipy.signal import lfilter  # takes a second to import, which few need

    kept = np.exp(-step / memory)
    steps = rng.standard_normal(shape)
    steps[1:] *= np.sqrt(1 - kept**2)
    return np.asarray(lfilter([1.0], [1.0, -kept], steps, axis=0))


def to_csv(scenario: Scenario, recorded: Trajectories) -> bytes:
    """The recording as an OpenACC file, byte for byte: CRLF, SI units, tenths of a millimetre."""
    count = len(scenario.vehicles)
    values = ((*map(str, DATE),), scenario.vehicles, (str(count),), ("1",), ("min",))
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


def write(scenario: Scenario, folder: Path) -> Path:
    """Write the recording and the truth file of a scenario; returns the recording's path."""
    path = folder / f"{scenario.name}.csv"
    recorded = record(true_trajectories(scenario), scenario.noise, scenario.seed)
    path.write_bytes(to_csv(scenario, recorded))
    truth = Truth(
        scenario.description, scenario.parameters, scenario.noise, scenario.seed, GENERATOR_VERSION
    )
    entries = {"synthetic": True} | msgspec.to_builtins(truth, enc_hook=_entries)
    text = json.dumps(entries, indent=2, ensure_ascii=False) + "\n"
    truth_path(path).write_bytes(text.encode())
    return path


def main(arguments: list[str]) -> int:
    """Write every scenario into the folder named on the command line."""
    if len(arguments) != 1:
        print("usage: python -m accpinn.recordings.synthetic FOLDER", file=sys.stderr)
        return 2
    folder = Path(arguments[0])
    folder.mkdir(parents=True, exist_ok=True)
    for scenario in SCENARIOS:
        path = write(scenario, folder)
        print(f"{path.name}: {path.stat().st_size / 1000:.0f} kB. {scenario.description}")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
