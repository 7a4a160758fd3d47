"""Value objects as trees of plain values and back, checked against their fields' types.

Names of fields are the keys. Numbers that JSON does not have stand as "nan", "inf" and "-inf";
complex ones as [re, im], members of an enum by name, arrays as nested lists.
"""

import math
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from enum import Enum
from types import NoneType, UnionType
from typing import (
    Any,
    Literal,
    NoReturn,
    TypeVar,
    Union,
    get_args,
    get_origin,
    get_type_hints,
)

import msgspec
import numpy as np
from numpy.typing import NDArray

from accpinn.errors import SnapshotError
from accpinn.findings import Finding
from accpinn.results.snapshot.arrays import Sizes
from accpinn.units import frozen

T = TypeVar("T")

NOT_FINITE = {"nan": math.nan, "inf": math.inf, "-inf": -math.inf}


def encode(value: Any, leave: frozenset[str] = frozenset()) -> Any:
    """A value as a tree; ``leave`` names fields of the outermost object that are kept elsewhere."""
    if isinstance(value, Enum):
        return value.name
    if value is None or isinstance(value, bool | int | str):
        return value
    if isinstance(value, float):
        return float(value) if math.isfinite(value) else str(float(value))
    if isinstance(value, complex):
        return [encode(value.real), encode(value.imag)]
    if isinstance(value, np.ndarray | np.generic):
        return encode(value.tolist())
    if isinstance(value, dict):
        return {str(key): encode(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [encode(item) for item in value]
    if isinstance(value, Finding):
        return encode(msgspec.to_builtins(value))
    names = [field.name for field in fields(value) if field.name not in leave]
    return {name: encode(getattr(value, name)) for name in names}


class Decoder:
    """Reads one document; every sentence names it and the place in it."""

    def __init__(
        self, what: str, sizes: Sizes, shapes: Mapping[str, tuple[str | int, ...]]
    ) -> None:
        """With the document's name, the numbers known and the shapes of fields by Class.field."""
        self.what, self.sizes, self.shapes = what, sizes, shapes

    def read(self, kind: type[T], tree: Any, place: str = "", **given: Any) -> T:
        """An object of the class ``kind``; fields in ``given`` are not looked for in the tree."""
        hints = _hints(kind)
        expected = hints.keys() - given.keys()
        if not isinstance(tree, dict) or tree.keys() != expected:
            self._refuse(place, f"is not what a {kind.__name__} has")
        values: dict[str, Any] = {}
        for name in expected:
            where = f"{place}.{name}" if place else name
            values[name] = self._value(hints[name], tree[name], where)
            symbols = self.shapes.get(f"{kind.__name__}.{name}")
            if symbols and self.sizes.refuses(_shape(values[name]), symbols):
                self._refuse(where, "has another length than the rest asks for")
        try:
            return kind(**values, **given)
        except (TypeError, ValueError) as fault:
            self._refuse(place, f"cannot be ({str(fault)[:60]})")

    def items(self, kind: type[T], tree: Any) -> list[Any]:
        """A list of trees, each to be read with `read`."""
        if not isinstance(tree, list):
            self._refuse("", f"is no list of {kind.__name__}")
        return tree

    def _value(self, kind: Any, tree: Any, place: str) -> Any:
        origin = get_origin(kind)
        parts = get_args(kind)
        if parts and all(isinstance(part, type) and issubclass(part, Finding) for part in parts):
            return self._finding(kind, tree, place)
        if origin in (Union, UnionType):
            return self._optional(kind, tree, place)
        if origin is Literal:
            return tree if tree in get_args(kind) else self._refuse(place, "is not known")
        if origin is tuple:
            return self._tuple(get_args(kind), tree, place)
        if origin is dict:
            return self._dict(get_args(kind)[1], tree, place)
        if origin is np.ndarray:
            return self._array(kind, tree, place)
        if isinstance(kind, type) and is_dataclass(kind):
            return self.read(kind, tree, place)
        return self._plain(kind, tree, place)

    def _plain(self, kind: Any, tree: Any, place: str) -> Any:
        if kind is Any:
            return tree
        if kind is float:
            return self._float(tree, place)
        if kind is complex:
            return complex(*self._tuple((float, float), tree, place))
        if isinstance(kind, type) and issubclass(kind, Enum):
            known = isinstance(tree, str) and tree in kind.__members__
            return kind[tree] if known else self._refuse(place, "is not known")
        if type(tree) is not kind:
            self._refuse(place, f"is no {kind.__name__}")
        return tree

    def _float(self, tree: Any, place: str) -> float:
        if isinstance(tree, str) and tree in NOT_FINITE:
            return NOT_FINITE[tree]
        if type(tree) not in (int, float):
            self._refuse(place, "is no number")
        return float(tree)

    def _finding(self, kind: Any, tree: Any, place: str) -> Any:
        try:
            return msgspec.convert(tree, kind, strict=False)
        except msgspec.ValidationError as fault:
            self._refuse(place, f"cannot be ({str(fault)[:60]})")

    def _optional(self, kind: Any, tree: Any, place: str) -> Any:
        if tree is None:
            return None
        [inner] = [part for part in get_args(kind) if part is not NoneType]
        return self._value(inner, tree, place)

    def _tuple(self, kinds: tuple[Any, ...], tree: Any, place: str) -> tuple[Any, ...]:
        if not isinstance(tree, list):
            self._refuse(place, "is no list")
        if kinds[-1] is Ellipsis:
            kinds = (kinds[0],) * len(tree)
        if len(kinds) != len(tree):
            self._refuse(place, f"has {len(tree)} parts instead of {len(kinds)}")
        pairs = enumerate(zip(kinds, tree, strict=True))
        return tuple(self._value(kind, item, f"{place}.{k}") for k, (kind, item) in pairs)

    def _dict(self, kind: Any, tree: Any, place: str) -> dict[str, Any]:
        if not isinstance(tree, dict):
            self._refuse(place, "is no object")
        return {name: self._value(kind, item, f"{place}.{name}") for name, item in tree.items()}

    def _array(self, kind: Any, tree: Any, place: str) -> NDArray[Any]:
        scalar = get_args(get_args(kind)[1])[0]
        leaf = bool if scalar is np.bool_ else float
        try:
            return frozen(self._leaves(leaf, tree, place), dtype=scalar)
        except ValueError:
            self._refuse(place, "has rows of different length")

    def _leaves(self, leaf: type, tree: Any, place: str) -> Any:
        if isinstance(tree, list):
            return [self._leaves(leaf, item, place) for item in tree]
        return self._plain(leaf, tree, place)

    def _refuse(self, place: str, fault: str) -> NoReturn:
        where = f'in {self.what}, "{place[:80]}"' if place else self.what
        raise SnapshotError(f"The snapshot is refused: {where} {fault}.")


def _shape(value: Any) -> tuple[int, ...]:
    return value.shape if isinstance(value, np.ndarray) else (len(value),)


def _hints(kind: Any) -> dict[str, Any]:
    """Types of an object's fields, without units."""
    hints = get_type_hints(kind)
    return {field.name: hints[field.name] for field in fields(kind)}
