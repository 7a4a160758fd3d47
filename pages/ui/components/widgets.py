"""Widgets that show what the workspace holds, and report a change through a callback."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any, TypeVar

import streamlit as st

from pages.ui.session.workspace import Workspace

T = TypeVar("T")
Change = Callable[[Any], object]
"""Called with the new value, before the page is drawn anew."""


def bound(
    key: str, value: object, change: Change, optional: bool = False, default: str = "value"
) -> dict[str, Any]:
    """Arguments with which a widget shows ``value``, whatever it showed before.

    The workspace is the one place where choices live: a widget reports a change through its
    callback and gets its value from here, so page switches and reloads lose nothing. It has the
    same value as its default, too: a browser that is still loading may miss the value set here,
    and would then report the default as the user's choice.

    A value that was chosen elsewhere comes with a new widget, whose key ends with a number. The
    browser may not have drawn it when the user clicks on something else; it then reports what the
    old widget shows, which is no choice.

    An emptied field changes nothing unless it is ``optional``; then it is a change to None.
    ``default`` names the widget's argument for its default; empty if it needs another.
    """
    replaced = f"{key} replaced"
    times = st.session_state.get(replaced, 0)
    name = f"{key}_{times}" if times else key
    if name in st.session_state and st.session_state[name] != value:
        times = st.session_state[replaced] = times + 1
        name = f"{key}_{times}"
    if name not in st.session_state:
        st.session_state[name] = value

    def changed() -> None:
        new = st.session_state[name]
        is_there = st.session_state.get(replaced, 0) == times
        if is_there and (optional or new is not None):
            change(new)

    return {"key": name, "on_change": changed} | ({default: value} if default else {})


def kept(workspace: Workspace, key: str, usual: object, default: str = "value") -> dict[str, Any]:
    """Arguments with which a widget shows what the workspace keeps under its key."""
    return bound(key, workspace.choices.get(key, usual), workspace.keep(key), default=default)


def _chosen(
    options: Mapping[T, str], value: T, key: str, change: Change | Workspace
) -> tuple[T, Change]:
    """What is chosen, and what keeps a change; a workspace keeps it among its choices."""
    if not isinstance(change, Workspace):
        return value, change
    chosen = change.choices.get(key, value)
    return chosen if chosen in options else value, change.keep(key)


def select(
    label: str,
    options: Mapping[T, str],
    value: T,
    key: str,
    change: Change | Workspace,
    labelled: bool = True,
    place: Any = st,
    **look: Any,
) -> T:
    """A select box, with what each option is called, in a column or container ``place``.

    Of a workspace in place of ``change``, ``value`` is the default, and the choice is kept there
    under ``key``. The label is read aloud also where it is not shown; ``look`` are Streamlit's
    further options. Returns what is chosen.
    """
    value, change = _chosen(options, value, key, change)
    place.selectbox(
        label,
        list(options),
        index=list(options).index(value),
        # The browser may still report an option that is gone.
        format_func=lambda option: options.get(option, str(option)),
        label_visibility="visible" if labelled else "collapsed",
        **bound(key, value, change, default=""),
        **look,
    )
    return value


def segments(
    label: str,
    options: Mapping[T, str],
    value: T,
    key: str,
    change: Change | Workspace,
    labelled: bool = False,
    **look: Any,
) -> T:
    """A segmented control; the arguments are those of `select`."""
    value, change = _chosen(options, value, key, change)
    st.segmented_control(
        label,
        list(options),
        format_func=options.__getitem__,
        required=True,
        label_visibility="visible" if labelled else "collapsed",
        **bound(key, value, change, default="default"),
        **look,
    )
    return value


def tabs(workspace: Workspace, key: str, views: Mapping[str, Callable[[], None]]) -> None:
    """Tabs of which only the open one is drawn; a switch draws the page anew.

    On a narrow screen they come after what is chosen on the page, and that after the answer: what
    has a key that begins with "later_1" and so on stands below the rest there.
    """
    titles = {title: title for title in views}
    value, change = _chosen(titles, next(iter(titles)), key, workspace)
    with st.container(key=f"later_2_{key}"):
        drawn = st.tabs([*titles], **bound(key, value, change, default="default"))
    for tab, draw in zip(drawn, views.values(), strict=True):
        if tab.open:
            with tab:
                draw()


def pick_follower(labels: Sequence[str], key: str) -> int:
    """The index of the vehicle that is shown below, 0 for the first; no question about one."""
    if len(labels) == 1:
        return 0
    chosen = st.selectbox("Follower", labels, key=key, width=320, label_visibility="collapsed")
    return labels.index(chosen) if chosen in labels else 0
