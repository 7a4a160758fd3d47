"""Results as trees of plain values and named arrays, and back: the one written form of them.

Dataclasses and structs become objects with the names of their fields as keys, tuples lists, and
members of a `NamedEnum` their names; nan and the infinities, which JSON does not have, become
"nan", "inf" and "-inf". An array, and `Parameters` as an array (.., 3 or 6), stands as nested
lists where it is small. A larger one is kept beside the tree under its own path, as
"fits.0.surrogate.speeds", and the tree holds that path.
"""

import io
import re
from collections.abc import Iterator, Mapping
from dataclasses import fields
from enum import Enum
from math import isfinite, prod
from typing import Any, TypeVar, get_args, get_origin

import msgspec
import numpy as np
from numpy.typing import NDArray

from accpinn.archives import UnpackedTooLarge, open_archive, read_member
from accpinn.channels import COMPUTABLE
from accpinn.model.cthp import Parameters

T = TypeVar("T")
Arrays = dict[str, NDArray[Any]]

NOT_FINITE = ("nan", "inf", "-inf")
MOST_ARRAYS = 10_000
"""Most arrays of one file; a comparison of ten methods on a hundred windows has half as many."""
SMALL = 64
"""Numbers of an array that stands in the tree itself."""


class NamedEnum(Enum):
    """An enumeration whose members are stored by name: their values may be sentences."""

    @classmethod
    def _missing_(cls, value: object) -> Any:
        return cls.__members__.get(str(value))


def dump(value: Any) -> tuple[Any, Arrays]:
    """A value as a tree, and the arrays that the tree names.

    The value consists of dataclasses, structs, tuples, dicts, numbers, texts and arrays.
    """
    arrays: Arrays = {}

    def tree(value: Any, path: str) -> Any:
        if isinstance(value, np.generic):
            value = value.item()
        if isinstance(value, Enum):
            value = value.name if isinstance(value, NamedEnum) else value.value
        if isinstance(value, Parameters):
            value = value.everything if value.everything[..., 3:].any() else value.values
        if isinstance(value, np.ndarray):
            if 0 < value.size <= SMALL and value.dtype in (np.float64, np.bool_):
                return tree(value.tolist(), path)
            arrays[path] = value
            return path
        if isinstance(value, float):
            return float(value) if isfinite(value) else str(float(value))
        if value is None or isinstance(value, int | str):
            return value
        items = {name: tree(item, _join(path, name)) for name, item in _items(value)}
        return list(items.values()) if isinstance(value, list | tuple) else items

    return tree(value, ""), arrays


def _items(value: Any) -> Iterator[tuple[str, Any]]:
    """Items of an object by name or number; a tagged struct names its kind first."""
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


def _join(path: str, name: str) -> str:
    return f"{path}.{name}" if path else name


def restore(kind: type[T], tree: Any, arrays: Mapping[str, NDArray[Any]]) -> T:
    """The value of a tree and its arrays, as `dump` gives them.

    Only values that the types of the fields allow are accepted.

    Raises:
        ValueError: for anything else, with the place, and for arrays that the tree does not name.
    """
    named: set[str] = set()

    def array(scalar: type[np.generic], item: Any) -> NDArray[Any]:
        values = arrays.get(item) if isinstance(item, str) else np.array(item, dtype=scalar)
        named.update([item] if isinstance(item, str) else [])
        if values is None or values.dtype.kind != np.dtype(scalar).kind:
            raise ValueError("Expected an array")
        values.setflags(write=False)
        return values

    def decode(kind: Any, item: Any) -> Any:
        if kind is Parameters:
            return Parameters.of(array(np.float64, item))
        if get_origin(kind) is np.ndarray:
            return array(get_args(get_args(kind)[1])[0], item)
        raise NotImplementedError(kind)

    try:
        # The lenient mode reads "nan" as a number; what else it allows does no harm.
        value = msgspec.convert(tree, kind, strict=False, dec_hook=decode)
    except RecursionError:
        raise ValueError("it is nested too deep") from None
    if foreign := arrays.keys() - named:
        raise ValueError(f"nothing names its array {min(foreign)[:60]}")
    return value


def flatten(tree: Any, path: str = "") -> Iterator[tuple[str, Any]]:
    """The leaves of a tree of plain values with their places, as "parameters.0.2"."""
    if isinstance(tree, dict | list):
        for name, item in _items(tree):
            yield from flatten(item, _join(path, name))
    else:
        yield path, tree


def read_arrays(packed: bytes, most: int) -> Arrays:
    """The arrays of an `.npz`, where they unpack to so many bytes at most.

    Raises:
        Exception: of many kinds, for anything else.
    """
    arrays: Arrays = {}
    with open_archive(packed, MOST_ARRAYS) as archive:
        for member in archive.namelist():
            name = member.removesuffix(".npy")
            if name == member or name in arrays:
                raise ValueError(f"it holds {member[:60]}, which is no array of its own")
            try:
                content = read_member(archive, member, most)
            except UnpackedTooLarge:
                raise ValueError("it would unpack to more than is read") from None
            most -= len(content)
            arrays[name] = _array(content)
    return arrays


def _array(content: bytes) -> NDArray[Any]:
    """The array of an `.npy`, whose header announces as many bytes as follow."""
    file = io.BytesIO(content)
    version = np.lib.format.read_magic(file)
    read_header = {
        (1, 0): np.lib.format.read_array_header_1_0,
        (2, 0): np.lib.format.read_array_header_2_0,
    }[version]
    shape, is_transposed, kind = read_header(file)
    if kind.hasobject or prod(shape) * kind.itemsize != len(content) - file.tell():
        raise ValueError("an array is not as large as it says")
    values: NDArray[Any] = np.empty(shape, kind, "F" if is_transposed else "C")
    if values.size:
        flat = np.frombuffer(content, kind, offset=file.tell())
        values[...] = flat.reshape(shape, order="F" if is_transposed else "C")
    return values


_UNSEEN = re.compile(
    "[\x00-\x08\x0b-\x1f\x7f-\x9f\u2028\u2029"  # control characters but tabs and line breaks
    "\u061c\u200e\u200f\u202a-\u202e\u2066-\u2069]"  # marks that turn the order of letters round
)


def sanitise(tree: Any, lines: bool = False) -> Any:
    """A tree of plain values without characters that control a terminal or a page."""
    if isinstance(tree, str):
        shown = _UNSEEN.sub("\ufffd", tree)
        return shown if lines else re.sub(r"[\t\n]+", " ", shown)
    if isinstance(tree, dict):
        return {sanitise(key): sanitise(item, key == "note") for key, item in tree.items()}
    if isinstance(tree, list):
        return [sanitise(item, lines) for item in tree]
    return tree


def check_numbers(tree: Any, arrays: Arrays) -> None:
    """Refuse numbers that nothing can be computed with; nan and the infinities have their places.

    Raises:
        ValueError: naming the place.
    """
    for place, leaf in (*flatten(tree), *arrays.items()):
        if isinstance(leaf, float | int | np.ndarray) and not isinstance(leaf, bool):
            sizes = np.abs(np.asarray(leaf, np.float64))
            if (np.isfinite(sizes) & (sizes > COMPUTABLE)).any():
                raise ValueError(f"{place} has a number beyond {COMPUTABLE:g}")
