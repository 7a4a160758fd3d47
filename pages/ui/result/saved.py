"""What pages say of a restored result: which one it is, and what would complete it."""

import streamlit as st

from accpinn.results.figures.recording import preview
from pages.ui.components import frame, show
from pages.ui.components.show import escape_markdown
from pages.ui.session.identity import owner_mark
from pages.ui.session.resources import library
from pages.ui.session.workspace import Workspace
from pages.ui.snapshots.listing import title_of


def banner(workspace: Workspace) -> None:
    """Which restored result a page shows, and what would complete it."""
    restored = workspace.restored
    if restored is None or not (restored.id or restored is workspace.result):
        return
    if workspace.result is not restored:
        state = "the training is new, on the same window."
    elif workspace.recording:
        state = "its recording is open, so everything is complete."
    elif workspace.segment:
        state = "its data came with it."
    else:
        state = "it came without its data."
    kind = "From the snapshot" if restored.id else "An earlier run"
    name = escape_markdown(title_of(restored))
    st.info(f"{kind} **{name}**; {state}", icon=":material/inventory_2:")

    def keep() -> None:
        with show.flashing():
            library().add(restored, owner_mark(workspace.id))

    if restored.id and not library().has(restored.id):
        show.messages(
            "This snapshot was deleted from the server and lasts only as long as this session;"
            " keep it again, and its link works again.",
            "warning",
            "delete",
        )
        st.button("Keep it again", key="snapshots_keep", on_click=keep)


def recording_needed(workspace: Workspace, what: str, here: bool = False) -> None:
    """Which recording would complete a page without data, which may be opened ``here``."""
    if workspace.segment or workspace.restored is None:
        return
    source = workspace.restored.analysis.source
    st.warning(
        f"{what} the recording, which is not part of the snapshot. It is"
        f" **{escape_markdown(source.name)}**, SHA-256 `{source.sha256 or 'not known'}`. Open that"
        f" file {'below' if here else 'on the Data page'}, and the window is restored.",
        icon=":material/database:",
    )
    if not here:
        frame.link(frame.DATA, "Open the recording on Data", workspace)


def show_data(workspace: Workspace) -> None:
    """The window's own curves, if they came along; else which recording has them."""
    banner(workspace)
    segment = workspace.segment
    if segment is None:
        recording_needed(workspace, "Speeds and gaps are in", here=True)
        return
    st.caption("These curves are the snapshot's; the whole recording is not part of it.")
    show.vehicle_key(segment)
    show.chart(preview(segment), "snapshots_data")
