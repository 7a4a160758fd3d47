"""Texts from a stranger's file, without what a terminal or a page would obey instead of show."""

import re
from typing import Any

_CONTROL = r"\x00-\x08\x0b-\x1f\x7f-\x9f\u2028\u2029"
"""All but tabs and line breaks."""
_DIRECTION = r"\u061c\u200e\u200f\u202a-\u202e\u2066-\u2069"
"""Marks that turn the order of letters round, so that a name reads as another."""
_UNSEEN = re.compile(f"[{_CONTROL}{_DIRECTION}]")
_BREAK = re.compile(r"[\t\n]+")
STANDS_FOR = "\ufffd"
LINES = ("note", "notes")
"""Fields whose texts may have several lines."""


def plainly_printable(text: str) -> bool:
    """Whether a JSON text holds no such character, neither as it is nor escaped."""
    return "\\" not in text and not _UNSEEN.search(text)


def sanitise(tree: Any, lines: bool = False) -> Any:
    """A tree of plain values with every such character of its texts replaced by "\ufffd".

    Args:
        tree: as read from JSON.
        lines: whether texts keep their line breaks.
    """
    if isinstance(tree, str):
        seen = _UNSEEN.sub(STANDS_FOR, tree)
        return seen if lines else _BREAK.sub(" ", seen)
    if isinstance(tree, dict):
        return {sanitise(key): sanitise(item, key in LINES) for key, item in tree.items()}
    if isinstance(tree, list):
        return [sanitise(item, lines) for item in tree]
    return tree
