"""Findings: facts about data or results that a reader should know, with their sentences.

Every room defines its findings beside the code that makes them. A finding holds numbers, names and
vehicle numbers; `Finding.text` is the template of its sentence, in which each field stands in
braces: "{vehicle}: α = {alpha:.4f} 1/s²". A finding adds further values by `_words`, and overrides
`sentence` where the template itself depends on its values.
"""

from collections.abc import Mapping, Sequence
from string import Formatter
from typing import Any, ClassVar, Protocol

import msgspec

Words = Mapping[str, object]
"""Values for a template, by name."""


class Labelled(Protocol):
    """The subject of a sentence: a recording, a segment or a segment's description."""

    @property
    def source(self) -> str:
        """File name of the recording."""

    def label(self, number: int) -> str:
        """The label of the vehicle with that number in the file."""


class Finding(msgspec.Struct, frozen=True, tag=True):
    """The base of all findings; a subclass's name is its kind."""

    text: ClassVar[str]
    """Template of the sentence, filled as `filled` says."""
    item_text: ClassVar[str] = ""
    """Template of an item of `{listed}`, filled for each vehicle with its part of tuples."""

    def sentence(self, about: Labelled) -> str:
        """The finding as a sentence; ``about`` names the recording and the vehicles."""
        return self.filled(self.text, about)

    def _words(self, about: Labelled) -> Words:
        """The template's values that are not fields."""
        return {}

    def filled(self, text: str, about: Labelled) -> str:
        """A template with the fields and `_words` of the finding.

        The fields `vehicle`, `vehicles` and `follower` are filled in as labels; vehicle 0 and None
        are "All followers". Tuples are listed as "α, β and τ", and the format "%" sets a space:
        `{share:.0%}` becomes "35 %"; `{share:percent}` is told as `percent` does. `{source}` is the
        recording, `{listed}` has `item_text` of each vehicle.
        """
        values: dict[str, Any] = {"source": about.source, **msgspec.structs.asdict(self)}
        if self.item_text:
            parts = {name: part for name, part in values.items() if isinstance(part, tuple)}
            items = []
            for k, number in enumerate(parts["vehicles"]):
                item = {name: part[k] for name, part in parts.items() if k < len(part)}
                item["vehicle"] = about.label(number)
                items.append(_TEMPLATES.format(self.item_text, **item))
            values["listed"] = ", ".join(items)
        if "{vehicle}" in text:
            values["vehicle"] = who(values["vehicle"], about)
        if "{follower}" in text:
            values["follower"] = about.label(values["follower"])
        if "{vehicles}" in text:
            values["vehicles"] = tuple(map(about.label, values["vehicles"]))
        return _TEMPLATES.vformat(text, (), {**values, **self._words(about)})


class _Templates(Formatter):
    def format_field(self, value: Any, format_spec: str) -> str:
        if isinstance(value, tuple):
            return joined([str(part) for part in value])
        if format_spec == "percent":
            return percent(value)
        text = format(value, format_spec)
        return f"{text[:-1]} %" if format_spec.endswith("%") else text


_TEMPLATES = _Templates()


def who(vehicle: int | None, about: Labelled) -> str:
    """The label of a vehicle; 0 and None stand for all followers."""
    return about.label(vehicle) if vehicle else "All followers"


def joined(parts: Sequence[str], word: str = "and") -> str:
    """Parts listed as in a sentence: "α, β and τ"."""
    return f" {word} ".join([", ".join(parts[:-1]), parts[-1]] if len(parts) > 1 else parts)


def capital(words: str) -> str:
    """The words with a capital at the beginning."""
    return words[:1].upper() + words[1:]


def percent(share: float) -> str:
    """A share as in a sentence, "35 %"; below 1 % with one significant digit."""
    return f"{100 * share:.0f} %" if share >= 0.01 else f"{100 * share:.1g} %"


def probability(share: float) -> str:
    """A share of draws; a share of finitely many draws never proves 0 or 1."""
    if share < 0.01:
        return "under 1 %"
    return "over 99 %" if share > 0.99 else percent(share)


def p_value(p: float) -> str:
    """A p-value as in a sentence: the probability of such data, or more extreme, by chance."""
    return "p < 0.001" if p < 0.001 else f"p = {p:.2g}"


def spelled(count: int) -> str:
    """A count in words, up to ten."""
    return _NUMBERS[count] if count < len(_NUMBERS) else str(count)


def all_of(count: int, what: str) -> str:
    """All of some things in words: "both followers", "all three followers"."""
    return f"both {what}" if count == 2 else f"all {spelled(count)} {what}"


_NUMBERS = ("no", "one", "two", "three", "four", "five", "six", "seven", "eight", "nine", "ten")
