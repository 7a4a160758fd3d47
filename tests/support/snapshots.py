"""Snapshots for tests: a small one made fast, and one with all that a snapshot can hold."""

from collections.abc import Callable, Sequence
from functools import cache
from typing import Any

import numpy as np
from accpinn.results.snapshot import MANIFEST, SCHEMA, Snapshot, create
from accpinn.results.snapshot.archive import seal, to_bytes, unpack

from accpinn.inference.intervals import intervals
from accpinn.inference.model_adequacy import Adequacy, BetterForm, ModelForm
from accpinn.methods.fit import Fit
from accpinn.methods.pinn.config import preset
from accpinn.methods.state_space import FORMS
from accpinn.model.cthp import Parameters
from accpinn.segment.segment import Segment
from accpinn.serial import dump, read_json, write_json
from accpinn.study.comparison import compare, results_among
from tests.support.driving import driven
from tests.support.methods import RIVALS as ESTIMATORS
from tests.support.methods import train
from tests.support.samples import PLATOON, sample

NOTE = "α β τ, “quotes”, <tags> and\nlines."


@cache
def small() -> Snapshot:
    """A short window with its data, few draws, and least squares."""
    segment = driven(duration=20.0, step=0.5)
    fit = ESTIMATORS["least-squares"](segment, "II")
    uncertainty = intervals(segment, fit, draws=10)
    return create(segment, fit, uncertainty=uncertainty, name="small", with_data=True)


@cache
def small_bytes() -> bytes:
    return to_bytes(small())


@cache
def trained() -> tuple[Segment, Fit]:
    """The PiNN's answer for the synthetic platoon."""
    segment = sample(PLATOON).segment
    return segment, train(segment, "II", preset("fast", iterations=20), threads=1)


@cache
def whole() -> Snapshot:
    """Of the synthetic platoon: network, comparison and data."""
    segment, fit = trained()
    methods = results_among(compare(segment, "II", ("least-squares", "recursive")))
    return create(segment, fit, methods=methods, name="whole", note=NOTE, with_data=True)


def delayed(vehicle: int = 2) -> Adequacy:
    """One follower that a delay describes better."""
    estimate, lower, upper = (
        Parameters.of([[factor * value for value in (0.1, 0.3, 1.2)]]) for factor in (1, 0.8, 1.2)
    )
    forms = tuple(
        ModelForm(form, estimate, lower, upper, np.array([[extra, 0.8 * extra, 1.2 * extra]]),
                  np.array([aic]), np.array([1.0]))
        for form, extra, aic in zip(FORMS, (0.0, 2.0, 0.5, 0.9), (0.0, -1.0, -2.0, -20.0),
                                    strict=True)
    )  # fmt: skip
    better = BetterForm(vehicle=vehicle, form="delay", aic=-20.0, holdout=1.0)
    return Adequacy(forms, None, (better,))


def entries(data: bytes) -> dict[str, bytes]:
    """What a snapshot's file holds beside its manifest."""
    found = unpack(data, "It")
    del found[MANIFEST]
    return found


def resealed(change: Callable[[dict[str, Any]], None], schema: int = SCHEMA) -> bytes:
    """The small snapshot with its documents changed and everything sealed anew."""
    parts = entries(small_bytes())
    trees = {name: read_json(text) for name, text in parts.items() if name.endswith(".json")}
    change(trees)
    return seal(parts | {name: write_json(tree) for name, tree in trees.items()}, schema)


def put(tree: Any, place: Sequence[str], leaf: Any) -> None:
    """Set the leaf at a place of a tree of objects and lists."""
    for name in place[:-1]:
        tree = tree[int(name) if isinstance(tree, list) else name]
    tree[int(place[-1]) if isinstance(tree, list) else place[-1]] = leaf


def bits(value: Any) -> tuple[Any, dict[str, tuple[Any, ...]]]:
    """What is equal exactly where all within two values is, to the last bit."""
    tree, arrays = dump(value)
    return tree, {name: (a.dtype, a.shape, a.tobytes()) for name, a in arrays.items()}
