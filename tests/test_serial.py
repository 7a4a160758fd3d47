"""Results as trees and arrays and back: bit for bit, and nothing but what the types allow."""

from dataclasses import dataclass, replace
from typing import Any, Literal

import msgspec
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from accpinn.findings import Finding
from accpinn.methods.estimate import Outcome
from accpinn.model.cthp import Parameters
from accpinn.serial import dump, flatten, restore
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
    return restore(type(value), msgspec.json.decode(msgspec.json.encode(tree)), arrays)


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


@pytest.mark.parametrize(
    ("place", "array"), [("values", "arrays.mask"), ("mask", "arrays.w"), ("values", "absent")]
)
def test_an_array_of_another_kind_is_refused(place: str, array: str) -> None:
    tree, arrays = dump(record())
    with pytest.raises(ValueError, match=place):
        restore(Record, tree | {place: array}, arrays)


def test_leaves_have_their_places() -> None:
    tree = dump({"a": (1.0, {"b": np.inf}), "c": Parameters([0.1], [0.2], [1.0])})[0]
    places = {"a.0": 1.0, "a.1.b": "inf", "c.0.0": 0.1, "c.0.1": 0.2, "c.0.2": 1.0}
    assert dict(flatten(tree)) == places
