"""One snapshot in full, to be read: where it is from, its result, link, report, verification."""

from dataclasses import replace

import streamlit as st
from accpinn.results.messages.snapshot import (
    check_rows,
    counted,
    duration,
    parameters_rest_on,
    standing_rows,
    verification_summary,
)
from accpinn.results.snapshot import SUFFIX, Snapshot
from accpinn.results.snapshot.saved import Entry
from accpinn.results.snapshot.verification import (
    HOWEVER_LONG,
    QUICK,
    Verification,
    recover,
    refit_seconds,
    verify,
    verify_parameters,
)

from accpinn.recordings.recording import Recording
from accpinn.results.messages.stability import headline
from accpinn.results.messages.summary import unfinished
from accpinn.results.report import render_report
from accpinn.results.tables.estimates import learned_parameters
from accpinn.results.tables.table import Column, Table
from accpinn.segment.segment import Segment
from accpinn.units import Seconds
from pages.ui.components import frame, show
from pages.ui.components.show import escape_markdown
from pages.ui.result.evaluated import of_snapshot
from pages.ui.result.view import show_evaluated
from pages.ui.session.resources import BY_CONTENT, library, opened
from pages.ui.session.sessions import SNAPSHOT
from pages.ui.session.workspace import Workspace
from pages.ui.snapshots.both import show_both
from pages.ui.snapshots.listing import title_of

SAME = "the same"
"""In place of a recomputed value that equals the stored one."""
LONGEST: Seconds = 300.0
"""Methods that are expected to take longer are not run again while the page waits."""


def show_one(workspace: Workspace, snapshot: Snapshot) -> None:
    """The result, as whoever follows its link sees it: nothing here changes or deletes it."""
    info, title = snapshot.info, snapshot.name.strip() or snapshot.id
    st.subheader(escape_markdown(title), anchor=False)
    when = snapshot.created[:16].replace("T", " ")
    st.caption(f"{frame.segment_line(info, snapshot.fit.case)} · saved {escape_markdown(when)} UTC")
    if snapshot.note:
        st.text(snapshot.note)
    _show_standing(workspace, snapshot)
    _show_buttons(workspace, snapshot, title)
    show.not_acc(info)
    show.messages(unfinished(snapshot.fit), "warning", "pause_circle")
    if snapshot.stability and not unfinished(snapshot.fit):
        chosen = learned_parameters(info, snapshot.fit)
        said = headline(chosen, snapshot.stability, snapshot.uncertainty)
        st.markdown(f"**{escape_markdown(said)}**")
    result = of_snapshot(snapshot, _data_of(workspace, snapshot))
    show_evaluated(workspace, result, "snapshots", lambda: snapshot, more={
        "Verify": lambda: _show_verification(workspace, snapshot),
        "Beside another": lambda: _show_beside(snapshot),
    })  # fmt: skip


def _data_of(workspace: Workspace, snapshot: Snapshot) -> Segment | None:
    """The data that came along, or else the open recording's."""
    recording = workspace.recording
    found = recover(snapshot, recording).segment if recording and not snapshot.segment else None
    return snapshot.segment or found


def _show_buttons(workspace: Workspace, snapshot: Snapshot, title: str) -> None:
    """Back, open, share, report and file."""
    # The title with nothing in it that a file name cannot have.
    stem = "".join(c if c.isalnum() or c in "-_." else "_" for c in title)
    stem = stem.strip("._")[:60] or snapshot.id

    def open_it() -> None:
        with show.flashing():
            workspace.restore(snapshot)
            show.flash("success", "Opened: every page now shows this snapshot.")

    with st.container(horizontal=True):
        back_button(workspace)
        if workspace.snapshot is None or workspace.snapshot.id != snapshot.id:
            st.button(
                "Open on every page", type="primary", icon=":material/folder_open:",
                key="snapshots_open", on_click=open_it,
                help="Stability, Platoon and Train then show it; your present result stays in the"
                " list of finished runs on page Train.",
            )  # fmt: skip
        with st.popover("Share", icon=":material/share:"):
            st.caption("A link to this page; it opens on any page of this server.")
            show.address(f"Snapshots?{SNAPSHOT}={snapshot.id}")
        st.download_button(
            "Report", lambda: render_report(snapshot, _verified(workspace, snapshot)),
            f"{stem}.html", "text/html",
            on_click="ignore", icon=":material/description:",
            help="One web page that needs nothing but a browser; it can be printed.",
        )  # fmt: skip
        if library().has(snapshot.id):
            st.download_button(
                "Download", lambda: library().raw(snapshot.id), f"{stem}{SUFFIX}",
                "application/zip", on_click="ignore", icon=":material/download:",
                help="The file itself: it can be sent, kept, and imported on any server.",
            )  # fmt: skip


def back_button(workspace: Workspace) -> None:
    """Leads back to the list."""

    def back() -> None:
        workspace.viewed = ""
        show.forget_flash()

    st.button("All snapshots", icon=":material/arrow_back:", key="snapshots_back", on_click=back)


def _again(snapshot: Snapshot) -> str:
    """The entry in Streamlit's session state that tells whether the methods are run again."""
    return f"snapshots_again_{snapshot.id}"


def _verified(workspace: Workspace, snapshot: Snapshot) -> Verification:
    """All of it computed anew, and the methods run again where the user asked for that."""
    recording = workspace.recording
    same = recording if recording and recording.sha256 == snapshot.info.sha256 else None
    again = bool(st.session_state.get(_again(snapshot)))
    return _verification(snapshot.digest, snapshot, same, again)


@st.cache_resource(max_entries=16, show_spinner=False, hash_funcs=BY_CONTENT)
def _verification(
    digest: str, _snapshot: Snapshot, recording: Recording | None, again: bool
) -> Verification:
    """What was found before for the same file and recording is not computed again."""
    return verify(_snapshot, recording, refit_within=HOWEVER_LONG if again else QUICK)


def _show_standing(workspace: Workspace, snapshot: Snapshot) -> None:
    """What the parameters rest on, in one line before anything is made of them."""
    if st.session_state.get(_again(snapshot)):
        with st.spinner("Running the methods again"):
            found = _verified(workspace, snapshot)
    else:
        with_data = replace(snapshot, segment=_data_of(workspace, snapshot))
        found = verify_parameters(with_data, refit_within=QUICK)
    said = parameters_rest_on(found, snapshot.info)
    if not found.ok:
        show.messages(said, "error")
        return
    with st.container(horizontal=True, vertical_alignment="center"):
        st.caption(escape_markdown(said))
        _offer_refit(workspace, snapshot)


def _offer_refit(workspace: Workspace, snapshot: Snapshot) -> None:
    """A button that runs the methods again, where the data are at hand and time allows."""
    segment = _data_of(workspace, snapshot)
    if segment is None or st.session_state.get(_again(snapshot)):
        return
    seconds = refit_seconds(snapshot, segment)
    if 0 < seconds <= LONGEST:
        st.button(
            f"Refit, about {duration(seconds)}", icon=":material/replay:", key="snapshots_again",
            on_click=lambda: st.session_state.update({_again(snapshot): True}),
            help="Runs every method of the snapshot anew on its data, with its settings.",
        )  # fmt: skip


def _show_verification(workspace: Workspace, snapshot: Snapshot) -> None:
    """How many of the stored figures agree with those computed now, and the exceptions."""
    with st.spinner("Computing all of it anew"):
        found = _verified(workspace, snapshot)
    st.markdown(f"**{escape_markdown(counted(found))}**")
    said = verification_summary(found, snapshot.info)
    show.messages(said, *(("success", "verified") if found.ok else ("error",)))
    texts = (Column(title, prose=True) for title in ("Result", "Stored", "Found now"))
    columns = (Column("Checked"), *texts)
    checks = check_rows(found, snapshot.info)
    rows = tuple(
        (c.name, c.sentence, c.stored, SAME if c.ok and c.stored == c.recomputed else c.recomputed)
        for c in sorted(checks, key=lambda check: check.ok)
    )
    with st.expander("Every figure, stored beside recomputed", expanded=not found.ok):
        show.table(Table("", columns, rows))
    with st.expander("What each group of figures rests on"):
        groups = tuple(row[:3] + row[4:] for row in standing_rows(found.standings))
        show.table(Table("", tuple(map(Column, ("Figures", "Of", "How", "Agree"))), groups))


def _show_beside(snapshot: Snapshot) -> None:
    """The same beside another of the server's snapshots, which the user picks."""
    others = [entry for entry in library().readable() if entry.id != snapshot.id]
    if not others:
        st.caption("No other snapshot is kept on this server.")
        return
    other = choose_entry("The second snapshot", "snapshots_second", others)
    show_both(snapshot, opened(other.id))


def choose_entry(label: str, key: str, entries: list[Entry]) -> Entry:
    """One of them, by name; at first the newest."""
    known = {e.id: e for e in entries}
    if st.session_state.get(key) not in known:
        st.session_state[key] = next(iter(known))
    chosen = st.selectbox(
        label, list(known), key=key, width=520,
        format_func=lambda name: f"{title_of(known[name])} · {known[name].source} · {name[:6]}",
    )  # fmt: skip
    return known[chosen]
