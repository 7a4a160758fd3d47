"""Snapshots: save a result, send it, import another, and compare two."""

import streamlit as st

from accpinn.errors import SnapshotError
from pages.ui.components import frame
from pages.ui.components.messages import show_error
from pages.ui.components.table import show_table
from pages.ui.session.resources import library, opened
from pages.ui.snapshots.differences import show_both
from pages.ui.snapshots.listing import choose, listing, show_one
from pages.ui.snapshots.restored import banner
from pages.ui.snapshots.saving import save_form, show_flash, upload_form


def main() -> None:
    workspace = frame.begin(
        "Snapshots", "Results as files: keep them, send them, open them again, compare them."
    )
    show_flash()
    banner(workspace)
    left, right = st.columns((1.4, 1), gap="large")
    with left:
        save_form(workspace)
    with right:
        upload_form()
    st.subheader("On this server", anchor=False)
    entries = library().entries()
    if not entries:
        st.caption("No snapshot is kept here yet.")
        return
    show_table(listing(entries))
    shown = workspace.snapshot.id if workspace.snapshot else ""
    entry = choose("Snapshot", "snapshots_chosen", entries, first=shown)
    if entry is None:
        return
    try:
        show_one(workspace, entry)
    except SnapshotError as fault:  # deleted or damaged since the list was read
        show_error(fault)
        return
    whole = tuple(one for one in entries if not one.fault and one.id != entry.id)
    if whole and not entry.fault:
        st.subheader("Compare with another", anchor=False)
        other = choose("The second snapshot", "snapshots_second", whole)
        if other and st.toggle("Show both side by side", key="snapshots_compare"):
            show_both(opened(entry.id), opened(other.id))


main()
