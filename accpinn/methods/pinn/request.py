"""What a training is asked for, and what is known of it before it begins.

A request (data, settings, method's version, start) has content addresses, under which the store
keeps its result and its checkpoint; a warm start gives it another fit's weights to begin with; and
a window that would need more memory than a server can spare is refused.
"""

import hashlib
import json
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property
from math import sqrt

import numpy as np

from accpinn.errors import ConfigError, SegmentError
from accpinn.methods.fit import Fit
from accpinn.methods.method import TYPICAL_SAMPLES
from accpinn.methods.pinn.config import (
    CALIBRATED,
    FAST,
    METHOD_VERSION,
    PAPER,
    STRETCH,
    PinnConfig,
    PresetName,
)
from accpinn.methods.store import Store
from accpinn.model.cthp import Case, Parameters
from accpinn.segment.segment import Segment
from accpinn.units import FloatArray, Seconds

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


@dataclass(frozen=True, eq=False)
class TrainingRequest:
    """Everything that determines the result of a training."""

    segment: Segment
    case: Case
    config: PinnConfig
    warm: WarmStart | None = None
    """The weights it begins with in place of random ones."""

    @property
    def typical_seconds(self) -> Seconds:
        """How long it takes on two cores, to within a factor of two or so."""
        return typical_seconds(self.segment, self.config)

    @cached_property
    def keys(self) -> tuple[str, str]:
        """Content addresses of its result and of its checkpoint.

        Equal addresses mean equal data, settings and method. Where a longer training only goes on
        where a shorter one ends (`paper` without L-BFGS), both share a checkpoint.
        """
        settings: dict[str, object] = self.config.to_json()
        if self.warm:
            settings["started_from"] = self.warm.digest()
        resumable = settings.copy()
        if self.config.preset == "paper" and not self.config.lbfgs_iterations:
            del resumable["iterations"]
        return self._address(settings), self._address(resumable)

    def _address(self, settings: dict[str, object]) -> str:
        request = {
            "method": METHOD_VERSION,
            "segment": self.segment.info.digest,
            "case": self.case,
            "config": settings,
        }
        return hashlib.sha256(json.dumps(request, sort_keys=True).encode()).hexdigest()

    @property
    def key(self) -> str:
        """The content address of its result: requests of equal keys have the same one."""
        return self.keys[0]

    def recall(self, store: Store) -> Fit | None:
        """The stored result, None where there is none."""
        known = store.load_fit(self.key, self.segment)
        return replace(known, cached=True) if known else None

    def resume_iteration(self, store: Store) -> int | None:
        """The iteration from which a stopped training of it would go on; None where it is new.

        So is one that was stopped before its first iteration, and a finished one is in the store.
        """
        result_key, resume_key = self.keys
        if store.has_fit(result_key):
            return None
        for key in (resume_key, result_key):
            state = store.load_state(key)
            if state is None:
                return None
            with suppress(KeyError, IndexError, TypeError, ValueError):
                last = int(state["history.rows"][-1][0])
                if last <= self.config.iterations + self.config.lbfgs_iterations:
                    return last or None
        return None

    def drop_checkpoints(self, store: Store) -> None:
        """Let its next training begin anew."""
        for key in self.keys:
            store.drop_state(key)


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
