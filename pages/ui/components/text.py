"""Foreign text on a page: shown as it is, never read as markdown, and times in words."""

import re

from accpinn.units import Seconds

_PUNCTUATION = re.compile(r"([!-/:-@\[-`{-~])")


def escape_markdown(text: str) -> str:
    """Text with every mark that markdown could read made literal."""
    return _PUNCTUATION.sub(r"\\\1", text)


def bullets(sentences: tuple[str, ...]) -> str:
    """Sentences as a list; a single one needs none."""
    if len(sentences) == 1:
        return escape_markdown(sentences[0])
    return "\n".join(f"- {escape_markdown(sentence)}" for sentence in sentences)


def left_out(regimes: tuple[str, ...]) -> str:
    """What a caption adds where regimes are left out; nothing where all instants count."""
    return f" · {', '.join(regimes)} left out" if regimes else ""


def format_duration(seconds: Seconds) -> str:
    """A duration as people say it: 4 s, 3 min 20 s, 45 min, 1 h 5 min."""
    whole = max(1, round(seconds))
    if whole < 60:
        return f"{whole} s"
    if whole >= 600:  # a second more or less says nothing then
        whole = 60 * round(whole / 60)
    minutes, rest = divmod(whole, 60)
    if minutes < 60:
        return f"{minutes} min {rest} s" if rest else f"{minutes} min"
    hours, minutes = divmod(minutes, 60)
    return f"{hours} h {minutes} min"
