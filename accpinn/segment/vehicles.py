"""Which vehicles of a recording can form a platoon: consecutive ones with a space-gap between."""

import re
from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from accpinn.channels import GAP
from accpinn.errors import SegmentError
from accpinn.recordings.recording import Recording

MAX_FOLLOWERS = 10

_PART = re.compile(r"(\d{1,3})(?:-(\d{1,3}))?")


def parse_vehicles(text: str) -> tuple[int, ...]:
    """The vehicles of a text as 1-5, 1,2 or 4; whether a recording has them is not asked here."""
    numbers: list[int] = []
    for part in text.replace(" ", "").split(","):
        match = _PART.fullmatch(part)
        if not match:
            raise SegmentError(f'"{text[:40]}" names no vehicles; write them as 1-5 or as 1,2.')
        first, last = int(match[1]), int(match[2] or match[1])
        numbers.extend(range(first, last + 1) if first <= last else range(first, last - 1, -1))
    return tuple(numbers)


def chains(recording: Recording) -> tuple[tuple[int, ...], ...]:
    """The longest possible platoons: every maximal run of linked vehicles, in order."""
    found: list[tuple[int, ...]] = []
    for number in recording.present:
        if found and found[-1][-1] == number - 1 and _linked(recording, number - 1):
            found[-1] = (*found[-1], number)
        else:
            found.append((number,))
    return tuple(chain for chain in found if len(chain) > 1)


def default_vehicles(recording: Recording) -> tuple[int, ...]:
    """The run that starts at vehicle 1; without one, the longest, and the first of equals."""
    possible = chains(recording)
    if not possible:
        raise SegmentError(
            f"{recording.source}: no two consecutive vehicles have speeds and a space-gap between"
            " them; choose another recording."
        )
    chosen = possible[0] if possible[0][0] == 1 else max(possible, key=len)
    return chosen[: MAX_FOLLOWERS + 1]


def check_vehicles(recording: Recording, vehicles: Sequence[int]) -> tuple[int, ...]:
    """The vehicles as given, if they form a platoon in this recording."""
    chosen = tuple(int(number) for number in vehicles)
    fault = _fault(recording, chosen)
    if fault:
        possible = " or ".join(f"{c[0]}-{c[-1]}" for c in chains(recording)) or "none"
        raise SegmentError(f"{recording.source}: {fault}; possible platoons: {possible}.")
    return chosen


def _fault(recording: Recording, chosen: tuple[int, ...]) -> str:
    if len(chosen) < 2:
        return "a leader and at least one follower are needed"
    if len(chosen) > MAX_FOLLOWERS + 1:
        return f"{len(chosen) - 1} followers are chosen and at most {MAX_FOLLOWERS} can be handled"
    present = recording.present
    for number in chosen:
        if number not in present:
            known = 1 <= number <= len(recording.vehicles)
            name = f" ({recording.vehicles[number - 1].name})" if known else ""
            return f"vehicle {number}{name} has no speed in this recording"
    for ahead, behind in pairwise(chosen):
        if behind != ahead + 1:
            return f"vehicle {behind} does not follow vehicle {ahead}"
        if not _linked(recording, ahead):
            return (
                f"{GAP.of(ahead)}, the space-gap between vehicles {ahead} and {behind}, is missing"
            )
    return ""


def _linked(recording: Recording, ahead: int) -> bool:
    return bool(np.isfinite(recording.gap_behind(ahead)).any())
