"""A `Fit` as plain named arrays and one JSON text, and back, bit for bit."""

import json
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from accpinn.methods.fit import Fit, MethodFinding, Outcome, ParameterTrack
from accpinn.methods.history import History
from accpinn.model.cthp import Parameters, Trajectories
from accpinn.segment.segment import Segment
from accpinn.units import FloatArray

Arrays = dict[str, NDArray[np.generic]]

_HISTORY = ("iteration", "seconds", "total", "data", "physics", "initial", "parameters")
_PLAIN = {
    "method": str,
    "case": str,
    "seconds": float,
    "config": dict,
    "loss": dict,
    "iterations": int,
    "network_weights": int,
}


def pack_fit(fit: Fit) -> Arrays:
    """Everything in ``fit`` but whether it came from a cache."""
    text: dict[str, Any] = {name: getattr(fit, name) for name in _PLAIN}
    text["outcome"] = fit.outcome.name
    text["active_bounds"] = [list(names) for names in fit.active_bounds]
    text["findings"] = msgspec.to_builtins(fit.findings)
    arrays: Arrays = {
        "fit": np.array(json.dumps(text)),
        "parameters": _table(fit.parameters),
        "unconstrained": _table(fit.unconstrained),
    }
    if fit.surrogate:
        arrays["surrogate.time"] = fit.surrogate.time
        arrays["surrogate.speeds"] = fit.surrogate.speeds
        arrays["surrogate.gaps"] = fit.surrogate.gaps
    if fit.history:
        arrays |= {f"history.{name}": getattr(fit.history, name) for name in _HISTORY[:-1]}
        arrays["history.parameters"] = fit.history.parameters.values
    if fit.track:
        arrays["track.time"] = fit.track.time
        arrays["track.parameters"] = fit.track.parameters.values
        if fit.track.deviation is not None:
            arrays["track.deviation"] = fit.track.deviation
    return arrays | {f"array.{name}": values for name, values in fit.arrays.items()}


def unpack_fit(arrays: Arrays) -> Fit:
    """The `Fit` that `pack_fit` packed.

    Raises:
        KeyError, ValueError, TypeError: where ``arrays`` is not a packed fit.
    """
    text = json.loads(str(arrays["fit"]))
    surrogate = None
    if "surrogate.time" in arrays:
        surrogate = Trajectories(
            *(np.asarray(arrays[f"surrogate.{n}"], float) for n in ("time", "speeds", "gaps"))
        )
    history = None
    if "history.iteration" in arrays:
        columns = {n: np.asarray(arrays[f"history.{n}"], float) for n in _HISTORY[:-1]}
        history = History(**columns, parameters=_parameters(arrays["history.parameters"]))
    track = None
    if "track.time" in arrays:
        deviation = arrays.get("track.deviation")
        track = ParameterTrack(
            np.asarray(arrays["track.time"], float),
            _parameters(arrays["track.parameters"]),
            None if deviation is None else np.asarray(deviation, float),
        )
    _require_types(text)
    return Fit(
        **{name: text[name] for name in _PLAIN},
        parameters=_parameters(arrays["parameters"]),
        unconstrained=_parameters(arrays["unconstrained"])
        if len(arrays["unconstrained"])
        else None,
        surrogate=surrogate,
        outcome=Outcome[text["outcome"]],
        active_bounds=tuple(tuple(names) for names in text["active_bounds"]),
        history=history,
        track=track,
        findings=msgspec.convert(text["findings"], tuple[MethodFinding, ...]),
        arrays={
            name.removeprefix("array."): np.asarray(values)
            for name, values in arrays.items()
            if name.startswith("array.")
        },
    )


def require_match(fit: Fit, segment: Segment) -> None:
    """Whether a finished training can be that of a segment.

    Raises:
        ValueError: where its numbers differ in shape from the segment, or are not finite.
    """
    followers = segment.followers
    shapes: list[tuple[FloatArray, tuple[int, ...]]] = [(fit.parameters.values, (followers, 3))]
    if fit.surrogate:
        modelled = fit.surrogate
        shapes += [(modelled.time, segment.time.shape), (modelled.speeds, segment.speeds.shape)]
        shapes += [(modelled.gaps, segment.gaps.shape)]
    if fit.history:
        kept = len(fit.history.iteration)
        shapes += [(getattr(fit.history, name), (kept,)) for name in _HISTORY[:-1]]
        sets = fit.history.parameters.values.shape[1]  # one in Case I
        shapes += [(fit.history.parameters.values, (kept, sets, 3))]
    if any(values.shape != shape for values, shape in shapes):
        raise ValueError("its numbers are not those of the window")
    if len(fit.active_bounds) != followers or (
        fit.unconstrained is not None and len(fit.unconstrained) != followers
    ):
        raise ValueError("its followers are not those of the window")
    gains = fit.parameters.values[:, :2]  # τ is nan where α = 0
    curves = [fit.surrogate.speeds, fit.surrogate.gaps] if fit.surrogate else []
    if not all(np.isfinite(values).all() for values in (gains, *curves)):
        raise ValueError("its numbers are not finite")


def _require_types(text: dict[str, Any]) -> None:
    if any(type(text[name]) is not kind for name, kind in _PLAIN.items()):
        raise TypeError("it holds other types")
    if not all(isinstance(value, int | float) for value in text["loss"].values()):
        raise TypeError("its loss is no number")


def _table(parameters: Parameters | None) -> NDArray[np.float64]:
    return np.empty((0, 3)) if parameters is None else parameters.values


def _parameters(table: NDArray[np.generic]) -> Parameters:
    return Parameters.of(np.asarray(table, float))
