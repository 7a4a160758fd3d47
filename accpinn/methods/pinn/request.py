"""What a training is asked for, and what is known of it before it begins.

A request (data, settings, method's version, start) has content addresses, under which the store
keeps its result and its checkpoint; a warm start gives it another fit's weights to begin with; and
a window that would need more memory than a server can spare is refused.
"""

import hashlib
from dataclasses import dataclass
from math import sqrt

import numpy as np

from accpinn.errors import ConfigError, SegmentError
from accpinn.methods.fit import Fit
from accpinn.methods.method import TYPICAL_SAMPLES
from accpinn.methods.pinn.config import (
    CALIBRATED,
    FAST,
    PAPER,
    PinnConfig,
    PresetName,
)
from accpinn.methods.pinn.network import STRETCH, FourierFeatures
from accpinn.model.cthp import Case, Parameters
from accpinn.segment.segment import Segment
from accpinn.units import FloatArray, Seconds

TYPICAL: dict[PresetName, tuple[Seconds, float, int]] = {
    "fast": (0.5, 0.12, FAST.iterations),
    "calibrated": (1.2, 0.6, CALIBRATED.iterations),
    "paper": (450.0, 0.44, PAPER.iterations),
}
"""Of a training on 300 s of one follower, the share of it that each further one adds, and for how
many iterations at most; see docs/validation.md."""
MOST_BYTES = 1.4e9
_PER_FEATURE, _MASKED = (34, 2), (48, 15)
"""Bytes per instant and input feature that `fast` takes at its peak, and for each follower;
measured, without a mask and with one."""
_PER_PAIR, _MASKED_PAIR = (550, 115), (550, 250)
"""Bytes per pair of features that `calibrated` takes, likewise: products of all derivatives."""
_OTHER_FEATURES = 70
"""Activations, constant and slope."""
_PER_INSTANT = 5_000
"""Bytes per instant that `paper` takes at its peak; measured."""


@dataclass(frozen=True, eq=False)
class WarmStart:
    """Weights and parameters of an earlier fit, with which a training begins."""

    arrays: dict[str, FloatArray]
    """As in `Fit.arrays`."""
    parameters: Parameters
    """(M,)"""
    origin: str
    """Whose they are, as "snapshot 0123456789abcdef"."""

    @classmethod
    def of(cls, fit: Fit, origin: str) -> "WarmStart":
        """Those of a fit."""
        return cls(fit.arrays, fit.parameters, origin)

    def digest(self) -> str:
        """SHA-256: equal digests mean an equal start."""
        found = hashlib.sha256()
        for name, values in [*sorted(self.arrays.items()), ("", self.parameters.values)]:
            found.update(f"{name}{values.shape}{values.dtype}".encode())
            found.update(np.ascontiguousarray(values).tobytes())
        return found.hexdigest()

    def initial(self, case: Case, followers: int) -> Parameters:
        """(1,) or (M,) to begin with; τ is 0 where it was undetermined.

        Raises:
            ConfigError: when it has another number of followers.
        """
        if self.parameters.values.shape != (followers, 3):
            raise ConfigError(
                f"The weights of {self.origin} are for {len(self.parameters)} followers, the window"
                f" has {followers}; choose the same vehicles, or start without them."
            )
        values = np.nan_to_num(self.parameters.values)
        if case == "II":
            return Parameters.of(values)
        alike = (values == values[0]).all()
        return Parameters.of(values[:1] if alike else values.mean(axis=0)[None])


def require_memory(segment: Segment, config: PinnConfig) -> None:
    """Refuse a window whose training would not fit.

    Raises:
        SegmentError: naming the longest window that can be trained on.
    """
    step, rate = segment.sample_time, 2 * STRETCH * config.highest_frequency
    if config.preset == "paper":
        needed: float = _PER_INSTANT * segment.samples
        longest: Seconds = MOST_BYTES / _PER_INSTANT * step
    elif config.preset == "calibrated":
        common, own = _PER_PAIR if segment.mask is None else _MASKED_PAIR
        each = common + own * segment.followers
        needed = each * (rate * segment.window.duration + _OTHER_FEATURES) ** 2
        longest = (sqrt(MOST_BYTES / each) - _OTHER_FEATURES) / rate
    else:
        common, own = _PER_FEATURE if segment.mask is None else _MASKED
        each = common + own * segment.followers
        features = FourierFeatures.up_to(config.highest_frequency, segment.window.duration).size
        needed = each * segment.samples * features
        # Instants and features both grow with the window.
        longest = sqrt(MOST_BYTES * step / (each * rate))
    if needed > MOST_BYTES:
        other = ", or the preset fast" if config.preset == "calibrated" else ""
        raise SegmentError(
            f"{segment.source}: a window of {segment.window.duration:,.0f} s would take"
            f" {needed / 1e9:,.1f} GB of memory to train on; take at most"
            f" {0.98 * longest // 10 * 10:,.0f} s{other}."
        )


def typical_seconds(segment: Segment, settings: PinnConfig | None) -> Seconds:
    """Of one training that runs all its iterations."""
    config = settings or FAST
    typical, further, iterations = TYPICAL[config.preset]
    followers = 1 + further * (segment.followers - 1)
    size = segment.samples / TYPICAL_SAMPLES * config.iterations / iterations
    larger = max(1.0, config.layers / FAST.layers * (config.width / FAST.width) ** 2)
    return typical * size * followers * larger
