"""A chart on a page, the picture it is saved as, and the key to its colours."""

import html
from collections.abc import Container, Iterable
from typing import Any

import plotly.graph_objects as go
import streamlit as st

from accpinn.results.figures.style import with_legend
from accpinn.segment.segment import Segment, SegmentInfo
from pages.ui.components.table import vehicle_colours

FORMATS = ("SVG", "PNG")
FORMAT = "frame_pictures"
"""The entry in Streamlit's session state that holds the user's choice."""
LEGEND = "frame_legend"
"""The entry that holds whether every chart has a legend of its own."""
PNG_SCALE = 3
"""Of a PNG against the screen, so that it can be printed."""


def show_chart(figure: go.Figure, key: str, **options: Any) -> Any:
    """Draw it; on hovering a button saves it as a picture named after ``key``."""
    if st.session_state.get(LEGEND):
        figure = with_legend(go.Figure(figure))
    # The page's own background goes into the picture, whose text has the page's colour.
    if side := st.context.theme.type:
        figure = go.Figure(figure).update_layout(
            paper_bgcolor=st.get_option(f"theme.{side}.backgroundColor")
        )
    chosen = str(st.session_state.get(FORMAT) or FORMATS[0]).lower()
    config = {
        "displaylogo": False,
        "modeBarButtons": [["toImage"]],
        "toImageButtonOptions": {
            "format": chosen,
            "filename": f"accpinn_{key}",
            "scale": PNG_SCALE if chosen == "png" else 1,
        },
    }
    return st.plotly_chart(figure, key=key, config=config, **options)


def show_key(
    entries: Iterable[tuple[str, str]], faint: Container[str] = (), dashed: str = ""
) -> None:
    """Names beside their colours.

    Args:
        entries: name and colour.
        faint: names that are less visible.
        dashed: what a dashed line means.
    """
    spans = [
        f"<span{' class=faint' if name in faint else ''}>"
        f'<i style="background:{colour}"></i>{html.escape(name)}</span>'
        for name, colour in entries
    ]
    if dashed:
        spans.append(f'<span><b aria-hidden="true">- -</b> {html.escape(dashed)}</span>')
    st.html(f'<div class="vehicle-key">{"".join(spans)}</div>')


def vehicle_key(segment: Segment | SegmentInfo, with_truth: bool = False) -> None:
    """The colour of each vehicle, once for all charts below."""
    leader, *followers = segment.labels
    names = (f"{leader} (leader)", *followers)
    entries = zip(names, vehicle_colours(segment), strict=True)
    show_key(entries, dashed="true value" if with_truth else "")


def clicked_data(points: list[dict[str, Any]]) -> Any:
    """What a chart's point carries that was clicked on; None where there is none."""
    if not points:
        return None
    data = points[0].get("customdata")
    return data[0] if isinstance(data, list) else data
