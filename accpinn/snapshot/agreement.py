"""Whether two objects of one kind say the same, number by number."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from accpinn.snapshot.codec import NOT_FINITE, encode

RELATIVE, ABSOLUTE = 1e-9, 1e-11
"""Figures closer than this are the same; other processors round differently."""


@dataclass(frozen=True)
class Check:
    """One figure, or group of figures, as stored and as recomputed."""

    name: str
    stored: str
    recomputed: str
    ok: bool
    sentence: str


def compared(
    name: str, texts: Sequence[str], one: Any, other: Any, relative: float = RELATIVE
) -> Check:
    """Two objects of the same kind, number by number; ``texts`` say both in short."""
    stored, recomputed = texts
    old, new = dict(_numbers(encode(one))), dict(_numbers(encode(other)))
    differing = [
        place for place in sorted(old.keys() | new.keys()) if not _same(place, old, new, relative)
    ]
    if not differing:
        figures = "1 figure agrees" if len(old) == 1 else f"All {len(old):,} figures agree"
        return Check(name, stored, recomputed, True, f"{figures}.")
    place = differing[0]
    sentence = (
        f"{len(differing):,} of {len(old):,} figures differ; {place}: stored {old.get(place)},"
        f" recomputed {new.get(place)}."
    )
    return Check(name, stored, recomputed, False, sentence)


def _same(place: str, old: dict[str, float], new: dict[str, float], relative: float) -> bool:
    if place not in old or place not in new:
        return False
    return bool(np.isclose(new[place], old[place], rtol=relative, atol=ABSOLUTE, equal_nan=True))


def _numbers(tree: Any, place: str = "") -> Iterator[tuple[str, float]]:
    """All numbers and answers of a tree by place; wording may change between versions."""
    if isinstance(tree, dict):
        for name, item in tree.items():
            yield from _numbers(item, f"{place}.{name}" if place else name)
    elif isinstance(tree, list):
        for k, item in enumerate(tree):
            yield from _numbers(item, f"{place}.{k}")
    elif isinstance(tree, bool | int | float):
        yield place, float(tree)
    elif isinstance(tree, str) and tree in NOT_FINITE:
        yield place, NOT_FINITE[tree]
