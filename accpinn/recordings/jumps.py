"""Jumps of a space-gap: another vehicle cuts in or out, or a sensor loses its target.

A jump is a step of p - b ∫Δv dt within a second that is large compared with what a sound gap
changes in the same time, and before and after which the difference is calm.
"""

import numpy as np

from accpinn.recordings.inconsistency import GapJumps
from accpinn.recordings.increments import (
    AGREEMENT_MINIMUM,
    JUMP,
    LONGEST_HOLE,
    Pair,
    integrated,
    time_in_holes,
)
from accpinn.units import MetresPerSecond, Seconds, stretches

JUMP_NOISE = 8.0
"""Least jump in robust standard deviations of the changes in the same time elsewhere."""
JUMP_TIME: Seconds = 1.0
"""Longest time of a jump."""
JUMP_SAMPLES = 5
"""Samples on either side of a jump whose medians are compared."""
JUMP_FLANK = 0.25
"""Largest change before and after a jump, as a share of it; a receiver's error wanders instead."""
JUMP_SHARP = 0.75
"""Least share of a jump that happens within `JUMP_TIME`."""
JUMP_HOLE: Seconds = 5.0
"""Longest hole across which a jump is sought."""
JUMP_DRIFT: MetresPerSecond = 1.0
"""Largest error of the integral of interpolated speeds, in m per s of a hole."""


def jumps_of(pair: Pair, slope: float, ahead: Seconds, behind: Seconds) -> GapJumps | None:
    """Jumps of a pair's gap beyond ``slope`` times the integral of the speed difference.

    ``ahead`` and ``behind`` are the lags of the two speeds in s. None where the gap has no jumps.
    """
    *speeds, (time, gap) = pair.fresh
    if len(gap) < 4 * JUMP_SAMPLES:
        return None
    unexplained, hole_time, inside = gap.copy(), np.zeros(len(time)), np.ones(len(time), bool)
    for (stamps, values), lag, sign in zip(speeds, (ahead, behind), (-slope, slope), strict=True):
        unexplained += sign * np.interp(time + lag, stamps, integrated(stamps, values))
        inside &= (time + lag >= stamps[0] - 1e-9) & (time + lag <= stamps[-1] + 1e-9)
        hole_time += np.interp(time + lag, stamps, time_in_holes(stamps, LONGEST_HOLE))
    time, unexplained, hole_time = time[inside], unexplained[inside], hole_time[inside]
    half = min(JUMP_SAMPLES, max(1, round(JUMP_TIME / 2 / pair.step)) | 1)
    middles = np.median(np.lib.stride_tricks.sliding_window_view(unexplained, half), axis=1)
    guard = max(1, round(JUMP_TIME / pair.step))
    span = half + guard  # from the first sample before to the first one after
    count = len(unexplained) - 2 * half - guard + 1
    if count < AGREEMENT_MINIMUM:
        return None
    before, after = middles[:count], middles[span : span + count]
    sizes = after - before
    first, last = np.arange(count), np.arange(count) + span + half - 1
    lasting = time[last] - time[first]
    hole = np.maximum(lasting - (span + half) * pair.step - LONGEST_HOLE, 0.0)
    hole = np.maximum(hole, hole_time[last] - hole_time[first])
    deviation = 1.4826 * float(np.median(np.abs(sizes - np.median(sizes))))
    limit = max(JUMP, JUMP_NOISE * deviation) + JUMP_DRIFT * hole
    large = (np.abs(sizes) > limit) & (hole <= JUMP_HOLE)
    jumps = []
    for stretch in stretches(large):
        k = stretch.first + int(np.abs(sizes[stretch.rows]).argmax())
        size = float(sizes[k])
        # Before and after, the rest hardly changes for as long again.
        far = max(k - span, 0), min(k + 2 * span, len(middles) - 1)
        calm = max(abs(middles[k] - middles[far[0]]), abs(middles[far[1]] - middles[k + span]))
        around = unexplained[far[0] : far[1] + half]
        sharpest = np.abs(around[guard:] - around[:-guard]).max()
        if calm > JUMP_FLANK * abs(size) or sharpest < JUMP_SHARP * abs(size):
            continue
        steps = np.diff(unexplained[k : k + span + half]) * np.sign(size)
        at = k + int(steps.argmax()) + 1
        jumps.append((round(float(time[at]), 6), round(size, 3)))
    if not jumps:
        return None
    return GapJumps(pair.vehicle, *(tuple(values) for values in zip(*sorted(jumps), strict=True)))
