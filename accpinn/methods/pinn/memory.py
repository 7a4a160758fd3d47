"""How long a window may be: what would take more memory than a server can spare is refused."""

from math import sqrt

from accpinn.errors import SegmentError
from accpinn.methods.pinn.config import PinnConfig
from accpinn.methods.pinn.features import FourierFeatures
from accpinn.segment.segment import Segment
from accpinn.units import Seconds

MOST_BYTES = 1.4e9
_PER_FEATURE = 32
"""Bytes per instant and input feature that `fast` takes at its peak; measured."""
_PER_FEATURE_COUNTED = 55
"""The same where instants are left out, as each follower then has products of its own."""
_PER_INSTANT = 5_000
"""Bytes per instant that `paper` takes at its peak; measured."""


def require_memory(segment: Segment, config: PinnConfig) -> None:
    """Refuse a window whose training would not fit.

    Raises:
        SegmentError: naming the longest window that can be trained on.
    """
    step = segment.sample_time
    if config.preset == "paper":
        needed: float = _PER_INSTANT * segment.samples
        longest: Seconds = MOST_BYTES / _PER_INSTANT * step
    else:
        each = _PER_FEATURE if segment.mask is None else _PER_FEATURE_COUNTED
        features = FourierFeatures(segment.window.duration, config.highest_frequency).size
        needed = each * segment.samples * features
        # Instants and features both grow with the window.
        longest = sqrt(MOST_BYTES * step / (4 * each * config.highest_frequency))
    if needed > MOST_BYTES:
        raise SegmentError(
            f"{segment.source}: a window of {segment.window.duration:,.0f} s would take"
            f" {needed / 1e9:,.1f} GB of memory to train on; take at most"
            f" {0.98 * longest // 10 * 10:,.0f} s."
        )
