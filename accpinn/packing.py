"""A `Fit` as plain named arrays and one JSON text, and back, bit for bit."""

import json
from typing import Any

import numpy as np
from numpy.typing import NDArray

from accpinn.cthp import Parameters, Trajectories
from accpinn.fit import Course, Fit, History, Outcome

Arrays = dict[str, NDArray[np.generic]]

_HISTORY = ("iteration", "seconds", "total", "data", "physics", "initial", "parameters")
_PLAIN = ("method", "case", "seconds", "config", "loss", "iterations", "network_weights")


def pack_fit(fit: Fit) -> Arrays:
    """Everything in ``fit`` but whether it came from a cache."""
    text: dict[str, Any] = {name: getattr(fit, name) for name in _PLAIN}
    text["outcome"] = fit.outcome.name
    text["active_bounds"] = [list(names) for names in fit.active_bounds]
    text["notes"] = list(fit.notes)
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
        arrays |= {f"history.{name}": getattr(fit.history, name) for name in _HISTORY}
    if fit.course:
        arrays["course.time"] = fit.course.time
        arrays["course.parameters"] = fit.course.parameters
        if fit.course.deviation is not None:
            arrays["course.deviation"] = fit.course.deviation
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
        history = History(**{n: np.asarray(arrays[f"history.{n}"], float) for n in _HISTORY})
    course = None
    if "course.time" in arrays:
        deviation = arrays.get("course.deviation")
        course = Course(
            np.asarray(arrays["course.time"], float),
            np.asarray(arrays["course.parameters"], float),
            None if deviation is None else np.asarray(deviation, float),
        )
    return Fit(
        **{name: text[name] for name in _PLAIN},
        parameters=_parameters(arrays["parameters"]),
        unconstrained=_parameters(arrays["unconstrained"]),
        surrogate=surrogate,
        outcome=Outcome[text["outcome"]],
        active_bounds=tuple(tuple(names) for names in text["active_bounds"]),
        history=history,
        course=course,
        notes=tuple(text["notes"]),
        arrays={
            name.removeprefix("array."): np.asarray(values)
            for name, values in arrays.items()
            if name.startswith("array.")
        },
    )


def _table(parameters: tuple[Parameters, ...]) -> NDArray[np.float64]:
    return np.array([[p.alpha, p.beta, p.tau] for p in parameters]).reshape(-1, 3)


def _parameters(table: NDArray[np.generic]) -> tuple[Parameters, ...]:
    return tuple(Parameters(*(float(v) for v in row)) for row in np.asarray(table, float))
