"""Two values of one kind compared place by place, as a snapshot has them and as computed anew."""

from typing import Any

import numpy as np

from accpinn.findings import Finding
from accpinn.results.snapshot.standing import Way
from accpinn.results.snapshot.validate import sanitise
from accpinn.serial import NOT_FINITE, dump, flatten, join

RELATIVE, ABSOLUTE = 1e-9, 1e-11
"""Figures closer than this are the same; other processors round differently."""
VARYING = {"seconds", "cached"}
"""Fields that differ from run to run."""
FEATURED = (
    "0.samples", "vehicles.0.linf_exact.value", "mean_time_gap.0", "parameters.0.2", "centre.0.2",
    "gap_mae.0", "0.errors.gap_mae.0", "deviation.0",
)  # fmt: skip
"""Places of values that stand for their part where all of it agrees."""


class PartCheck(Finding, frozen=True):
    """One part of a snapshot, as stored and as recomputed."""

    part: str
    """As "evaluation.closed_loop"."""
    ok: bool
    method: str = ""
    """Name of the method compared whose part it is; empty for the snapshot's own."""
    count: int = 0
    """Values compared."""
    place: str = ""
    """Within the part: of the first value that differs, else one of `FEATURED`, else the first."""
    stored: float | str | None = None
    """The value there; None where there is none."""
    recomputed: float | str | None = None
    differing: int = 0
    reason: str = ""
    """Why nothing could be computed, as the error says."""
    way: Way = "recomputed"
    """How the figures compared with it were found."""
    at: tuple[str, ...] = ()
    """The places in the snapshot of what was compared, as "fit.parameters.0.2"."""
    wrong: tuple[str, ...] = ()
    """Those of them that differ."""


def compare_parts(
    part: str,
    stored: Any,
    found: Any,
    method: str = "",
    *,
    relative: float = RELATIVE,
    absolute: float = ABSOLUTE,
    numbers_only: bool = False,
    at: str = "",
    way: Way = "recomputed",
) -> PartCheck:
    """Compare two objects of one kind, place by place.

    Args:
        part: of the snapshot.
        stored: as the snapshot has it.
        found: as recomputed.
        method: name of the method compared whose part it is.
        relative: differences up to this share of a number are none.
        absolute: nor are those up to this much.
        numbers_only: whether texts and findings may differ, as between versions.
        at: where the part stands in the snapshot.
        way: how ``found`` was.
    """
    old, new = (_compared(leaves(value), numbers_only) for value in (stored, found))
    places = sorted(old.keys() | new.keys())
    differing = {
        place: first
        for place in places
        if (first := _differing(old.get(place), new.get(place), relative, absolute)) is not None
    }
    featured = [place for place in FEATURED if place in old]
    place = next(iter([*differing, *featured, *places]), "")
    index = differing.get(place, (0,) * np.ndim(old.get(place, 0.0)))
    return PartCheck(
        part,
        not differing,
        method,
        sum(np.size(leaf) for leaf in old.values()) or len(places),
        ".".join([place, *map(str, index)] if place else map(str, index)),
        _value(old.get(place), index),
        _value(new.get(place), index),
        len(differing),
        way=way,
        at=tuple(join(at, place) for place in places),
        wrong=tuple(join(at, place) for place in differing),
    )


def leaves(value: Any) -> dict[str, Any]:
    """Numbers, answers, texts and large arrays of a value, or None, by their places."""
    tree, arrays = dump(value, share=False)
    return {
        place: float(leaf) if leaf in NOT_FINITE else arrays.get(place, leaf)
        for place, leaf in flatten(sanitise(tree))
    }


def _compared(found: dict[str, Any], numbers_only: bool) -> dict[str, Any]:
    """Those that are to agree."""
    kept = {}
    for place, leaf in found.items():
        names = set(place.split("."))
        text = isinstance(leaf, str) or "findings" in names
        if leaf is not None and not names & VARYING and not (text and numbers_only):
            kept[place] = leaf
    return kept


def _differing(one: Any, other: Any, relative: float, absolute: float) -> tuple[int, ...] | None:
    """Where two leaves first differ: an index, empty for a leaf as a whole; None where nowhere."""
    if one is None or other is None or isinstance(one, str) or isinstance(other, str):
        return None if isinstance(one, str) and one == other else ()
    a, b = np.asarray(one, float), np.asarray(other, float)
    if a.shape != b.shape:
        return ()
    with np.errstate(invalid="ignore", over="ignore"):
        near = np.abs(a - b) <= absolute + relative * np.minimum(np.abs(a), np.abs(b))
    same = near | (a == b) | (np.isnan(a) & np.isnan(b))
    return None if same.all() else tuple(map(int, np.argwhere(~same)[0]))


def _value(leaf: Any, index: tuple[int, ...]) -> float | str | None:
    if leaf is None or isinstance(leaf, str):
        return leaf
    if np.ndim(leaf) != len(index):
        return f"{np.shape(leaf)}"
    return float(leaf[index] if index else leaf)
