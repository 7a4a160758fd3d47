"""The runs of the OpenACC database that the Joint Research Centre publishes, and their vehicles.

`catalogue.csv` has the campaign and the name of each file, and the SHA-256 of those whose contents
are known; it holds no recording.

Headers name vehicles "Audi(A8)", "AUDI_E_TRON", "Mitsubishi(SpaceStar)", or by make or model alone:
"Hyundai", "Rexton". `makes.csv` has each spelling without case, spaces and punctuation, and what it
stands for. A name that it lacks keeps its spelling, but for a known make at its beginning.
"""

import csv
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from pathlib import Path

from accpinn.errors import ConfigError

PUBLISHED_AT = "https://jeodpp.jrc.ec.europa.eu/ftp/jrc-opendata/TransportExpData/JRCDBT0001/LATEST"
_PARTS = re.compile(r"\s*([^()_]+?)\s*(?:\(([^()]*)\)|_(.+))\s*")
"""Make and model apart, as "Audi(A8)" and "AUDI_A8"."""


@dataclass(frozen=True)
class Run:
    """A published file."""

    campaign: str
    """Campaign, which is also the name of its folder."""
    file: str
    sha256: str | None
    """SHA-256 of its bytes; None where it is not known."""

    @property
    def key(self) -> str:
        """The folder and file, as "Casale/part7.csv"."""
        return f"{self.campaign}/{self.file}"

    def path(self, folder: Path) -> Path:
        """The run's path below a folder of recordings."""
        return folder / self.campaign / self.file


@cache
def catalogue() -> tuple[Run, ...]:
    """All runs, by campaign and name; part10 follows part9."""
    rows = _rows("catalogue.csv")
    runs = [Run(row["campaign"], row["file"], row["sha256"] or None) for row in rows]
    return tuple(sorted(runs, key=lambda run: (run.campaign, _natural(run.file))))


def _natural(name: str) -> list[str | int]:
    """Sorts numbers within a name by their value; texts and numbers alternate."""
    return [int(part) if part.isdigit() else part for part in re.split(r"(\d+)", name)]


def find(names: Sequence[str]) -> tuple[Run, ...]:
    """The runs that campaigns or files name; all of them where nothing is named.

    Args:
        names: campaigns, files, or both as "Casale/part7.csv"; case does not matter.

    Raises:
        ConfigError: for a name that is not in the catalogue, or a file that two campaigns have.
    """
    if not names:
        return catalogue()
    chosen: dict[Run, None] = {}
    for name in names:
        wanted = name.strip().strip("/").lower()
        runs = [run for run in catalogue() if wanted == run.campaign.lower()]
        runs = runs or [run for run in catalogue() if wanted in (run.key.lower(), run.file.lower())]
        if not runs:
            listed = ", ".join(dict.fromkeys(run.campaign for run in catalogue()))
            raise ConfigError(
                f'"{name[:60]}" is not in the catalogue; choose a campaign ({listed}) or a file.'
            )
        if len({run.campaign for run in runs}) > 1:
            both = " or ".join(run.key for run in runs)
            raise ConfigError(f'"{name[:60]}" is the name of several runs; choose {both}.')
        chosen |= dict.fromkeys(runs)
    return tuple(chosen)


def make_and_model(name: str) -> tuple[str, str]:
    """Make and model by the name in a header; the model is empty where it does not tell."""
    listed = _makes().get(_key(name))
    if listed:
        return listed
    parts = _PARTS.fullmatch(name)
    if not parts:
        return name.strip(), ""
    make, model = parts[1], (parts[2] or parts[3]).strip()
    return _makes().get(_key(make), (make, ""))[0], model


def is_known(name: str) -> bool:
    """Whether the table has a name."""
    return _key(name) in _makes()


def _key(name: str) -> str:
    return re.sub(r"[^0-9a-z]+", "", name.lower())


@cache
def _makes() -> dict[str, tuple[str, str]]:
    return {row["spelling"]: (row["make"], row["model"]) for row in _rows("makes.csv")}


def _rows(name: str) -> Iterator[dict[str, str]]:
    text = files("accpinn.recordings").joinpath(name).read_text(encoding="utf-8")
    return csv.DictReader(text.split("\n"))
