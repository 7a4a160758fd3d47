"""The result strip on a page: a row a vehicle, one line about it, and the words behind Details."""

from collections.abc import Callable

import streamlit as st

from accpinn.results.figures.strip import STYLE, strip_html
from accpinn.results.strip import Strip
from pages.ui.components.show import escape_markdown


def show_strip(
    strip: Strip,
    details: Callable[[], None] | None = None,
    next_step: Callable[[], None] | None = None,
) -> None:
    """Draw the rows, and below them in one line what they rest on and what to do next.

    ``details`` writes the same in sentences, for whoever opens them; ``next_step`` draws buttons.
    """
    with st.container(border=True, gap="xsmall"):
        st.html(STYLE + strip_html(strip))
        with st.container(horizontal=True, vertical_alignment="center"):
            st.caption(" · ".join(map(escape_markdown, strip.about)), width="stretch")
            if details:
                with st.popover("Details", icon=":material/notes:", type="tertiary"):
                    details()
            if next_step:
                next_step()
