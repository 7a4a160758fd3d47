"""Results as trees of plain values and named arrays, and back: the one written form of them.

Dataclasses and structs become objects with the names of their fields as keys, tuples lists, members
of a `NamedEnum` their names, complex numbers [re, im], and nan and the infinities, which JSON does
not have, "nan", "inf" and "-inf". An array, and `Parameters` as an array (.., 3), stands as nested
lists where it is small; a larger one is kept beside the tree under its own path, as
"fit.surrogate.speeds", and the tree names it. Equal arrays are kept once.

Decoding follows the types of the fields and encodes the result again: a tree that differs from
what its value gives is refused, so there is one tree for one value.
"""

from collections.abc import Iterator, Mapping
from dataclasses import fields, is_dataclass
from enum import Enum
from hashlib import sha256
from math import isfinite
from typing import Any, TypeVar, get_args, get_origin

import msgspec
import numpy as np
from numpy.typing import NDArray

from accpinn.model.cthp import Parameters

T = TypeVar("T")
Arrays = dict[str, NDArray[Any]]

NOT_FINITE = ("nan", "inf", "-inf")
SMALL = 64
"""Numbers of an array that stands in the tree itself."""


class NamedEnum(Enum):
    """An enumeration whose members are stored by name: their values may be sentences."""

    @classmethod
    def _missing_(cls, value: object) -> Any:
        return cls.__members__.get(str(value))


def write_json(tree: Any) -> bytes:
    """The one text of a tree; keys are sorted."""
    return msgspec.json.encode(tree, order="sorted")


def read_json(text: bytes) -> Any:
    """The tree of a text that `write_json` wrote.

    Raises:
        ValueError: for any other text, however deep it is nested.
    """
    try:
        tree = msgspec.json.decode(text)
        same = write_json(tree) == text
    except (RecursionError, OverflowError):
        raise ValueError("it is nested too deep, or a number is absurd") from None
    if not same:
        raise ValueError("it is not as it was written")
    return tree


def dump(value: Any, share: bool = True) -> tuple[Any, Arrays]:
    """A value as a tree and the arrays that it names.

    Args:
        value: dataclasses, structs, tuples, dicts, numbers, texts and arrays within each other.
        share: whether equal arrays are kept once.

    Raises:
        ValueError: for a whole number beyond 64 bits.
    """
    encoder = _Encoder(share)
    return encoder.tree(value, ""), encoder.arrays


class _Encoder:
    def __init__(self, share: bool) -> None:
        self.arrays: Arrays = {}
        self._share = share
        self._names: dict[bytes, str] = {}

    def tree(self, value: Any, path: str) -> Any:
        if isinstance(value, np.generic):
            value = value.item()
        if isinstance(value, Enum):
            value = value.name if isinstance(value, NamedEnum) else value.value
        if isinstance(value, Parameters | np.ndarray):
            return self._array(value.values if isinstance(value, Parameters) else value, path)
        if isinstance(value, float):
            return float(value) if isfinite(value) else str(float(value))
        if isinstance(value, complex):
            return self.tree((value.real, value.imag), path)
        if isinstance(value, int) and abs(value) >= 2**63:
            raise ValueError(f"{path} is beyond all numbers")
        if value is None or isinstance(value, bool | int | str):
            return value
        items = {name: self.tree(item, join(path, name)) for name, item in _items(value)}
        return list(items.values()) if isinstance(value, list | tuple) else items

    def _array(self, values: NDArray[Any], path: str) -> Any:
        if 0 < values.size <= SMALL and values.dtype in (np.float64, np.bool_):
            return self.tree(values.tolist(), path)
        content = sha256(f"{values.dtype.str}{values.shape}".encode())
        content.update(np.ascontiguousarray(values).data.cast("B") if values.size else b"")
        name = self._names.setdefault(content.digest(), path) if self._share else path
        self.arrays.setdefault(name, values)
        return name


def _items(value: Any) -> Iterator[tuple[str, Any]]:
    """What an object holds, by name or number; a tagged struct names its kind first."""
    if isinstance(value, list | tuple):
        yield from ((str(k), item) for k, item in enumerate(value))
    elif isinstance(value, dict):
        yield from ((str(name), item) for name, item in value.items())
    elif isinstance(value, msgspec.Struct):
        config = value.__struct_config__
        if config.tag_field:
            yield config.tag_field, config.tag
        yield from msgspec.structs.asdict(value).items()
    else:
        yield from ((field.name, getattr(value, field.name)) for field in fields(value))


def join(path: str, name: str) -> str:
    """The place of what has that name at a place; either may be empty."""
    if not name:
        return path
    return f"{path}.{name}" if path else name


def restore(kind: type[T], tree: Any, arrays: Mapping[str, NDArray[Any]]) -> T:
    """The value of a tree and its arrays.

    Args:
        kind: its class; nothing is believed but what the types of its fields allow.
        tree: as `dump` gives it.
        arrays: those that the tree names, and no others.

    Raises:
        ValueError: for anything else, with the place.
    """

    def decode(kind: Any, item: Any) -> Any:
        if kind is complex:
            real, imaginary = item
            return complex(float(real), float(imaginary))
        if kind is Parameters:
            return Parameters.of(array(np.float64, item))
        if get_origin(kind) is np.ndarray:
            return array(get_args(get_args(kind)[1])[0], item)
        raise NotImplementedError(kind)

    def array(scalar: type[np.generic], item: Any) -> NDArray[Any]:
        values = arrays.get(item) if isinstance(item, str) else np.array(item, dtype=scalar)
        if values is None or values.dtype.kind != np.dtype(scalar).kind:
            raise ValueError("Expected an array")
        values.setflags(write=False)
        return values

    try:
        # Lax, so that "nan" is a number where one is due; what else that allows is refused below.
        value = msgspec.convert(tree, kind, strict=False, dec_hook=decode)
        again, named = dump(value)
        differing = {place for place, _ in _leaves(again) ^ _leaves(tree)}
        if differing or again != tree or named.keys() != arrays.keys():
            place = min(differing or named.keys() ^ arrays.keys(), default="it")
            raise ValueError(f'"{place}" does not belong there')
    except RecursionError:
        raise ValueError("it is nested too deep") from None
    return value


def flatten(tree: Any, path: str = "") -> Iterator[tuple[str, Any]]:
    """The leaves of a tree of plain values with their places."""
    if isinstance(tree, dict | list):
        for name, item in _items(tree):
            yield from flatten(item, join(path, name))
    else:
        yield path, tree


def _leaves(tree: Any) -> set[tuple[str, tuple[bool, Any]]]:
    """Places and leaves, with True kept apart from 1."""
    return {(place, (isinstance(leaf, bool), leaf)) for place, leaf in flatten(tree)}


class Shape:
    """The lengths of an array or a tuple, as `Shape("M", 3)`.

    A letter means the same number in all fields of one object, and those that are known from the
    start the same number everywhere; without any length every shape serves.
    """

    def __init__(self, *lengths: str | int, finite: bool = False) -> None:
        """With the lengths, and whether nan and the infinities are refused."""
        self.lengths, self.finite = lengths, finite

    def fault(self, value: Any, sizes: dict[str, int]) -> str:
        """What is wrong with a value; empty where nothing is. Unknown letters enter ``sizes``."""
        values = value.values if isinstance(value, Parameters) else value
        plain = not isinstance(values, np.ndarray)
        lengths = (len(values),) if plain else values.shape
        expected = tuple(
            sizes.setdefault(symbol, length) if isinstance(symbol, str) else symbol
            for symbol, length in zip(self.lengths, lengths, strict=False)
        )
        if self.lengths and (lengths != expected or len(lengths) != len(self.lengths)):
            return f"has the shape {lengths}, which does not fit the rest"
        if self.lengths and not plain and values.dtype not in (np.float64, np.bool_):
            return f"has the type {values.dtype}, which does not fit the rest"
        parts = values.values() if isinstance(values, dict) else (values,)
        if self.finite and not all(np.isfinite(part).all() for part in parts):
            return "has a number that is nan or infinite"
        return ""


def every(kind: type[T], value: Any) -> Iterator[T]:
    """All of a class that an object holds, at whatever depth."""
    if isinstance(value, kind):
        yield value
    if is_dataclass(value) or isinstance(value, msgspec.Struct | list | tuple | dict):
        for _, item in _items(value):
            yield from every(kind, item)


def check_shapes(
    value: Any, shapes: Mapping[str, Shape], sizes: Mapping[str, int], path: str = ""
) -> None:
    """Refuse arrays and tuples whose lengths contradict each other.

    Args:
        value: an object and all within it.
        shapes: by class and field, as "Fit.parameters".
        sizes: numbers known from the start by letter, as {"M": 4}.
        path: of the value, for the sentence.

    Raises:
        ValueError: naming the place.
    """
    if value is None or isinstance(value, bool | int | float | complex | str | Enum | np.ndarray):
        return
    own = dict(sizes)
    names = [kind.__name__ for kind in type(value).__mro__]
    for name, item in () if isinstance(value, Parameters) else _items(value):
        place = join(path, name)
        for shape in (shapes.get(f"{kind}.{name}") for kind in names):
            if shape and item is not None and (fault := shape.fault(item, own)):
                raise ValueError(f"{place} {fault}")
        check_shapes(item, shapes, sizes, place)
