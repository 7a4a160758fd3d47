"""What a snapshot says, held against what its own contents give when they are computed anew.

Each part is computed from the parameters, and where the window's data are at hand from these; both
objects become trees (see `accpinn.serial`), which are compared place by place. On one machine a
method gives the same to the last digit. Another processor rounds otherwise, and an iterative
training carries that on, so there its parameters count and no more (`Method.tolerance`).
"""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, fields, replace
from functools import partial
from typing import Any

import numpy as np

from accpinn import __version__
from accpinn.errors import AccpinnError, Finding
from accpinn.evaluation.evaluation import (
    Block,
    Evaluation,
    cross_validate,
    evaluate,
    pooled_holdout_errors,
)
from accpinn.inference.intervals import (
    SLACK,
    Uncertainty,
    agree,
    from_draws,
    intervals,
    judged,
)
from accpinn.inference.model_adequacy import model_forms
from accpinn.methods.fit import Fit, Outcome
from accpinn.methods.registry import METHODS
from accpinn.model.cthp import Trajectories
from accpinn.recordings.facts import facts_of
from accpinn.recordings.recording import Recording
from accpinn.results.snapshot import ATTRIBUTION_TEXT, Snapshot, light, stability
from accpinn.results.snapshot.validate import sanitise
from accpinn.results.tables.estimates import name_of
from accpinn.segment.cut import cut
from accpinn.segment.quality import assess_quality, exclude_regimes, label_regimes
from accpinn.segment.segment import BlocksMissing, Segment, WindowMoved, WindowShortened
from accpinn.serial import NOT_FINITE, dump, flatten

RECORDING, REFIT = "--recording", "--refit"
"""What checks more, as the command line has it."""

RELATIVE, ABSOLUTE = 1e-9, 1e-11
"""Figures closer than this are the same; other processors round differently."""
INTERVALS = 1e-6
"""The same for what follows from a posterior's draws."""
SOLVED = 1e-6
"""The same for what a method finds; a larger `Method.tolerance` is for its parameters alone."""
CURVES = 1e-4
"""m and m/s by which curves may differ from those that the weights give."""
INSTANTS = 300
"""At which these are computed."""
VARYING = {"seconds", "cached"}
"""Fields that differ from run to run."""
FEATURED = (
    "0.samples", "vehicles.0.linf_exact.value", "mean_time_gap.0", "parameters.0.2", "centre.0.2",
    "gap_mae.0", "0.errors.gap_mae.0", "deviation.0",
)  # fmt: skip
"""Places of values that stand for their part where all of it agrees."""


class Check(Finding, frozen=True):
    """One part of a snapshot, as stored and as recomputed."""

    part: str
    """As "evaluation.closed_loop"."""
    ok: bool
    method: str = ""
    """Name of the method compared whose part it is; empty for the snapshot's own."""
    count: int = 0
    """Values compared."""
    place: str = ""
    """Within the part: of the first value that differs, else one of `FEATURED`, else the first."""
    stored: float | str | None = None
    """The value there; None where there is none."""
    recomputed: float | str | None = None
    differing: int = 0
    reason: str = ""
    """Why nothing could be computed, as the error says."""


class Unchecked(Finding, frozen=True):
    """Something a snapshot says that was believed."""

    kind: str
    """"errors", "estimate", "stopped", "unknown start", "data", "version", "intervals", "blocks" or
    "remarks"."""
    cure: str = ""
    """`RECORDING` or `REFIT`; empty where nothing can check it."""
    detail: str = ""
    """The method, the recording's SHA-256 or the version that it is about."""


@dataclass(frozen=True)
class Verification:
    """All that was checked, and what was not."""

    checks: tuple[Check, ...]
    unchecked: tuple[Unchecked, ...] = ()

    @property
    def ok(self) -> bool:
        """Whether all of it agrees."""
        return all(check.ok for check in self.checks)


def verify(
    snapshot: Snapshot, recording: Recording | None = None, *, refit: bool = False
) -> Verification:
    """Compute the figures of a snapshot anew, and compare.

    Args:
        snapshot: as `load` reads it.
        recording: what it was learned from; with it errors and intervals are checked too where the
            snapshot has no data, and so are errors on the rest of the recording.
        refit: whether every method is run again where the data are at hand.
    """
    work = _Work(snapshot)
    work.compare("attribution", snapshot.attribution, ATTRIBUTION_TEXT)
    segment, source = snapshot.segment, None
    if recording is not None:
        found = recover(snapshot, recording)
        work.checks.append(found.check)
        segment = segment or found.segment
        if found.segment is not None:
            source = recording
            work.provenance(found.segment, recording)
    work.compare("stability", snapshot.stability, stability(snapshot.fit))
    work.curves()
    if segment is None:
        work.unchecked.append(Unchecked("errors", RECORDING))
    else:
        work.compare("quality", snapshot.quality, assess_quality(segment))
        if snapshot.adequacy:
            found_forms = model_forms(segment, snapshot.fit.case)
            work.compare("adequacy", snapshot.adequacy, found_forms, relative=SLACK, absolute=SLACK)
    own = ("", snapshot.fit, snapshot.uncertainty, snapshot.evaluation)
    compared = [
        (name_of(result.fit), result.fit, result.uncertainty, result.evaluation)
        for result in snapshot.methods
    ]
    for method, fit, uncertainty, evaluation in (own, *compared):
        if segment is not None:
            work.intervals(method, uncertainty, segment, fit)
            work.evaluation(method, evaluation, segment, fit, source)
        kind = obstacle(fit)
        if kind:
            work.unchecked.append(Unchecked(kind, detail=name_of(fit)))
        elif segment is None or not refit:
            work.unchecked.append(Unchecked("estimate", REFIT, name_of(fit)))
        else:
            work.refit(method, fit, evaluation, segment)
    if source is None and snapshot.info.sha256:
        work.unchecked.append(Unchecked("data", RECORDING, snapshot.info.sha256))
    if not work.same_version:
        work.unchecked.append(Unchecked("version", detail=snapshot.origin.accpinn))
    work.unchecked.append(Unchecked("remarks"))
    return Verification(tuple(work.checks), tuple(work.unchecked))


def obstacle(fit: Fit) -> str:
    """Why a method cannot be run again, as the kind of an `Unchecked`; empty where it can."""
    if fit.outcome is Outcome.STOPPED:
        return "stopped"
    return "unknown start" if "started_from" in fit.config else ""


@dataclass(frozen=True, eq=False)
class Recovered:
    """The window of a snapshot, cut anew from a recording."""

    check: Check
    segment: Segment | None = None
    """None where the recording or the window is another one."""


def recover(snapshot: Snapshot, recording: Recording) -> Recovered:
    """Cut the window of a snapshot anew, if the recording is the one it was learned from."""
    info = snapshot.info
    if info.sha256 != recording.sha256:
        return Recovered(compare("recording", info.sha256, recording.sha256))
    try:
        window, missing = info.window, any(isinstance(f, BlocksMissing) for f in info.findings)
        segment = cut(
            recording, window.start, window.duration, info.vehicles, allow_missing=missing
        )
        if info.excluded_regimes:
            labelled = label_regimes(segment, recording)
            segment = exclude_regimes(segment, labelled, info.excluded_regimes)
    except AccpinnError as fault:
        return Recovered(Check("window", False, reason=str(fault)))
    found = compare("window", info.digest, segment.info.digest)
    return Recovered(found, segment if found.ok else None)


class _Work:
    """One verification while it runs."""

    def __init__(self, snapshot: Snapshot) -> None:
        self.snapshot = snapshot
        self.same_version = snapshot.origin.accpinn == __version__
        self.checks: list[Check] = []
        self.unchecked: list[Unchecked] = []

    def compare(self, part: str, stored: Any, found: Any, method: str = "", **more: Any) -> None:
        """Enter a check of one part; where both have nothing there is none."""
        more = {"numbers_only": not self.same_version} | more
        done = compare(part, stored, found, method, **more)
        if done.count:
            self.checks.append(done)

    @contextmanager
    def attempt(self, part: str, method: str = "") -> Iterator[None]:
        """What cannot be computed is a part that does not hold."""
        try:
            yield
        except (AccpinnError, ValueError) as fault:
            self.checks.append(Check(part, False, method, reason=str(fault)))

    def provenance(self, segment: Segment, recording: Recording) -> None:
        """Names, findings and facts as the recording has them; its file may be called otherwise.

        How a window was moved or shortened cannot be seen again: it is cut as it then was.
        """
        info = self.snapshot.info
        moved = WindowMoved | WindowShortened
        kept = tuple(finding for finding in info.findings if not isinstance(finding, moved))
        stored = [replace(info, findings=kept), self.snapshot.facts]
        found = [replace(segment.info, source=info.source), facts_of(recording)]
        some = slice(None if self.snapshot.facts else 1)  # else it was taken without its recording
        self.compare("info", stored[some], found[some])

    def curves(self) -> None:
        """Whether the stored curves are what the method's stored state gives."""
        fit, redraw = self.snapshot.fit, METHODS[self.snapshot.fit.method].redraw
        if redraw is None:
            return
        stored = fit.surrogate
        time = (
            np.array([0.0, self.snapshot.info.window.duration]) if stored is None else stored.time
        )
        some = np.unique(np.linspace(0, len(time) - 1, INSTANTS).round().astype(int))
        if stored:
            stored = Trajectories(time[some], stored.speeds[some], stored.gaps[some])
        with self.attempt("fit.surrogate"):
            found = redraw(fit, time[some], float(time[-1]))
            self.compare("fit.surrogate", stored, found, absolute=CURVES)

    def intervals(
        self, method: str, stored: Uncertainty | None, segment: Segment, fit: Fit
    ) -> None:
        """Whether the intervals follow from the data; those of another version's method may not."""
        with self.attempt("uncertainty", method):
            asked = (stored.level, len(stored.draws)) if stored else ()
            found = intervals(segment, fit, *asked)
            if stored and stored.method != found.method and not self.same_version:
                self.unchecked.append(Unchecked("intervals", detail=stored.method))
            else:
                if stored and agree(stored, found):  # draws of another processor, perhaps
                    own = from_draws(stored.centre, stored.draws, stored.level)
                    found = judged(own, segment, fit)
                self.compare("uncertainty", stored, found, method, relative=INTERVALS)

    def evaluation(
        self, method: str, stored: Evaluation | None, segment: Segment, fit: Fit,
        recording: Recording | None,
    ) -> None:  # fmt: skip
        """Whether errors and collisions follow from the data, and pooled errors from the blocks."""
        found = evaluate(segment, fit, recording=recording)
        unknown = {"blocks"}  # they follow from the method alone; see `refit`
        if fit.surrogate is None:
            unknown.add("surrogate")
        if recording is None or not self.snapshot.facts:  # else nothing beyond the window was known
            unknown |= {"out_of_window", "out_of_window_seconds", "out_of_window_findings"}
        if stored and stored.blocks:
            found = replace(found, holdout=pooled_holdout_errors(stored.blocks))
        for field in fields(Evaluation):
            if field.name not in unknown:
                old, new = (getattr(one, field.name, None) for one in (stored, found))
                self.compare(f"evaluation.{field.name}", old, new, method)

    def refit(self, method: str, fit: Fit, evaluation: Evaluation | None, segment: Segment) -> None:
        """Run a method again on the data, and without the blocks held out."""
        of = METHODS[fit.method]
        settings = of.settings.from_json(fit.config) if of.settings else None
        estimate = partial(of.fit, case=fit.case, settings=settings)
        with self.attempt("refit", method):
            again = estimate(segment)
            pair = (fit, light(again) if method else again)
            old, new = (replace(one, config={}) for one in pair)
            found = compare("refit", old, new, method, relative=SOLVED, numbers_only=True)
            if not found.ok and of.tolerance > SOLVED:
                found = compare("refit", fit.parameters, again.parameters, method,
                                relative=of.tolerance)  # fmt: skip
            self.checks.append(found)
            if evaluation and evaluation.blocks:
                blocks = cross_validate(segment, estimate)
                if _times(blocks) != _times(evaluation.blocks):
                    self.unchecked.append(Unchecked("blocks", detail=name_of(fit)))
                else:
                    self.compare("evaluation.blocks", evaluation.blocks, blocks, method,
                                 relative=of.tolerance, numbers_only=True)  # fmt: skip


def _times(blocks: tuple[Block, ...]) -> list[tuple[float, float]]:
    return [(round(block.window.start, 3), round(block.window.duration, 3)) for block in blocks]


def compare(
    part: str,
    stored: Any,
    found: Any,
    method: str = "",
    *,
    relative: float = RELATIVE,
    absolute: float = ABSOLUTE,
    numbers_only: bool = False,
) -> Check:
    """Compare two objects of one kind, place by place.

    Args:
        part: of the snapshot.
        stored: as the snapshot has it.
        found: as recomputed.
        method: name of the method compared whose part it is.
        relative: differences up to this share of a number are none.
        absolute: nor are those up to this much.
        numbers_only: whether texts and findings may differ, as between versions.
    """
    old, new = _leaves(stored, numbers_only), _leaves(found, numbers_only)
    places = sorted(old.keys() | new.keys())
    differing = {
        place: at
        for place in places
        if (at := _differing(old.get(place), new.get(place), relative, absolute)) is not None
    }
    featured = [place for place in FEATURED if place in old]
    place = next(iter([*differing, *featured, *places]), "")
    index = differing.get(place, (0,) * np.ndim(old.get(place, 0.0)))
    return Check(
        part,
        not differing,
        method,
        sum(np.size(leaf) for leaf in old.values()) or len(places),
        ".".join([place, *map(str, index)] if place else map(str, index)),
        _value(old.get(place), index),
        _value(new.get(place), index),
        len(differing),
    )


def _leaves(value: Any, numbers_only: bool) -> dict[str, Any]:
    """Numbers, answers, texts and large arrays of a value by their places."""
    tree, arrays = dump(value, share=False)
    found: dict[str, Any] = {}
    for place, leaf in flatten(sanitise(tree)):
        names = set(place.split("."))
        if place in arrays:
            leaf = arrays[place]
        elif isinstance(leaf, str) and leaf in NOT_FINITE:
            leaf = float(leaf)
        text = isinstance(leaf, str) or "findings" in names
        if leaf is not None and not names & VARYING and not (text and numbers_only):
            found[place] = leaf
    return found


def _differing(one: Any, other: Any, relative: float, absolute: float) -> tuple[int, ...] | None:
    """Where two leaves first differ: an index, empty for a leaf as a whole; None where nowhere."""
    if one is None or other is None or isinstance(one, str) or isinstance(other, str):
        return None if isinstance(one, str) and one == other else ()
    a, b = np.asarray(one, float), np.asarray(other, float)
    if a.shape != b.shape:
        return ()
    with np.errstate(invalid="ignore", over="ignore"):
        near = np.abs(a - b) <= absolute + relative * np.minimum(np.abs(a), np.abs(b))
    same = near | (a == b) | (np.isnan(a) & np.isnan(b))
    return None if same.all() else tuple(map(int, np.argwhere(~same)[0]))


def _value(leaf: Any, index: tuple[int, ...]) -> float | str | None:
    if leaf is None or isinstance(leaf, str):
        return leaf
    if np.ndim(leaf) != len(index):
        return f"{np.shape(leaf)}"
    return float(leaf[index] if index else leaf)
