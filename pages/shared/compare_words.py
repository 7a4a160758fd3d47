"""What the comparison says: the answer in a sentence, and its tables."""

import numpy as np
import streamlit as st

from accpinn.comparison import Row
from accpinn.figures.style import vehicle_colour
from accpinn.segment import Segment
from accpinn.tables import typeset
from accpinn.tables.comparison import TITLES, intervals_table, methods_table
from accpinn.tables.results import PARAMETER_COLUMNS
from accpinn.uncertainty import Uncertainty
from pages.shared.results import downloads
from pages.shared.text import bullets, plain

NUMBERS = ("No", "One", "Two", "Three", "Four", "Five", "Six", "Seven", "Eight")


def show_answer(segment: Segment, rows: tuple[Row, ...]) -> None:
    """One sentence a follower: how far the methods agree, and what the data support."""
    doubt = rows[0].uncertainty
    lines = [answer(segment, rows, doubt, k) for k in range(segment.followers)]
    st.markdown("\n".join(f"- {line}" for line in lines) if len(lines) > 1 else lines[0])
    colliding = [_title(row) for row in rows if np.isfinite(row.assessment.collisions).any()]
    if colliding:
        st.warning(collision_line(colliding, len(rows)), icon=":material/warning:")
    flagged = [
        f"{_title(row)}: {sentence}" for row in rows for sentence in row.assessment.incidents
    ]
    if flagged:
        told = f"Every incident in closed loop, here and on the rest ({len(flagged)})"
        with st.expander(told, icon=":material/car_crash:"):
            st.markdown(bullets(tuple(flagged)))


def collision_line(methods: list[str], total: int) -> str:
    """Whose laws would not have driven this window without a collision."""
    if len(methods) == total:
        who = "the laws of all methods run" if total > 1 else "the law runs"
    else:
        who = f"{len(methods)} of {total} methods have a law that runs"
    return (
        f"Driving by itself behind the measured leader, {who} into the vehicle ahead on this"
        f" window: {', '.join(methods)}."
    )


def _title(row: Row) -> str:
    return TITLES.get(row.fit.method, row.fit.method)


def answer(segment: Segment, rows: tuple[Row, ...], doubt: Uncertainty, k: int) -> str:
    """The sentence of one follower, as markdown."""
    tables = np.array([row.fit.table()[k] for row in rows])
    parts = []
    for which, column in enumerate(PARAMETER_COLUMNS):
        values = tables[:, which][np.isfinite(tables[:, which])]
        if not len(values):
            continue
        ends = doubt.lower[k, which], doubt.upper[k, which]
        support = (
            f"{column.shown(float(ends[0]))} to {column.shown(float(ends[1]))}"
            if np.isfinite(ends[1])
            else f"{column.shown(float(ends[0]))} or more"
        )
        low, high = column.shown(float(values.min())), column.shown(float(values.max()))
        spread = f"from **{low}** to **{high}**" if low != high else f"**{low}**"
        parts.append(f"{column.title} {spread} (data: {support})")
    methods = f"{NUMBERS[len(rows)]} method{'s' if len(rows) != 1 else ''}"
    stable = (doubt.probability_l2[k], doubt.probability_linf[k])
    probable = (
        f" Probability that it is string stable: {stable[0]:.0%} in L2, {stable[1]:.0%} in L∞."
        if np.isfinite(stable).all()
        else ""
    )
    return f"{plain(segment.labels[k + 1])}: {methods.lower()}, {', '.join(parts)}.{probable}"


def show_intervals(segment: Segment, doubt: Uncertainty) -> None:
    """What the recording allows, whichever method is asked."""
    colours = [vehicle_colour(n, segment.vehicles[0]) for n in segment.vehicles[1:]]
    st.html(typeset.STYLE + intervals_table(segment, doubt).coloured(colours).to_html())
    st.caption(
        "Which parameters the data support where disturbances last for seconds, as on a road. A"
        " method's estimate may lie outside: disturbances that the vehicle itself answers pull it."
        " A lasting error of the measured gap shifts τ unseen: 0.1 m in 30 m by 0.3 %."
    )
    if doubt.notes:
        st.info(bullets(doubt.notes), icon=":material/info:")


def show_methods(
    segment: Segment, rows: tuple[Row, ...], follower: int, running: bool = False
) -> None:
    """Each method's estimates and errors."""
    table = methods_table(segment, rows, follower)
    st.html(typeset.STYLE + table.to_html())
    if running:
        return
    st.caption(
        "Surrogate fit: the method's own curve against the data. Closed loop: the law drives behind"
        " the measured leader. Held out: the window's first and last third, each driven by a law"
        " learned without it. Unseen rest: closed loop on the recording outside the window."
        " Collides at: when the law would run into the vehicle ahead; it drives on, and the errors"
        " include what follows."
    )
    downloads(table, segment)
