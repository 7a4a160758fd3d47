"""Arguments of public functions are checked against their annotations before anything runs.

`import accpinn` wraps every public function in `checked_function`, so a wrong argument ends as one
`ConfigError` that names the argument, the value and what is allowed. Only types are checked here;
each function checks values and shapes. Numbers and arrays of numpy count as Python's.
"""

import inspect
import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from difflib import get_close_matches
from functools import cache, wraps
from numbers import Integral, Real
from types import NoneType, SimpleNamespace, UnionType
from typing import (
    Annotated,
    Any,
    Literal,
    ParamSpec,
    TypeVar,
    Union,
    cast,
    get_args,
    get_origin,
    get_type_hints,
)

from accpinn.errors import ConfigError, shown

P = ParamSpec("P")
R = TypeVar("R")

CURES = {
    "by": 'names of columns in a tuple, as ("make",)',
    "content": "the path of a snapshot, or its bytes; save a result first",
    "data": "a recording, or segments of recordings",
    "exclude": 'names of regimes, as "standstill"',
    "fixed": 'numbers by names of parameters, as {"s0": 4.0}',
    "leader": "a Sinusoid, a SpeedStep, a Brake or a Recorded",
    "levels": "a number above 0 and below 1, as 0.9",
    "methods": 'names in a tuple, as ("pinn", "splines")',
    "models": 'keys in a tuple, as ("cthp", "idm")',
    "parameters": "Parameters of vehicles, or a result",
    "recording": "a recording, as accpinn.read gives it",
    "rows": "a frame, as accpinn.read_study gives it",
    "segments": "a segment, or several in a list",
    "settings": 'a dict of the preset\'s settings, as {"iterations": 100}',
    "source": "a file's path, a recording, or segments of recordings",
    "store": 'an accpinn.Store("folder")',
    "vehicles": 'consecutive numbers, leader first, as "1-2" or (1, 2)',
    "windows": 'pairs of start and end in s, as [(0, 300), (600, 900)], or "auto"',
}
"""Allowed values by the argument's name, which means the same in every public function."""
KINDS: dict[Any, str] = {
    str: "a text",
    int: "a whole number, as 0",
    float: "a number",
    bool: "True or False",
    bytes: "bytes",
    NoneType: "None",
}
"""Allowed values of other arguments, by type."""
ALIASES = {"hold": "fixed", "leave_out": "exclude", "out": "path"}
"""Words of the command line and of older releases for an argument."""


class _Mismatch(Exception):
    """A value that its annotation does not allow."""


def checked_function(function: Callable[P, R], name: str) -> Callable[P, R]:
    """A public function that checks its arguments first; ``name`` is its public name."""

    @wraps(function)
    def call(*args: P.args, **kwargs: P.kwargs) -> R:
        signature, hints = _described(function)
        try:
            bound = signature.bind(*args, **kwargs)
        except TypeError as fault:
            raise ConfigError(_unbound(name, signature, kwargs, fault)) from None
        for argument, value in bound.arguments.items():
            kind = signature.parameters[argument].kind
            if argument not in hints or kind in (kind.VAR_KEYWORD, kind.VAR_POSITIONAL):
                continue
            try:
                bound.arguments[argument] = _converted(hints[argument], value)
            except _Mismatch:
                allowed = CURES.get(argument) or _kinds(hints[argument])
                raise ConfigError(
                    f"{argument}: {shown(value)} is not allowed; choose {allowed}."
                ) from None
        return function(*bound.args, **bound.kwargs)

    call.__module__, call.__qualname__ = "accpinn", name  # so that it can be pickled by its name
    return cast("Callable[P, R]", call)


def checked_method(method: Callable[P, R]) -> Callable[P, R]:
    """Decorate a method of a public class that is to check its arguments first."""
    checked = checked_function(method, method.__qualname__)
    checked.__module__ = method.__module__
    return checked


@cache
def _described(function: Callable[..., Any]) -> tuple[inspect.Signature, dict[str, Any]]:
    """The signature of a function and its annotations by argument, read once."""
    given = {n: hint for n, hint in function.__annotations__.items() if n != "return"}
    names = getattr(inspect.unwrap(function), "__globals__", {})
    hints = get_type_hints(SimpleNamespace(__annotations__=given), names, include_extras=True)
    return inspect.signature(function), hints


def _unbound(
    name: str, signature: inspect.Signature, given: Mapping[str, Any], fault: TypeError
) -> str:
    """The sentence for arguments that do not fit a function, with those that would."""
    parameters = list(signature.parameters)
    for argument in given:
        if not {argument, "kwargs", "changes"} & set(parameters):
            near = get_close_matches(argument, parameters, 1)
            cure = ALIASES.get(argument, near[0] if near else "")
            listed = cure if cure in parameters else f"from {', '.join(parameters)}"
            return f"{argument}: {name} has no such argument; choose {listed}."
    return f"{name}: {fault}; help(accpinn.{name}) lists its arguments."


def _kinds(hint: Any) -> str:
    """Describe the values that an annotation allows."""
    origin, args = get_origin(hint), get_args(hint)
    if origin is Annotated:
        unit = args[1] if isinstance(args[1], str) else ""
        return f"a number in {unit}" if unit else _kinds(args[0])
    if origin in (Union, UnionType):
        words = dict.fromkeys(_kinds(part) for part in args if part is not NoneType)
        return " or ".join(words)
    if origin is Literal:
        return " or ".join(map(str, args))
    if hint in KINDS:
        return KINDS[hint]
    kind = origin or hint
    if isinstance(kind, type):
        if kind is cast("Any", Callable):
            return "a function"
        if issubclass(kind, os.PathLike):
            return "a path"
        if kind in (Sequence, list, tuple, Iterable):
            return "a list"
        if kind in (Mapping, dict):
            return "a dict"
        if kind.__module__.partition(".")[0] == "accpinn":
            return f"an accpinn.{kind.__name__}"
        return f"a {kind.__name__}"
    return "another one"


def _converted(hint: Any, value: Any) -> Any:
    """The value, with numpy's numbers as Python's, if the annotation allows it.

    Raises:
        _Mismatch: if it does not.
    """
    if type(value).__module__ == "numpy" and hasattr(value, "dtype") and not value.shape:
        value = value.item()
    origin, args = get_origin(hint), get_args(hint)
    if origin is Annotated:
        return _converted(args[0], value)
    if origin in (Union, UnionType):
        for alternative in args:
            with suppress(_Mismatch):
                return _converted(alternative, value)
        raise _Mismatch
    if origin is Literal:
        if isinstance(value, str | int | bool) and value in args:
            return value
        raise _Mismatch
    kind = origin or hint
    if kind in (Any, object):
        return value
    if kind in (int, float):
        abstract: type = Integral if kind is int else Real
        if isinstance(value, bool) or not isinstance(value, abstract):
            raise _Mismatch
        return value
    if kind in (Sequence, tuple, list, Iterable):
        return _items(kind, args, value)
    if kind in (Mapping, dict):
        if not isinstance(value, Mapping):
            raise _Mismatch
        keys, values = args if len(args) == 2 else (Any, Any)
        return {_converted(keys, key): _converted(values, item) for key, item in value.items()}
    if kind is cast("Any", Callable):
        return _require(callable(value), value)
    if isinstance(kind, type) and kind.__module__.partition(".")[0] == "numpy":
        return _array(value)
    if isinstance(kind, type) and not getattr(kind, "_is_protocol", False):
        return _require(isinstance(value, kind), value)
    return value


def _require(holds: bool, value: Any) -> Any:
    if not holds:
        raise _Mismatch
    return value


def _items(kind: Any, args: Sequence[Any], value: Any) -> Any:
    """A sequence whose items fit; an array of numpy becomes a list."""
    if type(value).__module__ == "numpy" and hasattr(value, "tolist"):
        value = value.tolist()
    allowed = Iterable if kind is Iterable else Sequence
    if isinstance(value, str | bytes) or not isinstance(value, allowed):
        raise _Mismatch
    if not args:
        return value
    if kind is tuple and args[-1:] != (...,):
        value = tuple(value)
        if len(value) != len(args):
            raise _Mismatch
        return tuple(_converted(part, item) for part, item in zip(args, value, strict=True))
    items = [_converted(args[0], item) for item in value]
    return items if isinstance(value, list) else tuple(items)


def _array(value: Any) -> Any:
    """An array of numbers, as numpy reads it."""
    import numpy as np

    try:
        array = np.asarray(value)
    except ValueError:  # rows of several lengths
        raise _Mismatch from None
    if array.dtype.kind not in "fiub":
        raise _Mismatch
    return value if isinstance(value, np.ndarray) else array


def check_level(level: float) -> None:
    """Refuse a level of an interval that is not above 0 and below 1.

    Raises:
        ConfigError: naming the value.
    """
    if not 0.0 < level < 1.0:
        raise ConfigError(f"level: {level:g} is not allowed; choose above 0 and below 1, as 0.9.")
