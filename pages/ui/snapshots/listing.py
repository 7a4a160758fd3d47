"""A list of saved results: a row each, whose name opens it."""

from collections.abc import Callable, Sequence
from itertools import islice

import streamlit as st

from accpinn.results.tables.estimates import (
    EVERY_FOLLOWER,
    PARAMETER_COLUMNS,
    TITLES,
    name_of,
)
from accpinn.results.tables.table import supported_digits
from accpinn.study.result import Result
from accpinn.study.store import Entry
from pages.ui.components.show import escape_markdown

LISTED = 20
"""Rows at most; a search finds the others."""
WIDTHS = (3.2, 4.0, 2.6, 1.4)
"""Widths of a row's cells: name, where it is from, parameters, what can be done with it."""


def show_entries(
    entries: Sequence[Entry],
    key: str,
    open_entry: Callable[[Entry], None],
    action: Callable[[Entry], None] | None = None,
    help: str | None = None,
) -> None:
    """The rows, with a field to search them where they are many.

    Args:
        entries: the newest first.
        key: begins the keys of widgets.
        open_entry: called with the entry whose name is clicked on.
        action: draws what else can be done with an entry.
        help: what a click does.
    """
    matching = entries
    if len(entries) > LISTED // 4:
        asked = st.text_input(
            "Search", key=f"{key}_search", icon=":material/search:", width=420,
            placeholder="name, recording, vehicle or method",
        )  # fmt: skip
        words = (asked or "").casefold().split()
        matching = [entry for entry in entries if all(word in entry.words for word in words)]
    for entry in islice(matching, LISTED):
        with st.container(key=f"{key}_row_{entry.id}"):
            cells = st.columns(WIDTHS, vertical_alignment="center")
            cells[0].button(
                escape_markdown(title_of(entry)), key=f"{key}_open_{entry.id}", type="tertiary",
                icon=":material/error:" if entry.fault else ":material/inventory_2:",
                on_click=open_entry, args=(entry,), help=help,
            )  # fmt: skip
            for cell, line in zip(cells[1:], _lines(entry), strict=False):
                cell.caption(escape_markdown(line))
            if action:
                with cells[3]:
                    action(entry)
    hidden = len(matching) - LISTED
    if hidden > 0:
        st.caption(f"{hidden} more: search for them.")
    elif not matching:
        st.caption("Nothing has these words.")


def title_of(saved: Entry | Result) -> str:
    """What a saved result is called: its name, or else method and Case."""
    if saved.name.strip():
        return saved.name.strip()
    if isinstance(saved, Result):
        title, case = name_of(saved.fit), f", Case {saved.fit.case}"
    else:
        title = TITLES.get(saved.method, saved.method)
        title += f" ({saved.preset} preset)" if saved.preset else ""
        case = f", Case {saved.case}"
    return (title + case * (len(saved.parameters) > 1)) or saved.id


def _lines(entry: Entry) -> tuple[str, ...]:
    """Where it is from, and its first parameters."""
    if entry.fault:
        return "damaged", "–"
    first, last = (entry.vehicles[end] for end in (0, -1))
    where = f"{entry.source}, {entry.window}, {first} to {last}"
    when = entry.created[:16].replace("T", " ")
    data = ", with data" if entry.with_data else ""
    method = TITLES.get(entry.method, entry.method)
    return f"{where} · saved {when} UTC{data}", f"{method}; {first_estimate(entry)}"


def first_estimate(entry: Entry) -> str:
    """The first follower's parameters, with the digits that their intervals support."""
    shared = entry.case == "I" and len(entry.parameters) > 1
    unknown = ((float("nan"),) * 3,)
    ends = zip((entry.lower or unknown)[0], (entry.upper or unknown)[0], strict=True)
    shown = []
    for column, value, (low, high) in zip(PARAMETER_COLUMNS, entry.parameters[0], ends,
                                          strict=True):  # fmt: skip
        digits = supported_digits(low, high, column.digits or 0)
        shown.append(f"{column.title} {value:.{digits}f} {column.unit}")
    return f"{EVERY_FOLLOWER if shared else entry.vehicles[1]}: {', '.join(shown)}"


def choose_entry(label: str, key: str, entries: Sequence[Entry]) -> Entry:
    """One of them, by name; at first the newest."""
    known = {entry.id: entry for entry in entries}
    if st.session_state.get(key) not in known:
        st.session_state[key] = next(iter(known))
    chosen = st.selectbox(
        label, list(known), key=key, width=520,
        format_func=lambda name: f"{title_of(known[name])} · {known[name].source} · {name[:6]}",
    )  # fmt: skip
    return known[chosen]
