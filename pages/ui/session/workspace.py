"""What one browser has loaded, chosen and trained; setting an early step drops the later ones."""

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import msgspec
from accpinn.inference.multistart import Trial
from accpinn.results.snapshot import Snapshot, create
from accpinn.results.snapshot.verification import recover

from accpinn.errors import ConfigError, SegmentError, SnapshotError
from accpinn.inference.intervals import Uncertainty, intervals
from accpinn.inference.model_adequacy import Adequacy, model_forms
from accpinn.methods.fit import Fit, Outcome
from accpinn.methods.pinn.config import PinnConfig, PresetName
from accpinn.methods.pinn.request import TrainingRequest, WarmStart
from accpinn.methods.registry import METHODS
from accpinn.model.cthp import Case, Parameters
from accpinn.recordings.mapping import CsvMapping
from accpinn.recordings.recording import Recording, Window
from accpinn.recordings.synthetic import Truth
from accpinn.results.tables.estimates import name_of
from accpinn.segment.cut import DURATION, complete_windows, cut, default_vehicles
from accpinn.segment.quality import exclude_regimes, label_regimes
from accpinn.segment.segment import Segment, SegmentInfo
from accpinn.study.comparison import (
    FitRecord,
    MethodFailure,
    MethodResult,
    result_of,
    results_among,
)
from accpinn.tasks.task import Task, comparison_task, starts_task, training_task
from accpinn.units import Seconds
from pages.ui.session.choices import (
    DatabaseChoice,
    DataChoice,
    MapChoice,
    ParameterChoice,
    PlatoonChoice,
    Source,
)
from pages.ui.session.resources import store, task_queue
from pages.ui.session.runs import Runs

DEFAULT_CASE: Case = "II"
"""Each follower with parameters of its own, as different cars have."""
KEPT_RECORDINGS = 4
KEPT_RECORDS = 3 * len(METHODS)
"""Those of three comparisons."""


@dataclass(frozen=True)
class PendingFile:
    """A file that asks for its mapping, or for one of its trajectories, before it can be read."""

    name: str
    source: bytes | Path
    trajectories: tuple[tuple[str, int], ...] = ()
    """Names and numbers of vehicles; empty where a mapping is needed first."""
    mapping: CsvMapping | None = None


class Opened(msgspec.Struct, frozen=True):
    """What a session has open, by name."""

    source: str
    """File name of the recording."""
    sha256: str
    trajectory: str | None
    campaign: str | None
    vehicles: tuple[int, ...]
    start: Seconds
    end: Seconds
    case: Case
    excluded_regimes: tuple[str, ...]
    preset: PresetName
    run: str
    """Short name of the finished run that is shown; empty for none."""

    @property
    def window(self) -> Window:
        """Of the recording."""
        return Window(self.start, self.end)


@dataclass(eq=False)
class Workspace:
    """The steps of one user, first to last: recording, segment, training."""

    id: str
    recording: Recording | None = None
    truth: Truth | None = None
    refusal: str = ""
    """Why the last attempt to open something failed."""
    pending: PendingFile | None = None
    """A file that cannot be read before something is known of it."""
    awaited: Opened | None = None
    """What was open before a restart of the server, as long as nothing else is."""
    vehicles: tuple[int, ...] = ()
    window: Window = field(default_factory=lambda: Window(0.0, DURATION))
    case: Case = DEFAULT_CASE
    excluded_regimes: tuple[str, ...] = ()
    """Regimes that the user leaves out of the model's equations."""
    segment: Segment | None = None
    fault: str = ""
    """Why there is no segment."""
    preset: PresetName = "calibrated"
    """To begin with the one that disturbances do not bias."""
    settings: dict[str, dict[str, Any]] = field(default_factory=dict)
    """Per preset, the settings that differ from it."""
    training: Task[Fit] | None = None
    comparison: Task[MethodResult | MethodFailure | Adequacy] | None = None
    """All methods on the segment, while they run and when they are done."""
    starts: Task[Trial] | None = None
    """Trainings of the segment from several initial values."""
    validation: Segment | None = None
    """The window on which the learned parameters are validated."""
    records: tuple[FitRecord, ...] = ()
    """Fits that are no longer current, oldest first."""
    snapshot: Snapshot | None = None
    """The result that is shown as it was saved; without its data there may be no segment."""
    run: str = ""
    """Short name of the present result among the runs; empty where it is none of them."""
    kept_open: Opened | None = None
    """What was last written of what is open."""
    viewed: str = ""
    """Short name of the snapshot that page Snapshots shows in full; empty for the list."""
    data_choice: DataChoice = field(default_factory=DataChoice)
    parameter_choice: ParameterChoice = field(default_factory=ParameterChoice)
    map_choice: MapChoice = field(default_factory=MapChoice)
    platoon_choice: PlatoonChoice = field(default_factory=PlatoonChoice)
    database_choice: DatabaseChoice = field(default_factory=DatabaseChoice)
    pictures: str = "SVG"
    """The format in which charts are saved."""
    tabs: dict[str, str] = field(default_factory=dict)
    """The title of the tab that is open, by the key of its row of tabs."""
    legends: bool = False
    """Whether each chart has one of its own, beside the key that serves a whole page."""
    opened: dict[str, tuple[Recording, Truth | None]] = field(default_factory=dict)
    """The recordings opened last, by their SHA-256."""
    _kept: Fit | None = None
    """The training that was last put among the runs."""
    _uncertainty: tuple[Fit, Uncertainty] | None = None
    """That of a fit, kept with it."""
    _adequacy: tuple[Segment, Case, Adequacy] | None = None
    """That of a segment, kept with it."""
    _own: MethodResult | None = None
    """The evaluated training, kept with its fit."""

    @property
    def is_empty(self) -> bool:
        """Whether nothing was opened in it yet."""
        return self.recording is None and self.snapshot is None and not self.opened

    @cached_property
    def runs(self) -> Runs:
        """The finished trainings of this session, on disk."""
        return Runs(self.id, store().folder)

    def keep_run(self) -> None:
        """Put the training among the runs once it has finished; nothing happens before."""
        training, segment = self.training, self.segment
        fit = training.result if training else None
        if fit is None or segment is None or fit is self._kept:
            return
        if fit.outcome in (Outcome.STOPPED, Outcome.DIVERGED):
            return
        self._kept = fit
        case = f", Case {fit.case}" if segment.followers > 1 else ""
        with suppress(SnapshotError):
            run = create(
                segment, fit, recording=self.recording, uncertainty=self.uncertainty(),
                name=f"{name_of(fit)}{case}",
            )  # fmt: skip
            self.run = self.runs.keep(run)

    def open(self, recording: Recording, truth: Truth | None = None) -> None:
        """Begin with a recording: its longest platoon, and the first window without holes.

        If it is the one that the snapshot shown was learned from, it completes that instead.
        """
        awaited, self.awaited = self.awaited, None
        if self.snapshot and not self.recording and recover(self.snapshot, recording).segment:
            self.restore(self.snapshot, recording, truth)
            return
        vehicles = default_vehicles(recording)
        self.archive_and_stop()
        self.recording, self.truth, self.refusal = recording, truth, ""
        self.validation = None
        self.remember(recording, truth)
        if awaited and awaited.sha256 == recording.sha256:
            self.choose(awaited.vehicles, awaited.window, awaited.case, awaited.excluded_regimes)
        else:
            self.choose(vehicles, _first_window(recording, vehicles), DEFAULT_CASE, ())

    def remember(self, recording: Recording, truth: Truth | None = None) -> None:
        """Put a recording among those opened last."""
        self.opened = {**self.opened, recording.sha256: (recording, truth)}
        for oldest in list(self.opened)[:-KEPT_RECORDINGS]:
            del self.opened[oldest]

    @property
    def recording_bytes(self) -> int:
        """What its recordings take in memory, and an upload that cannot be read yet."""
        waiting = self.pending.source if self.pending else b""
        known = sum(recording.nbytes for recording, _ in self.opened.values())
        return known + (len(waiting) if isinstance(waiting, bytes) else 0)

    def forget_other_recordings(self) -> None:
        """Keep the open one, or else the last, alone."""
        self.pending = None
        kept = self.recording.sha256 if self.recording else ""
        last = list(self.opened)[-1:]
        shown = {key: one for key, one in self.opened.items() if key == kept}
        self.opened = shown or {key: self.opened[key] for key in last}

    def restore(
        self, snapshot: Snapshot, recording: Recording | None = None, truth: Truth | None = None
    ) -> None:
        """Show a snapshot on every page.

        Args:
            snapshot: to be shown.
            recording: in place of the open one; it stays open if the snapshot is of it.
            truth: of that recording, where it is known.
        """
        self.archive_and_stop()
        info = snapshot.info
        given, known = (recording, truth) if recording else (self.recording, self.truth)
        segment = recover(snapshot, given).segment if given else None
        self.recording, self.truth = (given, known) if segment else (None, None)
        if self.recording:
            self.remember(self.recording, self.truth)
        self.segment = segment or snapshot.segment
        self.vehicles, self.case = info.vehicles, snapshot.fit.case
        self.window = info.window
        self.excluded_regimes, self.fault, self.refusal = info.excluded_regimes, "", ""
        self._uncertainty = (snapshot.fit, snapshot.uncertainty) if snapshot.uncertainty else None
        self.choose_source("fit")
        self.snapshot = snapshot
        self.run = snapshot.id if self.runs.has(snapshot.id) else ""
        with suppress(ConfigError):  # another method's result leaves the preset as it is
            config = PinnConfig.from_json(snapshot.fit.config)
            self.preset, self.settings[config.preset] = config.preset, config.changes()

    def choose(
        self,
        vehicles: Sequence[int] | None = None,
        window: Window | None = None,
        case: Case | None = None,
        excluded_regimes: tuple[str, ...] | None = None,
    ) -> None:
        """Change the segment or the case; earlier results become records.

        Args:
            vehicles: numbers in the file, leader first.
            window: of the recording.
            case: "I" or "II".
            excluded_regimes: left out of the model's equations.
        """
        self.archive_and_stop()
        self.snapshot = None
        self.vehicles = tuple(vehicles or self.vehicles)
        self.window, self.case = window or self.window, case or self.case
        if excluded_regimes is not None:
            self.excluded_regimes = excluded_regimes
        try:
            whole = self.whole_segment()
            if whole and self.recording:
                labels = label_regimes(whole, self.recording)
                self.segment = exclude_regimes(whole, labels, self.excluded_regimes)
            self.fault = ""
        except SegmentError as fault:
            self.segment, self.fault = None, str(fault)

    def whole_segment(self) -> Segment | None:
        """The chosen segment with all its instants; None where no recording is open.

        Raises:
            SegmentError: where the window cannot be used.
        """
        if self.recording is None:
            return None
        return cut(self.recording, self.window.start, self.window.duration, self.vehicles)

    def request(self, config: PinnConfig, warm: WarmStart | None = None) -> TrainingRequest | None:
        """The request for a training of the segment; None where there is no segment."""
        return TrainingRequest(self.segment, self.case, config, warm) if self.segment else None

    def train(self, config: PinnConfig, warm: WarmStart | None = None, anew: bool = False) -> None:
        """Queue a training of the segment.

        Args:
            config: all settings.
            warm: an earlier fit to begin with.
            anew: begin at the first iteration, also where an earlier training stopped later.
        """
        if request := self.request(config, warm):
            self._record([self.fit] if self.fit else [])
            self.keep_run()
            self.run = ""
            self.choose_source("fit")
            self.training = task_queue().submit(training_task(self.id, request), anew)

    @property
    def warm(self) -> WarmStart | None:
        """The network of the snapshot shown, if it has one."""
        snapshot = self.snapshot
        if snapshot is None or not snapshot.fit.arrays:
            return None
        return WarmStart.of(snapshot.fit, f"snapshot {snapshot.id}")

    def compare(self) -> None:
        """Queue all methods on the segment."""
        if self.segment:
            self._record([row.fit for row in self.compared])
            task = comparison_task(self.id, self.segment, self.case, self.recording)
            self.comparison = task_queue().submit(task)

    def train_starts(self, config: PinnConfig) -> None:
        """Queue a training of the segment from each of five initial values."""
        if self.segment:
            task = starts_task(self.id, self.segment, self.case, config)
            self.starts = task_queue().submit(task)

    @property
    def tasks(self) -> tuple[Task[Any], ...]:
        """All that were asked for on this segment."""
        every = (self.training, self.comparison, self.starts)
        return tuple(task for task in every if task)

    def archive_and_stop(self) -> None:
        """Keep a record of the present fits, and end what still runs.

        A training that is stopped leaves its checkpoint, from which the same request goes on.
        """
        self._record([row.fit for row in self.compared] + ([self.fit] if self.fit else []))
        self.keep_run()
        self.run = ""
        source = self.parameter_choice.source = self.parameter_source
        for task in self.tasks:
            task_queue().stop(task)
        self.training = self.comparison = self.starts = None
        if source == "fit":
            self._forget_vehicles()

    def _record(self, fits: Sequence[Fit]) -> None:
        if self.segment is None:
            return
        for fit in fits:
            record = FitRecord.of(self.segment, fit)
            others = [other for other in self.records if not other.same_as(record)]
            self.records = (*others, record)[-KEPT_RECORDS:]

    @property
    def compared(self) -> tuple[MethodResult, ...]:
        """The results of the methods, as far as they were run."""
        if self.comparison:
            order = list(METHODS)
            found = results_among(self.comparison.results)
            return tuple(sorted(found, key=lambda row: order.index(row.fit.method)))
        return self.snapshot.methods if self.snapshot else ()

    def compared_with_training(self) -> tuple[MethodResult, ...]:
        """The same, and the finished training where no method ran with its settings."""
        rows, fit, segment = self.compared, self.fit, self.segment
        if not rows or segment is None or fit is None or not METHODS[fit.method].is_iterative:
            return rows
        known = any((row.fit.method, row.fit.config) == (fit.method, fit.config) for row in rows)
        if known or fit.outcome not in (Outcome.FINISHED, Outcome.CONVERGED):
            return rows
        if self._own is None or self._own.fit is not fit:
            self._own = result_of(segment, fit, self.recording)
        return (*rows, self._own)

    @property
    def fit(self) -> Fit | None:
        """The result of the training, or else of the snapshot shown, if there is one yet."""
        if self.training:
            return self.training.result
        return self.snapshot.fit if self.snapshot else None

    @property
    def parameter_source(self) -> Source:
        """Where the parameters on Stability and Platoon are from: as chosen, or a newer fit."""
        choice = self.parameter_choice
        is_newer = self.fit is not None and self.fit is not choice.fit
        return "fit" if is_newer else choice.source

    def choose_source(self, source: Source) -> None:
        """Choose where those parameters are from, until there is a newer fit."""
        if source != self.parameter_source:
            self._forget_vehicles()
        self.parameter_choice.source, self.parameter_choice.fit = source, self.fit

    def _forget_vehicles(self) -> None:
        """Forget what was chosen among other vehicles."""
        self.platoon_choice.reset()
        self.map_choice.reset()

    @property
    def fit_info(self) -> SegmentInfo | None:
        """The segment that the fit is of; it is known also where the data are not."""
        if self.segment:
            return self.segment.info
        return self.snapshot.info if self.snapshot else None

    def uncertainty(self) -> Uncertainty | None:
        """That of the current fit; None where there is none, or its data are not here."""
        # Read once, as another tab of the session may change them meanwhile.
        fit, segment, kept = self.fit, self.segment, self._uncertainty
        if fit and kept and kept[0] is fit:
            return kept[1]
        if fit is None or segment is None:
            return None
        self._uncertainty = (fit, intervals(segment, fit))
        return self._uncertainty[1]

    @property
    def known_adequacy(self) -> Adequacy | None:
        """The forms of the model for the segment, if they were compared before."""
        found = self.comparison.results if self.comparison else ()
        if compared := next((one for one in found if isinstance(one, Adequacy)), None):
            return compared
        kept = self._adequacy
        if kept and kept[0] is self.segment and kept[1] == self.case:
            return kept[2]
        return self.snapshot.adequacy if self.snapshot else None

    def compare_forms(self) -> Adequacy | None:
        """Compare the forms of the model on the segment, which takes some seconds once."""
        if self.segment is None:
            return None
        found = self.known_adequacy or model_forms(self.segment, self.case)
        self._adequacy = (self.segment, self.case, found)
        return found

    def as_snapshot(self, name: str = "", note: str = "", with_data: bool = False) -> Snapshot:
        """The current result with all that the session knows of it.

        Raises:
            SnapshotError: where there is no result, or its data are not open.
        """
        fit, segment, old = self.fit, self.segment, self.snapshot
        if fit is None or segment is None:
            raise SnapshotError("There is no result with its data to save; train on a window.")
        return create(
            segment,
            fit,
            recording=self.recording,
            facts=old.facts if old else None,
            uncertainty=self.uncertainty(),
            evaluation=old.evaluation if old and old.fit is fit else None,
            methods=self.compared,
            adequacy=self.known_adequacy,
            name=name,
            note=note,
            with_data=with_data,
        )

    @property
    def recording_duration(self) -> Seconds | None:
        """That of the recording which the window is of, as far as it is known."""
        if self.recording:
            return self.recording.duration
        return self.snapshot.facts.get("duration") if self.snapshot else None

    @property
    def true_parameters(self) -> Parameters | None:
        """One entry a follower of the segment; None where the truth is not known."""
        if self.truth is None:
            return None
        return self.truth.parameters[[number - 2 for number in self.vehicles[1:]]]


def _first_window(recording: Recording, vehicles: tuple[int, ...]) -> Window:
    """The first complete stretch that is long enough, else the longest one."""
    complete = complete_windows(recording, vehicles)
    if not complete:
        return Window(0.0, min(DURATION, recording.duration))
    best = max(complete, key=lambda window: (min(window.duration, DURATION), -window.start))
    return Window(best.start, min(best.end, best.start + DURATION))
