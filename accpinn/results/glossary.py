"""Glossary of the symbols and terms of tables and pages, from `glossary.toml`."""

import tomllib
from itertools import starmap
from pathlib import Path
from typing import NamedTuple

from accpinn.channels import FREQUENCY, GAP, LINF_GAIN, MAGNITUDE, PARAMETERS, SPEED

_QUANTITIES = {q.symbol: q for q in (*PARAMETERS, GAP, SPEED, MAGNITUDE, LINF_GAIN, FREQUENCY)}


class Term(NamedTuple):
    """A symbol or a term."""

    word: str
    meaning: str
    """Whole sentences."""
    unit: str = ""


def _term(heading: str, meaning: str) -> Term:
    """A term from its heading, as "ω_c [rad/s]"; a quantity's meaning begins with its name."""
    word, _, unit = heading.removesuffix("]").partition(" [")
    if quantity := _QUANTITIES.get(word):
        return Term(word, f"{quantity.name}. {meaning}", quantity.unit)
    return Term(word, meaning, unit)


_TEXT = (Path(__file__).parent / "glossary.toml").read_text(encoding="utf-8")
GROUPS = {
    subject: tuple(starmap(_term, terms.items())) for subject, terms in tomllib.loads(_TEXT).items()
}
"""Terms by subject."""

MEANINGS = {term.word: term.meaning for terms in GROUPS.values() for term in terms}
