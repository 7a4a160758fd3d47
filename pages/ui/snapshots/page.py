"""The page Snapshots: saving and importing, the list, and one result in full."""

import html

import streamlit as st

from accpinn.errors import SnapshotError
from accpinn.methods.estimate import Outcome
from accpinn.recordings import Recording
from accpinn.results.messages.summary import unfinished
from accpinn.results.report import render_report
from accpinn.results.reproduction import verification_table
from accpinn.study.result import Result
from accpinn.study.snapshot import LARGEST, LONGEST_NAME, LONGEST_NOTE, SUFFIX
from accpinn.study.store import Entry
from accpinn.study.verification import PROMPT, Verification, refit_seconds, verify
from accpinn.tasks import Status
from pages.ui.components import frame, show
from pages.ui.components.monitor import monitor, stop_button
from pages.ui.components.result import banner, show_result
from pages.ui.components.show import escape_markdown
from pages.ui.session.resources import library, opened
from pages.ui.session.saved import may_delete, own_snapshots, readable_snapshots
from pages.ui.session.sessions import SNAPSHOT
from pages.ui.session.users import owner_mark
from pages.ui.session.workspace import Workspace
from pages.ui.snapshots.listing import choose_entry, show_both, show_entries, title_of

UNDO = "snapshots_undo"
"""The entry in Streamlit's session state with the snapshot that was deleted last."""
COLOURS = {True: "green", False: "red", None: "gray"}
"""Colour of a verification's mark by its outcome."""
MARK = '<span style="cursor: help; font-size: .875rem" title="{why}">{brief}</span>'
CONTAINS = "The file contains the recorded speeds and gaps of its windows."
LESS = "To share less, send the parameter card (Train, Export) or a report without curves."
NO_CURVES = "snapshots_no_curves"
"""The entry in Streamlit's session state that tells whether a report has curves."""


def show_page(workspace: Workspace) -> None:
    _undo_button()
    if workspace.viewed:
        try:
            show_one(workspace, opened(workspace.viewed))
        except SnapshotError as fault:  # deleted or damaged since the list was read
            show.messages(str(fault), "error")
            back_button(workspace)
        return
    st.caption("Results as files: keep them, send them, open them again, compare them.")
    banner(workspace)
    # The whole list takes the place of the forms.
    is_whole = bool(workspace.choices.get("snapshots_all"))
    title = "Save the current result, or import a snapshot"
    with st.expander(title, icon=":material/add:") if is_whole else st.container():
        left, right = st.columns((2, 1), gap="large")
        with left:
            _save_form(workspace)
        with right:
            _upload_form(workspace)
    entries = own_snapshots(workspace.id)
    if not entries:
        st.caption("You have kept no snapshot here yet.")
        return
    show_entries(
        workspace, entries, "snapshots", lambda entry: _view(workspace, entry.id),
        lambda entry: _show_actions(workspace, entry), title="Kept here",
        help="Shows the result, with its link, report and verification.",
    )  # fmt: skip


def _view(workspace: Workspace, name: str) -> None:
    """Show a snapshot, or the list; what was said of another one goes."""
    workspace.viewed = name
    show.forget_flash()


def _save_form(workspace: Workspace) -> None:
    result = workspace.result
    st.subheader("Save the current result", anchor=False)
    if result is None or result.estimate.outcome is Outcome.DIVERGED:
        st.caption("There is no result to save yet: train on a window first.")
        frame.link(frame.TRAIN, "Go to Train", workspace)
        return
    show.messages(unfinished(result.estimate), "warning", "pause_circle")
    with st.form("snapshots_form", border=False):
        name, note = st.columns((1, 1.4))
        name.text_input(
            "Name", key="snapshots_name", max_chars=LONGEST_NAME,
            placeholder=suggested_name(workspace), help="As suggested, if you leave it empty.",
        )  # fmt: skip
        note.text_input("Note", key="snapshots_note", max_chars=LONGEST_NOTE)
        with st.container(horizontal=True, vertical_alignment="center"):
            st.form_submit_button(
                "Save", type="primary", icon=":material/save:", on_click=_save, args=(workspace,)
            )
            st.caption(CONTAINS, help=LESS, width="stretch")


def suggested_name(workspace: Workspace) -> str:
    """Which vehicle or vehicles, in which recording and window or windows."""
    if (result := workspace.result) is None:
        return ""
    info, count = result.info, len(result.infos)
    vehicles = f"vehicles {info.vehicles[1]} to {info.vehicles[-1]}"
    who = info.labels[1] if info.followers == 1 else vehicles
    when = str(info.window) if count == 1 else f"{count} windows"
    return f"{who}, {info.source.rpartition('.')[0] or info.source}, {when}"[:LONGEST_NAME]


def _save(workspace: Workspace) -> None:
    snapshot = workspace.as_snapshot(
        name=st.session_state["snapshots_name"].strip() or suggested_name(workspace),
        note=st.session_state["snapshots_note"].strip(),
    )
    workspace.viewed = library().add(snapshot, owner_mark(workspace.id))
    show.flash("success", f"Saved as “{snapshot.name}”.")


def _upload_form(workspace: Workspace) -> None:
    """A file from elsewhere, kept only once it is known to be whole."""

    def took(name: str, raw: bytes) -> None:
        try:
            workspace.viewed = library().add(raw, owner_mark(workspace.id))
        except SnapshotError as fault:
            raise SnapshotError(f"{name}: {fault}") from fault
        show.flash("success", f"{name} is whole and now kept as {workspace.viewed}.")

    st.subheader("Import a snapshot", anchor=False)
    most = int(LARGEST / 1e6)
    show.upload(
        "A file that ends in .accpinn.zip; it is checked first.",
        "snapshots_upload", took, type="zip", max_upload_size=most,
    )  # fmt: skip


def _show_actions(workspace: Workspace, entry: Entry) -> None:
    """How it was verified, and what its owner can do."""
    with st.container(horizontal=True, vertical_alignment="center", gap="xsmall"):
        if checked := library().verification(entry.id):
            why = html.escape(f"{checked.sentence} {checked.how}.")
            st.html(MARK.format(why=why, brief=html.escape(checked.brief)))
        _delete_button(workspace, entry)


def _delete_button(workspace: Workspace, entry: Entry) -> None:
    if not may_delete(workspace.id, entry.id):
        return

    def delete() -> None:
        library().delete(entry.id)
        st.session_state[UNDO] = entry
        show.flash("success", f"Deleted: {title_of(entry)}. Links to it no longer work.")

    st.button(
        "Delete", icon=":material/delete:", key=f"snapshots_delete_{entry.id}", on_click=delete,
        type="tertiary", help="From the server, for everyone; it can be brought back for a day.",
    )  # fmt: skip


def _undo_button() -> None:
    entry = st.session_state.get(UNDO)
    if entry is None:
        return

    def restore() -> None:
        library().restore(entry.id)
        st.session_state[UNDO] = None
        show.flash("success", f"Brought back: {title_of(entry)}.")

    st.button(
        f"Undo: bring {show.escape_markdown(title_of(entry))} back", icon=":material/undo:",
        key="snapshots_undo_button", on_click=restore,
    )  # fmt: skip


# One snapshot in full


def show_one(workspace: Workspace, snapshot: Result) -> None:
    """The result, as whoever follows its link sees it: nothing here changes or deletes it."""
    info, title = snapshot.info, title_of(snapshot)
    source, recording = snapshot.analysis.source, workspace.recording
    # A file that is read by another mapping may give other numbers, which say nothing of this one.
    if recording and (recording.sha256, recording.mapping) != (source.sha256, source.mapping):
        recording = None
    st.subheader(escape_markdown(title), anchor=False)
    when = snapshot.created[:16].replace("T", " ")
    where = frame.segment_line(info, snapshot.estimate.case, snapshot.analysis.windows)
    st.caption(f"{where} · saved {escape_markdown(when)} UTC")
    if snapshot.note:
        st.text(snapshot.note)
    _show_buttons(workspace, snapshot, recording, title)
    _show_standing(workspace, snapshot, recording)
    show.not_acc(info)
    whole = snapshot.found_in(recording)
    more = {
        "Verify": lambda: _show_verification(workspace, snapshot),
        "Beside another": lambda: _show_beside(workspace, whole, recording),
    }
    show_result(workspace, whole, "snapshots", lambda: snapshot, more=more)


def _show_buttons(
    workspace: Workspace, snapshot: Result, recording: Recording | None, title: str
) -> None:
    stem = show.stem_of(title)[:60] or snapshot.id

    def open_it() -> None:
        workspace.restore(snapshot)
        show.flash("success", "Opened: every page now shows this snapshot.")

    with st.container(horizontal=True):
        back_button(workspace)
        if workspace.restored is None or workspace.restored.id != snapshot.id:
            st.button(
                "Open on every page", type="primary", icon=":material/folder_open:",
                key="snapshots_open", on_click=open_it,
                help="Stability, Platoon and Train then show it; your present result stays in the"
                " list of finished runs on page Train.",
            )  # fmt: skip
        with st.popover("Share", icon=":material/share:"):
            st.caption("A link to this page; it opens on any page of this server.")
            show.address(f"Snapshots?{SNAPSHOT}={snapshot.id}")
        with st.popover("Report", icon=":material/description:"):
            st.checkbox(
                "Without curves", key=NO_CURVES,
                help="The report then has neither recorded speeds and gaps nor simulated ones.",
            )  # fmt: skip
            st.download_button(
                "Download the report", lambda: _report(workspace, snapshot, recording),
                f"{stem}.html", "text/html", on_click="ignore", key="snapshots_report",
                help="One web page that needs nothing but a browser; it can be printed.",
            )  # fmt: skip
        if library().has(snapshot.id):
            st.download_button(
                "Download", lambda: library().raw(snapshot.id), f"{stem}{SUFFIX}",
                "application/zip", on_click="ignore", icon=":material/download:",
                help="The file itself: it can be sent, kept, and imported on any server."
                f" {CONTAINS} {LESS}",
            )  # fmt: skip


def back_button(workspace: Workspace) -> None:
    st.button(
        "All snapshots", icon=":material/arrow_back:", key="snapshots_back",
        on_click=_view, args=(workspace, ""),
    )  # fmt: skip


def _report(workspace: Workspace, snapshot: Result, recording: Recording | None) -> str:
    """The report with its verification, which is made first where it takes little time."""
    has_curves, checked = not st.session_state.get(NO_CURVES), _verified(workspace, snapshot)
    if checked is None:
        checked = verify(snapshot, recording, refit_within=PROMPT)
        library().keep_verification(snapshot, checked)
    return render_report(snapshot, checked, with_curves=has_curves)


def _verified(workspace: Workspace, snapshot: Result) -> Verification | None:
    """How it was verified, now or earlier, by whomever; None where it was not."""
    task = workspace.verifications.get(snapshot.id)
    return library().verification(snapshot.id) or (task.result if task else None)


def _show_standing(workspace: Workspace, snapshot: Result, recording: Recording | None) -> None:
    """Whether it agrees with what is computed now, or a button that runs its methods again."""
    task, checked = workspace.verifications.get(snapshot.id), _verified(workspace, snapshot)
    if task and task.is_active:
        monitor(task, lambda _: stop_button(task, "Stop", "snapshots_verify_stop"))
        return
    if task and task.status is Status.FAILED:
        show.messages(task.error, "error")
    with st.container(horizontal=True, vertical_alignment="center", key="snapshots_standing"):
        if checked and checked.ok is False:
            show.messages(checked.sentence, "error")
        elif checked:
            mark, sentence = checked.mark[0], escape_markdown(checked.sentence)
            sentence = f":{COLOURS[checked.ok]}[**{mark}**] {sentence}"
            st.caption(sentence, help=escape_markdown(checked.how), width="content")
        _verify_button(workspace, snapshot, recording, checked)


def _verify_button(
    workspace: Workspace, snapshot: Result, recording: Recording | None,
    checked: Verification | None,
) -> None:  # fmt: skip
    """Verify it, or once more where more can be checked now."""
    if snapshot.estimate.outcome is Outcome.STOPPED:
        st.caption("Not verified: a stopped training cannot be run again.", width="content")
        return
    label = "Verify"
    if checked and not any(check.cure == "--refit" for check in checked.unchecked):
        if recording is None or checked.has_recording:
            return
        label = "Verify against the recording"
    seconds = sum(map(refit_seconds, (snapshot, *snapshot.compared)))
    about = f", about {show.format_duration(seconds)}" if seconds else ""
    st.button(
        f"{label}{about}", icon=":material/replay:", key="snapshots_again",
        on_click=workspace.verify, args=(snapshot, recording),
        help="Runs every method of the snapshot anew on its data, with its settings, and compares"
        " all numbers.",
    )  # fmt: skip


def _show_verification(workspace: Workspace, snapshot: Result) -> None:
    """Every part, as stored and as computed again."""
    checked = _verified(workspace, snapshot)
    if checked is None:
        st.caption("Not verified yet.")
        return
    show.caption(f"{checked.how}.")
    show.table(verification_table(checked))


def _show_beside(workspace: Workspace, snapshot: Result, recording: Recording | None) -> None:
    """The same beside another of the user's snapshots."""
    others = [entry for entry in readable_snapshots(workspace.id) if entry.id != snapshot.id]
    if not others:
        st.caption("No other snapshot is kept here.")
        return
    other = choose_entry(workspace, "The second snapshot", "snapshots_second", others)
    show_both(workspace, snapshot, opened(other).found_in(recording))
