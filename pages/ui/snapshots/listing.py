"""A list of saved results: a row each, whose name opens it."""

from collections.abc import Callable, Sequence
from itertools import islice

import streamlit as st
from accpinn.results.snapshot.saved import Entry

from accpinn.channels import PARAMETERS
from accpinn.results.tables.estimates import EVERY_FOLLOWER, TITLES
from pages.ui.components.show import escape_markdown

LISTED = 20
"""Rows at most; a search finds the others."""
WIDTHS = (3.2, 4.0, 2.6, 1.4)
"""Of a row's cells: name, where it is from, parameters, what can be done with it."""


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
    found = entries
    if len(entries) > LISTED // 4:
        asked = st.text_input(
            "Search", key=f"{key}_search", icon=":material/search:", width=420,
            placeholder="name, recording, vehicle or method",
        )  # fmt: skip
        found = [entry for entry in entries if matches(entry, asked or "")]
    for entry in islice(found, LISTED):
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
    hidden = len(found) - LISTED
    if hidden > 0:
        st.caption(f"{hidden} more: search for them.")
    elif not found:
        st.caption("Nothing has these words.")


def matches(entry: Entry, words: str) -> bool:
    """Whether each of the words stands somewhere in what the list shows of it."""
    shown = " ".join((title_of(entry), *_lines(entry), *entry.vehicles, entry.note, entry.id))
    return all(word in shown.casefold() for word in words.casefold().split())


def title_of(entry: Entry) -> str:
    """What it is called: its name, or else its short name."""
    return entry.name.strip() or entry.id


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
    values = zip(PARAMETERS, entry.parameters[0], entry.digits, strict=True)
    shown = (f"{one.symbol} {value:.{digits}f} {one.unit}" for one, value, digits in values)
    return f"{EVERY_FOLLOWER if shared else entry.vehicles[1]}: {', '.join(shown)}"
