"""The PiNN as a method of the registry, and all that is known of a training before torch loads.

A training's request (data, settings, method's version, start) has a content address, under which
the store keeps its result and its checkpoint; a warm start gives it another fit's weights to begin
with; and a window that would need more memory than a server can spare is refused.
"""

import hashlib
import json
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from math import sqrt
from typing import Any

import numpy as np

from accpinn.errors import ConfigError, SegmentError
from accpinn.methods.fit import Fit, Run
from accpinn.methods.method import Method, TaskContext
from accpinn.methods.pinn.config import FAST, METHOD_VERSION, PRESETS, PinnConfig
from accpinn.methods.pinn.surrogate import FourierFeatures, redraw
from accpinn.methods.store import Store
from accpinn.model.cthp import Case, Parameters
from accpinn.segment.segment import Segment
from accpinn.units import FloatArray, Seconds

MOST_BYTES = 1.4e9
_PER_FEATURE = 32
"""Bytes per instant and input feature that `fast` takes at its peak; measured."""
_PER_FEATURE_MASKED = 55
"""The same with a mask, as each follower then has products of its own."""
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


def request_keys(
    segment: Segment, case: Case, config: PinnConfig, warm: WarmStart | None = None
) -> tuple[str, str]:
    """Content addresses of a request's result and of its checkpoint.

    Equal addresses mean equal data, settings and method. Where a longer training only goes on
    where a shorter one ends (`paper` without L-BFGS), both share a checkpoint.
    """
    settings: dict[str, object] = config.to_json()
    if warm:
        settings["started_from"] = warm.digest()
    resumable = settings.copy()
    if config.preset == "paper" and not config.lbfgs_iterations:
        del resumable["iterations"]
    return _address(segment, case, settings), _address(segment, case, resumable)


def resume_iteration(
    store: Store, segment: Segment, case: Case, config: PinnConfig, warm: WarmStart | None = None
) -> int | None:
    """The iteration from which a training of this request would go on; None where it is new.

    So is one that was stopped before its first iteration, and a finished one is in the store.
    """
    result_key, resume_key = request_keys(segment, case, config, warm)
    if store.has_fit(result_key):
        return None
    for key in (resume_key, result_key):
        state = store.load_state(key)
        if state is None:
            return None
        with suppress(KeyError, IndexError, TypeError, ValueError):
            last = int(state["history.rows"][-1][0])
            if last <= config.iterations + config.lbfgs_iterations:
                return last or None
    return None


def drop_checkpoints(
    store: Store, segment: Segment, case: Case, config: PinnConfig, warm: WarmStart | None = None
) -> None:
    """Drop the checkpoints that a training of this request would go on from."""
    for key in request_keys(segment, case, config, warm):
        store.drop_state(key)


def _address(segment: Segment, case: Case, settings: dict[str, object]) -> str:
    request = {
        "method": METHOD_VERSION,
        "segment": segment.info.digest,
        "case": case,
        "config": settings,
    }
    return hashlib.sha256(json.dumps(request, sort_keys=True).encode()).hexdigest()


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
        each = _PER_FEATURE if segment.mask is None else _PER_FEATURE_MASKED
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


def _run(segment: Segment, case: Case, settings: PinnConfig | None, context: TaskContext) -> Run:
    from accpinn.methods.pinn.training import training  # torch takes a second to import

    return training(
        segment,
        case,
        settings or FAST,
        store=context.store,
        should_stop=context.should_stop,
        threads=context.threads,
        warm=context.warm,
    )


def _variant(config: Mapping[str, Any]) -> str:
    """The preset, and whether settings differ from it."""
    name = str(config.get("preset", ""))
    usual = PRESETS[name].to_json() if name in PRESETS else {}
    return f"{name} preset" + ("" if dict(config) == usual else ", own options")


METHOD = Method(
    key="pinn",
    title="PiNN",
    run=_run,
    summary="physics-inspired neural network: trajectories and parameters learned together",
    typical_seconds=2.9,
    tolerance=1e-3,
    settings=PinnConfig,
    variant=_variant,
    description="a physics-inspired neural network (PiNN)",
    is_iterative=True,
    redraw=redraw,
)
