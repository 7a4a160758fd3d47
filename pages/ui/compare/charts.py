"""The comparison in pictures: estimates, one method against the data, parameters over time."""

from collections.abc import Mapping, Sequence
from typing import Any

import streamlit as st

from accpinn.evaluation.closed_loop import closed_loop
from accpinn.model.cthp import Parameters
from accpinn.results.figures import comparison as figures
from accpinn.results.figures.style import vehicle_colour
from accpinn.results.figures.training import tracking
from accpinn.results.tables.names import name_of
from accpinn.segment.segment import Segment
from accpinn.study.comparison import MethodResult
from pages.ui.components.charts import show_chart


def choose_follower(segment: Segment) -> int:
    """Whose methods are shown below."""
    if segment.followers == 1:
        return 0
    return st.selectbox(
        "Follower",
        range(segment.followers),
        format_func=lambda k: segment.labels[k + 1],
        key="compare_follower",
        width=320,
    )


def show_estimates(
    segment: Segment,
    rows: tuple[MethodResult, ...],
    follower: int,
    truth: Parameters | None,
    earlier: Sequence[figures.Estimate],
) -> MethodResult:
    """Dots over the interval of the data; returns the method that the user looks at."""
    st.subheader("Do the methods agree?", anchor=False)
    by_name = {name_of(row.fit): row for row in rows}
    chart = st.container()
    name = st.selectbox(
        "Look at", list(by_name), key="compare_method", width=320, help="Or click on its dot above."
    )
    entries = [
        figures.Estimate(title, row.fit.parameters.values[follower])
        for title, row in by_name.items()
    ]
    number = segment.vehicles[follower + 1]
    figure = figures.estimates(
        [*entries, *earlier],
        vehicle_colour(number, segment.vehicles[0]),
        rows[0].uncertainty,
        follower,
        truth,
        name,
    )

    def clicked() -> None:
        picked = picked_name(st.session_state["compare_estimates"]["selection"]["points"])
        if picked in by_name:
            st.session_state["compare_method"] = picked

    with chart:
        show_chart(figure, "compare_estimates", on_select=clicked, selection_mode="points")
        st.caption(
            f"Grey: {100 * rows[0].uncertainty.level:.0f} % interval of the data."
            + (" Dashed: true value." if truth else "")
            + (" Rings: earlier runs." if earlier else "")
        )
    return by_name[name]


def picked_name(points: Sequence[Mapping[str, Any]]) -> str:
    """The row of the dot clicked on; empty where there is none."""
    if not points:
        return ""
    name = points[0].get("customdata", "")
    return str(name[0] if isinstance(name, list) else name)


def show_curves(segment: Segment, row: MethodResult, follower: int) -> None:
    """Gap, speed and the gap's error of one method."""
    title = name_of(row.fit)
    st.subheader(f"{title} against the data", anchor=False)
    figure = tracking(
        segment, follower, row.fit.surrogate, closed_loop(segment, row.fit), title, with_error=True
    )
    show_chart(figure, "compare_curves")


def show_courses(
    segment: Segment, rows: tuple[MethodResult, ...], follower: int, truth: Parameters | None
) -> None:
    """What the online methods thought at each instant."""
    followed = [(name_of(row.fit), row.fit.track) for row in rows if row.fit.track]
    if not followed:
        return
    st.subheader("Parameters over time, by the online methods", anchor=False)
    show_chart(figures.courses(followed, follower, truth, segment.start), "compare_courses")
    st.caption(
        "Shaded: one standard deviation, as the method itself states it; this is far too little for"
        " α and β where disturbances last for seconds." + (" Dashed: true value." if truth else "")
    )
