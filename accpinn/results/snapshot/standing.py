"""What each figure of a snapshot rests on: recomputed, refitted, or only told by who wrote it.

Figures are known by their places in the snapshot's tree (see `accpinn.serial`), as
"fit.parameters.0.2" or "methods.1.fit.parameters.0.2", and belong to groups.
"""

from collections.abc import Collection, Mapping
from typing import Literal

from accpinn.findings import Finding

Way = Literal["refitted", "recomputed", "told"]
"""Found by the method run again; computed from parameters and data; compared with nothing."""

DURATIONS = "durations"
GROUPS = {
    "parameters": ("fit.parameters", "fit.unconstrained", "fit.active_bounds"),
    "curves": ("fit.surrogate",),
    "settings": ("fit.config", "fit.method", "fit.case"),
    "method's remarks": ("fit.findings",),
    "training": ("fit",),
    "quality": ("quality",),
    "intervals": ("uncertainty",),
    "hold-out": ("evaluation.holdout", "evaluation.blocks"),
    "outside": (
        "evaluation.out_of_window",
        "evaluation.out_of_window_seconds",
        "evaluation.out_of_window_findings",
    ),
    "errors": ("evaluation",),
    "stability": ("stability",),
    "forms": ("adequacy",),
    "data": ("segment.time", "segment.speeds", "segment.gaps", "segment.mask", "segment.missing"),
    "recording": ("info.source", "info.sha256", "segment.source", "segment.sha256", "facts"),
    "names": ("info.names", "segment.names"),
    "window": ("info", "segment"),
    "name and note": ("name", "note"),
    "created": ("created",),
    "origin": ("origin",),
    "attribution": ("attribution",),
}
"""The groups of figures, in the order in which they are told, and where these stand; the first
place that fits counts."""


class Standing(Finding, frozen=True):
    """What the figures of one group rest on, or some of them."""

    group: str
    """A key of `GROUPS`, or `DURATIONS`."""
    way: Way
    ok: bool
    """Whether all of them agree with what was found now; True for those only told."""
    figures: int
    """How many; a large array counts as one."""
    compared: bool = False
    """Whether they are of the methods compared, not of the snapshot's own result."""


def group_of(place: str) -> str:
    """The group of the figure at a place of a snapshot."""
    names = _own(place).split(".")
    if {"seconds", "cached"} & set(names):
        return DURATIONS
    starts = {".".join(names[:k]) for k in (1, 2)}
    return next(group for group, places in GROUPS.items() if starts & set(places))


def _own(place: str) -> str:
    """The same place within a method compared."""
    return place.split(".", 2)[2] if place.startswith("methods.") else place


def standings(ways: Mapping[str, Way], failed: Collection[str]) -> tuple[Standing, ...]:
    """Figures by group, as tables and sentences have them.

    Args:
        ways: by place, all figures of a snapshot.
        failed: the places of the checks that do not hold.
    """
    failing = set(failed)
    found: dict[tuple[bool, str, Way], list[str]] = {}
    for place, way in ways.items():
        key = (place.startswith("methods."), group_of(place), way)
        found.setdefault(key, []).append(place)
    order = [*GROUPS, DURATIONS]
    return tuple(
        Standing(group, way, not failing & set(places), len(places), compared)
        for (compared, group, way), places in sorted(
            found.items(), key=lambda one: (one[0][0], order.index(one[0][1]), one[0][2])
        )
    )
