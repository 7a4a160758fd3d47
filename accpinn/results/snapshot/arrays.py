"""Arrays as a snapshot has them: `.npy` members, checked against a list of names and shapes.

A header is believed only where it is the very text that numpy writes for that type and shape, and
where the shape accounts for every byte that follows; only then is memory taken.
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from io import BytesIO
from math import prod
from typing import Any

import numpy as np
from numpy.typing import NDArray

from accpinn.errors import SnapshotError
from accpinn.results.snapshot.archive import check_packed, contents, pack

Arrays = dict[str, NDArray[Any]]

MOST_ARRAYS = 200
SUFFIX = ".npy"
MAGIC = b"\x93NUMPY\x01\x00"
_HEADER = re.compile(
    rb"\{'descr': '(<f8|<f4|<i8|\|b1)', 'fortran_order': False,"
    rb" 'shape': \(((?:\d{1,19},)?|\d{1,19}(?:, \d{1,19}){1,7})\), \} *\n"
)
_PREFIX = len(MAGIC) + 2
_NAME = re.compile(r"[A-Za-z0-9_]+(\.[A-Za-z0-9_]+)*\.npy")
"""Of a member, as "hidden.layers.0.weight.npy": nothing that could be a path."""


class Sizes:
    """How many there are of what: every symbol means the same number in all arrays."""

    def __init__(self, **known: int) -> None:
        """With the symbols known from the start, as M=2."""
        self._known = known

    def refuses(self, shape: Sequence[int], symbols: Sequence[str | int]) -> bool:
        """Whether a shape contradicts its symbols; a symbol new to it takes its first number."""
        if len(shape) != len(symbols):
            return True
        return any(
            length
            != (self._known.setdefault(symbol, length) if isinstance(symbol, str) else symbol)
            for length, symbol in zip(shape, symbols, strict=True)
        )

    def __getitem__(self, symbol: str) -> int:
        """The number."""
        return self._known[symbol]


@dataclass(frozen=True)
class Shape:
    """What an array has to be."""

    symbols: tuple[str | int, ...]
    dtype: str = "<f8"
    finite: bool = True
    """Whether nan and infinity are refused."""


def write(arrays: Mapping[str, NDArray[Any]]) -> bytes:
    """The arrays as one uncompressed `.npz`."""
    return pack({name + SUFFIX: _member(values) for name, values in arrays.items()})


def _member(values: NDArray[Any]) -> bytes:
    buffer = BytesIO()
    plain = np.ascontiguousarray(values).reshape(np.shape(values))
    np.lib.format.write_array(buffer, plain, version=(1, 0), allow_pickle=False)
    return buffer.getvalue()


def read(data: bytes, what: str) -> Arrays:
    """The arrays of an `.npz` that `write` wrote, each a copy of its own.

    Args:
        data: its bytes; who calls has bounded their number.
        what: how sentences name it, as "the network's weights".

    Raises:
        SnapshotError: for anything that `write` would not have written.
    """
    whole = f"The part with {what}"
    members = contents(data, whole, MOST_ARRAYS)
    check_packed(data, members, whole)
    for name in members:
        if not _NAME.fullmatch(name):
            raise SnapshotError(f'The snapshot is refused: in {what}, "{name[:60]}" is no name.')
    return {
        name.removesuffix(SUFFIX): _array(member, f"{what}, {name}")
        for name, member in members.items()
    }


def _array(member: bytes, place: str) -> NDArray[Any]:
    length = int.from_bytes(member[len(MAGIC) : _PREFIX], "little")
    header = _HEADER.fullmatch(member[_PREFIX : _PREFIX + length])
    if not member.startswith(MAGIC) or header is None:
        raise SnapshotError(
            f"The snapshot is refused: {place} is no plain array of numbers in the form that"
            " snapshots have."
        )
    dtype = np.dtype(header[1].decode())
    shape = tuple(int(part) for part in header[2].decode().split(",") if part.strip())
    payload = memoryview(member)[_PREFIX + length :]
    if prod(shape) * dtype.itemsize != len(payload):
        raise SnapshotError(
            f"The snapshot is refused: {place} claims the shape {shape}, but has"
            f" {len(payload):,} bytes."
        )
    try:
        values: NDArray[Any] = np.frombuffer(payload, dtype).reshape(shape).copy()
    except (ValueError, OverflowError):  # empty, but of lengths beyond all memory
        raise SnapshotError(f"The snapshot is refused: {place} has an absurd shape.") from None
    if _member(values) != member:
        raise SnapshotError(f"The snapshot is refused: the header of {place} is not numpy's own.")
    return values


def check(arrays: Arrays, shapes: Mapping[str, Shape], sizes: Sizes, what: str) -> None:
    """Refuse arrays that are missing, unknown, of another shape or type, or not finite.

    Raises:
        SnapshotError: naming the array.
    """
    if arrays.keys() != shapes.keys():
        name = min(arrays.keys() ^ shapes.keys())
        fault = "is missing" if name in shapes else "does not belong there"
        raise SnapshotError(f'The snapshot is refused: in {what}, "{name}" {fault}.')
    for name, shape in shapes.items():
        values = arrays[name]
        if values.dtype.str != shape.dtype or sizes.refuses(values.shape, shape.symbols):
            raise SnapshotError(
                f'The snapshot is refused: in {what}, "{name}" has the shape {values.shape} and'
                f" type {values.dtype}, which do not fit the rest."
            )
        if shape.finite:
            check_finite(values, f'{what}, "{name}"')


def check_finite(values: NDArray[Any], place: str) -> None:
    """Refuse nan and infinity.

    Raises:
        SnapshotError: naming the place.
    """
    if not np.isfinite(values).all():
        raise SnapshotError(f"The snapshot is refused: in {place}, a number is nan or infinite.")
