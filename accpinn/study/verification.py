"""Verification of a snapshot: its analysis is run again and compared number by number.

The analysis is run again on the snapshot's data, and estimate, posterior and held-out errors of
both are compared number by number; so are the methods compared with it, and with the recording the
data themselves. All else is derived from these whenever it is asked for. A part is then

    reproduced     it was computed again, and agrees or not
    not checked    that was not possible, or would have taken too long

On one machine a method gives the same to the last digit. Another processor rounds otherwise, and an
iterative training carries that on: there its numbers are compared with tolerances, and its history
is not compared. A whole file proves nothing, as anyone can write one with a digest that fits.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from math import inf
from typing import Any, Literal

import numpy as np

from accpinn import __version__
from accpinn.channels import PARAMETERS
from accpinn.errors import AccpinnError
from accpinn.inference.intervals import SLACK
from accpinn.methods import TaskContext
from accpinn.methods.estimate import Estimate, Outcome, Posterior
from accpinn.methods.findings import CacheProblem, Continued, MethodFinding
from accpinn.methods.joint_likelihood import UNKNOWNS
from accpinn.methods.registry import METHODS
from accpinn.recordings import Recording, facts_of
from accpinn.segment import SegmentInfo, WindowMoved, WindowShortened
from accpinn.segment.cut import MAX_FOLLOWERS
from accpinn.serial import NOT_FINITE, dump, flatten, sanitise
from accpinn.study.judge import judged_again, seconds_of
from accpinn.study.result import Result, now
from accpinn.study.run import estimate
from accpinn.units import FloatArray, Seconds, interval_ends

State = Literal["reproduced", "not checked"]
Cure = Literal["", "--recording", "--refit"]
"""Option of the command line that checks more; empty where none can."""

PATIENCE: Seconds = 60.0
"""Longest time that running the methods again may be expected to take by default."""
PROMPT: Seconds = 5.0
"""Longest time that running the methods again may take before a report is made."""
HOWEVER_LONG: Seconds = inf
EACH_PAIR: Seconds = 0.1
"""Time that a posterior takes for each follower in each window."""

RELATIVE, ABSOLUTE = 1e-9, 1e-11
"""Numbers closer than this are the same; other processors round differently."""
SOLVED = 1e-6
"""Relative tolerance of the numbers that a method finds."""
FAULTS = (AccpinnError, ValueError, ArithmeticError)
"""Exceptions of computing with numbers that no snapshot has."""
COUNTED = 0.05
"""Difference of what is counted of draws, and of probabilities, from one processor to another."""
VARYING = {"seconds", "cached"}
"""Fields that differ from run to run."""
EVERYWHERE = ("method", "spec", "case", "settings", "numbers", "speeds", "driven", "outcome",
              "active_bounds", "network_weights")  # fmt: skip
"""Fields that an iterative training gives alike on every processor."""
CURVES = 0.05
"""Difference of its curves from one processor to another, in m and m/s, and share of what is
determined less than the parameters: those of each window by itself, loss, disturbances."""
SMALL = 1e-3
"""Difference of its disturbances, in m/s²."""
FEATURED = {
    f"parameters.{k}.{column}": f"{quantity.symbol} {{}} {quantity.unit} of follower {k + 1}"
    for k in range(MAX_FOLLOWERS)
    for column, quantity in enumerate(PARAMETERS)
} | {"0.errors.gap_mae.0": "gap MAE {} m", "samples": "{} samples"}
"""Values that differ, in words by their places."""
TITLES = {
    "estimate": "Estimate", "posterior": "Intervals", "holdout": "Hold-out",
    "judgements": "Models in windows left out", "info": "Window and names",
    "facts": "Facts of the recording", "data": "Data",
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
    """Expected time of the cure, in s; 0 where that is not known."""

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
MARKS = {True: "✓", False: "✗", None: "–"}
"""Sign before a verification's sentence."""


@dataclass(frozen=True)
class Verification:
    """All checks of a snapshot."""

    checks: tuple[Check, ...]
    created: str = ""
    """When they were made: ISO 8601 in UTC."""
    accpinn: str = ""
    """The version of accpinn that made them."""

    @property
    def ok(self) -> bool | None:
        """True if everything was computed again and agrees; None if something was not.

        It is False as soon as anything that was checked differs. The data are what all is computed
        from: a snapshot carries them, and only the recording can be held against them, so that
        they are listed among `unchecked` without it but do not count here.
        """
        if not all(check.ok for check in self.checks):
            return False
        return None if any(check.part != "data" for check in self.unchecked) else True

    @property
    def unchecked(self) -> tuple[Check, ...]:
        """The parts that were not checked."""
        return tuple(check for check in self.checks if check.state == "not checked")

    @property
    def numbers(self) -> int:
        """Count of numbers that were computed again."""
        return sum(check.numbers for check in self.checks)

    @property
    def has_recording(self) -> bool:
        """Whether the data were compared with the recording."""
        return self._is_reproduced("data", "info")

    @property
    def sentence(self) -> str:
        """The outcome: what differs first, or how many numbers agree and what was not checked."""
        for check in self.checks:
            if not check.ok:
                return f"Verification failed. {check.title}: {check.sentence}"
        agree = f"{self.numbers:,} of {self.numbers:,} numbers computed again agree"
        if self.ok:
            return f"Verified: {agree}."
        if not self.numbers:
            why = self.unchecked[0].reason if self.unchecked else "nothing was asked for"
            return f"Not verified: nothing was computed again, as {why}."
        left = ", ".join(self._titles(check for check in self.unchecked if check.part != "data"))
        return f"Verified in part: {agree}; not checked: {left}."

    @property
    def brief(self) -> str:
        """The mark with its number, for a list."""
        differing = sum(check.differing for check in self.checks)
        words = {True: "verified", False: "differ", None: "in part"}[self.ok]
        counted = f"{differing if self.ok is False else self.numbers:,} {words}"
        return f"{MARKS[self.ok]} {'differs' if self.ok is False and not differing else counted}"

    @property
    def mark(self) -> str:
        """The sentence behind its mark."""
        return f"{MARKS[self.ok]} {self.sentence}"

    @property
    def how(self) -> str:
        """Extent, date and version of the verification in one line."""
        done = ["methods run again"] * self._is_reproduced("estimate")
        done += ["data compared with the recording"] * self.has_recording
        when = f"{self.created[:16].replace('T', ' ')} UTC" if self.created else ""
        version = f"accpinn {self.accpinn}" if self.accpinn else ""
        return ", ".join(filter(None, (when, version, " and ".join(done))))

    def _is_reproduced(self, *parts: str) -> bool:
        every = {check.part for check in self.checks if check.state == "reproduced"}
        return not every.isdisjoint(parts)

    def _titles(self, checks: Iterable[Check]) -> list[str]:
        """Names of parts, each once, and of many compared methods their number."""
        titles, those = list[str](), [*checks]
        for part in dict.fromkeys(check.part for check in those):
            named = [check.title for check in those if check.part == part]
            total = sum(check.part == part for check in self.checks)
            many = [f"{TITLES[part]} ({len(named)} of {total})"]
            titles += many if len(named) > MOST_NAMED else dict.fromkeys(named)
        return titles


def verify(
    result: Result,
    recording: Recording | None = None,
    *,
    refit_within: Seconds = PATIENCE,
    on_refit: Callable[[str, Seconds], None] | None = None,
    own_only: bool = False,
    context: TaskContext | None = None,
) -> Verification:
    """Run the analysis of a snapshot again, and compare.

    Args:
        result: as `load` reads it.
        recording: what it was learned from, with which the data themselves are compared.
        refit_within: how many seconds running the methods again may be expected to take, the
            snapshot's own method first. See `PATIENCE`, `PROMPT` and `HOWEVER_LONG`.
        on_refit: called with the title and the expected seconds of each method before it is run.
        own_only: whether all but the snapshot's own estimate is left out.
        context: progress and stop of the methods; what is stopped ends the verification early.
    """
    checks: list[Check] = []
    whole, left = result, refit_within
    with np.errstate(all="ignore"):  # forged numbers overflow, and then differ
        if recording is not None:
            try:
                whole = result.with_data(recording)
                checks += _provenance(result, whole, recording)
            except AccpinnError as fault:
                checks.append(Check("data", "reproduced", False, reason=str(fault)))
        rows = () if own_only else result.compared
        for subject, name in [(result, ""), *((r, METHODS[r.analysis.method].title) for r in rows)]:
            seconds = refit_seconds(subject)
            may_refit = subject.estimate.outcome is not Outcome.STOPPED and seconds <= left
            if may_refit:
                left -= seconds
                if on_refit:
                    on_refit(METHODS[subject.analysis.method].title, seconds)
            checks += _of_subject(subject, name, may_refit, context)
            if context and context.is_stopped:
                break
        if result.judgements and not own_only:
            checks.append(_judged(whole, left))
    if recording is None and not own_only and result.analysis.source.sha256:
        digest = result.analysis.source.sha256
        reason = f"that takes the recording {result.info.source} (SHA-256 {digest[:16]}…)"
        checks.append(Check("data", "not checked", reason=reason, cure="--recording"))
    return Verification(tuple(checks), now(), __version__)


def _judged(whole: Result, left: Seconds) -> Check:
    """The models judged again in windows of the recording."""
    stored = whole.judgements
    seconds = seconds_of(sum(len(judged.windows) for judged in stored))
    unchecked = partial(Check, "judgements", "not checked")
    if whole.recording is None:
        return unchecked(reason="the recording is not at hand", cure="--recording")
    if seconds > left:
        reason = "judging models again takes time"
        return unchecked(reason=reason, cure="--refit", seconds=seconds)
    try:
        return _compare("judgements", stored, judged_again(stored, whole.recording), relative=SLACK)
    except FAULTS as fault:
        return Check("judgements", "reproduced", False, reason=str(fault))


def refit_seconds(result: Result) -> Seconds:
    """Expected time of running the method of a result again, hold-out included, in s."""
    try:
        method, config = METHODS[result.analysis.method], result.analysis.config
        once = method.expected_seconds(result.segments, config)
    except AccpinnError:
        return 0.0
    pairs = len(result.segments) * result.info.followers if result.estimate.posterior else 0
    return once * (1 + len(result.blocks)) + EACH_PAIR * pairs


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


def _of_subject(
    subject: Result, name: str, may_refit: bool, context: TaskContext | None
) -> list[Check]:
    """The checks of the snapshot's own result, or of a compared method's."""
    if subject.estimate.outcome is Outcome.STOPPED:
        reason = "its training was stopped by hand"
        return [Check("estimate", "not checked", method=name, reason=reason)]
    if not may_refit:
        reason, seconds = "running the method again takes time", refit_seconds(subject)
        return [Check("estimate", "not checked", True, name, reason=reason, cure="--refit",
                      seconds=seconds)]  # fmt: skip
    try:
        return _refit(subject, name, context)
    except FAULTS as fault:  # what cannot be computed does not agree
        return [Check("estimate", "reproduced", False, name, reason=str(fault))]


def _refit(subject: Result, name: str, context: TaskContext | None) -> list[Check]:
    """Run the method again on the data, and without the parts held out."""
    method = METHODS[subject.analysis.method]
    again = estimate(subject.analysis, subject.segments, context=context)
    if context and context.is_stopped:
        return [Check("estimate", "not checked", method=name, reason="it was stopped")]
    before, after = (
        replace(point, findings=_lasting(point), posterior=None)
        for point in (subject.estimate, again)
    )
    first = _compare("estimate", before, after, name, relative=SOLVED)
    if not first.ok and method.tolerance > SOLVED:
        first = _iterated(subject, again, name)
    checks = [first]
    if subject.estimate.posterior:
        checks.append(_posteriors(subject.estimate, again, name))
    if subject.blocks:
        blocks = replace(subject, estimate=again).with_holdout().blocks
        checks.append(_compare("holdout", subject.blocks, blocks, name, relative=method.tolerance))
    return checks


def _lasting(estimate: Estimate) -> tuple[MethodFinding, ...]:
    """The findings that do not depend on how often it was run."""
    return tuple(f for f in estimate.findings if not isinstance(f, Continued | CacheProblem))


def _iterated(subject: Result, again: Estimate, name: str) -> Check:
    """Whether an iterative training gave the same on another processor, up to tolerances.

    The stored curves are also held against those of the stored weights.
    """
    stored, tolerance = subject.estimate, METHODS[subject.analysis.method].tolerance

    def part(fields: Sequence[str], relative: float, absolute: float = ABSOLUTE) -> Check:
        old, new = ({field: getattr(e, field) for field in fields} for e in (stored, again))
        return _compare("estimate", old, new, name, relative=relative, absolute=absolute)

    kinds, anew = ([type(f).__name__ for f in _lasting(e)] for e in (stored, again))
    redraw = METHODS[subject.analysis.method].redraw
    redrawn = tuple(
        redraw(stored, k, segment.time, float(segment.time[-1]))
        if redraw and not segment.blocks_missing
        else curves
        for k, (segment, curves) in enumerate(zip(subject.segments, stored.curves, strict=True))
    )
    checks = [
        part(EVERYWHERE, SOLVED),
        _compare("estimate", kinds, anew, name),
        part(("parameters",), tolerance),
        part(("windows", "unconstrained", "loss"), CURVES),
        part(("curves",), tolerance, CURVES),
        _compare("estimate", redrawn, stored.curves, name, absolute=CURVES),
        _compare(
            "estimate",
            _disturbances(stored),
            _disturbances(again),
            name,
            relative=CURVES,
            absolute=SMALL,
        ),
    ]
    total = sum(check.numbers for check in checks)
    return replace(next((c for c in checks if not c.ok), checks[0]), numbers=total)


def _disturbances(estimate: Estimate) -> dict[str, FloatArray]:
    """Disturbances and noise by the likelihood; empty for a method without one."""
    names = (UNKNOWNS, "disturbance")
    return {n: array for n, array in estimate.arrays.items() if n.rpartition(".")[2] in names}


def _posteriors(stored: Estimate, again: Estimate, name: str) -> Check:
    """Whether two posteriors are the same, draw by draw, or else their ends up to `SLACK`.

    Processors round differently, and one draw more or less beyond an end moves it.
    """
    old, new = stored.posterior, again.posterior
    exact = _compare("posterior", old, new, name, relative=SOLVED)
    if exact.ok or old is None or new is None:
        return exact
    before, after = _ends(old), _ends(new)
    if (old.method, old.level, before.shape) != (new.method, new.level, after.shape):
        return exact
    near = np.abs(before - after) <= SLACK * (after[1] - after[0])
    is_near = bool((near | ~np.isfinite(before - after)).all())
    if not is_near or not _same(_counts(old), _counts(new), COUNTED, COUNTED):
        return exact
    return Check("posterior", "reproduced", True, name, numbers=exact.numbers)


def _ends(posterior: Posterior) -> FloatArray:
    """(2, ..) ends of all intervals that a posterior gives."""
    draws = posterior.typical, posterior.further
    intervals: list[tuple[FloatArray, FloatArray]] = [
        *(interval_ends(sets.everything, posterior.level) for sets in draws),
        (posterior.windows_lower.everything, posterior.windows_upper.everything),
        (posterior.windows_gap[0], posterior.windows_gap[1]),
    ]
    return np.array([np.concatenate([np.ravel(pair[end]) for pair in intervals]) for end in (0, 1)])


def _counts(posterior: Posterior) -> FloatArray:
    """Effective draws, and the probabilities that windows and followers differ."""
    return np.array([*posterior.differ, *posterior.draws, posterior.followers_differ])


def _compare(
    part: str,
    stored: Any,
    anew: Any,
    name: str = "",
    *,
    relative: float = RELATIVE,
    absolute: float = ABSOLUTE,
) -> Check:
    """Two objects of one kind, number by number and text by text."""
    old, new = _leaves(stored), _leaves(anew)
    places = sorted(old.keys() | new.keys())
    differing = [
        place for place in places if not _same(old.get(place), new.get(place), relative, absolute)
    ]
    words = ("", "")
    if differing:
        words = _shown(differing[0], old.get(differing[0]), new.get(differing[0]))
    return Check(
        part, "reproduced", not differing, name,
        numbers=sum(np.size(leaf) for leaf in old.values()),
        differing=len(differing),
        stored=words[0],
        computed=words[1],
    )  # fmt: skip


def _leaves(value: Any) -> dict[str, Any]:
    """Numbers, answers, texts and large arrays by their places, but what varies from run to run."""
    tree, arrays = dump(value)
    leaves = {}
    for place, leaf in flatten(sanitise(tree)):
        names = set(place.split("."))
        if isinstance(leaf, str) and leaf in NOT_FINITE:
            leaf = float(leaf)
        leaf = arrays.get(leaf, leaf) if isinstance(leaf, str) else leaf
        if leaf is not None and not names & VARYING:
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
