"""The server's snapshots: the list, one of them in full, and how to open or verify it."""

from urllib.parse import urlsplit

import streamlit as st

from accpinn.results.messages.snapshot import check_rows, summary
from accpinn.results.report.page import render_report
from accpinn.results.snapshot.saved import Entry
from accpinn.results.snapshot.schema import SUFFIX, Snapshot
from accpinn.results.snapshot.verification import obstacle, verify
from accpinn.results.tables.estimates import TITLES
from accpinn.results.tables.table import Column, Table
from accpinn.units import Seconds
from pages.ui.components.messages import show_error, show_messages
from pages.ui.components.table import show_table
from pages.ui.session.resources import library, opened
from pages.ui.session.sessions import SNAPSHOT
from pages.ui.session.workspace import Workspace
from pages.ui.snapshots.saving import flash, flashing

LISTED = 50
"""Snapshots in the table; all can be chosen below it."""
WIDEST = 28
"""Characters of a name or file name in that table."""
SAME = "the same"
"""In place of a recomputed value that equals the stored one."""
QUICK: Seconds = 20.0
"""A method that took longer is not run again while the page waits."""


def listing(entries: tuple[Entry, ...]) -> Table:
    """The newest snapshots, a line each."""
    columns = (
        Column("Name"), Column("Recording"), Column("Window"), Column("Vehicles"),
        Column("Method"), Column("First α, β, τ"), Column("Data"), Column("Saved (UTC)"),
    )  # fmt: skip
    rows = tuple(_line(entry) for entry in entries[:LISTED])
    return Table("", columns, rows)


def _line(entry: Entry) -> tuple[str, ...]:
    if entry.fault:
        return (f"{entry.id} (damaged)", *("–",) * 7)
    first = "{:.4f}, {:.4f}, {:.3f}".format(*entry.parameters[0])
    return (
        _short(title(entry)), _short(entry.source), entry.window, _numbers(entry.vehicles),
        TITLES.get(entry.method, entry.method), first, "yes" if entry.with_data else "no",
        entry.created[:16].replace("T", " "),
    )  # fmt: skip


def _short(text: str) -> str:
    """Room for the other columns; the whole text stands with the one that is chosen."""
    return text if len(text) <= WIDEST else f"{text[: WIDEST - 1]}…"


def _numbers(labels: tuple[str, ...]) -> str:
    """The first and the last vehicle, as "1 to 5"."""
    return " to ".join(label.partition(" ")[0] for label in (labels[0], labels[-1]))


def title(entry: Entry) -> str:
    """What a snapshot is called: its name, or else its short name."""
    return entry.name.strip() or entry.id


def choose(label: str, key: str, entries: tuple[Entry, ...], first: str = "") -> Entry | None:
    """One of them, by name; at first the one of that id, else the newest."""
    known = {entry.id: entry for entry in entries}
    if st.session_state.get(key) not in known:
        st.session_state[key] = first if first in known else next(iter(known))
    chosen = st.selectbox(
        label,
        list(known),
        format_func=lambda name: (
            f"{title(known[name])} · {known[name].source or 'damaged'} · {name[:6]}"
        ),
        key=key,
    )
    return known.get(chosen or "")


def show_one(workspace: Workspace, entry: Entry) -> None:
    """Note, buttons, link, and verification."""
    if entry.fault:
        show_error(entry.fault)
        _delete_button(entry)
        return
    if entry.note:
        st.text(entry.note)
    with st.container(horizontal=True):
        st.button(
            "Open", type="primary", icon=":material/folder_open:", key="snapshots_open",
            on_click=_open, args=(workspace, entry.id),
        )  # fmt: skip
        st.download_button(
            f"Download ({entry.size / 1e6:.1f} MB)",
            lambda: library().raw(entry.id),
            f"{_file_name(entry)}{SUFFIX}",
            "application/zip",
            on_click="ignore",
            icon=":material/download:",
        )
        st.download_button(
            "Report",
            lambda: render_report(opened(entry.id)),
            f"{_file_name(entry)}.html",
            "text/html",
            on_click="ignore",
            icon=":material/description:",
            help="One web page that needs nothing but a browser; it can be printed.",
        )
        _delete_button(entry)
    st.caption("Link to this snapshot; it opens on any page of this server.")
    st.code(link_to(entry.id), language=None)
    with st.expander("Verify: stored beside recomputed", icon=":material/fact_check:"):
        show_verification(workspace, opened(entry.id))


def link_to(name: str) -> str:
    """The address under which this server shows a snapshot."""
    parts = urlsplit(st.context.url or "")
    base = f"{parts.scheme}://{parts.netloc}" if parts.netloc else ""
    return f"{base}/Snapshots?{SNAPSHOT}={name}"


def _open(workspace: Workspace, name: str) -> None:
    with flashing():
        workspace.restore(opened(name))
        flash("success", "Opened: every page now shows this snapshot.")


def _delete_button(entry: Entry) -> None:
    with st.popover("Delete", icon=":material/delete:"):
        st.write("Delete it from the server for everyone? Links to it will stop working.")
        st.button("Yes, delete it", key="snapshots_delete", on_click=_delete, args=(entry,))


def _delete(entry: Entry) -> None:
    with flashing():
        library().delete(entry.id)
        flash("success", f"Deleted: {title(entry)}.")


def _file_name(entry: Entry) -> str:
    """The name with nothing in it that a file name cannot have."""
    kept = "".join(c if c.isalnum() or c in "-_." else "_" for c in title(entry))
    return kept.strip("._")[:60] or entry.id


def show_verification(workspace: Workspace, snapshot: Snapshot) -> None:
    """Every number checked, as stored and as computed now from the snapshot's own contents."""
    recording = workspace.recording
    same = recording if recording and recording.sha256 == snapshot.info.sha256 else None
    again = False
    if snapshot.fit.seconds < QUICK and (snapshot.segment or same) and not obstacle(snapshot.fit):
        again = st.toggle(
            "Run the methods again, too", key="snapshots_again",
            help="Every method of the snapshot is run anew on its data, with its settings.",
        )  # fmt: skip
    with st.spinner("Computing all of it anew"):
        found = verify(snapshot, same, refit=again)
    if found.ok:
        show_messages(summary(found, snapshot.info), "success", "verified")
    else:
        show_error(summary(found, snapshot.info))
    texts = (Column(title, prose=True) for title in ("Result", "Stored", "Recomputed"))
    columns = (Column("Checked"), *texts)
    rows = tuple(
        (c.name, c.sentence, c.stored, SAME if c.ok and c.stored == c.recomputed else c.recomputed)
        for c in check_rows(found, snapshot.info)
    )
    show_table(Table("", columns, rows))
