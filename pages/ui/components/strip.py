"""The result strip on a page: a row a vehicle, one line about it, and the words behind Details."""

from collections.abc import Callable
from functools import cache
from typing import Any

import streamlit as st
import streamlit.components.v2 as components

from accpinn.results.figures.strip import STYLE, strip_html
from accpinn.results.strip import Strip
from pages.ui.components.show import escape_markdown

LISTENER = """export default function ({ parentElement, setTriggerValue }) {
  const box = (parentElement.host ?? parentElement).closest("[class*=st-key-strip_of]");
  if (!box) return;
  const clicked = (event) => {
    const row = event.target.closest(".strip-row[data-row]");
    if (row) setTriggerValue("row", Number(row.dataset.row));
  };
  box.addEventListener("click", clicked);
  return () => box.removeEventListener("click", clicked);
}"""
"""Reports a click on a row; the rows themselves are plain HTML, which can be read without it."""


@cache
def _listener() -> Any:
    """The component that listens, declared once."""
    return components.component("accpinn_strip_clicks", js=LISTENER)


def show_strip(
    strip: Strip,
    details: Callable[[], None] | None = None,
    next_step: Callable[[], None] | None = None,
    page: str = "",
    choose: Callable[[int], None] | None = None,
) -> None:
    """Draw the rows, and below them in one line their basis and the next step.

    Args:
        strip: the rows.
        details: writes the same in sentences, for whoever opens them.
        next_step: draws buttons.
        page: begins the keys of a strip whose rows can be clicked.
        choose: gets the place of the vehicle whose row is clicked, 0 for the first.
    """
    is_clickable = choose is not None and len(strip.rows) > 1
    with st.container(border=True, gap="xsmall", key=f"strip_of_{page}" if is_clickable else None):
        st.html(STYLE + strip_html(strip))
        if choose and is_clickable:
            _listen(f"{page}_strip", choose)
        if strip.lacking:
            st.caption(escape_markdown(strip.lacking))
        with st.container(horizontal=True, vertical_alignment="center"):
            st.caption(" · ".join(map(escape_markdown, strip.about)), width="stretch")
            if details:
                with st.popover("Details", icon=":material/notes:", type="tertiary"):
                    details()
            if next_step:
                next_step()


def _listen(key: str, choose: Callable[[int], None]) -> None:
    """Call ``choose`` with the place of a row that is clicked."""

    def clicked() -> None:
        row = st.session_state[key].get("row")
        if row is not None:
            choose(int(row))

    _listener()(key=key, on_row_change=clicked, height=0)
