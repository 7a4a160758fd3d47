"""What is wrong with the data of a readable file, in plain sentences; nothing is changed here."""

from collections.abc import Iterator

import numpy as np

from accpinn.channels import GAP, SPEED, Quantity
from accpinn.mask import Run, runs
from accpinn.recordings.recording import Recording
from accpinn.units import FloatArray, MetresPerSecond, Seconds

AGREEMENT_LIMIT = 0.5
"""Least correlation between a gap's rate of change and the speed difference that counts as sound;
the sound recordings of the database reach 0.8 and more."""
AGREEMENT_WINDOW: Seconds = 1.0
"""Rates are taken over this time, so that measurement noise does not hide the agreement."""
AGREEMENT_MINIMUM = 30
"""Instants it takes to judge the agreement."""
RELATIVE_MOTION: MetresPerSecond = 0.2
"""With less deviation of the speed difference, noise decides and the agreement says nothing."""
FROZEN: Seconds = 0.5
"""A value repeated for longer while moving is a receiver that hung."""
MOVING: MetresPerSecond = 1.0
"""Below it a vehicle may well repeat its value: it stands."""
LITTLE_MOTION: MetresPerSecond = 0.5
"""A leader whose speed deviates less excites nothing."""
BLOCKS_LISTED = 3


def findings(recording: Recording) -> Iterator[str]:
    """All warnings about the data."""
    for number in recording.present:
        yield from _missing_speed(recording, number)
    for number in _gaps(recording):
        yield from _missing_gap_alone(recording, number)
    for number in _gaps(recording):
        yield from _disagreement(recording, number)
    yield from _negative(recording)
    yield from _implausible(recording)
    yield from _frozen(recording)
    yield from _little_motion(recording)


def agreement(recording: Recording, number: int) -> float | None:
    """Correlation between dIVS/dt and the speed difference of vehicles number and number + 1.

    1 for a sound recording; None where the two vehicles hardly move against each other.
    """
    half = max(1, round(AGREEMENT_WINDOW / recording.sample_time / 2))
    width = 2 * half
    gap = recording.gap_behind(number)
    if len(gap) <= width:
        return None
    span = recording.time[width:] - recording.time[:-width]
    rate = (gap[width:] - gap[:-width]) / span
    difference = recording.speed_of(number) - recording.speed_of(number + 1)
    smooth = np.convolve(difference, np.full(width + 1, 1 / (width + 1)), "valid")
    known = np.isfinite(rate) & np.isfinite(smooth)
    if known.sum() < AGREEMENT_MINIMUM or smooth[known].std() < RELATIVE_MOTION:
        return None
    if rate[known].std() < 1e-9:
        return 0.0
    return float(np.corrcoef(rate[known], smooth[known])[0, 1])


def _gaps(recording: Recording) -> list[int]:
    present = set(recording.present)
    return [
        number
        for number in range(1, recording.gap.shape[1] + 1)
        if {number, number + 1} <= present and np.isfinite(recording.gap_behind(number)).any()
    ]


def _channels(recording: Recording) -> Iterator[tuple[Quantity, int, FloatArray]]:
    for number in recording.present:
        yield SPEED, number, recording.speed_of(number)
    for number in _gaps(recording):
        yield GAP, number, recording.gap_behind(number)


def _seconds(recording: Recording, run: Run) -> str:
    first, last = recording.time[run.first], recording.time[run.last]
    return f"{first:.1f} s" if len(run) == 1 else f"{first:.1f}-{last:.1f} s"


def _blocks(recording: Recording, blocks: tuple[Run, ...]) -> str:
    """The longest blocks, in order of time."""
    longest = sorted(sorted(blocks, key=len, reverse=True)[:BLOCKS_LISTED], key=lambda r: r.first)
    listed = ", ".join(_seconds(recording, run) for run in longest)
    more = len(blocks) - len(longest)
    others = f" and in {more} shorter block{'s' if more > 1 else ''}" if more else ""
    return f"at {listed}{others}"


def _missing_speed(recording: Recording, number: int) -> Iterator[str]:
    absent = np.isnan(recording.speed_of(number))
    if absent.any():
        name = recording.vehicles[number - 1].name
        yield (
            f"{SPEED.of(number)} ({name}) is missing in {_share(absent)} of the samples,"
            f" {_blocks(recording, runs(absent))}."
        )


def _missing_gap_alone(recording: Recording, number: int) -> Iterator[str]:
    """Gaps vanish along with a speed; only what goes beyond that is news."""
    speeds = recording.speed[:, number - 1 : number + 1]
    alone = np.isnan(recording.gap_behind(number)) & np.isfinite(speeds).all(axis=1)
    if alone.any():
        yield (
            f"{GAP.of(number)} is missing in {_share(alone)} of the samples where both speeds are"
            f" known, {_blocks(recording, runs(alone))}."
        )


def _share(mask: np.ndarray) -> str:
    share = 100 * mask.mean()
    return f"{share:.0f} %" if share >= 1 else f"{share:.1g} %"


def _disagreement(recording: Recording, number: int) -> Iterator[str]:
    value = agreement(recording, number)
    if value is not None and value < AGREEMENT_LIMIT:
        yield (
            f"{GAP.of(number)} contradicts the speeds of vehicles {number} and {number + 1}: its"
            f" rate of change correlates with their difference by {value:.2f} (1 if they agreed),"
            f" so do not trust results for vehicle {number + 1}."
        )


def _negative(recording: Recording) -> Iterator[str]:
    for channel, number, values in _channels(recording):
        negative = values < 0
        if negative.any():
            yield (
                f"{channel.of(number)} is negative in {int(negative.sum())} samples,"
                f" the lowest {np.nanmin(values):.2g} {channel.unit}."
            )


def _implausible(recording: Recording) -> Iterator[str]:
    for channel, number, values in _channels(recording):
        beyond = values > channel.highest
        if beyond.any():
            yield (
                f"{channel.of(number)} exceeds {channel.highest:g} {channel.unit} in"
                f" {int(beyond.sum())} samples, up to {np.nanmax(values):.4g}; check its unit."
            )


def _frozen(recording: Recording) -> Iterator[str]:
    for channel, number, values in _channels(recording):
        follower = number if channel is SPEED else number + 1
        moving = recording.speed_of(follower)[1:] > MOVING
        repeats = runs((values[1:] == values[:-1]) & moving)
        longest = max(repeats, key=len, default=None)
        if longest and len(longest) * recording.sample_time > FROZEN:
            # A run of k repeats is k + 1 equal samples.
            run = Run(longest.first, longest.last + 1)
            name = recording.vehicles[follower - 1].name
            whose = name if name == f"Vehicle {follower}" else f"{follower} {name}"
            lasting = recording.time[run.last] - recording.time[run.first]
            yield (
                f"The {channel.name.lower()} of {whose} is frozen for {lasting:.1f} s while it"
                f" moves, at {_seconds(recording, run)}."
            )


def _little_motion(recording: Recording) -> Iterator[str]:
    first = recording.present[0]
    deviation = float(np.nanstd(recording.speed_of(first)))
    if deviation < LITTLE_MOTION:
        yield (
            f"The speed of vehicle {first} varies by only {deviation:.2f} m/s (standard deviation);"
            " so little excitation may not tell the parameters apart."
        )
