"""Widgets that show what the workspace holds, and report a change through a callback."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, TypeVar

import streamlit as st

from accpinn.segment.segment import Segment, SegmentInfo

T = TypeVar("T")
Change = Callable[[Any], object]
"""Called with the new value, before the page is drawn anew."""


def sync_widget(key: str, value: object) -> str:
    """Let the widget of that key show ``value``, whatever it showed before; returns the key.

    The workspace is the one place where choices live: a widget reports a change through its
    callback and gets its value from here, so page switches and reloads lose nothing. Give the
    widget the same value as its default, too: a browser that is still loading may miss the value
    set here, and would then report the default as the user's choice.
    """
    if st.session_state.get(key) != value:
        st.session_state[key] = value
    return key


def _bound(key: str, value: object, change: Change, optional: bool = False) -> dict[str, Any]:
    """The key of a widget that shows a value, and its callback.

    An emptied field changes nothing, unless it is ``optional``.
    """

    def changed() -> None:
        new = st.session_state[key]
        if optional or new is not None:
            change(new)

    return {"key": sync_widget(key, value), "on_change": changed}


def segments(
    label: str,
    options: Mapping[T, str],
    value: T,
    key: str,
    change: Change,
    labelled: bool = False,
    **look: Any,
) -> None:
    """A segmented control.

    Args:
        label: read aloud, and shown if it is ``labelled``.
        options: what each option is called.
        value: the present choice.
        key: of the widget.
        change: called with the new choice.
        labelled: whether the label is shown.
        look: further options of Streamlit's widget.
    """
    st.segmented_control(
        label,
        list(options),
        default=value,
        format_func=options.__getitem__,
        required=True,
        label_visibility="visible" if labelled else "collapsed",
        **_bound(key, value, change),
        **look,
    )


def select(
    label: str,
    options: Iterable[T],
    value: T,
    key: str,
    change: Change,
    name: Callable[[T], str] = str,
    labelled: bool = True,
    place: Any = st,
    **look: Any,
) -> None:
    """A select box.

    Args:
        label: read aloud, and shown if it is ``labelled``.
        options: to choose from.
        value: the present choice.
        key: of the widget.
        change: called with the new choice.
        name: what an option is called.
        labelled: whether the label is shown.
        place: the column or container that it stands in.
        look: further options of Streamlit's widget.
    """
    offered = list(options)
    place.selectbox(
        label,
        offered,
        index=offered.index(value),
        format_func=name,
        label_visibility="visible" if labelled else "collapsed",
        **_bound(key, value, change),
        **look,
    )


def number(
    label: str,
    value: float,
    key: str,
    change: Change,
    place: Any = st,
    optional: bool = False,
    **look: Any,
) -> None:
    """A number input.

    Args:
        label: with the unit.
        value: the present number.
        key: of the widget.
        change: called with the new number.
        place: the column or container that it stands in.
        optional: an emptied field is a change to None.
        look: further options of Streamlit's widget.
    """
    place.number_input(label, value=value, **_bound(key, value, change, optional), **look)


def toggle(label: str, value: bool, key: str, change: Change, **look: Any) -> None:
    """A switch; the arguments are those of `number`."""
    st.toggle(label, value=value, **_bound(key, value, change), **look)


def pick(label: str, options: Sequence[str], key: str, **look: Any) -> int:
    """The index of one of several names; no question where there is one.

    Args:
        label: shown above.
        options: the names.
        key: of the widget, which remembers the choice itself.
        look: further options of Streamlit's widget.
    """
    if len(options) == 1:
        return 0
    chosen = st.selectbox(
        label, range(len(options)), format_func=options.__getitem__, key=key, width=320, **look
    )
    return chosen or 0


def pick_follower(segment: Segment | SegmentInfo, key: str) -> int:
    """The index of the follower that is shown below, 0 for the first."""
    return pick("Follower", segment.labels[1:], key)
