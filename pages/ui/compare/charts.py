"""The comparison in pictures: estimates, one method against the data, parameters over time."""

import streamlit as st

from accpinn.evaluation.closed_loop import closed_loop
from accpinn.model.cthp import Parameters
from accpinn.results.figures import comparison as figures
from accpinn.results.figures.training import tracking
from accpinn.results.tables.estimates import fit_record_table, fit_record_title, name_of
from accpinn.segment.segment import Segment
from accpinn.study.comparison import FitRecord, MethodResult
from accpinn.units import FloatArray
from pages.ui.components.charts import clicked_data, show_chart
from pages.ui.components.table import show_table, vehicle_colours
from pages.ui.session.workspace import Workspace

MOST = 8
"""Earlier fits over the chart at once."""


def show_estimates(
    segment: Segment,
    rows: tuple[MethodResult, ...],
    follower: int,
    truth: Parameters | None,
    earlier: list[figures.Estimate],
) -> MethodResult:
    """Dots over the intervals; returns the result of the method that the user picked.

    Args:
        segment: the data.
        rows: the methods'.
        follower: 0 for the first.
        truth: its true parameters, where they are known.
        earlier: laid over the chart.
    """
    st.subheader("Agreement of the methods", anchor=False)
    by_name = {name_of(row.fit): row for row in rows}
    chart = st.container()
    name = st.selectbox(
        "Method", list(by_name), key="compare_method", width=320, help="Or click on its dot above."
    )
    entries = [
        figures.Estimate(title, row.fit.parameters.values[follower])
        for title, row in by_name.items()
    ]
    uncertainty = rows[0].uncertainty
    figure = figures.estimates(
        [*entries, *earlier], vehicle_colours(segment)[follower + 1], uncertainty, follower, truth,
        name,
    )  # fmt: skip

    def clicked() -> None:
        picked = clicked_data(st.session_state["compare_estimates"]["selection"]["points"])
        if picked in by_name:
            st.session_state["compare_method"] = picked

    with chart:
        show_chart(figure, "compare_estimates", on_select=clicked, selection_mode="points")
        st.caption(
            f"Grey: {100 * uncertainty.level:.0f} % interval."
            + (" Dashed: true value." if truth else "")
            + (" Rings: earlier fits." if earlier else "")
        )
    return by_name[name]


def show_curves(segment: Segment, row: MethodResult, follower: int) -> None:
    """Gap, speed and the gap's error of one method."""
    name, driven = name_of(row.fit), closed_loop(segment, row.fit)
    st.subheader(f"{name} against the data", anchor=False)
    figure = tracking(segment, follower, row.fit.surrogate, driven, name, with_error=True)
    show_chart(figure, "compare_curves")


def show_tracks(
    segment: Segment, rows: tuple[MethodResult, ...], follower: int, truth: Parameters | None
) -> None:
    """The parameters over time of the online methods.

    Args:
        segment: the data.
        rows: the methods'.
        follower: 0 for the first.
        truth: its true parameters, where they are known.
    """
    tracks = [(name_of(row.fit), row.fit.track) for row in rows if row.fit.track]
    if not tracks:
        return
    st.subheader("Parameters over time, by the online methods", anchor=False)
    show_chart(figures.tracks(tracks, follower, truth, segment.start), "compare_tracks")
    st.caption(
        "Shaded: one standard deviation by the method itself, which is far too small for α and β"
        " where disturbances last for seconds." + (" Dashed: true value." if truth else "")
    )


def choose_earlier(workspace: Workspace, segment: Segment, follower: int) -> list[figures.Estimate]:
    """Earlier fits of the session to lay over the chart of estimates."""
    vehicle = segment.vehicles[follower + 1]
    known: dict[str, FloatArray] = {}
    for record in reversed(workspace.records):
        if (values := record.of_vehicle(vehicle)) is not None:
            known[f"{len(known) + 1}. {fit_record_title(record)}"] = values.values
    if not known:
        return []
    chosen = st.multiselect(
        "Earlier fits to lay over the chart",
        list(known),
        key="compare_earlier",
        max_selections=MOST,
        placeholder=f"{len(known)} kept",
    )
    return [figures.Estimate(name, known[name], earlier=True) for name in chosen if name in known]


def show_records(
    records: tuple[FitRecord, ...],
    segment: Segment,
    rows: tuple[MethodResult, ...],
    follower: int,
) -> None:
    """All earlier fits, and where there are rows the differences from the present ones.

    Args:
        records: of the session, oldest first.
        segment: the data.
        rows: the present ones, which may be none.
        follower: 0 for the first.
    """
    if not records:
        return
    st.subheader("Earlier fits", anchor=False)
    count = len(records)
    st.caption(f"Kept from earlier in this session: {count} fit{'s' if count != 1 else ''}.")
    # Of two fits by one method the first counts: the second is the session's own training.
    now = {row.fit.method: FitRecord.of(segment, row.fit) for row in reversed(rows)}
    table = fit_record_table(tuple(reversed(records)), now, segment.vehicles[follower + 1])
    if table.rows:
        show_table(table)
    else:
        st.caption("None of them has this vehicle as a follower.")
