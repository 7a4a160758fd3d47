"""How long a training takes, and which windows would need more memory than a server can spare."""

from math import sqrt

from accpinn.errors import SegmentError
from accpinn.methods.method import TYPICAL_SAMPLES
from accpinn.methods.pinn.config import CALIBRATED, FAST, PAPER, STRETCH, PinnConfig, PresetName
from accpinn.segment.segment import Segment
from accpinn.units import Seconds

TYPICAL: dict[PresetName, tuple[Seconds, float, int]] = {
    "fast": (0.4, 0.25, FAST.iterations),
    "calibrated": (0.6, 0.8, CALIBRATED.iterations),
    "paper": (450.0, 0.44, PAPER.iterations),
}
"""Of a training on 300 s of one follower, the share of it that each further one adds, and for how
many iterations at most; see docs/validation.md."""
MOST_BYTES = 1.4e9
_PER_FEATURE, _MASKED = (48, 3), (60, 5)
"""Bytes per instant and input feature that `fast` takes at its peak, and for each follower;
measured, without a mask and with one."""
_PER_INSTANT = 5_000
"""Bytes per instant that `paper` takes at its peak; measured."""


def require_memory(segment: Segment, config: PinnConfig) -> None:
    """Refuse a window whose training would not fit.

    Raises:
        SegmentError: naming the longest window that can be trained on.
    """
    step, rate = segment.sample_time, 2 * STRETCH * config.highest_frequency
    if config.preset == "paper":
        needed: float = _PER_INSTANT * segment.samples
        longest: Seconds = MOST_BYTES / _PER_INSTANT * step
    else:
        common, own = _PER_FEATURE if segment.mask is None else _MASKED
        each = common + own * segment.followers
        features = 2 * len(config.angular_frequencies(segment.window.duration)) + 2
        needed = each * segment.samples * features
        # Instants and features both grow with the window.
        longest = sqrt(MOST_BYTES * step / (each * rate))
    if needed > MOST_BYTES:
        raise SegmentError(
            f"{segment.source}: a window of {segment.window.duration:,.0f} s would take"
            f" {needed / 1e9:,.1f} GB of memory to train on; take at most"
            f" {0.98 * longest // 10 * 10:,.0f} s."
        )


def typical_seconds(segment: Segment, settings: PinnConfig | None) -> Seconds:
    """Of one training that runs all its iterations."""
    config = settings or FAST
    typical, further, iterations = TYPICAL[config.preset]
    followers = 1 + further * (segment.followers - 1)
    size = segment.samples / TYPICAL_SAMPLES * config.iterations / iterations
    larger = max(1.0, config.layers / FAST.layers * (config.width / FAST.width) ** 2)
    return typical * size * followers * larger
