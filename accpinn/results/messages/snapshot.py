"""What was checked of a snapshot, in words."""

from collections.abc import Sequence
from itertools import zip_longest
from typing import NamedTuple

from accpinn.findings import Labelled, joined
from accpinn.results.snapshot.places import PartCheck
from accpinn.results.snapshot.standing import Standing, Way
from accpinn.results.snapshot.verification import RECORDING, Unchecked, Verification
from accpinn.results.tables.table import ABSENT
from accpinn.units import Seconds

TITLES = {
    "fit.surrogate": "Network's curves",
    "info": "Window and names",
    "facts": "Facts of the recording",
    "quality": "Data's quality",
    "adequacy": "Forms of the model",
    "refit": "Method run again",
    "uncertainty": "Intervals",
    "evaluation.surrogate": "Surrogate fit",
    "evaluation.closed_loop": "Closed-loop simulation",
    "evaluation.holdout": "Hold-out",
    "evaluation.blocks": "Hold-out, block by block",
    "evaluation.out_of_window": "Outside the window",
    "evaluation.out_of_window_seconds": "Time outside the window",
    "evaluation.whiteness": "Residual",
    "evaluation.findings": "Collisions",
    "evaluation.out_of_window_findings": "Collisions outside the window",
}
"""Of the parts whose own names would not do."""
PLACES = {
    "samples": "{} samples",
    "vehicles.0.linf_exact.value": "‖h‖₁ {}",
    "mean_time_gap.0": "mean time gap {} s",
    "parameters.0.2": "τ {} s",
    "centre.0.2": "τ {} s",
    "gap_mae.0": "gap MAE {} m",
    "0.errors.gap_mae.0": "gap MAE {} m",
    "deviation.0": "{} m/s²",
}
"""A value in words, by its place, where that names a quantity; of the first follower."""
DIGEST = 16
"""Digits of a digest that tell it from all others."""
LONGEST = 40
"""Characters of a text that is quoted."""
BEFORE = 20
"""Of these, the ones before two texts part."""

WHAT = {
    "errors": "its errors and intervals, as the data are not in it",
    "estimate": "that {detail} finds these parameters{time}",
    "stopped": "that {detail} finds these parameters, as its training was stopped by hand",
    "unknown start": "that {detail} finds these parameters, as its training began from weights that"
    " are not in the snapshot",
    "data": "that the data are those of {source} (SHA-256 {detail})",
    "version": "its sentences, as accpinn {detail} wrote them",
    "intervals": "its intervals, which another method gave: {detail}",
    "draws": "the single draws of {detail}, which differ from those drawn here as on another"
    " processor",
    "blocks": "the hold-out of {detail}, as other blocks were held out then",
    "remarks": "name, note, date, machine and the method's remarks, which anyone can write",
}
"""What was not checked, by kind."""
GROUPS = {
    "parameters": "α, β, τ",
    "training": "course of the estimation",
    "quality": "data quality",
    "outside": "errors outside the window",
    "forms": "forms of the model",
    "data": "speeds and gaps",
    "names": "names of vehicles",
    "created": "time of saving",
    "origin": "versions and machine",
    "durations": "computing times",
}
"""Of the groups of figures whose own names would not do."""
WAYS: dict[Way, str] = {"refitted": "Refitted", "recomputed": "Recomputed", "told": "Told only"}
COMPARED = "methods compared"
UNREFITTED = ("estimate", "stopped", "unknown start")
"""Kinds of a method that was not run again."""


class StandingRow(NamedTuple):
    """A group of figures in words."""

    group: str
    of: str
    """Empty for the snapshot's own result."""
    way: str
    figures: int
    agree: str
    """"yes", "NO", or empty for what was compared with nothing."""


class CheckRow(NamedTuple):
    """A check in words."""

    name: str
    stored: str
    recomputed: str
    ok: bool
    sentence: str
    way: Way


def _group(name: str) -> str:
    """A group of figures in words."""
    return GROUPS.get(name, name)


def _title(check: PartCheck) -> str:
    """The name of the part that was checked."""
    own = check.part.rpartition(".")[2].replace("_", " ").capitalize()
    return ", ".join(filter(None, [TITLES.get(check.part, own), check.method]))


def _values(check: PartCheck) -> tuple[str, str]:
    """One value of the part, as stored and as recomputed, with its place."""
    if check.reason:
        return ABSENT, "not possible"
    pair = (check.stored, check.recomputed)
    stored, recomputed = map(_brief, pair) if check.ok else _apart(*pair)
    named = PLACES.get(check.place, f"{check.place}: {{}}" if check.place else "{}")
    return named.format(stored), named.format(recomputed)


def _apart(one: float | str | None, other: float | str | None) -> tuple[str, str]:
    """Two values with no more digits or words than it takes to see that they differ."""
    if isinstance(one, float) and isinstance(other, float):
        pairs = [(f"{one:.{d}g}", f"{other:.{d}g}") for d in range(6, 18)]
        return next((pair for pair in pairs if pair[0] != pair[1]), pairs[0])
    first, second = (_plain(value) for value in (one, other))
    letters = enumerate(zip_longest(first, second))
    start = next((k for k, (a, b) in letters if a != b), 0) - BEFORE
    return _from(first, start), _from(second, start)


def _brief(value: float | str | None) -> str:
    text = _plain(value)
    return text if len(text) <= DIGEST else ABSENT if " " in text else text[:DIGEST]


def _plain(value: float | str | None) -> str:
    return "nothing" if value is None else value if isinstance(value, str) else f"{value:.6g}"


def _from(text: str, start: int) -> str:
    shown = text if start <= 0 else f"…{text[start:]}"
    return " ".join((shown if len(shown) <= LONGEST else f"{shown[: LONGEST - 1]}…").split())


def check_sentence(check: PartCheck, about: Labelled) -> str:
    """The outcome of a check; ``about`` is the snapshot's `info`."""
    if check.reason:
        return check.reason
    if check.ok:
        return "1 value agrees." if check.count == 1 else f"All {check.count:,} values agree."
    if check.part == "recording":
        digest = f" with the SHA-256 {check.stored}" if check.stored else ""
        return (
            "This is not the recording the result was learned from; that is"
            f" {about.source}{digest}."
        )
    if check.part == "window":
        return (
            "The recording is the same, but the window cut from it differs, as if bridged or"
            " resampled in another way."
        )
    many = f"{check.differing:,} values differ, the first" if check.differing > 1 else "One differs"
    place = f" in {check.place}" if check.place else ""
    stored, recomputed = _apart(check.stored, check.recomputed)
    return f"{many}{place}: stored {stored}, {WAYS[check.way].lower()} {recomputed}."


def unchecked_sentence(unchecked: Unchecked, about: Labelled) -> str:
    """What was not checked; ``about`` is the snapshot's `info`."""
    time = f" (about {duration(unchecked.seconds)})" if unchecked.seconds else ""
    if unchecked.cure == RECORDING:
        time = ", as the data are not at hand"
    return WHAT[unchecked.kind].format(detail=unchecked.detail, source=about.source, time=time)


def refitting(method: str, seconds: Seconds) -> str:
    """Before a method is run again: what, and how long it is expected to take."""
    return f"Running {method} again, about {duration(seconds)} …"


def duration(seconds: Seconds) -> str:
    """About how long: 4 s, 8 min, 2 h."""
    for unit, length in (("h", 3600.0), ("min", 60.0)):
        if seconds >= 1.5 * length:
            return f"{seconds / length:.0f} {unit}"
    return f"{max(1.0, seconds):.0f} s"


def verification_summary(verification: Verification, about: Labelled) -> str:
    """The first fault, or what agrees and what was not checked.

    Args:
        verification: of a snapshot.
        about: the snapshot's `info`.
    """
    for check in verification.checks:
        if not check.ok:
            return f"{_title(check)}: {check_sentence(check, about)}"
    believed = dict.fromkeys(unchecked_sentence(one, about) for one in verification.unchecked)
    return f"{rests_on(verification)} Not checked: {'; '.join(believed)}."


def rests_on(verification: Verification) -> str:
    """What was refitted, recomputed and only told: "Refitted: α, β, τ agree. Told only: names."."""
    found: dict[Way, dict[str, bool]] = {way: {} for way in WAYS}
    for one in verification.standings:
        if one.way != "told":
            name = COMPARED if one.compared else _group(one.group)
            found[one.way][name] = found[one.way].get(name, True) and one.ok
    known = {one.group for one in verification.standings if one.way != "told"}
    told = (one.group for one in verification.standings if one.group not in known)
    found["told"] = dict.fromkeys(map(_group, told), True)
    return " ".join(
        f"{WAYS[way]}: {_agreeing(way, names)}." for way, names in found.items() if names
    )


def parameters_rest_on(verification: Verification, about: Labelled) -> str:
    """What the parameters of a snapshot rest on, in one line, before anything is made of them.

    Args:
        verification: of a snapshot, or of its parameters alone.
        about: the snapshot's `info`.
    """
    if not verification.ok:
        return verification_summary(verification, about)
    if verification.refitted:
        return "Refitted: α, β, τ agree."
    why = [one for one in verification.unchecked if one.kind in UNREFITTED][:1]
    said = "; ".join(unchecked_sentence(one, about) for one in why)
    return f"Not refitted: α, β, τ are only told. Not checked: {said}." if why else ""


def _agreeing(way: Way, names: dict[str, bool]) -> str:
    """As "α, β, τ and curves agree; intervals DIFFER"."""
    if way == "told":
        return ", ".join(names)
    parts = (
        ([name for name, ok in names.items() if ok], "agree"),
        ([name for name, ok in names.items() if not ok], "DIFFER"),
    )
    return "; ".join(f"{joined(which)} {verb}" for which, verb in parts if which)


def standing_rows(standings: Sequence[Standing]) -> tuple[StandingRow, ...]:
    """Every group of figures in words, as tables and the command line's JSON have it."""
    return tuple(
        StandingRow(
            _group(one.group),
            COMPARED if one.compared else "",
            WAYS[one.way].lower(),
            one.figures,
            "" if one.way == "told" else "yes" if one.ok else "NO",
        )
        for one in standings
    )


def check_rows(verification: Verification, about: Labelled) -> tuple[CheckRow, ...]:
    """Every check in words, as tables and the command line's JSON have it.

    Args:
        verification: of a snapshot.
        about: the snapshot's `info`.
    """
    return tuple(
        CheckRow(_title(check), *_values(check), check.ok, check_sentence(check, about), check.way)
        for check in verification.checks
    )


def counted(verification: Verification) -> str:
    """How many of the stored figures agree with those computed anew: "41 of 41 agree"."""
    agreeing = sum(check.ok for check in verification.checks)
    return f"{agreeing} of {len(verification.checks)} agree"
