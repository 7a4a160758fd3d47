"""What the comparison answers: whether the methods agree, and whose laws collide."""

from collections.abc import Sequence

import numpy as np
import streamlit as st

from accpinn.inference.identifiability import wide_intervals
from accpinn.results.messages.evaluation import closed_loop_event
from accpinn.results.tables.estimates import PARAMETER_COLUMNS
from accpinn.results.tables.names import name_of
from accpinn.segment.segment import Segment
from accpinn.study.comparison import MethodResult
from accpinn.units import FloatArray
from pages.ui.components.text import escape_markdown


def show_verdict(segment: Segment, rows: tuple[MethodResult, ...]) -> None:
    """A sentence or two for each set of parameters, then whatever runs into the vehicle ahead."""
    sets = 1 if rows[0].fit.case == "I" else segment.followers
    st.markdown(_listed([verdict(segment, rows, k) for k in range(sets)]))
    touching = collision_lines(segment, rows)
    if touching:
        said = (
            "Driving by themselves behind the measured leader, these laws run into the vehicle"
            " ahead on this window:"
        )
        ahead = " " if len(touching) == 1 else "\n\n"
        st.warning(f"{said}{ahead}{_listed(touching)}", icon=":material/warning:")
    told = closed_loop_events(segment, rows)
    if told:
        count = sum(len(row.evaluation.all_findings) for row in rows)
        title = f"All events in the closed-loop simulations, here and outside the window ({count})"
        with st.expander(title, icon=":material/car_crash:"):
            st.markdown(told)


def verdict(segment: Segment, rows: Sequence[MethodResult], k: int) -> str:
    """Whether the estimates lie within what the data allow, as markdown.

    Args:
        segment: the data.
        rows: the methods'.
        k: 0 for the first follower; in Case I, where all share one law, without effect.
    """
    shared = rows[0].fit.case == "I" and segment.followers > 1
    name = "All followers together" if shared else segment.labels[k + 1]
    label, uncertainty = f"**{escape_markdown(name)}**", rows[0].uncertainty
    names = [name_of(row.fit) for row in rows]
    tables = np.array([row.fit.parameters.values[k] for row in rows])
    lower, upper = uncertainty.lower[k].values, uncertainty.upper[k].values
    if np.isnan(lower).all():
        return f"{label}: the data determine nothing that the methods could be held against."
    level = f"{100 * uncertainty.level:.0f} %"
    outside = []
    for column, values, low, high in zip(PARAMETER_COLUMNS, tables.T, lower, upper, strict=True):
        beyond = [
            f"too {side} for {_who(names, found.tolist())}"
            for found, side in ((values < low, "low"), (values > high, "high"))
            if found.any()
        ]
        outside += [f"{column.title} is {' and '.join(beyond)}"] if beyond else []
    if outside:
        said = f"no: by the {level} intervals of the data, {'; '.join(outside)}."
    else:
        said = f"yes, all methods lie within the {level} intervals of the data"
        wide = [one.symbol for one in wide_intervals(uncertainty, k)]
        which, are = ("that of", "is") if len(wide) == 1 else ("those of", "are")
        reserve = f", but {which} {_joined(wide)} {are} too wide for that to say much"
        said += f"{reserve if wide else ''}."
    return f"{label}: {said} {_most_apart(tables)}".rstrip()


def _most_apart(tables: FloatArray) -> str:
    """The parameter that the methods (R, 3) say least alike; empty where there is one method."""
    if len(tables) < 2:
        return ""
    relative = []
    for values in tables.T:
        known = values[np.isfinite(values)]
        mean = known.mean() if len(known) else 0.0
        relative.append(np.ptp(known) / mean if mean > 0 else 0.0)
    which = int(np.argmax(relative))
    column, values = PARAMETER_COLUMNS[which], tables[:, which]
    low, high = column.shown(float(np.nanmin(values))), column.shown(float(np.nanmax(values)))
    if low == high:
        return "All estimates are the same."
    return f"The estimates differ most in {column.title}: {low} to {high} {column.unit}."


def collision_lines(segment: Segment, rows: Sequence[MethodResult]) -> list[str]:
    """By whose laws each follower would not have driven this window without a collision."""
    names = [name_of(row.fit) for row in rows]
    touching = np.isfinite([row.evaluation.collision_times(segment.vehicles) for row in rows])
    return [
        f"{escape_markdown(label)}, as learned by {_who(names, by.tolist())}."
        for label, by in zip(segment.labels[1:], touching.T, strict=True)
        if by.any()
    ]


def closed_loop_events(segment: Segment, rows: Sequence[MethodResult]) -> str:
    """All of them by follower and method, as markdown; empty where there are none."""
    parts = []
    for vehicle in segment.vehicles[1:]:
        lines = []
        for row in rows:
            events = [
                closed_loop_event(one)
                for one in row.evaluation.all_findings
                if one.vehicle == vehicle
            ]
            if events:
                lines.append(f"{name_of(row.fit)}: {escape_markdown(' · '.join(events))}")
        if lines:
            parts.append(f"**{escape_markdown(segment.label(vehicle))}**\n\n{_bulleted(lines)}")
    return "\n\n".join(parts)


def _who(names: Sequence[str], which: Sequence[bool]) -> str:
    """The methods marked, by the shorter of two ways to name them."""
    marked = [name for name, yes in zip(names, which, strict=True) if yes]
    others = [name for name, yes in zip(names, which, strict=True) if not yes]
    if not others:
        return "every method" if len(names) > 1 else names[0]
    return f"all methods but {_joined(others)}" if len(others) < len(marked) else _joined(marked)


def _joined(names: Sequence[str]) -> str:
    return " and ".join([", ".join(names[:-1]), names[-1]] if len(names) > 1 else names)


def _listed(lines: Sequence[str]) -> str:
    return _bulleted(lines) if len(lines) > 1 else lines[0]


def _bulleted(lines: Sequence[str]) -> str:
    return "\n".join(f"- {line}" for line in lines)
