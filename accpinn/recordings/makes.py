"""Make and model of a vehicle from the name in a file's header, in one spelling.

Headers write "Audi(A8)", "AUDI_E_TRON", "Mitsubishi(SpaceStar)", or the make or the model alone:
"Hyundai", "Rexton". The table `makes.csv` has each spelling without case, spaces and punctuation,
and what it stands for. A name that it lacks keeps its spelling, but for a known make at its
beginning.
"""

import csv
import re
from functools import cache
from importlib.resources import files

_PARTS = re.compile(r"\s*([^()_]+?)\s*(?:\(([^()]*)\)|_(.+))\s*")
"""Make and model apart, as "Audi(A8)" and "AUDI_A8"."""


def make_and_model(name: str) -> tuple[str, str]:
    """Make and model by the name in a header; the model is empty where it does not tell."""
    listed = _table().get(_key(name))
    if listed:
        return listed
    parts = _PARTS.fullmatch(name)
    if not parts:
        return name.strip(), ""
    make, model = parts[1], (parts[2] or parts[3]).strip()
    return _table().get(_key(make), (make, ""))[0], model


def is_known(name: str) -> bool:
    """Whether the table has a name."""
    return _key(name) in _table()


def _key(name: str) -> str:
    return re.sub(r"[^0-9a-z]+", "", name.lower())


@cache
def _table() -> dict[str, tuple[str, str]]:
    text = files("accpinn.recordings").joinpath("makes.csv").read_text(encoding="utf-8")
    return {
        row["spelling"]: (row["make"], row["model"]) for row in csv.DictReader(text.split("\n"))
    }
