"""What a page says where there is no segment to work on, and the way to one."""

import streamlit as st

from pages.ui.components import frame
from pages.ui.components.text import escape_markdown
from pages.ui.session.workspace import Workspace


def show_missing(workspace: Workspace, nothing: str) -> None:
    """Why the page can do nothing yet; ``nothing`` is as "Nothing to train on"."""
    if workspace.recording is None:
        st.info(f"{nothing} yet: first open a recording.", icon=":material/info:")
    else:
        st.warning(
            f"The window cannot be used yet. {escape_markdown(workspace.fault)}",
            icon=":material/warning:",
        )
    frame.link(frame.DATA, "Go to Data", workspace, "arrow_forward")
