"""Fits packed into plain arrays and back: bit for bit."""

import io
from dataclasses import fields, replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from accpinn.methods import least_squares, splines
from accpinn.methods.fit import Fit, Outcome
from accpinn.methods.packing import Arrays, pack_fit, unpack_fit
from accpinn.methods.pinn.config import preset
from accpinn.methods.pinn.training import train
from accpinn.model.cthp import Parameters
from tests.support.driving import MIXED, driven

FITS = {
    "least squares": lambda: least_squares.fit(driven(MIXED)),
    "splines": lambda: splines.fit(driven(MIXED), "I"),
    "pinn, fast": lambda: train(driven(MIXED), "II", preset("fast", iterations=30)),
    "pinn, paper": lambda: train(driven(), "I", preset("paper", iterations=10)),
    "no headway": lambda: splines.fit(driven(((-0.002, 0.5, -5.0),))),
}


def through_a_file(arrays: Arrays) -> Arrays:
    """As they come back from disk, where nothing may be pickled."""
    file = io.BytesIO()
    np.savez(file, **arrays)
    file.seek(0)
    with np.load(file, allow_pickle=False) as loaded:
        return {name: loaded[name] for name in loaded.files}


def bits(value: Any) -> Any:
    """Equal exactly when all numbers inside are, also nan and the sign of zero."""
    if isinstance(value, np.ndarray):
        return value.shape, value.dtype, value.tobytes()
    if isinstance(value, float):
        return np.float64(value).tobytes()
    if isinstance(value, dict):
        return {name: bits(item) for name, item in value.items()}
    if isinstance(value, list | tuple):
        return type(value), [bits(item) for item in value]
    if hasattr(value, "__dataclass_fields__"):
        return [bits(getattr(value, field.name)) for field in fields(value)]
    return value


@pytest.mark.parametrize("method", FITS)
def test_a_fit_of_every_method_comes_back_bit_for_bit(method: str) -> None:
    fit = FITS[method]()
    again = unpack_fit(through_a_file(pack_fit(fit)))
    for field in fields(Fit):
        assert bits(getattr(again, field.name)) == bits(getattr(fit, field.name)), field.name


def test_whether_it_came_from_a_cache_is_not_packed() -> None:
    fit = replace(least_squares.fit(driven()), cached=True)
    assert not unpack_fit(pack_fit(fit)).cached


NUMBERS = st.floats(allow_nan=True, allow_infinity=True)


@given(
    st.lists(st.builds(Parameters, NUMBERS, NUMBERS, NUMBERS), min_size=1, max_size=10),
    NUMBERS,
    st.sampled_from(Outcome),
    st.lists(st.text(), max_size=3),
)
def test_any_numbers_and_sentences_survive(
    parameters: list[Parameters], loss: float, outcome: Outcome, notes: list[str]
) -> None:
    fit = replace(
        least_squares.fit(driven()),
        parameters=tuple(parameters),
        unconstrained=tuple(reversed(parameters)),
        loss={"total": loss},
        outcome=outcome,
        notes=tuple(notes),
    )
    again = unpack_fit(pack_fit(fit))
    assert bits(again.parameters) == bits(fit.parameters)
    assert bits(again.unconstrained) == bits(fit.unconstrained)
    assert bits(again.loss["total"]) == bits(loss)
    assert again.outcome is outcome
    assert again.notes == tuple(notes)


@pytest.mark.parametrize("missing", ["fit", "parameters", "surrogate.gaps", "history.total"])
def test_what_is_no_fit_is_refused(missing: str) -> None:
    packed = pack_fit(FITS["pinn, fast"]())
    del packed[missing]
    with pytest.raises(KeyError):
        unpack_fit(packed)
