"""How a chart stands on a page, and how it leaves it as a picture."""

from typing import Any

import plotly.graph_objects as go
import streamlit as st

from accpinn.results.figures.style import with_legend

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
    return st.plotly_chart(figure, key=key, config=picture_button(key), **options)


def picture_button(name: str) -> dict[str, Any]:
    """Plotly's settings for the one button that our charts have."""
    chosen = str(st.session_state.get(FORMAT) or FORMATS[0]).lower()
    return {
        "displaylogo": False,
        "modeBarButtons": [["toImage"]],
        "toImageButtonOptions": {
            "format": chosen,
            "filename": f"accpinn_{name}",
            "scale": PNG_SCALE if chosen == "png" else 1,
        },
    }
