"""Every method by its key, in the order in which they are shown."""

import re
from collections.abc import Mapping, Sequence
from typing import Any

from accpinn.errors import ConfigError, SegmentError
from accpinn.methods import (
    Method,
    dual_ukf,
    least_squares,
    particle,
    recursive,
    simulation,
    splines,
)
from accpinn.methods.pinn import training as pinn
from accpinn.methods.pinn.config import DEFAULT, PRESETS, PinnConfig
from accpinn.recordings import Recording
from accpinn.segment import Segment
from accpinn.segment.cut import IncompleteWindow, cut
from accpinn.units import Seconds

METHODS: dict[str, Method] = {
    method.key: method
    for method in (
        pinn.METHOD,
        least_squares.METHOD,
        least_squares.SMOOTHED,
        splines.METHOD,
        simulation.METHOD,
        recursive.METHOD,
        particle.METHOD,
        dual_ukf.METHOD,
    )
}
PRESET_METHOD = pinn.METHOD
"""The method whose presets pages, Python and the command line offer by their bare names."""
VARIANTS: dict[str, tuple[str, PinnConfig | None]] = {
    "pinn": ("pinn", PRESETS["calibrated"]),
    "pinn-fast": ("pinn", PRESETS["fast"]),
    "pinn-paper": ("pinn", PRESETS["paper"]),
    **{key: (key, None) for key in METHODS if key != "pinn"},
}
"""A method with the settings that a name stands for, where several are run side by side."""
COMPARED = tuple(name for name in VARIANTS if name != "pinn-paper")
"""The variants that are compared by default; training by the preset paper takes minutes."""
SHIPPED = frozenset(VARIANTS)
"""Names of methods that are part of the package."""
_KEY = re.compile(r"[a-z][a-z0-9]*(-[a-z0-9]+)*")
_ALIASES = {"maximum-likelihood": "pinn", "pinn-calibrated": "pinn"}


def register_method(method: Method) -> None:
    """Add an estimation method, which this process then knows by its key everywhere.

    A method that was registered before is replaced, so that a notebook's cell can be run again.
    Raise its `Method.version` with every change of its numbers where results are kept in a store.

    Args:
        method: see `Method`, and `accpinn.methods.direct` for one without settings.

    Raises:
        ConfigError: for a key that the package uses.

    Examples:
        >>> import accpinn
        >>> from dataclasses import replace
        >>> accpinn.register_method(replace(accpinn.METHODS["splines"], key="mine", title="Mine"))
        >>> recording = accpinn.sample("motorway")
        >>> accpinn.fit(recording, vehicles="1-2", method="mine").parameters.alpha.shape
        (1,)
    """
    if method.key in SHIPPED or method.key in _ALIASES:
        raise ConfigError(f"method: {method.key[:40]} is the package's own; choose another key.")
    if not _KEY.fullmatch(method.key):
        raise ConfigError(
            f"method: {method.key[:40]!r} is no key; choose lower-case words joined by hyphens."
        )
    METHODS[method.key] = method
    VARIANTS[method.key] = (method.key, None)


def recommended_method(model: str | None = None, preset: str | None = None) -> str:
    """The method by which a model is estimated unless another is named.

    It is the one with a posterior: the PiNN's preset calibrated, or else simulation. A preset that
    is named is the PiNN's.
    """
    able = pinn.METHOD.models(PRESETS[DEFAULT].to_json())
    is_pinn = preset is not None or model is None or model in able
    return pinn.METHOD.key if is_pinn else simulation.METHOD.key


def method_of(key: str) -> Method:
    """The method of that key.

    Raises:
        ConfigError: for an unknown key.
    """
    if not isinstance(key, str) or _ALIASES.get(key, key) not in METHODS:
        raise ConfigError(f"method: {str(key)[:40]} is not known; choose {', '.join(METHODS)}.")
    return METHODS[_ALIASES.get(key, key)]


def title_of(key: str) -> str:
    """The name of a method wherever people read it; an unknown key as it is."""
    return METHODS[key].title if key in METHODS else key


def variant_key(name: str) -> str:
    """The name in `VARIANTS` that a name stands for.

    Raises:
        ConfigError: for an unknown name.
    """
    key = _ALIASES.get(name, name) if isinstance(name, str) else name
    if not isinstance(key, str) or key not in VARIANTS:
        raise ConfigError(f"methods: {str(name)[:40]} is not known; choose {', '.join(VARIANTS)}.")
    return key


def variant_of(name: str) -> tuple[str, PinnConfig | None]:
    """The method and the settings that a name stands for; see `variant_key`."""
    return VARIANTS[variant_key(name)]


def variant_name(method: str, settings: Mapping[str, Any]) -> str:
    """The name in `VARIANTS` of a method with settings as JSON; presets count, not options."""
    preset = settings.get("preset")
    return method if preset in (None, DEFAULT) else f"{method}-{preset}"


def segment_for(
    variants: Sequence[tuple[str, Mapping[str, Any]]],
    recording: Recording,
    start: Seconds,
    duration: Seconds,
    vehicles: Sequence[int] | None,
) -> Segment:
    """The window that methods are to be applied to; samples may be missing if all allow that.

    Args:
        variants: keys of `METHODS` with their settings as JSON.
        recording: what to cut from.
        start: see `accpinn.segment.cut.cut`, as all others.
        duration: in s.
        vehicles: leader first.

    Raises:
        SegmentError: one sentence of what is wrong and what would be possible.
    """
    allowed = all(METHODS[key].allows_missing(settings) for key, settings in variants)
    try:
        return cut(recording, start, duration, vehicles, allow_missing=allowed)
    except IncompleteWindow as fault:
        alone = " alone" if len(variants) > 1 else ""
        raise SegmentError(
            f"{str(fault).removesuffix('.')}, or choose the PiNN's preset calibrated{alone}, which"
            " allows missing samples."
        ) from None
