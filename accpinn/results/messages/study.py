"""Whether the methods agree, in sentences: estimates against intervals, and collisions."""

from collections.abc import Sequence

import numpy as np

from accpinn.inference.identifiability import wide_intervals
from accpinn.results.tables.estimates import PARAMETER_COLUMNS
from accpinn.results.tables.names import name_of
from accpinn.segment.segment import SegmentInfo
from accpinn.study.comparison import MethodResult
from accpinn.units import FloatArray


def agreement(rows: Sequence[MethodResult], k: int) -> str:
    """Whether the methods' estimates lie within the intervals, and which differ most.

    Args:
        rows: the methods'.
        k: 0 for the first follower; in Case I, where all share one parameter set, 0.
    """
    uncertainty, names = rows[0].uncertainty, [name_of(row.fit) for row in rows]
    estimates = np.array([row.fit.parameters.values[k] for row in rows])
    lower, upper = uncertainty.lower[k].values, uncertainty.upper[k].values
    if np.isnan(lower).all():
        return "the data determine no parameter that the methods could be compared with."
    level = f"{100 * uncertainty.level:.0f} % intervals"
    outside = []
    for column, values, low, high in zip(PARAMETER_COLUMNS, estimates.T, lower, upper, strict=True):
        beyond = [
            f"too {side} for {listed_methods(names, found.tolist())}"
            for found, side in ((values < low, "low"), (values > high, "high"))
            if found.any()
        ]
        outside += [f"{column.title} is {' and '.join(beyond)}"] if beyond else []
    if outside:
        said = f"no: by the {level}, {'; '.join(outside)}."
    else:
        wide = [quantity.symbol for quantity in wide_intervals(uncertainty, k)]
        which, are = ("that of", "is") if len(wide) == 1 else ("those of", "are")
        reserve = f", but {which} {_joined(wide)} {are} too wide to mean much" if wide else ""
        said = f"yes, all estimates lie within the {level}{reserve}."
    return f"{said} {_largest_difference(estimates)}".rstrip()


def _largest_difference(estimates: FloatArray) -> str:
    """The parameter whose estimates (R, 3) differ most; empty for one method."""
    if len(estimates) < 2:
        return ""
    relative = []
    for values in estimates.T:
        known = values[np.isfinite(values)]
        mean = known.mean() if len(known) else 0.0
        relative.append(np.ptp(known) / mean if mean > 0 else 0.0)
    which = int(np.argmax(relative))
    column, values = PARAMETER_COLUMNS[which], estimates[:, which]
    low, high = column.shown(float(np.nanmin(values))), column.shown(float(np.nanmax(values)))
    if low == high:
        return "All estimates are the same."
    return f"The estimates differ most in {column.title}: {low} to {high} {column.unit}."


def colliding_methods(info: SegmentInfo, rows: Sequence[MethodResult]) -> tuple[str, ...]:
    """For each follower that collides in a closed-loop simulation, by whose parameters it does."""
    names = [name_of(row.fit) for row in rows]
    times = [row.evaluation.collision_times(info.vehicles) for row in rows]
    return tuple(
        f"{label}, with the parameters of {listed_methods(names, by.tolist())}."
        for label, by in zip(info.labels[1:], np.isfinite(times).T, strict=True)
        if by.any()
    )


def listed_methods(names: Sequence[str], which: Sequence[bool]) -> str:
    """The methods marked, by the shorter of two ways to name them.

    Args:
        names: of all methods.
        which: True for those marked; at least one.
    """
    marked = [name for name, yes in zip(names, which, strict=True) if yes]
    others = [name for name, yes in zip(names, which, strict=True) if not yes]
    if not others:
        return "every method" if len(names) > 1 else names[0]
    return f"all methods but {_joined(others)}" if len(others) < len(marked) else _joined(marked)


def _joined(names: Sequence[str]) -> str:
    return " and ".join([", ".join(names[:-1]), names[-1]] if len(names) > 1 else names)
