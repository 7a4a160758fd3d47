"""Two snapshots beside each other: parameters, Bode magnitudes, and what differs between them."""

import html
from itertools import zip_longest

import numpy as np
import streamlit as st

from accpinn.results.figures.stability import bode
from accpinn.results.figures.style import vehicle_colours
from accpinn.results.tables.estimates import PARAMETER_COLUMNS, learned_parameters
from accpinn.results.tables.table import ABSENT, Column, Range, Table
from accpinn.study.analysis import differences
from accpinn.study.result import Result
from pages.ui.components import show
from pages.ui.snapshots.listing import title_of


def show_both(first: Result, second: Result) -> None:
    """Parameters with intervals, Bode magnitudes, and what differs in settings and data."""
    show.messages(other_vehicles(first, second), "warning", "compare_arrows")
    longer = max(first.info, second.info, key=lambda info: info.followers)
    colours = [colour for colour in vehicle_colours(longer.vehicles)[1:] for _ in PARAMETER_COLUMNS]
    show.table(parameter_differences(first, second), colours)
    _show_responses(first, second)
    if changes := what_differs(first, second):
        st.markdown(f"**What differs**, first → second:\n\n{show.bullets(changes)}")
    else:
        st.caption("Both were made with the same settings, from the same window of one recording.")


def other_vehicles(first: Result, second: Result) -> str:
    """A warning where followers in the same place are not the same; else empty."""
    pairs = zip_longest(first.info.labels[1:], second.info.labels[1:], fillvalue="no vehicle")
    unlike = [f"{label} stands beside {beside}" for label, beside in pairs if label != beside]
    if not unlike:
        return ""
    return (
        f"The followers are not the same: {'; '.join(unlike)}. The differences below are then"
        " between vehicles, not between two results for one."
    )


def parameter_differences(first: Result, second: Result) -> Table:
    """One row a follower and parameter: both values with intervals, and the second less the first.

    Followers are matched in driving order.
    """
    columns = (
        Column("Follower"), Column("Parameter"),
        Column("First"), Column("interval"), Column("Second"), Column("interval "),
        Column("Δ"), Column("Δ in %"),
    )  # fmt: skip
    rows = []
    labels = zip_longest(first.info.labels[1:], second.info.labels[1:], fillvalue=ABSENT)
    for k, (label, beside) in enumerate(labels):
        name = label if label == beside else f"{label} / {beside}"
        for which, column in enumerate(PARAMETER_COLUMNS):
            (a, *cells), (b, *others) = (_estimate(s, k, which) for s in (first, second))
            change = 100 * (b - a) / a if a else np.nan
            cells += [*others, _signed(b - a, column.digits or 0), _signed(change, 1)]
            rows.append((name, column.heading, *cells))
    return Table("Parameters", columns, tuple(rows))


def _estimate(result: Result, follower: int, which: int) -> tuple[float, str, str]:
    """A parameter, and how it and its interval are printed; nan for no follower."""
    known, column = result.parts.uncertainty, PARAMETER_COLUMNS[which]
    if follower >= result.info.followers:
        return np.nan, ABSENT, ABSENT
    value = float(result.parameters.values[follower, which])
    ends = (known.lower, known.upper) if known else ()
    interval = Range(*(float(end.values[follower, which]) for end in ends)) if ends else None
    return value, column.shown(value), column.shown(interval)


def _signed(value: float, digits: int) -> str:
    sign = "+" if value else ""
    return f"{value:{sign}.{digits}f}" if np.isfinite(value) else ABSENT


def _show_responses(first: Result, second: Result) -> None:
    """Both Bode magnitudes in one chart; nothing where the parameters of either have none."""
    charts = []
    for result in (first, second):
        if result.stability is None:
            return
        charts.append(bode(learned_parameters(result.info, result.fit), result.stability))
    chart, added = charts
    for trace in added.data:
        if trace.mode == "lines+markers" and (trace.customdata is None or trace.customdata[0] >= 0):
            # The whole platoon's line is left to the first alone: the chart stays readable.
            chart.add_scatter(
                x=trace.x, y=trace.y, mode="lines",
                name=f"{trace.name}, {html.escape(title_of(second))}",
                line={**trace.line.to_plotly_json(), "dash": "dot"},
                hovertemplate="%{y:.2f} dB at %{x:.3f} rad/s",
            )  # fmt: skip
    whole = " Dashed: the first one's whole platoon." if first.info.followers > 1 else ""
    st.caption(f"Bode magnitude. Full lines: the first snapshot; dotted: the second.{whole}")
    show.chart(chart, "snapshots_bode")


def what_differs(first: Result, second: Result) -> tuple[str, ...]:
    """What differs in data, settings and program, a few words each."""
    asked = differences(first.analysis, second.analysis)
    further = (
        ("SHA-256", first.analysis.source.sha256[:16], second.analysis.source.sha256[:16]),
        ("iterations done", f"{first.fit.iterations:,}", f"{second.fit.iterations:,}"),
        ("accpinn", first.origin.accpinn, second.origin.accpinn),
    )
    return asked + tuple(f"{name}: {a} → {b}" for name, a, b in further if a != b)
