"""What a snapshot says, held against what its own contents give when computed anew."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

from accpinn import __version__
from accpinn.errors import AccpinnError
from accpinn.recordings.recording import Recording
from accpinn.results.snapshot.agreement import Check, compared
from accpinn.results.snapshot.codec import encode
from accpinn.results.snapshot.content import ID_LENGTH, Snapshot
from accpinn.results.snapshot.create import facts_of, stability
from accpinn.results.snapshot.file import Content, load
from accpinn.results.snapshot.recompute import from_data
from accpinn.results.snapshot.refitting import network_curve, refitted, repeatable
from accpinn.results.snapshot.sanitise import sanitise
from accpinn.results.snapshot.schema import ATTRIBUTION_TEXT
from accpinn.results.tables.names import TITLES
from accpinn.segment.cut import cut
from accpinn.segment.regimes import exclude_regimes, label_regimes
from accpinn.segment.segment import Segment
from accpinn.stability.report import VehicleStability

RECORDING, REFIT = "--recording", "--refit"
"""What checks more, as the command line has it."""


@dataclass(frozen=True)
class Unchecked:
    """Something a snapshot says that was believed."""

    what: str
    cure: str = ""
    """`RECORDING` or `REFIT`; empty where nothing can check it."""


@dataclass(frozen=True)
class Verification:
    """All that was checked."""

    checks: tuple[Check, ...]
    sentence: str
    """The whole, and what was not checked."""
    unchecked: tuple[Unchecked, ...] = ()

    @property
    def ok(self) -> bool:
        """Whether all of it agrees."""
        return all(check.ok for check in self.checks)


def verify(
    content: Content, recording: Recording | None = None, *, again: bool = False
) -> Verification:
    """Read a snapshot, then compute its figures anew.

    Args:
        content: the file's path, or its bytes.
        recording: what it was learned from; with it errors and intervals are checked too where the
            snapshot has no data, and so are errors on the rest of the recording.
        again: whether every method is run again where the data are at hand.

    Raises:
        SnapshotError: when it cannot be read, naming the damaged part.
    """
    return check(load(content), recording, again=again)


def check(
    snapshot: Snapshot, recording: Recording | None = None, *, again: bool = False
) -> Verification:
    """The same for a snapshot that was read already."""
    ours = snapshot.origin.accpinn == __version__
    checks = [_whole(snapshot), *_stability(snapshot, ours), *network_curve(snapshot.fit)]
    if ours:
        checks.append(_attribution(snapshot))
    segment, same = snapshot.segment, None
    if recording is not None:
        found = _found(snapshot, recording)
        checks.append(found.check)
        segment = segment or found.segment
        if found.segment is not None:
            same = recording
            checks.append(_provenance(snapshot, found.segment, recording, ours))
    if segment is not None:
        checks += from_data(snapshot, segment, same, ours)
        checks += refitted(snapshot, segment) if again else ()
    unchecked = tuple(_unchecked(snapshot, segment, same, again))
    return Verification(tuple(checks), _sentence(checks, segment, unchecked), unchecked)


def recovered(snapshot: Snapshot, recording: Recording) -> Segment | None:
    """The window of a snapshot, cut anew from its recording; None where it is another one."""
    return _found(snapshot, recording).segment


def _whole(snapshot: Snapshot) -> Check:
    known = snapshot.id or "not saved yet"
    return Check("Contents", known, known, True, "Every part is as it was written.")


def _provenance(snapshot: Snapshot, segment: Segment, recording: Recording, wording: bool) -> Check:
    """Names, notes and facts as the recording has them; the file itself may be called otherwise."""
    known, found = snapshot.info, segment.info
    stored: list[Any] = [known.names, known.findings, known.excluded_share]
    given: list[Any] = [found.names, found.findings, found.excluded_share]
    if snapshot.facts:  # else it was taken without its recording
        stored.append(snapshot.facts)
        given.append(facts_of(recording))
    texts = [f"{info.followers + 1} vehicles" for info in (known, found)]
    return compared("Names and notes", texts, stored, sanitise(encode(given)), wording=wording)


def _stability(snapshot: Snapshot, wording: bool) -> Iterator[Check]:
    old, new = snapshot.stability, stability(snapshot.fit)
    if old is None or new is None:
        same = old is new
        reason = "There is no report, as the parameters allow none."
        yield Check("Stability", _said(old), _said(new), same, reason if same else _DIFFERS)
        return
    for text, one, other in zip(snapshot.info.labels[1:], old.vehicles, new.vehicles, strict=True):
        verdicts = _verdicts(one), _verdicts(other)
        yield compared(f"Stability of {text}", verdicts, one, other, wording=wording)
    if len(old.vehicles) > 1:
        last = [f"‖h‖₁ {float(report.platoon.linf.gain[-1]):.6g}" for report in (old, new)]
        yield compared("Stability of the platoon", last, old.platoon, new.platoon, wording=wording)


_DIFFERS = "Only one of both has a report."


def _said(report: object) -> str:
    return "no report" if report is None else "a report"


def _verdicts(vehicle: VehicleStability) -> str:
    answers = [
        f"{name} {'yes' if verdict.stable else 'no'}"
        for name, verdict in (("L2", vehicle.l2), ("L∞", vehicle.linf_exact))
    ]
    return f"{', '.join(answers)}, ‖h‖₁ {vehicle.linf_gain:.6g}"


@dataclass(frozen=True, eq=False)
class _Found:
    check: Check
    segment: Segment | None = None


def _found(snapshot: Snapshot, recording: Recording) -> _Found:
    """The snapshot's window in a recording, if that is the one."""
    info = snapshot.info
    stored, given = info.sha256[:ID_LENGTH], recording.sha256[:ID_LENGTH]
    if info.sha256 != recording.sha256:
        sentence = (
            f"{recording.source} is not the recording the result was learned from; that is"
            f" {info.source} with the SHA-256 {info.sha256}."
        )
        return _Found(Check("Recording", stored, given, False, sentence))
    try:
        segment = cut(recording, info.window.start, info.window.duration, info.vehicles)
        if info.excluded_regimes:
            segment = exclude_regimes(
                segment, label_regimes(segment, recording), info.excluded_regimes
            )
    except AccpinnError as fault:
        return _Found(Check("Recording", stored, given, False, str(fault)))
    same = segment.info.digest == info.digest
    sentence = (
        "The recording is the same, and so is the window cut from it."
        if same
        else "The recording is the same, but the window cut from it differs, as if bridged or"
        " resampled in another way."
    )
    window = Check(
        "Window", info.digest[:ID_LENGTH], segment.info.digest[:ID_LENGTH], same, sentence
    )
    return _Found(window, segment if same else None)


def _attribution(snapshot: Snapshot) -> Check:
    same = snapshot.attribution == ATTRIBUTION_TEXT
    sentence = "It names the authors of data and method." if same else "It is not accpinn's text."
    return Check("Attribution", "as stored", "as accpinn writes it", same, sentence)


def _unchecked(
    snapshot: Snapshot, segment: Segment | None, same: Recording | None, again: bool
) -> Iterator[Unchecked]:
    """What a reader must not take for granted."""
    info, fit = snapshot.info, snapshot.fit
    if segment is None:
        yield Unchecked("its errors and intervals, as the data are not in it", RECORDING)
    method = TITLES.get(fit.method, fit.method)
    reason = repeatable(fit)
    if reason:
        yield Unchecked(f"that {method} finds these parameters, as {reason}")
    elif segment is None or not again:
        yield Unchecked(f"that {method} finds these parameters", REFIT)
    if same is None and info.sha256:
        yield Unchecked(
            f"that the data are those of {info.source} (SHA-256 {info.sha256})", RECORDING
        )
    if snapshot.origin.accpinn != __version__:
        yield Unchecked(f"its sentences, as accpinn {snapshot.origin.accpinn} wrote them")
    yield Unchecked("name, note, date, machine and the method's remarks, which anyone can write")


def _sentence(checks: list[Check], segment: Segment | None, open_: Sequence[Unchecked]) -> str:
    wrong = [check for check in checks if not check.ok]
    if wrong:
        return f"{wrong[0].name}: {wrong[0].sentence}"
    what = "stability follows from its parameters"
    if segment is not None:
        what = "stability, errors and intervals follow from its contents"
    return (
        f"The snapshot is whole, and its {what}. Not checked:"
        f" {'; '.join(one.what for one in open_)}."
    )
