"""What a snapshot says, held against what its own contents give when they are computed anew.

Each part is computed from the parameters, and where the window's data are at hand the methods are
run again on these; both objects become trees (see `accpinn.serial`), which are compared place by
place. On one machine a method gives the same to the last digit. Another processor rounds
otherwise, and an iterative training carries that on, so there its parameters count and no more
(`Method.tolerance`). What was compared with nothing is only told: it rests on whoever wrote the
file. A whole file proves nothing else, as anyone can seal a forged one.
"""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, fields, replace
from functools import partial
from math import inf
from typing import Any

import numpy as np

from accpinn import __version__
from accpinn.errors import AccpinnError
from accpinn.evaluation.evaluation import (
    Block,
    Evaluation,
    cross_validate,
    evaluate,
    pooled_holdout_errors,
)
from accpinn.findings import Finding
from accpinn.inference.intervals import SLACK, Uncertainty, agree, from_draws, intervals, judged
from accpinn.inference.model_adequacy import model_forms
from accpinn.methods.fit import Fit, Outcome
from accpinn.methods.registry import METHODS
from accpinn.model.cthp import Trajectories
from accpinn.recordings.recording import Recording, facts_of
from accpinn.results.snapshot import ATTRIBUTION_TEXT, Snapshot, light, stability
from accpinn.results.snapshot.places import PartCheck, compare_parts, leaves
from accpinn.results.snapshot.standing import Standing, Way, standings
from accpinn.results.tables.estimates import name_of
from accpinn.segment.cut import cut
from accpinn.segment.quality import assess_quality, exclude_regimes, label_regimes
from accpinn.segment.segment import BlocksMissing, Segment, WindowMoved, WindowShortened
from accpinn.units import Seconds

RECORDING, REFIT = "--recording", "--refit"
"""What checks more, as the command line has it."""
PATIENCE: Seconds = 60.0
"""Methods are run again by default as long as that is expected to take no longer in all."""
PROMPT: Seconds = 5.0
"""The same where the verification only comes before something else."""
QUICK: Seconds = 0.0
"""No method is run again."""
HOWEVER_LONG: Seconds = inf
"""All are."""

INTERVALS = 1e-6
"""As `places.RELATIVE`, for what follows from a posterior's draws."""
SOLVED = 1e-6
"""The same for what a method finds; a larger `Method.tolerance` is for its parameters alone."""
CURVES = 1e-4
"""m and m/s by which curves may differ from those that the weights give."""
INSTANTS = 300
"""At which these are computed."""
FAULTS = (AccpinnError, ValueError, ArithmeticError)
"""What computing with numbers that no snapshot has can raise."""


class Unchecked(Finding, frozen=True):
    """Something a snapshot says that was believed."""

    kind: str
    """"errors", "estimate", "stopped", "unknown start", "data", "version", "intervals", "draws",
    "blocks" or "remarks"."""
    cure: str = ""
    """`RECORDING` or `REFIT`; empty where nothing can check it."""
    detail: str = ""
    """The method, the recording's SHA-256 or the version that it is about."""
    seconds: Seconds = 0.0
    """How long the cure is expected to take; 0 where that is not known."""


@dataclass(frozen=True)
class Verification:
    """All that was checked, and what was not."""

    checks: tuple[PartCheck, ...]
    unchecked: tuple[Unchecked, ...] = ()
    standings: tuple[Standing, ...] = ()
    """What was refitted, recomputed or only told, in groups of figures."""
    ways: tuple[tuple[str, Way], ...] = ()
    """The same by the place of each figure, as "fit.parameters.0.2"."""

    @property
    def ok(self) -> bool:
        """Whether all of it agrees."""
        return all(check.ok for check in self.checks)

    @property
    def refitted(self) -> bool:
        """Whether the snapshot's own method was run again."""
        return any(
            (one.group, one.way, one.compared) == ("parameters", "refitted", False)
            for one in self.standings
        )


OnRefit = Callable[[str, Seconds], None]


def verify(
    snapshot: Snapshot,
    recording: Recording | None = None,
    *,
    refit_within: Seconds = PATIENCE,
    on_refit: OnRefit | None = None,
) -> Verification:
    """Compute the figures of a snapshot anew, run its methods again, and compare.

    Args:
        snapshot: as `load` reads it.
        recording: what it was learned from; with it errors and intervals are checked too where the
            snapshot has no data, and so are errors on the rest of the recording.
        refit_within: how many seconds running the methods again may take as far as is known
            beforehand, its own method first; the others are only told. See `PATIENCE`, `PROMPT`,
            `QUICK` and `HOWEVER_LONG`.
        on_refit: called with the name and the expected seconds of each method before it is run.
    """
    with np.errstate(all="ignore"):  # forged numbers overflow, and then differ
        return _Work(snapshot, refit_within, on_refit).all(recording)


def verify_parameters(snapshot: Snapshot, *, refit_within: Seconds = PROMPT) -> Verification:
    """The same for the parameters and what follows from them alone, which takes no time.

    Args:
        snapshot: as `load` reads it.
        refit_within: as `verify` has it.
    """
    with np.errstate(all="ignore"):
        return _Work(snapshot, refit_within).parameters()


def refit_seconds(snapshot: Snapshot, segment: Segment) -> Seconds:
    """How long running all methods of a snapshot again takes that can be; 0 where none can."""
    return sum(of.expected_seconds(segment) for of in _subjects(snapshot) if not obstacle(of.fit))


def obstacle(fit: Fit) -> str:
    """Why a method cannot be run again, as the kind of an `Unchecked`; empty where it can."""
    if fit.outcome is Outcome.STOPPED:
        return "stopped"
    return "unknown start" if "started_from" in fit.config else ""


@dataclass(frozen=True, eq=False)
class Recovered:
    """The window of a snapshot, cut anew from a recording."""

    check: PartCheck
    segment: Segment | None = None
    """None where the recording or the window is another one."""


def recover(snapshot: Snapshot, recording: Recording) -> Recovered:
    """Cut the window of a snapshot anew, if the recording is the one it was learned from."""
    info = snapshot.info
    if info.sha256 != recording.sha256:
        return Recovered(compare_parts("recording", info.sha256, recording.sha256))
    try:
        window, missing = info.window, any(isinstance(f, BlocksMissing) for f in info.findings)
        segment = cut(
            recording, window.start, window.duration, info.vehicles, allow_missing=missing
        )
        if info.excluded_regimes:
            labelled = label_regimes(segment, recording)
            segment = exclude_regimes(segment, labelled, info.excluded_regimes)
    except AccpinnError as fault:
        return Recovered(PartCheck("window", False, reason=str(fault)))
    found = compare_parts("window", info.digest, segment.info.digest)
    return Recovered(found, segment if found.ok else None)


@dataclass(frozen=True, eq=False)
class _Subject:
    """A fit with what was computed from it: the snapshot's own, or that of a method compared."""

    name: str
    """Of a method compared; empty for the snapshot's own."""
    place: str
    """Where it stands: "" or "methods.0."."""
    fit: Fit
    uncertainty: Uncertainty | None
    evaluation: Evaluation | None

    @property
    def settings(self) -> Any:
        """With which the method is run again.

        Raises:
            ConfigError: for settings that the method cannot have.
        """
        of = METHODS[self.fit.method]
        return of.settings.from_json(self.fit.config) if of.settings else None

    def expected_seconds(self, segment: Segment) -> Seconds:
        """How long running it again takes, without the blocks held out too.

        Raises:
            ConfigError: for settings that the method cannot have.
        """
        once = METHODS[self.fit.method].expected_seconds(segment, self.settings)
        return once * (1 + len(self.evaluation.blocks) if self.evaluation else 1)


def _subjects(snapshot: Snapshot) -> tuple[_Subject, ...]:
    """The snapshot's own result, then the methods compared."""
    return (
        _Subject("", "", snapshot.fit, snapshot.uncertainty, snapshot.evaluation),
        *(
            _Subject(name_of(one.fit), f"methods.{k}.", one.fit, one.uncertainty, one.evaluation)
            for k, one in enumerate(snapshot.methods)
        ),
    )


class _Work:
    """One verification while it runs."""

    def __init__(
        self, snapshot: Snapshot, refit_within: Seconds, on_refit: OnRefit | None = None
    ) -> None:
        self.snapshot = snapshot
        self.same_version = snapshot.origin.accpinn == __version__
        self.seconds_left, self.on_refit = refit_within, on_refit
        self.checks: list[PartCheck] = []
        self.unchecked: list[Unchecked] = []
        self.ways: dict[str, Way] = {}
        self.own = _subjects(snapshot)[0]

    def all(self, recording: Recording | None) -> Verification:
        """Check everything."""
        snapshot = self.snapshot
        self.compare("attribution", snapshot.attribution, ATTRIBUTION_TEXT)
        segment, source = snapshot.segment, None
        if recording is not None:
            found = recover(snapshot, recording)
            self.checks.append(found.check)
            segment = segment or found.segment
            if found.segment is not None:
                source = recording
                self.provenance(found.segment, recording)
        self.follows()
        subjects = _subjects(snapshot)
        if segment is None:
            self.unchecked.append(Unchecked("errors", RECORDING))
        else:
            with self.attempt("quality"):
                self.compare("quality", snapshot.quality, assess_quality(segment))
            self.forms(segment)
            for subject in subjects:
                self.intervals(subject, segment)
                self.evaluation(subject, segment, source)
        self.estimates(subjects, segment)
        if source is None and snapshot.info.sha256:
            self.unchecked.append(Unchecked("data", RECORDING, snapshot.info.sha256))
        if not self.same_version:
            self.unchecked.append(Unchecked("version", detail=snapshot.origin.accpinn))
        self.unchecked.append(Unchecked("remarks"))
        return self.verification()

    def parameters(self) -> Verification:
        """Check the snapshot's own parameters, and what follows from them without the data."""
        self.follows()
        self.estimates((self.own,), self.snapshot.segment)
        return self.verification()

    def verification(self) -> Verification:
        """What was found so far."""
        stored = leaves(self.snapshot)
        del stored["digest"]  # it follows from the file
        ways: dict[str, Way] = {
            place: self.ways.get(place, "told")
            for place, leaf in stored.items()
            if leaf is not None
        }
        failed = [place for check in self.checks for place in check.wrong]
        return Verification(
            tuple(self.checks), tuple(self.unchecked), standings(ways, failed), tuple(ways.items())
        )

    def follows(self) -> None:
        """Check what follows from the fit itself."""
        with self.attempt("stability"):
            self.compare("stability", self.snapshot.stability, stability(self.snapshot.fit))
        self.curves()

    def compare(
        self,
        part: str,
        stored: Any,
        found: Any,
        subject: _Subject | None = None,
        *,
        at: str = "",
        way: Way = "recomputed",
        **more: Any,
    ) -> PartCheck:
        """Enter a check of one part; where both have nothing there is none.

        Args:
            part: of the snapshot or of a method compared.
            stored: as the snapshot has it.
            found: as computed now.
            subject: whose it is.
            at: where it stands, if not under the part's own name.
            way: how it was found.
            more: as `compare_parts` has it.
        """
        subject = subject or self.own
        more = {"numbers_only": not self.same_version} | more
        place = subject.place + (at or part)
        done = compare_parts(part, stored, found, subject.name, at=place, way=way, **more)
        if done.count:
            self.checks.append(done)
            self.ways |= dict.fromkeys(done.at, way)
        return done

    @contextmanager
    def attempt(self, part: str, subject: _Subject | None = None) -> Iterator[None]:
        """What cannot be computed is a part that does not hold."""
        try:
            yield
        except FAULTS as fault:
            self.checks.append(
                PartCheck(part, False, (subject or self.own).name, reason=str(fault))
            )

    def provenance(self, segment: Segment, recording: Recording) -> None:
        """Names, findings and facts as the recording has them; its file may be called otherwise.

        How a window was moved or shortened cannot be seen again: it is cut as it then was.
        """
        info = self.snapshot.info
        moved = WindowMoved | WindowShortened
        kept = tuple(finding for finding in info.findings if not isinstance(finding, moved))
        found = replace(segment.info, source=info.source)
        check = self.compare("info", replace(info, findings=kept), found)
        told = {place for place in check.at if kept != info.findings and "findings" in place}
        self.ways |= dict.fromkeys(("info.source", *told), "told")
        if self.snapshot.facts:  # else it was taken without its recording
            self.compare("facts", self.snapshot.facts, facts_of(recording))

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

    def forms(self, segment: Segment) -> None:
        """Whether the forms of the model are those of the data."""
        stored = self.snapshot.adequacy
        if stored:
            with self.attempt("adequacy"):
                found = model_forms(segment, self.snapshot.fit.case)
                self.compare("adequacy", stored, found, relative=SLACK, absolute=SLACK)

    def intervals(self, of: _Subject, segment: Segment) -> None:
        """Whether the intervals follow from the data; those of another version's method may not."""
        stored = of.uncertainty
        with self.attempt("uncertainty", of):
            asked = (stored.level, len(stored.draws)) if stored else ()
            found = intervals(segment, of.fit, *asked)
            if stored and stored.method != found.method and not self.same_version:
                self.unchecked.append(Unchecked("intervals", detail=stored.method))
                return
            same = compare_parts("", stored, found, relative=INTERVALS).ok
            if stored and not same and agree(stored, found):  # draws of another processor, perhaps
                own = from_draws(stored.centre, stored.draws, stored.level)
                found = judged(own, segment, of.fit)
            self.compare("uncertainty", stored, found, of, relative=INTERVALS)
            if stored and not same and self.checks[-1].ok:
                told = (place for place in self.ways if place.startswith(f"{of.place}uncertainty."))
                self.ways |= dict.fromkeys(told, "told")
                self.unchecked.append(Unchecked("draws", detail=name_of(of.fit)))

    def evaluation(self, of: _Subject, segment: Segment, recording: Recording | None) -> None:
        """Whether errors and collisions follow from the data, and pooled errors from the blocks."""
        stored = of.evaluation
        with self.attempt("evaluation", of):
            found = evaluate(segment, of.fit, recording=recording)
            unknown = {"blocks"}  # they follow from the method alone; see `refit`
            if of.fit.surrogate is None:
                unknown.add("surrogate")
            if recording is None or not self.snapshot.facts:  # else no more was known
                unknown |= {"out_of_window", "out_of_window_seconds", "out_of_window_findings"}
            if stored and stored.blocks:
                found = replace(found, holdout=pooled_holdout_errors(stored.blocks))
            for field in fields(Evaluation):
                if field.name not in unknown:
                    old, new = (getattr(one, field.name, None) for one in (stored, found))
                    self.compare(f"evaluation.{field.name}", old, new, of)

    def estimates(self, subjects: Sequence[_Subject], segment: Segment | None) -> None:
        """Run the methods again that can be and may be, and name the others."""
        known = []
        for of in subjects:
            if kind := obstacle(of.fit):
                self.unchecked.append(Unchecked(kind, detail=name_of(of.fit)))
            elif segment is None:
                self.unchecked.append(Unchecked("estimate", RECORDING, name_of(of.fit)))
            else:
                with self.attempt("refit", of):
                    known.append((bool(of.name), of.expected_seconds(segment), of))
        if segment is None:
            return
        for _, seconds, of in sorted(known, key=lambda one: one[:2]):
            if seconds > self.seconds_left:
                self.unchecked.append(Unchecked("estimate", REFIT, name_of(of.fit), seconds))
                continue
            self.seconds_left -= seconds
            if self.on_refit:
                self.on_refit(name_of(of.fit), seconds)
            with self.attempt("refit", of):
                self.refit(of, segment)

    def refit(self, of: _Subject, segment: Segment) -> None:
        """Run a method again on the data, and without the blocks held out."""
        fit, evaluation, method = of.fit, of.evaluation, METHODS[of.fit.method]
        estimate = partial(method.fit, case=fit.case, settings=of.settings)
        again = estimate(segment)
        if of.name:
            again = light(again)
        old, new = (replace(one, config={}, findings=()) for one in (fit, again))
        exact = compare_parts(
            "refit", old, new, relative=SOLVED, numbers_only=not self.same_version
        ).ok
        if exact or method.tolerance <= SOLVED:
            self.compare("refit", old, new, of, at="fit", way="refitted", relative=SOLVED)
        else:
            self.compare(
                "refit", fit.parameters, again.parameters, of, at="fit.parameters",
                way="refitted", relative=method.tolerance,
            )  # fmt: skip
        if evaluation and evaluation.blocks:
            blocks = cross_validate(segment, estimate)
            if _times(blocks) != _times(evaluation.blocks):
                self.unchecked.append(Unchecked("blocks", detail=name_of(fit)))
            else:
                self.compare(
                    "evaluation.blocks", evaluation.blocks, blocks, of,
                    way="refitted", relative=method.tolerance,
                    numbers_only=not (exact and self.same_version),
                )  # fmt: skip


def _times(blocks: tuple[Block, ...]) -> list[tuple[float, float]]:
    return [(round(block.window.start, 3), round(block.window.duration, 3)) for block in blocks]
