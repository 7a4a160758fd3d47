"""Snapshots for tests: a small one made fast, and one with all that a snapshot can hold."""

from dataclasses import replace
from functools import cache
from typing import Any

from accpinn.inference.intervals import intervals
from accpinn.methods.fit import Fit
from accpinn.methods.pinn.config import preset
from accpinn.methods.pinn.training import train
from accpinn.results.snapshot import documents
from accpinn.results.snapshot.archive import contents
from accpinn.results.snapshot.content import Snapshot
from accpinn.results.snapshot.create import create
from accpinn.results.snapshot.file import sealed, to_bytes
from accpinn.results.snapshot.schema import MANIFEST, PARTS, SCHEMA
from accpinn.segment.segment import Segment
from accpinn.study.comparison import compare
from tests.driving import driven
from tests.support.methods import RIVALS as ESTIMATORS
from tests.support.samples import PLATOON, sample


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
    rows = tuple(compare(segment, "II", ("least-squares", "recursive")))
    fit = replace(fit, notes=("A note with “quotes”, <tags> and\nlines.",))
    return create(segment, fit, rows=rows, name="whole", note="α β τ", with_data=True)


def resealed(change: Any, schema: int = SCHEMA) -> bytes:
    """The small snapshot with its documents changed and everything sealed anew."""
    parts = contents(small_bytes(), "It", len(PARTS))
    del parts[MANIFEST]
    trees = {n: documents.read(c, n) for n, c in parts.items() if n.endswith(".json")}
    change(trees)
    return sealed(parts | {n: documents.write(t) for n, t in trees.items()}, schema)
