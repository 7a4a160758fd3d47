"""Results as trees and arrays and back: bit for bit, and nothing but what the types allow."""

from contextlib import nullcontext
from dataclasses import dataclass, replace
from typing import Any, Literal

import msgspec
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from accpinn.findings import Finding
from accpinn.methods.fit import Outcome
from accpinn.model.cthp import Parameters
from accpinn.serial import Shape, check_shapes, dump, read_json, restore, write_json
from accpinn.units import FloatArray, Seconds
from tests.support.snapshots import bits


class Hit(Finding, frozen=True):
    vehicle: int
    time: float


class Bound(Finding, frozen=True):
    names: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class Record:
    """One field of every kind that results have."""

    name: str | None
    time: Seconds
    case: Literal["I", "II"]
    poles: tuple[complex, complex]
    values: FloatArray
    mask: NDArray[np.bool_] | None
    parameters: Parameters
    outcome: Outcome
    findings: tuple[Hit | Bound, ...]
    arrays: dict[str, FloatArray]
    config: dict[str, Any]
    count: int = 0


NUMBERS = st.floats(allow_nan=True, allow_infinity=True)


def record(size: int = 3, number: float = 1.0) -> Record:
    return Record(
        name="nan",
        time=number,
        case="I",
        poles=(complex(-1.0, number), complex(number, 0.0)),
        values=np.full((size, 2), number),
        mask=np.arange(size) % 2 == 0,
        parameters=Parameters([0.1] * size, 0.2, np.nan),
        outcome=Outcome.STOPPED,
        findings=(Hit(2, number), Bound(("α", "null"))),
        arrays={"w": np.ones(100, np.float32), "v": np.full((size, 2), number)},
        config={"a": None, "b": [1, 2.5, "x"]},
    )


def again(value: Any) -> Any:
    tree, arrays = dump(value)
    return restore(type(value), read_json(write_json(tree)), arrays)


@given(st.integers(0, 50), NUMBERS)
def test_any_numbers_survive(size: int, number: float) -> None:
    before = record(size, number)
    after = again(before)
    assert bits(after) == bits(before)
    assert after.outcome is Outcome.STOPPED
    assert after.arrays["w"].dtype == np.float32
    assert after.values.shape == (size, 2)
    assert isinstance(after.findings[1], Bound)


@given(st.text(), st.lists(st.text(), max_size=3))
def test_any_texts_survive(name: str, names: list[str]) -> None:
    before = replace(record(), name=name, findings=(Bound(tuple(names)),))
    assert bits(again(before)) == bits(before)


def test_equal_arrays_are_kept_once() -> None:
    values = np.arange(100.0)
    _, arrays = dump({"a": values, "b": values.copy(), "c": values.reshape(50, 2)})
    assert list(arrays) == ["a", "c"]


def test_a_whole_number_beyond_64_bits_is_refused() -> None:
    with pytest.raises(ValueError, match="count"):
        dump(replace(record(), count=2**63))


@pytest.mark.parametrize(
    ("change", "place"),
    [
        ({"name": 5}, "name"),
        ({"time": "1.5"}, "time"),
        ({"time": None}, "time"),
        ({"time": True}, "time"),
        ({"case": "III"}, "case"),
        ({"poles": [[1.0, 2.0]]}, "poles"),
        ({"poles": [[1.0, 2.0], [1.0]]}, "poles"),
        ({"values": [[1.0, True]]}, "values"),
        ({"values": [[1.0, None]]}, "values"),
        ({"values": [[1.0], [1.0, 2.0]]}, "values"),
        ({"values": "values"}, "values"),
        ({"values": "arrays.mask"}, "values"),
        ({"values": [1.0] * 100}, "values"),
        ({"values": {}}, "values"),
        ({"mask": [0.5]}, "mask"),
        ({"mask": "arrays.w"}, "mask"),
        ({"parameters": [[1.0, 2.0]]}, "parameters"),
        ({"outcome": Outcome.STOPPED.value}, "outcome"),
        ({"outcome": None}, "outcome"),
        ({"findings": [{"type": "Other"}]}, "findings"),
        ({"findings": [{"type": "Hit", "vehicle": 1}]}, "findings"),
        ({"count": 1.5}, "count"),
        ({"more": 1}, "more"),
    ],
    ids=str,
)
def test_what_the_types_do_not_allow_is_refused(change: dict[str, Any], place: str) -> None:
    tree, arrays = dump(record())
    with pytest.raises(ValueError, match=place):
        restore(Record, tree | change, arrays)


def test_fields_and_arrays_that_are_missing_or_too_many_are_refused() -> None:
    tree, arrays = dump(record())
    for changed in ({}, arrays | {"more": np.zeros(3)}):
        with pytest.raises(ValueError, match=r"arrays|more"):
            restore(Record, tree, changed)
    for name in ("name", "count", "findings"):
        with pytest.raises(ValueError, match=name):
            restore(Record, {key: tree[key] for key in tree if key != name}, arrays)


@pytest.mark.parametrize(
    "text", [b"", b" 1", b"1e5", b"NaN", b"1e999", b'{"b":1,"a":2}', b'{"a":1,"a":1}', b'"\\u0041"',
             b"[" * 100_000, b"[" * 5000 + b"]" * 5000, b"9" * 100_000, b'"\xff"']
)  # fmt: skip
def test_a_text_that_would_not_be_written_is_refused(text: bytes) -> None:
    with pytest.raises((ValueError, msgspec.MsgspecError)):
        read_json(text)


@pytest.mark.parametrize(
    ("shape", "sizes", "number", "said"),
    [
        (Shape("N", 2), {"N": 3}, 1.0, ""),
        (Shape("N", 2), {}, 1.0, ""),
        (Shape("N", 2), {"N": 4}, 1.0, "values has the shape"),
        (Shape("N", 3), {}, 1.0, "values has the shape"),
        (Shape("N"), {}, 1.0, "values has the shape"),
        (Shape(finite=True), {}, 1.0, ""),
        (Shape(finite=True), {}, np.inf, "nan or infinite"),
    ],
)
def test_shapes_are_held_against_each_other(
    shape: Shape, sizes: dict[str, int], number: float, said: str
) -> None:
    shapes = {"Record.values": shape, "Record.parameters": Shape("N", 3)}
    with pytest.raises(ValueError, match=said) if said else nullcontext():
        check_shapes((record(number=number),), shapes, sizes)
