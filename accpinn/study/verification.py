"""What a snapshot says, held against what its analysis gives when it is run again.

The analysis is run again on the snapshot's data, or on those cut anew from the recording, and each
part of both results is compared number by number. A part is then

    reproduced     the method was run again and gives the same
    recomputed     it follows from the stored fit and the data, or from the fit alone
    not checked    neither was possible; the part rests on whoever wrote the file

On one machine a method gives the same to the last digit. Another processor rounds otherwise, and an
iterative training carries that on, so there its parameters count and no more (`Method.tolerance`).
A whole file proves nothing, as anyone can write one with a digest that fits.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from math import inf
from typing import Any, Literal

import numpy as np

from accpinn.errors import AccpinnError
from accpinn.evaluation import of_blocks
from accpinn.inference.intervals import SLACK, agree, from_draws, with_estimates
from accpinn.methods.estimate import Outcome
from accpinn.methods.registry import METHODS
from accpinn.model.cthp import Trajectories
from accpinn.recordings import Recording, facts_of
from accpinn.segment import SegmentInfo, WindowMoved, WindowShortened
from accpinn.serial import NOT_FINITE, dump, flatten, sanitise
from accpinn.study.judge import judged_again, seconds_of
from accpinn.study.result import Parts, Result
from accpinn.study.run import estimate
from accpinn.units import Seconds

State = Literal["reproduced", "recomputed", "not checked"]
Cure = Literal["", "--recording", "--refit"]
"""What checks more, as the command line has it; empty where nothing can."""

PATIENCE: Seconds = 60.0
"""Longest time that running the methods again may be expected to take by default."""
PROMPT: Seconds = 5.0
"""The same where the verification only comes before something else."""
QUICK: Seconds = 0.0
"""The same where no method is to be run again."""
HOWEVER_LONG: Seconds = inf

RELATIVE, ABSOLUTE = 1e-9, 1e-11
"""Numbers closer than this are the same; other processors round differently."""
SOLVED = 1e-6
"""The same share for what a method finds, and for what follows from draws."""
DRAWN = 1e-3
"""Largest difference of small numbers that follow from draws, as probabilities of forms."""
CURVES = 1e-4
"""Largest difference, in m and m/s, of curves from those that the weights give."""
TOLERANCES = {
    "fit": (SOLVED, ABSOLUTE), "curves": (RELATIVE, CURVES), "uncertainty": (SOLVED, ABSOLUTE),
    "adequacy": (SLACK, DRAWN), "answer": (SLACK, DRAWN), "gain_checks": (SLACK, DRAWN),
    "judgements": (SLACK, DRAWN), "disturbances": (SLACK, DRAWN),
}  # fmt: skip
"""Relative and absolute, of parts that need others than `RELATIVE` and `ABSOLUTE`."""
PARTS = ("answer", "gain_checks", "qualities", "uncertainty", "evaluation", "adequacy")
"""Parts that follow from fit and data."""
INSTANTS = 300
"""Instants at which curves are compared."""
FAULTS = (AccpinnError, ValueError, ArithmeticError)
"""What computing with numbers that no snapshot has can raise."""
VARYING = {"seconds", "cached"}
"""Fields that differ from run to run."""
EVERYWHERE = ("parameters", "unconstrained", "method", "case", "config")
"""What an iterative training gives on every processor."""
LIKELY = ("log_likelihood", "evidence", "unknowns", "disturbance")
"""What the likelihood says, among losses and arrays: there up to `SLACK`."""
FEATURED = {
    "0.parameters.0.2": "τ {} s", "centre.0.2": "τ {} s", "0.mean_time_gap.0": "mean time gap {} s",
    "closed_loop.gap_mae.0": "gap MAE {} m", "0.errors.gap_mae.0": "gap MAE {} m",
    "samples": "{} samples",
}  # fmt: skip
"""Values that differ, in words by their places."""
TITLES = {
    "fit": "Estimate", "disturbances": "Disturbances", "curves": "Network's curves",
    "qualities": "Data quality",
    "answer": "Answer", "gain_checks": "Measured gain",
    "uncertainty": "Intervals", "evaluation": "Errors", "holdout": "Hold-out",
    "adequacy": "Forms of the model", "judgements": "Models in windows left out",
    "info": "Window and names", "facts": "Facts of the recording", "data": "Data",
}  # fmt: skip
"""Parts of a result, in the order in which they are listed."""


@dataclass(frozen=True)
class Check:
    """One part of a snapshot, as stored and as found now."""

    part: str
    """A key of `TITLES`."""
    state: State
    ok: bool = True
    """Whether the numbers agree; True for a part that was not checked."""
    method: str = ""
    """Title of the compared method whose part it is; empty for the snapshot's own."""
    numbers: int = 0
    """Numbers compared."""
    differing: int = 0
    stored: str = ""
    """The first number or text that differs, in words; empty where all agree."""
    computed: str = ""
    reason: str = ""
    """Why it could not be checked or computed, as a clause."""
    cure: Cure = ""
    seconds: Seconds = 0.0
    """How long the cure is expected to take, in s; 0 where that is not known."""

    @property
    def title(self) -> str:
        """The name of the part."""
        return TITLES[self.part] + (f" ({self.method})" if self.method else "")

    @property
    def sentence(self) -> str:
        """The outcome of the check."""
        if self.state == "not checked":
            return f"Not checked, as {self.reason}."
        if self.reason:
            return self.reason
        if self.ok:
            counted = "1 number agrees" if self.numbers == 1 else f"All {self.numbers:,} agree"
            return f"{counted}, {self.state}."
        many = "One number differs" if self.differing == 1 else f"{self.differing:,} numbers differ"
        return f"{many}: stored {self.stored}, {self.state} {self.computed}."


MOST_NAMED = 2
"""Methods of a part that a sentence names; of more it tells the number."""


@dataclass(frozen=True)
class Verification:
    """All checks of a snapshot."""

    checks: tuple[Check, ...]

    @property
    def ok(self) -> bool:
        """Whether all that was checked agrees."""
        return all(check.ok for check in self.checks)

    @property
    def unchecked(self) -> tuple[Check, ...]:
        """The parts that were not checked."""
        return tuple(check for check in self.checks if check.state == "not checked")

    @property
    def sentence(self) -> str:
        """The first difference, or what agrees and what was not checked."""
        for check in self.checks:
            if not check.ok:
                return f"{check.title}: {check.sentence}"
        said = []
        for state in ("reproduced", "recomputed", "not checked"):
            titles = list[str]()
            for part in dict.fromkeys(check.part for check in self.checks):
                every = [check for check in self.checks if check.part == part]
                those = [check.title for check in every if check.state == state]
                many = [f"{TITLES[part]} ({len(those)} of {len(every)})"]
                titles += many if len(those) > MOST_NAMED else dict.fromkeys(those)
            if titles:
                said.append(f"{state.capitalize()}: {', '.join(titles)}.")
        return " ".join(said)

    @property
    def counted(self) -> str:
        """How many of the stored numbers agree: "412 of 412 numbers agree; 2 parts not checked"."""
        numbers, left = sum(check.numbers for check in self.checks), len(self.unchecked)
        agreeing = numbers - sum(check.differing for check in self.checks)
        open_parts = f"; {left} part{'s' * (left > 1)} not checked" if left else ""
        return f"{agreeing:,} of {numbers:,} numbers agree{open_parts}"


def verify(
    result: Result,
    recording: Recording | None = None,
    *,
    refit_within: Seconds = PATIENCE,
    on_refit: Callable[[str, Seconds], None] | None = None,
    parameters_only: bool = False,
) -> Verification:
    """Run the analysis of a snapshot again as far as that is possible, and compare.

    Args:
        result: as `load` reads it.
        recording: what it was learned from; needed where the data are not in the snapshot.
        refit_within: how many seconds running the methods again may be expected to take, the
            snapshot's own method first. See `PATIENCE`, `PROMPT`, `QUICK` and `HOWEVER_LONG`.
        on_refit: called with the title and the expected seconds of each method before it is run.
        parameters_only: whether what follows from the parameters is left out, and so are the
            methods compared; that takes no time but the method's own.
    """
    checks: list[Check] = []
    whole = result
    with np.errstate(all="ignore"):  # forged numbers overflow, and then differ
        if recording is not None:
            try:
                whole = result.with_data(recording)
                checks += _provenance(result, whole, recording)
            except AccpinnError as fault:
                checks.append(Check("data", "recomputed", False, reason=str(fault)))
        left = refit_within
        subjects = [(whole, "")] if parameters_only else _subjects(whole)
        for subject, name in subjects:
            seconds = refit_seconds(subject)
            may_refit = bool(subject.segments) and not _is_stopped(subject) and seconds <= left
            if may_refit:
                left -= seconds
                if on_refit:
                    on_refit(METHODS[subject.analysis.method].title, seconds)
            parts = () if parameters_only else PARTS
            checks += _of_subject(subject, name, parts, may_refit)
    if whole.parts.judgements and not parameters_only:
        checks.append(_judged(whole, left))
    if recording is None and not parameters_only and result.analysis.source.sha256:
        digest = result.analysis.source.sha256
        reason = f"that takes the recording {result.info.source} (SHA-256 {digest[:16]}…)"
        checks.append(Check("data", "not checked", reason=reason, cure="--recording"))
    return Verification(tuple(checks))


def _judged(whole: Result, left: Seconds) -> Check:
    """The models judged again in windows of the recording."""
    stored = whole.parts.judgements or ()
    seconds = seconds_of(sum(len(judged.windows) for judged in stored))
    unchecked = partial(Check, "judgements", "not checked")
    if whole.recording is None:
        return unchecked(reason="the recording is not at hand", cure="--recording")
    if seconds > left:
        reason = "judging models again takes time"
        return unchecked(reason=reason, cure="--refit", seconds=seconds)
    try:
        return _compare("judgements", stored, judged_again(stored, whole.recording))
    except FAULTS as fault:
        return Check("judgements", "recomputed", False, reason=str(fault))


def _subjects(whole: Result) -> list[tuple[Result, str]]:
    """The result and the methods compared, each with its own windows' data, with names."""
    given = {segment.info.digest: segment for segment in whole.segments}
    rows = [
        replace(row, segments=tuple(given[i.digest] for i in row.infos if i.digest in given))
        for row in whole.compared
    ]
    return [(whole, ""), *((row, METHODS[row.analysis.method].title) for row in rows)]


def refit_seconds(result: Result) -> Seconds:
    """How long running the method of a result again takes, hold-out included, in s."""
    try:
        method, config = METHODS[result.analysis.method], result.analysis.config
        once = sum(method.expected_seconds(segment, config) for segment in result.segments)
    except AccpinnError:
        return 0.0
    blocks = result.parts.evaluation.blocks if result.parts.evaluation else ()
    return once * (1 + len(blocks))


def _is_stopped(result: Result) -> bool:
    return result.fit.outcome is Outcome.STOPPED


def _provenance(result: Result, whole: Result, recording: Recording) -> list[Check]:
    """Names, findings and facts as the recording has them; its file may be called otherwise."""

    def comparable(info: SegmentInfo) -> SegmentInfo:
        of_cut = (WindowMoved, WindowShortened)
        findings = tuple(finding for finding in info.findings if not isinstance(finding, of_cut))
        return replace(info, source="", findings=findings)

    stored, anew = ([comparable(info) for info in part.infos] for part in (result, whole))
    checks = [_compare("info", stored, anew)]
    if result.facts:
        checks.append(_compare("facts", result.facts, facts_of(recording)))
    return checks


def _of_subject(subject: Result, name: str, parts: Sequence[str], may_refit: bool) -> list[Check]:
    """The checks of the snapshot's own result, or of a compared method's."""
    known = [part for part in parts if getattr(subject.parts, part) is not None]
    unchecked = partial(Check, state="not checked", method=name)
    computed: dict[str, Callable[[], list[Check]]] = {}
    checks: list[Check] = []
    if may_refit:
        computed["fit"] = partial(_refit, subject, name)
    elif not subject.segments:
        reason = "the data are not at hand"
        checks = [unchecked(part, reason=reason, cure="--recording") for part in ("fit", *known)]
    elif _is_stopped(subject):
        checks = [unchecked("fit", reason="its training was stopped by hand")]
    else:
        reason, seconds = "running the method again takes time", refit_seconds(subject)
        checks = [unchecked("fit", reason=reason, cure="--refit", seconds=seconds)]
    if not name:
        computed["curves"] = partial(_curves, subject)
    fresh = replace(subject, parts=Parts())
    for part in known if subject.segments else ():
        computed[part] = partial(_part, fresh, part, subject.parts, name)
    for part, check in computed.items():
        try:
            checks += check()
        except FAULTS as fault:  # what cannot be computed does not agree
            checks.append(Check(part, "recomputed", False, name, reason=str(fault)))
    return checks


def _refit(subject: Result, name: str) -> list[Check]:
    """Run the method again on the data, and without the blocks held out."""
    method = METHODS[subject.analysis.method]
    again = estimate(subject.analysis, subject.segments, subject.recording)
    new = again.as_row() if name == method.title else again
    before, after = (
        [replace(fit, findings=()) for fit in result.fits] for result in (subject, new)
    )
    checks = [_compare("fit", before, after, name, state="reproduced")]
    is_exact = checks[0].ok
    if not is_exact and method.tolerance > SOLVED:
        stored, anew = (
            [{field: getattr(fit, field) for field in EVERYWHERE} for fit in fits]
            for fits in (before, after)
        )
        then, now = (
            [{key: (fit.loss | fit.arrays).get(key) for key in LIKELY} for fit in fits]
            for fits in (before, after)
        )
        checks = [
            _compare("fit", stored, anew, name, state="reproduced", relative=method.tolerance),
            _compare("disturbances", then, now, name, state="reproduced"),
        ]
    evaluation = subject.parts.evaluation
    if evaluation and evaluation.blocks:
        blocks = again.with_holdout().evaluation.blocks
        checks.append(
            _compare("holdout", evaluation.blocks, blocks, name, state="reproduced",
                     relative=method.tolerance, numbers_only=not is_exact)
        )  # fmt: skip
    return checks


def _part(fresh: Result, part: str, parts: Parts, name: str) -> list[Check]:
    """A part computed anew from the stored fit and the data."""
    if part == "gain_checks":
        fresh = replace(fresh, parts=Parts(answer=parts.answer))
    stored, anew = getattr(parts, part), getattr(fresh, part)
    if part == "uncertainty" and agree(stored, anew):
        # On another processor draws differ, and the ends of intervals a little.
        drawn = from_draws(stored.centre, stored.draws, stored.level, anew.method)
        anew = with_estimates(drawn, fresh.segments[0], fresh.fit)
    if part == "answer":
        stored, anew = (side.without_draws() for side in (stored, anew))
    if part == "evaluation":
        unknown = ["blocks"]  # they follow from the method alone
        if fresh.fit.surrogate is None:
            unknown.append("surrogate")
        if fresh.recording is None or not fresh.facts:
            unknown += ["out_of_window", "out_of_window_seconds", "out_of_window_findings"]
        anew = replace(anew, holdout=of_blocks(stored.blocks))
        stored, anew = (replace(side, **dict.fromkeys(unknown)) for side in (stored, anew))
    return [_compare(part, stored, anew, name)]


def _curves(subject: Result) -> list[Check]:
    """Whether the stored curves are what the method's stored state gives."""
    fit, redraw = subject.fit, METHODS[subject.fit.method].redraw
    if redraw is None or fit.surrogate is None:
        return []
    curves = fit.surrogate
    rows = np.unique(np.linspace(0, len(curves.time) - 1, INSTANTS).round().astype(int))
    stored = Trajectories(curves.time[rows], curves.speeds[rows], curves.gaps[rows])
    anew = redraw(fit, stored.time, float(curves.time[-1]))
    return [_compare("curves", stored, anew)]


def _compare(
    part: str,
    stored: Any,
    anew: Any,
    name: str = "",
    *,
    state: State = "recomputed",
    relative: float | None = None,
    numbers_only: bool = False,
) -> Check:
    """Two objects of one kind, number by number and text by text."""
    usual, absolute = TOLERANCES.get(part, (RELATIVE, ABSOLUTE))
    relative = relative or usual
    old, new = (_leaves(value, numbers_only) for value in (stored, anew))
    places = sorted(old.keys() | new.keys())
    differing = [
        place for place in places if not _same(old.get(place), new.get(place), relative, absolute)
    ]
    words = ("", "")
    if differing:
        words = _shown(differing[0], old.get(differing[0]), new.get(differing[0]))
    return Check(
        part, state, not differing, name,
        numbers=sum(np.size(leaf) for leaf in old.values()),
        differing=len(differing),
        stored=words[0],
        computed=words[1],
    )  # fmt: skip


def _leaves(value: Any, numbers_only: bool) -> dict[str, Any]:
    """Numbers, answers, texts and large arrays by their places, but what varies from run to run."""
    tree, arrays = dump(value)
    leaves = {}
    for place, leaf in flatten(sanitise(tree)):
        names = set(place.split("."))
        if isinstance(leaf, str) and leaf in NOT_FINITE:
            leaf = float(leaf)
        leaf = arrays.get(leaf, leaf) if isinstance(leaf, str) else leaf
        is_text = isinstance(leaf, str) or "findings" in names
        if leaf is not None and not names & VARYING and not (is_text and numbers_only):
            leaves[place] = leaf
    return leaves


def _same(stored: Any, anew: Any, relative: float, absolute: float) -> bool:
    if stored is None or anew is None or isinstance(stored, str) or isinstance(anew, str):
        return isinstance(stored, str) and isinstance(anew, str) and stored == anew
    a, b = np.asarray(stored, float), np.asarray(anew, float)
    if a.shape != b.shape:
        return False
    with np.errstate(invalid="ignore", over="ignore"):
        near = np.abs(a - b) <= absolute + relative * np.minimum(np.abs(a), np.abs(b))
    return bool((near | (a == b) | (np.isnan(a) & np.isnan(b))).all())


def _shown(place: str, stored: Any, anew: Any) -> tuple[str, str]:
    """A leaf as stored and as found now, with the digits it takes to see a difference."""
    if np.ndim(stored) and np.shape(stored) == np.shape(anew):
        first = np.unravel_index(np.argmax(np.abs(stored - anew)), stored.shape)
        stored, anew = float(stored[first]), float(anew[first])
        place = ".".join([place, *map(str, first)])
    pairs = [tuple(map(_brief, (stored, anew)))]
    if isinstance(stored, float | int) and isinstance(anew, float | int):
        pairs = [(f"{stored:.{digits}g}", f"{anew:.{digits}g}") for digits in range(6, 18)]
    before, after = next((pair for pair in pairs if pair[0] != pair[1]), pairs[0])
    words = FEATURED.get(place, f"{place}: {{}}")
    return words.format(before), words.format(after)


def _brief(leaf: Any) -> str:
    text = "nothing" if leaf is None else str(np.shape(leaf) if np.ndim(leaf) else leaf)
    return text if len(text) <= 40 else f"{text[:39]}…"
