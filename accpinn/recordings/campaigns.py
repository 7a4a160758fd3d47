"""Which campaign of the database a file belongs to, where that is certain."""

import re
from dataclasses import dataclass
from datetime import date


@dataclass(frozen=True)
class Campaign:
    """A campaign: its folder, how it names its files, and the days it took place."""

    folder: str
    files: re.Pattern[str]
    days: tuple[date, ...]
    unique: bool
    """Whether the file names alone tell this campaign from the others."""


def _days(year: int, month: int, *days: int) -> tuple[date, ...]:
    return tuple(date(year, month, day) for day in days)


_PART = re.compile(r"part\d+(_\d+)?\b")

CAMPAIGNS = (
    Campaign("AstaZero", re.compile(r"ASta_\d{6}_platoon\d+"), _days(2019, 7, 4, 5), True),
    Campaign("Casale", _PART, _days(2020, 10, 27), False),
    Campaign(
        "Cherasco",
        re.compile(r"(JRC-Cher|Cher-JRC)_"),
        _days(2018, 8, 30) + _days(2018, 9, 24),
        True,
    ),
    Campaign("JRC low speed", _PART, _days(2020, 9, 30), False),
    Campaign("Vicolungo", re.compile(r"(JRC-VC|VC-JRC)_"), _days(2019, 2, 26, 27, 28), True),
    Campaign(
        "ZalaZone", re.compile(r"(handling|dynamic)_part\d+"), _days(2019, 10, 6, 7, 8, 9), True
    ),
)


def campaign_of(name: str, folder: str | None, day: date | None) -> str | None:
    """The campaign, or None: a wrong guess would be worse than none.

    Folder or file name must point to it and the date must not contradict; file names that two
    campaigns share (part7.csv) need the date as well.
    """
    fits = [c.folder for c in CAMPAIGNS if _points_to(c, name, folder, day)]
    return fits[0] if len(fits) == 1 else None


def _points_to(campaign: Campaign, name: str, folder: str | None, day: date | None) -> bool:
    if day is not None and day not in campaign.days:
        return False
    in_folder = folder is not None and folder.strip().lower() == campaign.folder.lower()
    named = bool(campaign.files.match(name)) and (campaign.unique or day is not None)
    return in_folder or named
