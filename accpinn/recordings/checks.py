"""What is wrong with the data of a readable file, as findings; nothing is changed here."""

from collections.abc import Iterator

import numpy as np

from accpinn.channels import GAP, SPEED, Quantity
from accpinn.mask import Mask, Stretch, stretches
from accpinn.recordings.recording import (
    GapContradictsSpeeds,
    LittleLeaderMotion,
    Recording,
    RecordingFinding,
    SamplesMissing,
    ValuesFrozen,
    ValuesOutOfRange,
)
from accpinn.units import FloatArray, MetresPerSecond, Seconds

AGREEMENT_LIMIT = 0.5
"""Least correlation between a gap's rate of change and the speed difference that counts as sound;
the sound recordings of the database reach 0.8 and more."""
AGREEMENT_WINDOW: Seconds = 1.0
"""Rates are taken over this time, so that measurement noise does not hide the agreement."""
AGREEMENT_MINIMUM = 30
"""Instants that a correlation takes."""
RELATIVE_MOTION: MetresPerSecond = 0.2
"""With less deviation of the speed difference, noise dominates the correlation."""
FROZEN: Seconds = 0.5
"""A value repeated for longer while moving is a fault of the receiver."""
MOVING: MetresPerSecond = 1.0
"""Slower vehicles stand: they may repeat their values and have no meaningful time gap."""
LITTLE_LEADER_MOTION: MetresPerSecond = 0.5
"""A leader whose speed deviates less excites nothing."""
BLOCKS_LISTED = 3


def check(recording: Recording) -> Iterator[RecordingFinding]:
    """All findings about the data of a recording."""
    gaps = _gaps(recording)
    channels = [(SPEED, number, recording.speed_of(number)) for number in recording.present]
    channels += [(GAP, number, recording.gap_behind(number)) for number in gaps]
    for number in recording.present:
        absent = np.isnan(recording.speed_of(number))
        if absent.any():
            yield _missing(recording, SPEED, number, absent)
    for number in gaps:
        # Gaps vanish along with a speed; only what goes beyond that is news.
        speeds = recording.speed[:, number - 1 : number + 1]
        alone = np.isnan(recording.gap_behind(number)) & np.isfinite(speeds).all(axis=1)
        if alone.any():
            yield _missing(recording, GAP, number, alone)
    for number in gaps:
        value = agreement(recording, number)
        if value is not None and value < AGREEMENT_LIMIT:
            yield GapContradictsSpeeds(vehicle=number, correlation=value)
    for channel, number, values in channels:
        if count := int((values < channel.lowest).sum()):
            yield ValuesOutOfRange(channel.column, number, count, float(np.nanmin(values)))
    for channel, number, values in channels:
        if count := int((values > channel.highest).sum()):
            yield ValuesOutOfRange(channel.column, number, count, float(np.nanmax(values)))
    for channel, number, values in channels:
        yield from _frozen(recording, channel, number, values)
    leader = recording.present[0]
    deviation = float(np.nanstd(recording.speed_of(leader)))
    if deviation < LITTLE_LEADER_MOTION:
        yield LittleLeaderMotion(leader, deviation)


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
    """The numbers of the space-gaps that hold a value, between two present vehicles."""
    present = set(recording.present)
    return [
        number
        for number in range(1, recording.gap.shape[1] + 1)
        if {number, number + 1} <= present and np.isfinite(recording.gap_behind(number)).any()
    ]


def _missing(recording: Recording, channel: Quantity, number: int, mask: Mask) -> SamplesMissing:
    blocks = stretches(mask)
    longest = sorted(sorted(blocks, key=len, reverse=True)[:BLOCKS_LISTED], key=lambda b: b.first)
    windows = tuple(recording.window(block) for block in longest)
    shorter = len(blocks) - len(longest)
    return SamplesMissing(channel.column, number, float(mask.mean()), windows, shorter)


def _frozen(
    recording: Recording, channel: Quantity, number: int, values: FloatArray
) -> Iterator[ValuesFrozen]:
    follower = number if channel is SPEED else number + 1
    moving = recording.speed_of(follower)[1:] > MOVING
    repeats = stretches((values[1:] == values[:-1]) & moving)
    longest = max(repeats, key=len, default=None)
    if longest and len(longest) * recording.sample_time > FROZEN:
        # A stretch of k repeats is k + 1 equal samples.
        equal = Stretch(longest.first, longest.last + 1)
        yield ValuesFrozen(channel.column, follower, recording.window(equal))
