"""Sentences on a page: foreign text shown as it is, lists of findings in boxes, durations."""

import re
from collections.abc import Callable, Sequence
from typing import Literal, TypeVar

import streamlit as st

from accpinn.errors import AccpinnError
from accpinn.units import Seconds

T = TypeVar("T")

_PUNCTUATION = re.compile(r"([!-/:-@\[-`{-~])")
_ICONS = {"info": "info", "success": "check_circle", "warning": "warning", "error": "error"}


def escape_markdown(text: str) -> str:
    """Text with every mark that markdown could read made literal."""
    return _PUNCTUATION.sub(r"\\\1", text)


def bullets(sentences: Sequence[str]) -> str:
    """Sentences as a list; a single one needs none."""
    if len(sentences) == 1:
        return escape_markdown(sentences[0])
    return "\n".join(f"- {escape_markdown(sentence)}" for sentence in sentences)


def show_messages(
    sentences: str | Sequence[str],
    kind: Literal["info", "success", "warning", "error"] = "info",
    icon: str = "",
    after: str = "",
) -> None:
    """Sentences in a box; nothing where there is none.

    Args:
        sentences: as plain text, which is shown literally.
        kind: of the box.
        icon: name of a Material icon in place of the kind's own.
        after: plain text below a list of sentences.
    """
    if sentences:
        said = bullets((sentences,) if isinstance(sentences, str) else sentences)
        said += f"\n\n{escape_markdown(after)}" if after else ""
        getattr(st, kind)(said, icon=f":material/{icon or _ICONS[kind]}:")


def attempt(work: Callable[[], T]) -> T | None:
    """The result of some work; None, with the reason shown, where it is refused."""
    try:
        return work()
    except AccpinnError as fault:
        show_error(fault)
        return None


def show_error(fault: Exception | str) -> None:
    """Why something cannot be done."""
    show_messages(str(fault), "error")


def format_duration(seconds: Seconds) -> str:
    """A duration in words: 4 s, 3 min 20 s, 45 min, 1 h 5 min."""
    whole = max(1, round(seconds))
    if whole < 60:
        return f"{whole} s"
    if whole >= 600:  # a second more or less does not matter then
        whole = 60 * round(whole / 60)
    minutes, rest = divmod(whole, 60)
    if minutes < 60:
        return f"{minutes} min {rest} s" if rest else f"{minutes} min"
    hours, minutes = divmod(minutes, 60)
    return f"{hours} h {minutes} min"
