"""Whether two objects of one kind say the same, number by number."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from math import isnan
from typing import Any

from accpinn.results.snapshot.codec import NOT_FINITE, encode

RELATIVE, ABSOLUTE = 1e-9, 1e-11
"""Figures closer than this are the same; other processors round differently."""
LONGEST = 120
"""Characters of a sentence that is quoted."""
BEFORE = 30
"""Of these, the ones before two sentences part."""


@dataclass(frozen=True)
class Check:
    """One figure, or group of figures, as stored and as recomputed."""

    name: str
    stored: str
    recomputed: str
    ok: bool
    sentence: str


def compared(
    name: str,
    texts: Sequence[str],
    one: Any,
    other: Any,
    relative: float = RELATIVE,
    wording: bool = False,
) -> Check:
    """Two objects of the same kind, number by number.

    Args:
        name: of the check.
        texts: both in short.
        one: as stored.
        other: as recomputed.
        relative: differences up to this share are none.
        wording: whether sentences count as well, as between objects of one version.
    """
    stored, recomputed = texts
    trees = encode(one), encode(other)
    old, new = (dict(_numbers(tree)) for tree in trees)
    differing = [
        place for place in sorted(old.keys() | new.keys()) if not _same(place, old, new, relative)
    ]
    if not differing and wording and (said := _differing_sentence(*trees)):
        return Check(name, stored, recomputed, False, said)
    if not differing:
        figures = "1 figure agrees" if len(old) == 1 else f"All {len(old):,} figures agree"
        return Check(name, stored, recomputed, True, f"{figures}.")
    place = differing[0]
    before, now = _told_apart(old.get(place), new.get(place))
    sentence = (
        f"{len(differing):,} of {len(old):,} figures differ; {place}: stored {before},"
        f" recomputed {now}."
    )
    return Check(name, stored, recomputed, False, sentence)


def _same(place: str, old: dict[str, float], new: dict[str, float], relative: float) -> bool:
    if place not in old or place not in new:
        return False
    before, now = old[place], new[place]
    if before == now or (isnan(before) and isnan(now)):
        return True
    return abs(before - now) <= ABSOLUTE + relative * min(abs(before), abs(now))


def _told_apart(one: float | None, other: float | None) -> tuple[str, str]:
    """Two figures with no more digits than it takes to see that they differ."""
    if one is None or other is None:
        only = f"{one if other is None else other:.6g}"
        return ("nothing", only) if one is None else (only, "nothing")
    texts = ((f"{one:.{digits}g}", f"{other:.{digits}g}") for digits in range(4, 18))
    return next(((a, b) for a, b in texts if a != b), (str(one), str(other)))


def _differing_sentence(one: Any, other: Any) -> str:
    """What the first sentence that differs says in both; empty where all are the same."""
    old, new = (dict(_sentences(tree)) for tree in (one, other))
    for place in sorted(old.keys() | new.keys()):
        before, now = old.get(place, ""), new.get(place, "")
        if before != now:
            pairs = enumerate(zip(before, now, strict=False))
            alike = next((k for k, (a, b) in pairs if a != b), min(len(before), len(now)))
            one, other = (_from(text, alike) for text in (before, now))
            return f"A sentence is stored as “{one}”, but the contents give “{other}”."
    return ""


def _from(sentence: str, alike: int) -> str:
    """What follows where two sentences part, with a few words before."""
    start = max(0, alike - BEFORE)
    shown = f"{'…' if start else ''}{sentence[start:]}"
    return shown if len(shown) <= LONGEST else f"{shown[: LONGEST - 1]}…"


def _sentences(tree: Any, place: str = "") -> Iterator[tuple[str, str]]:
    """All texts of a tree by place, but those that stand for numbers."""
    if isinstance(tree, dict | list):
        pairs = tree.items() if isinstance(tree, dict) else enumerate(tree)
        for name, item in pairs:
            yield from _sentences(item, f"{place}.{name}" if place else str(name))
    elif isinstance(tree, str) and tree not in NOT_FINITE:
        yield place, tree


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
