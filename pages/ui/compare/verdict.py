"""The answer of the comparison, its tables, and the methods without a result."""

from collections.abc import Sequence

import streamlit as st

from accpinn.methods.registry import METHODS
from accpinn.results.messages.methods import agreement, colliding_methods
from accpinn.results.messages.reliability import closed_loop_event
from accpinn.results.tables.estimates import TITLES, methods_table, name_of
from accpinn.segment.segment import Segment
from accpinn.study.comparison import MethodFailure, MethodResult
from pages.ui.components.messages import bullets, escape_markdown, show_messages
from pages.ui.components.table import show_downloads, show_table, stem_of


def show_failures(failures: Sequence[MethodFailure]) -> None:
    """The methods without a result, those with the same reason together."""
    reasons: dict[str, list[str]] = {}
    for failure in failures:
        reasons.setdefault(str(failure.fault), []).append(TITLES[failure.method])
    sentences = [
        f"No result from {', '.join(who) if len(who) < len(METHODS) else 'any method'}: {why}"
        for why, who in reasons.items()
    ]
    show_messages(sentences, "warning")


def show_verdict(segment: Segment, rows: tuple[MethodResult, ...]) -> None:
    """Whether the methods agree on each set of parameters, and what happens in closed loop."""
    shared = rows[0].fit.case == "I" and segment.followers > 1
    names = ("All followers together",) if shared else segment.labels[1:]
    lines = [
        f"**{escape_markdown(name)}**: {escape_markdown(agreement(rows, k))}"
        for k, name in enumerate(names)
    ]
    st.markdown("\n".join(f"- {line}" for line in lines) if len(lines) > 1 else lines[0])
    if colliding := colliding_methods(segment.info, rows):
        lead = "In closed-loop simulation on this window, these collide with the vehicle ahead:"
        gap = " " if len(colliding) == 1 else "\n\n"
        st.warning(f"{lead}{gap}{bullets(colliding)}", icon=":material/warning:")
    if events := event_list(segment, rows):
        count = sum(len(row.evaluation.all_findings) for row in rows)
        title = f"All events in closed-loop simulation, inside and outside the window ({count})"
        with st.expander(title, icon=":material/car_crash:"):
            st.markdown(events)


def event_list(segment: Segment, rows: Sequence[MethodResult]) -> str:
    """Closed-loop findings by follower and method, as markdown; empty where there are none."""
    parts = []
    for vehicle in segment.vehicles[1:]:
        lines = []
        for row in rows:
            found = [one for one in row.evaluation.all_findings if one.vehicle == vehicle]
            if events := " · ".join(map(closed_loop_event, found)):
                lines.append(f"- {name_of(row.fit)}: {escape_markdown(events)}")
        if lines:
            parts.append("\n".join((f"**{escape_markdown(segment.label(vehicle))}**\n", *lines)))
    return "\n\n".join(parts)


def show_methods(
    segment: Segment, rows: tuple[MethodResult, ...], follower: int, running: bool = False
) -> None:
    """Each method's estimates and errors.

    Args:
        segment: the data.
        rows: the methods'.
        follower: 0 for the first.
        running: more rows are to come, so caption and downloads wait.
    """
    table = methods_table(segment.info, rows, follower)
    show_table(table)
    if running:
        return
    own = not all(row.evaluation.blocks for row in rows)
    gap = segment.gaps[:, follower]
    st.caption(
        "MAE: mean absolute error. Surrogate fit: error of the smooth curve that the method itself"
        " fits to the motion (a dash where it has none). Closed loop: error of the closed-loop"
        " simulation (leader's speed given). Held out: closed loop on each third of the window with"
        " the parameters learned from the other two. Outside the window: closed loop on the rest of"
        " the recording. Collides at: the first contact with the vehicle ahead; the simulation"
        " continues, and the errors include what follows. For scale: the measured space-gap"
        f" deviates by {abs(gap - gap.mean()).mean():.2f} m from its mean."
        + (" Hold-out is not computed for your own training." * own)
    )
    show_downloads(table, f"{stem_of(segment)}_methods", "compare")
