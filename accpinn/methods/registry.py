"""Every method by its key, in the order in which they are shown."""

from collections.abc import Sequence

from accpinn.errors import ConfigError, SegmentError
from accpinn.methods import (
    Method,
    dual_ukf,
    least_squares,
    maximum_likelihood,
    particle,
    recursive,
    simulation,
    splines,
)
from accpinn.methods.pinn import training as pinn
from accpinn.model.registry import CTHPS
from accpinn.recordings import Recording
from accpinn.segment import Segment
from accpinn.segment.cut import IncompleteWindow, cut
from accpinn.units import Seconds

METHODS: dict[str, Method] = {
    method.key: method
    for method in (
        pinn.METHOD,
        maximum_likelihood.METHOD,
        least_squares.METHOD,
        least_squares.SMOOTHED,
        splines.METHOD,
        simulation.METHOD,
        recursive.METHOD,
        particle.METHOD,
        dual_ukf.METHOD,
    )
}


def usual_method(model: str | None, preset: str | None = None) -> str:
    """The method by which a model is estimated unless another is named: a preset may be."""
    by_network = model in CTHPS or model in pinn.METHOD.models({"preset": preset})
    return "pinn" if model is None or by_network else simulation.METHOD.key


def method_of(key: str) -> Method:
    """The method of that key.

    Raises:
        ConfigError: for an unknown key.
    """
    if key not in METHODS:
        raise ConfigError(f"method: {key[:40]} is not known; choose {', '.join(METHODS)}.")
    return METHODS[key]


def segment_for(
    methods: Sequence[str],
    recording: Recording,
    start: Seconds,
    duration: Seconds,
    vehicles: Sequence[int] | None,
) -> Segment:
    """The window that methods are to be applied to; samples may be missing if all allow that.

    Args:
        methods: keys of `METHODS`.
        recording: what to cut from.
        start: see `accpinn.segment.cut.cut`, as all others.
        duration: in s.
        vehicles: leader first.

    Raises:
        SegmentError: one sentence of what is wrong and what would be possible.
    """
    allowed = all(METHODS[key].allows_missing for key in methods)
    try:
        return cut(recording, start, duration, vehicles, allow_missing=allowed)
    except IncompleteWindow as fault:
        others = " or ".join(key for key, method in METHODS.items() if method.allows_missing)
        alone = " alone" if len(methods) > 1 else ""
        raise SegmentError(
            f"{str(fault).removesuffix('.')}, or choose {others}{alone}, which allows missing"
            " samples."
        ) from None
