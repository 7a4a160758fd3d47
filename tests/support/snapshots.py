"""Results for tests: a small one made fast, and one with all that a snapshot can hold."""

from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np

from accpinn.inference.intervals import ParameterInterval
from accpinn.inference.model_adequacy import (
    Adequacy,
    BetterForm,
    FormPosterior,
    ModelForm,
    WeightedForms,
)
from accpinn.methods.method import TaskContext
from accpinn.methods.pinn.config import preset
from accpinn.methods.state_space import FORMS
from accpinn.model.cthp import Parameters
from accpinn.recordings.openacc import read
from accpinn.serial import dump
from accpinn.study.analysis import Analysis, Source
from accpinn.study.comparison import compare, results_among
from accpinn.study.result import Result
from accpinn.study.run import estimate, run
from accpinn.study.snapshot import named, to_bytes
from tests.support.driving import driven
from tests.support.samples import FOLDER, PLATOON

NOTE = "α β τ, “quotes”, <tags> and\nlines."


@cache
def small() -> Result:
    """A short window with its data, and least squares."""
    segment = driven(duration=20.0, step=0.5)
    source = Source(segment.source, segment.sha256, None, segment.info.digest)
    asked = Analysis(source, segment.vehicles, (segment.window,)).with_method("least-squares")
    return named(estimate(asked, (segment,)), "small", with_data=True)


@cache
def small_bytes() -> bytes:
    return to_bytes(small())


@cache
def whole() -> Result:
    """The PiNN's answer for the synthetic platoon, with a comparison and the data."""
    recording = read(FOLDER / f"{PLATOON}.csv")
    asked = Analysis.of(recording, settings=preset("fast", iterations=20))
    result = run(asked, recording, context=TaskContext(threads=1))
    compared = results_among(compare(asked, recording, ("least-squares", "recursive")))
    return named(replace(result, compared=compared), "whole", NOTE, with_data=True)


def delayed(vehicle: int = 2) -> Adequacy:
    """One follower that a delay describes better."""
    rows = (("cthp", 0.0, 0.0), ("delay", 0.9, -20.0))
    forms = tuple(
        ModelForm(form, Parameters.of([[0.1, 0.3, 1.2]]), np.full((1, 3), 0.1),
                  np.array([extra]), np.array([aic]), np.array([1.0]))
        for form, extra, aic in rows
    )  # fmt: skip
    ends = (("α", 0.08, 0.12), ("β", 0.25, 0.4), ("τ", 1.1, 1.3))
    intervals = tuple(ParameterInterval(*one, estimate=one[1], likeliest=one[1]) for one in ends)
    under = tuple(
        FormPosterior(
            form=form, probability=probability, intervals=intervals, extra=extra,
            extra_lower=0.9 * extra, extra_upper=1.1 * extra,
        )
        for form, probability, extra in zip(FORMS, (0.0, 0.0, 0.25, 0.75), (0, 1, 0.5, 0.9),
                                            strict=True)
    )  # fmt: skip
    better = BetterForm(vehicle=vehicle, posterior=under[-1], aic=-20.0, holdout=1.0, level=0.9)
    weighted = WeightedForms(vehicle=vehicle, intervals=intervals, forms=under, level=0.9)
    return Adequacy(forms, None, (better, weighted))


def put(tree: Any, place: Sequence[str], leaf: Any) -> None:
    """Set the leaf at a place of a tree of objects and lists."""
    for name in place[:-1]:
        tree = tree[int(name) if isinstance(tree, list) else name]
    tree[int(place[-1]) if isinstance(tree, list) else place[-1]] = leaf


def bits(value: Any) -> tuple[Any, dict[str, tuple[Any, ...]]]:
    """What is equal exactly where all within two values is, to the last bit."""
    tree, arrays = dump(value)
    return tree, {name: (a.dtype, a.shape, a.tobytes()) for name, a in arrays.items()}
