"""The page Snapshots: saving and importing, the list, one in full, and two beside each other."""

import html
from itertools import zip_longest
from typing import Any
from urllib.parse import urlsplit

import numpy as np
import streamlit as st

from accpinn.errors import SnapshotError
from accpinn.methods.fit import Outcome
from accpinn.results.figures.stability import bode
from accpinn.results.messages.methods import unfinished
from accpinn.results.messages.snapshot import check_rows, summary
from accpinn.results.report import render_report
from accpinn.results.snapshot import (
    LARGEST,
    LONGEST_NAME,
    LONGEST_NOTE,
    SUFFIX,
    Snapshot,
    create,
    stability,
)
from accpinn.results.snapshot.saved import Entry
from accpinn.results.snapshot.verification import obstacle, verify
from accpinn.results.tables.estimates import PARAMETER_COLUMNS, TITLES, learned_parameters
from accpinn.results.tables.table import ABSENT, Column, Range, Table
from accpinn.units import Seconds
from pages.ui.components import frame, show
from pages.ui.result.saved import banner
from pages.ui.session.resources import library, opened
from pages.ui.session.sessions import SNAPSHOT
from pages.ui.session.workspace import Workspace

LISTED = 50
"""Snapshots in the table; all can be chosen below it."""
WIDEST = 28
"""Characters of a name or file name in that table."""
SAME = "the same"
"""In place of a recomputed value that equals the stored one."""
QUICK: Seconds = 20.0
"""A method that took longer is not run again while the page waits."""
CHOSEN = "snapshots_chosen"
"""Key of the box with the snapshot that is shown in full."""


def show_page() -> None:
    """Draw the page."""
    workspace = frame.begin(
        "Snapshots", "Results as files: keep them, send them, open them again, compare them."
    )
    show.flashed()
    banner(workspace)
    left, right = st.columns((1.4, 1), gap="large")
    with left:
        _save_form(workspace)
    with right:
        _upload_form()
    st.subheader("On this server", anchor=False)
    entries = library().entries()
    if not entries:
        st.caption("No snapshot is kept here yet.")
        return
    show.table(listing(entries))
    shown = workspace.snapshot.id if workspace.snapshot else ""
    entry = choose_entry("Snapshot", CHOSEN, entries, first=shown)
    if entry is None:
        return
    try:
        _show_one(workspace, entry)
    except SnapshotError as fault:  # deleted or damaged since the list was read
        show.messages(str(fault), "error")
        return
    whole = tuple(one for one in entries if not one.fault and one.id != entry.id)
    if whole and not entry.fault:
        st.subheader("Compare with another", anchor=False)
        other = choose_entry("The second snapshot", "snapshots_second", whole)
        if other and st.toggle("Show both side by side", key="snapshots_compare"):
            show_both(opened(entry.id), opened(other.id))


# Saving and importing


def _save_form(workspace: Workspace) -> None:
    """Name, note and the question about the data, for the current result."""
    fit, segment = workspace.fit, workspace.segment
    st.subheader("Save the current result", anchor=False)
    if fit is None or fit.outcome is Outcome.DIVERGED:
        st.caption("There is no result to save yet: train on a window first.")
        frame.link(frame.TRAIN, "Go to Train", workspace)
        return
    if segment is None:
        st.caption("The result shown is a snapshot already, and its data are not open.")
        return
    show.messages(unfinished(fit), "warning", "pause_circle")
    with st.form("snapshots_form", border=False):
        st.text_input("Name", key="snapshots_name", max_chars=LONGEST_NAME)
        st.text_area("Note", key="snapshots_note", max_chars=LONGEST_NOTE, height=80)
        included = "Include the data slice (speeds and gaps of the window)"
        st.checkbox(included, key="snapshots_with_data")
        st.caption(
            "With it, whoever opens the file sees the data and can train on. OpenACC data may be"
            " passed on under CC BY 4.0; the file names its authors. Your own data: your choice."
        )
        st.form_submit_button(
            "Save", type="primary", icon=":material/save:", on_click=_save, args=(workspace,)
        )


def _save(workspace: Workspace) -> None:
    """Keep the current result with all that the session knows of it."""
    fit, segment, old = workspace.fit, workspace.segment, workspace.snapshot
    if fit is None or segment is None:
        return
    with show.flashing():
        snapshot = create(
            segment,
            fit,
            recording=workspace.recording,
            facts=old.facts if old else None,
            uncertainty=workspace.uncertainty(),
            evaluation=old.evaluation if old and old.fit is fit else None,
            methods=workspace.compared,
            adequacy=workspace.known_adequacy,
            name=st.session_state["snapshots_name"].strip(),
            note=st.session_state["snapshots_note"].strip(),
            with_data=st.session_state["snapshots_with_data"],
        )
        kept = st.session_state[CHOSEN] = library().add(snapshot)
        name = f"“{snapshot.name}”" if snapshot.name else f"snapshot {kept}"
        show.flash("success", f"Saved as {name}.")


def _upload_form() -> None:
    """A file from elsewhere, kept only once it is known to be whole."""

    def uploaded() -> None:
        upload = st.session_state["snapshots_upload"]
        if upload is None:
            return
        with show.flashing(f"{upload.name}: "):
            kept = st.session_state[CHOSEN] = library().add(upload.getvalue())
            show.flash("success", f"{upload.name} is whole and now in the list as {kept}.")

    st.subheader("Import a snapshot", anchor=False)
    st.file_uploader(
        f"A file that ends in .accpinn.zip, up to {LARGEST / 1e6:.0f} MB; it is checked first.",
        type="zip",
        key="snapshots_upload",
        on_change=uploaded,
        max_upload_size=int(LARGEST / 1e6),
    )


# The list, and one in full


def listing(entries: tuple[Entry, ...]) -> Table:
    """The newest snapshots, a line each."""
    columns = (
        Column("Name"), Column("Recording"), Column("Window"), Column("Vehicles"),
        Column("Method"), Column("First α, β, τ"), Column("Data"), Column("Saved (UTC)"),
    )  # fmt: skip
    return Table("", columns, tuple(_line(entry) for entry in entries[:LISTED]))


def _line(entry: Entry) -> tuple[str, ...]:
    """The cells of one; long names leave room, and stand in full with the one that is chosen."""
    if entry.fault:
        return (f"{entry.id} (damaged)", *("–",) * 7)
    names = (_title(entry), entry.source)
    name, source = (t if len(t) <= WIDEST else f"{t[: WIDEST - 1]}…" for t in names)
    first, last = (entry.vehicles[end].partition(" ")[0] for end in (0, -1))
    return (
        name, source, entry.window, f"{first} to {last}",
        TITLES.get(entry.method, entry.method),
        "{:.4f}, {:.4f}, {:.3f}".format(*entry.parameters[0]),
        "yes" if entry.with_data else "no", entry.created[:16].replace("T", " "),
    )  # fmt: skip


def _title(entry: Entry) -> str:
    """What a snapshot is called: its name, or else its short name."""
    return entry.name.strip() or entry.id


def choose_entry(label: str, key: str, entries: tuple[Entry, ...], first: str = "") -> Entry | None:
    """One of them, by name; at first the one of that id, else the newest."""
    known = {e.id: (e, f"{_title(e)} · {e.source or 'damaged'} · {e.id[:6]}") for e in entries}
    if st.session_state.get(key) not in known:
        st.session_state[key] = first if first in known else next(iter(known))
    chosen = st.selectbox(label, list(known), format_func=lambda name: known[name][1], key=key)
    return known[chosen][0] if chosen in known else None


def _show_one(workspace: Workspace, entry: Entry) -> None:
    """Note, buttons, link, and verification."""
    if entry.fault:
        show.messages(entry.fault, "error")
        _delete_button(entry)
        return
    if entry.note:
        st.text(entry.note)
    # The title with nothing in it that a file name cannot have.
    stem = "".join(c if c.isalnum() or c in "-_." else "_" for c in _title(entry))
    stem = stem.strip("._")[:60] or entry.id
    with st.container(horizontal=True):
        st.button(
            "Open", type="primary", icon=":material/folder_open:", key="snapshots_open",
            on_click=_open, args=(workspace, entry.id),
        )  # fmt: skip
        st.download_button(
            f"Download ({entry.size / 1e6:.1f} MB)", lambda: library().raw(entry.id),
            f"{stem}{SUFFIX}", "application/zip", on_click="ignore", icon=":material/download:",
        )  # fmt: skip
        st.download_button(
            "Report", lambda: render_report(opened(entry.id)), f"{stem}.html", "text/html",
            on_click="ignore", icon=":material/description:",
            help="One web page that needs nothing but a browser; it can be printed.",
        )  # fmt: skip
        _delete_button(entry)
    st.caption("Link to this snapshot; it opens on any page of this server.")
    address = urlsplit(st.context.url or "")
    server = f"{address.scheme}://{address.netloc}" if address.netloc else ""
    st.code(f"{server}/Snapshots?{SNAPSHOT}={entry.id}", language=None)
    with st.expander("Verify: stored beside recomputed", icon=":material/fact_check:"):
        _show_verification(workspace, opened(entry.id))


def _open(workspace: Workspace, name: str) -> None:
    with show.flashing():
        workspace.restore(opened(name))
        show.flash("success", "Opened: every page now shows this snapshot.")


def _delete_button(entry: Entry) -> None:
    def delete() -> None:
        with show.flashing():
            library().delete(entry.id)
            show.flash("success", f"Deleted: {_title(entry)}.")

    with st.popover("Delete", icon=":material/delete:"):
        st.write("Delete it from the server for everyone? Links to it will stop working.")
        st.button("Yes, delete it", key="snapshots_delete", on_click=delete)


def _show_verification(workspace: Workspace, snapshot: Snapshot) -> None:
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
    said = summary(found, snapshot.info)
    show.messages(said, *(("success", "verified") if found.ok else ("error",)))
    texts = (Column(title, prose=True) for title in ("Result", "Stored", "Recomputed"))
    columns = (Column("Checked"), *texts)
    rows = tuple(
        (c.name, c.sentence, c.stored, SAME if c.ok and c.stored == c.recomputed else c.recomputed)
        for c in check_rows(found, snapshot.info)
    )
    show.table(Table("", columns, rows))


# Two beside each other


def show_both(one: Snapshot, other: Snapshot) -> None:
    """Parameters with intervals, Bode magnitudes, and what differs in settings and data."""
    show.messages(other_vehicles(one, other), "warning", "compare_arrows")
    longer = max(one.info, other.info, key=lambda info: info.followers)
    colours = [colour for colour in show.vehicle_colours(longer)[1:] for _ in PARAMETER_COLUMNS]
    show.table(parameter_differences(one, other), colours)
    _show_responses(one, other)
    changes = differing_settings(one, other)
    if changes.rows:
        show.table(changes)
    else:
        st.caption("Both were made with the same settings, from the same window of one recording.")


def other_vehicles(one: Snapshot, other: Snapshot) -> str:
    """A warning where followers in the same place are not the same; else empty."""
    pairs = zip_longest(one.info.labels[1:], other.info.labels[1:], fillvalue="no vehicle")
    unlike = [f"{first} stands beside {second}" for first, second in pairs if first != second]
    if not unlike:
        return ""
    return (
        f"The followers are not the same: {'; '.join(unlike)}. The differences below are then"
        " between vehicles, not between two results for one."
    )


def parameter_differences(one: Snapshot, other: Snapshot) -> Table:
    """One row a follower and parameter: both values with intervals, and the second less the first.

    Followers are matched in driving order.
    """
    columns = (
        Column("Follower"), Column("Parameter"),
        Column("First"), Column("interval"), Column("Second"), Column("interval "),
        Column("Δ"), Column("Δ in %"),
    )  # fmt: skip
    rows = []
    labels = zip_longest(one.info.labels[1:], other.info.labels[1:], fillvalue=ABSENT)
    for k, (first, second) in enumerate(labels):
        name = first if first == second else f"{first} / {second}"
        for which, column in enumerate(PARAMETER_COLUMNS):
            (a, *cells), (b, *others) = (_estimate(s, k, which) for s in (one, other))
            change = 100 * (b - a) / a if a else np.nan
            cells += [*others, _signed(b - a, column.digits or 0), _signed(change, 1)]
            rows.append((name, column.heading, *cells))
    return Table("Parameters", columns, tuple(rows))


def _estimate(snapshot: Snapshot, follower: int, which: int) -> tuple[float, str, str]:
    """A parameter, and how it and its interval are printed; nan for no follower."""
    known, column = snapshot.uncertainty, PARAMETER_COLUMNS[which]
    if follower >= snapshot.info.followers:
        return np.nan, ABSENT, ABSENT
    value = float(snapshot.fit.parameters.values[follower, which])
    ends = (known.lower, known.upper) if known else ()
    interval = Range(*(float(end.values[follower, which]) for end in ends)) if ends else None
    return value, column.shown(value), column.shown(interval)


def _signed(value: float, digits: int) -> str:
    return f"{value:+.{digits}f}" if np.isfinite(value) else ABSENT


def _show_responses(one: Snapshot, other: Snapshot) -> None:
    """Both Bode magnitudes in one chart; nothing where the parameters of either have none."""
    charts = []
    for snapshot in (one, other):
        report = stability(snapshot.fit)
        if report is None:
            return
        charts.append(bode(learned_parameters(snapshot.info, snapshot.fit), report))
    chart, second = charts
    for trace in second.data:
        if trace.mode == "lines+markers" and (trace.customdata is None or trace.customdata[0] >= 0):
            # The whole platoon's line is left to the first alone: the chart stays readable.
            chart.add_scatter(
                x=trace.x, y=trace.y, mode="lines",
                name=f"{trace.name}, {html.escape(other.name or other.id)}",
                line={**trace.line.to_plotly_json(), "dash": "dot"},
                hovertemplate="%{y:.2f} dB at %{x:.3f} rad/s",
            )  # fmt: skip
    whole = " Dashed: the first one's whole platoon." if one.info.followers > 1 else ""
    st.caption(f"Bode magnitude. Full lines: the first snapshot; dotted: the second.{whole}")
    show.chart(chart, "snapshots_bode")


def differing_settings(one: Snapshot, other: Snapshot) -> Table:
    """The settings and data that differ, a line each."""
    first, second = _settings(one), _settings(other)
    rows = tuple(
        (name, first.get(name, ABSENT), second.get(name, ABSENT))
        for name in first | second
        if first.get(name) != second.get(name)
    )
    columns = (Column("Setting"), Column("First", prose=True), Column("Second", prose=True))
    return Table("What differs", columns, rows)


def _settings(snapshot: Snapshot) -> dict[str, str]:
    info, fit = snapshot.info, snapshot.fit
    found: dict[str, Any] = {
        "recording": info.source,
        "recording's SHA-256": info.sha256[:16],
        "window": f"{info.window}",
        "vehicles": ", ".join(info.labels),
        "excluded": ", ".join(info.excluded_regimes) or "nothing",
        "method": fit.method,
        "case": fit.case,
        "iterations done": fit.iterations,
        "accpinn": snapshot.origin.accpinn,
        **fit.config,
    }
    return {name: str(value) for name, value in found.items()}
