"""Results as trees and arrays and back: bit for bit, and nothing but what the types allow."""

from dataclasses import dataclass, replace
from typing import Any, Literal

import msgspec
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from accpinn.errors import Finding
from accpinn.methods import least_squares, splines
from accpinn.methods.fit import Fit, Outcome
from accpinn.methods.pinn.config import preset
from accpinn.model.cthp import Parameters
from accpinn.serial import Shape, check_shapes, dump, read_json, restore, write_json
from accpinn.units import FloatArray, Seconds
from tests.support.driving import MIXED, driven
from tests.support.methods import train
from tests.support.snapshots import bits

FITS = {
    "least squares": lambda: least_squares.fit(driven(MIXED)),
    "splines": lambda: splines.fit(driven(MIXED), "I"),
    "pinn, fast": lambda: train(driven(MIXED), "II", preset("fast", iterations=30)),
    "pinn, paper": lambda: train(driven(), "I", preset("paper", iterations=10)),
    "no headway": lambda: splines.fit(driven(((-0.002, 0.5, -5.0),))),
}


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


@pytest.mark.parametrize("method", FITS)
def test_a_fit_of_every_method_comes_back_bit_for_bit(method: str) -> None:
    fit = FITS[method]()
    assert isinstance(again(fit), Fit)
    assert bits(again(fit)) == bits(fit)


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


@pytest.mark.parametrize("name", ["name", "count", "findings"])
def test_a_field_that_is_missing_is_refused(name: str) -> None:
    tree, arrays = dump(record())
    del tree[name]
    with pytest.raises(ValueError, match=name):
        restore(Record, tree, arrays)


def test_arrays_that_are_missing_or_that_nothing_names_are_refused() -> None:
    tree, arrays = dump(record())
    for changed in ({}, arrays | {"more": np.zeros(3)}):
        with pytest.raises(ValueError, match=r"arrays|more"):
            restore(Record, tree, changed)


@pytest.mark.parametrize(
    "text", [b"", b" 1", b"1e5", b"NaN", b"1e999", b'{"b":1,"a":2}', b'{"a":1,"a":1}', b'"\\u0041"',
             b"[" * 100_000, b"[" * 5000 + b"]" * 5000, b"9" * 100_000, b'"\xff"']
)  # fmt: skip
def test_a_text_that_would_not_be_written_is_refused(text: bytes) -> None:
    with pytest.raises((ValueError, msgspec.MsgspecError)):
        read_json(text)


@pytest.mark.parametrize(
    ("shape", "sizes", "fault"),
    [
        (Shape("N", 2), {"N": 3}, ""),
        (Shape("N", 2), {}, ""),
        (Shape("N", 2), {"N": 4}, "values"),
        (Shape("N", 3), {}, "values"),
        (Shape("N"), {}, "values"),
        (Shape(finite=True), {}, ""),
    ],
)
def test_shapes_are_held_against_each_other(
    shape: Shape, sizes: dict[str, int], fault: str
) -> None:
    shapes = {"Record.values": shape, "Record.parameters": Shape("N", 3)}
    said = ""
    try:
        check_shapes((record(),), shapes, sizes)
    except ValueError as refusal:
        said = str(refusal)
    assert fault in said
    assert bool(fault) == bool(said)


def test_numbers_that_are_not_finite_are_refused_where_they_have_no_meaning() -> None:
    shapes = {"Record.values": Shape(finite=True)}
    with pytest.raises(ValueError, match="nan or infinite"):
        check_shapes(record(number=np.inf), shapes, {})
