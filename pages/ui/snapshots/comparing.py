"""Two snapshots beside each other: parameters with intervals, response, settings."""

import html
from itertools import zip_longest
from typing import Any

import numpy as np
import plotly.graph_objects as go
import streamlit as st

from accpinn.model.published import ParameterSet
from accpinn.results.figures.stability import bode
from accpinn.results.figures.style import vehicle_colour
from accpinn.results.snapshot.create import stability
from accpinn.results.snapshot.schema import Snapshot
from accpinn.results.tables.table import ABSENT, STYLE, Cell, Column, Table, between
from pages.ui.components.charts import show_chart
from pages.ui.components.text import escape_markdown

PARAMETERS = (("α", "1/s²", 4), ("β", "1/s", 4), ("τ", "s", 3))


def show_both(one: Snapshot, other: Snapshot) -> None:
    """Everything about two."""
    unlike = other_vehicles(one, other)
    if unlike:
        st.warning(escape_markdown(unlike), icon=":material/compare_arrows:")
    table = parameter_differences(one, other)
    longer = max(one.info, other.info, key=lambda info: info.followers)
    colours = [
        vehicle_colour(n, longer.vehicles[0]) for n in longer.vehicles[1:] for _ in PARAMETERS
    ]
    st.html(STYLE + table.coloured(colours).to_html())
    chart = responses(one, other)
    if chart:
        whole = " Dashed: the first one's whole platoon." if one.info.followers > 1 else ""
        st.caption(
            f"Response over frequency. Full lines: the first snapshot; dotted: the second.{whole}"
        )
        show_chart(chart, "snapshots_bode")
    changes = differing_settings(one, other)
    if not changes.rows:
        st.caption("Both were made with the same settings, from the same window of one recording.")
        return
    st.html(STYLE + changes.to_html())


def other_vehicles(one: Snapshot, other: Snapshot) -> str:
    """What to beware of where followers in the same place are not the same; else empty."""
    pairs = zip_longest(one.info.labels[1:], other.info.labels[1:], fillvalue="no vehicle")
    unlike = [f"{first} stands beside {second}" for first, second in pairs if first != second]
    if not unlike:
        return ""
    return (
        f"The followers are not the same: {'; '.join(unlike)}. The differences below are then"
        " between vehicles, not between two results for one."
    )


def parameter_differences(one: Snapshot, other: Snapshot) -> Table:
    """One row a follower and parameter: both values with intervals, and the second less the first.

    Followers are matched in driving order.
    """
    columns = (
        Column("Follower"), Column("Parameter"),
        Column("First"), Column("interval"), Column("Second"), Column("interval "),
        Column("Δ"), Column("Δ in %"),
    )  # fmt: skip
    rows: list[tuple[Cell, ...]] = []
    labels = zip_longest(one.info.labels[1:], other.info.labels[1:])
    for k, (first, second) in enumerate(labels):
        name = first if first == second else f"{first or ABSENT} / {second or ABSENT}"
        for which, (symbol, unit, digits) in enumerate(PARAMETERS):
            a, b = _value(one, k, which), _value(other, k, which)
            rows.append(
                (
                    name,
                    f"{symbol} [{unit}]",
                    _shown(a, digits),
                    _interval(one, k, which, digits),
                    _shown(b, digits),
                    _interval(other, k, which, digits),
                    _shown(b - a, digits, "+"),
                    _shown(100 * (b - a) / a if a else np.nan, 1, "+"),
                )
            )
    return Table("Parameters", columns, tuple(rows))


def _value(snapshot: Snapshot, follower: int, which: int) -> float:
    table = snapshot.fit.parameters.values
    return float(table[follower, which]) if follower < len(table) else np.nan


def _shown(value: float, digits: int, sign: str = "") -> str:
    return f"{value:{sign}.{digits}f}" if np.isfinite(value) else ABSENT


def _interval(snapshot: Snapshot, follower: int, which: int, digits: int) -> str:
    uncertainty = snapshot.uncertainty
    if uncertainty is None or follower >= len(uncertainty.lower):
        return ABSENT
    low, high = (
        float(ends.values[follower, which]) for ends in (uncertainty.lower, uncertainty.upper)
    )
    return ABSENT if np.isnan(low) or np.isnan(high) else between(low, high, digits)


def responses(one: Snapshot, other: Snapshot) -> go.Figure | None:
    """Both responses in one chart; None where the parameters of either allow none."""
    charts = []
    for snapshot in (one, other):
        report, info = stability(snapshot.fit), snapshot.info
        if report is None:
            return None
        laws = ParameterSet(
            info.source, info.names[1:], snapshot.fit.parameters, info.vehicles, info.labels[1:]
        )
        charts.append(bode(laws, report))
    whole = charts[0]
    for trace in charts[1].data:
        if trace.mode == "lines+markers" and (trace.customdata is None or trace.customdata[0] >= 0):
            name = f"{trace.name}, {html.escape(other.name or other.id)}"
            # The whole platoon's line is left to the first alone: the chart stays readable.
            whole.add_scatter(
                x=trace.x, y=trace.y, mode="lines", name=name,
                line={**trace.line.to_plotly_json(), "dash": "dot"},
                hovertemplate="%{y:.2f} dB at %{x:.3f} rad/s",
            )  # fmt: skip
    return whole


def differing_settings(one: Snapshot, other: Snapshot) -> Table:
    """What was set or given differently, a line each."""
    first, second = _settings(one), _settings(other)
    names = [*first, *(name for name in second if name not in first)]
    rows = tuple(
        (name, first.get(name, ABSENT), second.get(name, ABSENT))
        for name in names
        if first.get(name) != second.get(name)
    )
    columns = (Column("Setting"), Column("First", prose=True), Column("Second", prose=True))
    return Table("What differs", columns, rows)


def _settings(snapshot: Snapshot) -> dict[str, str]:
    info, fit = snapshot.info, snapshot.fit
    found: dict[str, Any] = {
        "recording": info.source,
        "recording's SHA-256": info.sha256[:16],
        "window": f"{info.window}",
        "vehicles": ", ".join(info.labels),
        "left out": ", ".join(info.excluded_regimes) or "nothing",
        "method": fit.method,
        "case": fit.case,
        "iterations done": fit.iterations,
        "accpinn": snapshot.origin.accpinn,
        **fit.config,
    }
    return {name: str(value) for name, value in found.items()}
