"""The form for the columns of a table of one's own: how they are read, and changes to it.

Open are only those fields that nothing decides; all others are behind "Change columns". What is
chosen is kept in the session's `Pending`, so that plot and findings are always those of the form.
"""

from collections.abc import Callable, Sequence
from typing import Any, Literal

import streamlit as st

from accpinn.findings import Finding
from accpinn.recordings import Recording
from accpinn.recordings.clocks import FRAME
from accpinn.recordings.draft import Choice, Proposal, roles_of
from accpinn.recordings.files import contradictions
from accpinn.recordings.inconsistency import Inconsistency
from accpinn.recordings.mapping import (
    CsvMapping,
    GapColumn,
    SpeedColumn,
    cured,
    cures_of,
    parse_mapping,
    write_mapping,
)
from accpinn.recordings.source import excerpt
from accpinn.results.figures.recording import beginning
from accpinn.results.figures.style import CLEAR, vehicle_colour
from accpinn.results.messages import messages
from accpinn.results.recording import cure_words
from accpinn.results.tables import Column, Table
from pages.ui.components import show
from pages.ui.components.show import escape_markdown, select
from pages.ui.data.fields import Fields, counts_frames, read_by
from pages.ui.session.pending import Pending, is_complete, lacks_length
from pages.ui.session.workspace import Workspace

LISTED = 8
"""Rows of the table of columns, if fewer are used; columns that are not used follow in a line."""
LONGEST_NUMBER, LONGEST_CELL = 9, 28
"""Characters that are shown of a number, and of the first values."""
MOST_CURES = 3
"""Buttons beside a finding."""
CHANGING = "data_map_changing"
"""The entry in Streamlit's session state that shows the fields of all columns."""


def show_form(workspace: Workspace, pending: Pending, opened: Callable[[str | None], None]) -> None:
    """Show how the pending table is read, the open questions, and the button that opens it.

    Args:
        workspace: the session.
        pending: its pending table.
        opened: is called with the name of the run that is to be opened; None for the only one.
    """
    trajectory = _choose_run(workspace, pending)
    reading = pending.reading(trajectory)
    recording = reading if isinstance(reading, Recording) else None
    mapping = pending.mapping
    about = [f"**{escape_markdown(pending.file.content.name)}**"]
    if recording:
        about.append(f"{len(recording.present)} vehicles")
        rate = 1 / recording.sample_time
        about.append(f"{recording.duration:,.0f} s at {rate:.3g} Hz")
    st.markdown(" · ".join(about))
    is_open = False
    if mapping:
        is_open = _ask(workspace, pending, mapping)
        _show_columns(workspace, pending, mapping)
    if recording:
        leader, *_ = recording.present
        key = [(recording.label(k), vehicle_colour(k, leader)) for k in recording.present]
        show.key(key, title="First minutes:")
        show.chart(beginning(recording), "data_beginning")
        if mapping:
            show_cures(
                recording, mapping, lambda new: read_by(workspace, new), "data_form", "primary"
            )
        else:
            show.warnings(messages(recording.findings, recording), "the data")
    elif not is_open:
        show.messages(str(reading), "error")
    is_doubtful = recording is not None and bool(contradictions(recording))

    def cancel() -> None:
        workspace.pending = None
        show.forget_flash()

    with st.container(horizontal=True):
        st.button(
            "Open as it is" if is_doubtful else "Open", key="data_open_table",
            type="secondary" if is_doubtful else "primary", disabled=recording is None,
            on_click=opened, args=(trajectory,), icon=":material/arrow_forward:",
            help="What stands above contradicts the data; results would be wrong." if is_doubtful
            else "The recording over time on page Data, where one more click trains on it.",
        )  # fmt: skip
        st.button("Cancel", on_click=cancel, key="data_cancel")
    if mapping:
        _change_columns(workspace, pending, mapping)
    show.flashed()


def _choose_run(workspace: Workspace, pending: Pending) -> str | None:
    """The run that is to be opened, of a table with several."""
    runs = pending.runs
    if not runs:
        return None
    options = {name: f"{excerpt(name, 60)} · {count} vehicles" for name, count in runs}
    return select(
        f"{len(runs)} runs in {pending.file.content.name}; choose one", options, runs[0][0],
        "data_trajectory", workspace, width=420,
        help="Pairs whose leader is another pair's follower at the same time are one run.",
    )  # fmt: skip


# Findings, and what cures them


def show_cures(
    recording: Recording, mapping: CsvMapping, act: Callable[[CsvMapping], None], place: str,
    look: Literal["primary", "secondary"] = "secondary",
) -> None:  # fmt: skip
    """Faults of the data, each with the changes of the mapping that cure it.

    Args:
        recording: as it was read.
        mapping: by which it was.
        act: gets the mapping that a button stands for.
        place: begins the buttons' keys.
        look: of the likeliest cure's button.
    """
    against, offered = contradictions(recording), set[CsvMapping]()
    for k, finding in enumerate(against):
        if k < show.SHOWN:
            show.messages(finding.sentence(recording), "warning")
        if isinstance(finding, Inconsistency):
            with st.container(horizontal=True):
                for cure in cures_of(finding, mapping)[:MOST_CURES]:
                    new = cured(mapping, cure)
                    if new in offered:
                        continue
                    offered.add(new)
                    st.button(
                        cure_words(cure, mapping, finding.vehicle), on_click=act, args=(new,),
                        icon=":material/healing:", key=f"{place}_cure_{len(offered)}",
                        type=look if len(offered) == 1 else "secondary",
                        help="Changes how the columns are read; plot and findings are then new.",
                    )  # fmt: skip
    others = [finding for finding in recording.findings if finding not in against]
    others_said = messages(others, recording)
    left = against[show.SHOWN :]
    show.cautions(others_said[: show.SHOWN])
    hidden: tuple[Finding, ...] = (*left, *others[show.SHOWN :])
    if hidden:
        with st.expander(f"{len(hidden)} more about the data"):
            st.markdown(show.bullets(messages(hidden, recording)))


# What was understood


def _show_columns(workspace: Workspace, pending: Pending, mapping: CsvMapping) -> None:
    """A row for each column that is used, and for a few that are not."""
    choices = pending.file.proposal.choices
    is_kept = workspace.mappings.get(pending.file.names) == mapping
    roles: dict[str, list[tuple[str, str]]] = {}
    for name, role, unit in roles_of(mapping):
        roles.setdefault(name, []).append((role, unit))
    used = [choice for choice in choices if choice.column in roles]
    spare = [choice for choice in choices if choice.column not in roles]
    listed = spare[: max(0, LISTED - len(used))]
    rows = [choice for choice in choices if choice in used or choice in listed]
    remarks = _remarks(mapping)
    cells = [
        (
            Column("Column"),
            [excerpt(choice.column, 40) for choice in rows],
        ),
        (
            Column("Holds"),
            [
                ", ".join([*(role for role, _ in roles.get(choice.column, ())),
                           *remarks.get(choice.column, ())]) or "not used"
                for choice in rows
            ],
        ),
        (
            Column("Unit"),
            [next((unit for _, unit in roles.get(choice.column, ())), "") for choice in rows],
        ),
        (
            Column("First values"),
            [_first_values(choice) for choice in rows],
        ),
        (
            Column("Reason", prose=True),
            [_reason(choice, roles.get(choice.column, []), is_kept) for choice in rows],
        ),
    ]  # fmt: skip
    colours = [] if mapping.by else [_colour(mapping, choice.column) for choice in rows]
    show.table(Table.of("", cells), colours)
    unused = [choice.column for choice in spare if choice not in listed]
    if unused:
        show.caption(excerpt(f"{len(unused)} more are not used: {', '.join(unused)}", 200))


def _first_values(choice: Choice) -> str:
    """The first two cells of a column, digits of numbers cut; the first one where it is long."""
    cells = [cell or "–" for cell in choice.cells[:2]]
    if all(set(cell) <= set("+-.,0123456789eE–") for cell in cells):
        return ", ".join(excerpt(cell, LONGEST_NUMBER) for cell in cells)
    pair = ", ".join(cells)
    return pair if len(pair) <= LONGEST_CELL else excerpt(cells[0], LONGEST_CELL)


def _reason(choice: Choice, roles: Sequence[tuple[str, str]], is_kept: bool) -> str:
    if not roles:
        return choice.reason if not choice.role else "as you chose"
    if (choice.role, choice.unit) == roles[0]:
        return choice.reason
    return "as for an earlier table with these columns" if is_kept else "as you chose"


def _remarks(mapping: CsvMapping) -> dict[str, list[str]]:
    """Further operations on columns: sign, clock, and lengths subtracted."""
    remarks: dict[str, list[str]] = {}
    parts: tuple[SpeedColumn | GapColumn, ...] = (*mapping.speeds, *mapping.gaps)
    for part in parts:
        changes = ["sign reversed"] * part.reversed
        changes += [f"shifted by {part.shift:+g} s"] if part.shift else []
        if isinstance(part, GapColumn) and not isinstance(part.subtract, str) and part.subtract > 0:
            changes.append(f"less {part.subtract:g} m")
        remarks[part.column] = changes
    return remarks


def _colour(mapping: CsvMapping, column: str) -> str:
    """Colour of the vehicle whose speed or gap the column holds."""
    for k, speed in enumerate(mapping.speeds, 1):
        if column == speed.column:
            return vehicle_colour(k, 1)
    for k, gap in enumerate(mapping.gaps, 2):
        if column in (gap.column, gap.minus):
            return vehicle_colour(k - 1 if gap.minus and column == gap.column else k, 1)
    return CLEAR


# What is open


def _ask(workspace: Workspace, pending: Pending, mapping: CsvMapping) -> bool:
    """The questions and their fields; whether some field is empty yet."""
    proposal = pending.file.proposal
    if workspace.mappings.get(pending.file.names) == mapping or proposal.is_supported:
        return False
    is_open = not is_complete(mapping)
    if is_open or mapping == proposal.mapping:
        show.messages(proposal.undecided, "warning", "help")
    fields = Fields(workspace, pending, mapping)
    names = [name for name in open_fields(proposal) if fields.has(name)]
    for at in range(0, len(names), 4):
        columns = st.columns(4, vertical_alignment="bottom")
        for name, place in zip(names[at : at + 4], columns, strict=False):
            fields.draw(name, place)
    return is_open


def open_fields(proposal: Proposal) -> tuple[str, ...]:
    """The fields that nothing decides, by their names in `Fields`."""
    if proposal.is_supported:
        return ()
    mapping = proposal.mapping
    guessed = {c.column: c.is_by_values for c in proposal.choices if c.role and not c.is_supported}
    fields = list[str]()
    if mapping.time is None:
        fields += ["time", "time_unit"]
    elif mapping.time.unit == FRAME:
        fields += ["time_unit"]
    elif mapping.time.column in guessed:
        fields += ["time_unit"]
    if mapping.time is None or mapping.time.unit == FRAME:
        fields.append("step")
    for k, speed in enumerate(mapping.speeds):
        if not speed.column or guessed.get(speed.column):
            fields += [f"speed_{k}"]
    if any(not guessed[s.column] for s in mapping.speeds if s.column in guessed) or any(
        not speed.column for speed in mapping.speeds
    ):
        fields.append("speed_units")
    for k, gap in enumerate(mapping.gaps):
        if not gap.column or guessed.get(gap.column):
            fields += [f"gap_{k}"]
        if lacks_length(gap):
            fields.append(f"length_{k}")
    if any(not gap.column or guessed.get(gap.column) is False for gap in mapping.gaps):
        fields.append("gap_units")
    return tuple(fields)


def _change_columns(workspace: Workspace, pending: Pending, mapping: CsvMapping) -> None:
    """All fields that are not open above, a row a role; and the mapping as a file."""
    expander = st.expander(
        "Change columns", icon=":material/tune:", key=CHANGING, on_change="rerun"
    )
    if not expander.open:
        return
    fields = Fields(workspace, pending, mapping)
    is_asked = workspace.mappings.get(pending.file.names) != mapping
    shown = set(open_fields(pending.file.proposal)) if is_asked else set[str]()

    def row(names: Sequence[str], widths: Sequence[float]) -> Sequence[Any]:
        """Fields beside each other; the places of further ones are returned."""
        places = st.columns(widths, vertical_alignment="bottom")
        for name, place in zip(names, places, strict=False):
            if name not in shown and fields.has(name):
                fields.draw(name, place)
        return places[len(names) :]

    with expander:
        row(["rows", "run"] if mapping.by else ["rows", "vehicles", "run"], (1.4, 0.7, 1.2))
        time = ["time", "time_unit"] if mapping.time else ["time", "step"]
        time += ["step"] if counts_frames(mapping) else ["date"] if mapping.time else []
        row(time, (1.4, 0.7, 1.2))
        if mapping.by:
            fields.by_vehicle(st.columns(4, vertical_alignment="bottom"))
        for k in range(len(mapping.speeds)):
            names = [f"speed_{k}", f"speed_unit_{k}"]
            names += [] if mapping.by else [f"name_{k}", f"relative_{k}"]
            widths = (1.4, 0.7, *(() if mapping.by else (1.2, 1.2)), 0.8, 0.8)
            fields.shift_and_sign("speed", k, row(names, widths))
        for k in range(len(mapping.gaps)):
            names = [f"gap_{k}", f"gap_unit_{k}", f"minus_{k}", f"length_{k}", f"length_column_{k}"]
            widths = (1.4, 0.7, 1.2, 1, 1.2, 0.8, 0.8)
            fields.shift_and_sign("gap", k, row(names, widths))
        for vehicle in range(1, len(mapping.speeds) + 1):
            if not mapping.by:
                fields.mode(vehicle, st.columns((1.4, 1, 1), vertical_alignment="bottom"))
        _exchange_mapping(workspace, mapping)


def _exchange_mapping(workspace: Workspace, mapping: CsvMapping) -> None:
    """The mapping from a file, and as one."""

    def took(name: str, raw: bytes) -> None:
        read_by(workspace, parse_mapping(raw, name))

    with st.container(horizontal=True):
        with st.popover("Use a mapping file", icon=":material/upload_file:"):
            show.upload(
                "A mapping as JSON, as the command line takes it.", "data_mapping_upload", took,
                type="json", max_upload_size=1,
            )  # fmt: skip
        st.download_button(
            "Mapping as JSON", write_mapping(mapping), "mapping.json", "application/json",
            on_click="ignore", icon=":material/download:", key="data_mapping_json",
            help="For the command line's option --mapping, or for another server.",
        )  # fmt: skip
