"""What one browser has loaded, chosen and trained; setting an early step drops the later ones."""

from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import streamlit as st

from accpinn.errors import ConfigError, SegmentError
from accpinn.inference.intervals import Uncertainty
from accpinn.inference.multistart import Trial, multistart
from accpinn.methods.fit import Fit
from accpinn.methods.method import TaskContext
from accpinn.methods.pinn.config import STARTS, PinnConfig, PresetName
from accpinn.methods.registry import METHODS
from accpinn.model.cthp import Case, Parameters
from accpinn.recordings.recording import Recording, Window
from accpinn.recordings.synthetic import Truth
from accpinn.results.snapshot.schema import Snapshot
from accpinn.results.snapshot.verification import recover
from accpinn.segment import regimes
from accpinn.segment.cut import DURATION, complete_windows, cut
from accpinn.segment.segment import Segment, SegmentInfo
from accpinn.segment.vehicles import default_vehicles
from accpinn.study.comparison import FitRecord, MethodFailure, MethodResult, compare, results_among
from accpinn.tasks.job import Job
from accpinn.tasks.series import Series
from pages.ui.session.resources import task_queue
from pages.ui.session.ui_state import MapChoice, ParameterChoice, PlatoonChoice

if TYPE_CHECKING:
    from accpinn.methods.pinn.warm_start import WarmStart

KEPT_RUNS = 24
"""Three comparisons of eight methods."""


@dataclass(eq=False)
class Workspace:
    """The steps of one user, first to last: recording, segment, training."""

    id: str
    recording: Recording | None = None
    truth: Truth | None = None
    refusal: str = ""
    """Why the last attempt to open something failed."""
    vehicles: tuple[int, ...] = ()
    window: Window = field(default_factory=lambda: Window(0.0, DURATION))
    case: Case = "II"
    exclude_regimes: tuple[str, ...] = ()
    """Regimes that the user leaves out of the law's equations."""
    segment: Segment | None = None
    fault: str = ""
    """Why there is no segment."""
    preset: PresetName = "fast"
    settings: dict[str, dict[str, Any]] = field(default_factory=dict)
    """Per preset, the settings that differ from it."""
    job: Job | None = None
    uncertainty: tuple[Fit, Uncertainty] | None = None
    """What the data leave open about a fit, kept with that fit."""
    comparison: Series[MethodResult | MethodFailure] | None = None
    """All methods on the segment, while they run and when they are done."""
    own: MethodResult | None = None
    """What the training is worth beside the methods, kept with its fit."""
    starts: Series[Trial] | None = None
    """Trainings of the segment from several initial values."""
    runs: tuple[FitRecord, ...] = ()
    """Fits that are no longer current, oldest first."""
    snapshot: Snapshot | None = None
    """The result that is shown as it was saved; without its data there may be no segment."""
    laws: ParameterChoice = field(default_factory=ParameterChoice)
    pictures: str = "SVG"
    """The format in which charts are saved."""
    legends: bool = False
    """Whether each chart has one of its own, beside the key that serves a whole page."""
    map: MapChoice = field(default_factory=MapChoice)
    drive: PlatoonChoice = field(default_factory=PlatoonChoice)

    def open(self, recording: Recording, truth: Truth | None = None) -> None:
        """Begin with a recording: its longest platoon, and the first window without holes.

        If it is the one that the snapshot shown was learned from, it completes that instead.
        """
        if self.snapshot and not self.recording and recover(self.snapshot, recording).segment:
            self.restore(self.snapshot, recording, truth)
            return
        vehicles = default_vehicles(recording)
        self.recording, self.truth, self.refusal = recording, truth, ""
        window = _first_window(recording, vehicles)
        self.choose(vehicles=vehicles, window=window, exclude_regimes=())

    def restore(
        self, snapshot: Snapshot, recording: Recording | None = None, truth: Truth | None = None
    ) -> None:
        """Show a snapshot on every page; its recording stays open, or is opened, if it is given."""
        self.archive_and_stop()
        info, given = snapshot.info, recording or self.recording
        cut_anew = recover(snapshot, given).segment if given else None
        self.recording = given if cut_anew else None
        self.truth = (truth or self.truth) if cut_anew else None
        self.segment = cut_anew or snapshot.segment
        self.vehicles, self.case = info.vehicles, snapshot.fit.case
        self.window = Window(info.window.start, info.window.start + info.window.duration)
        self.leave_out, self.fault, self.refusal = info.excluded_regimes, "", ""
        self.uncertainty = (snapshot.fit, snapshot.uncertainty) if snapshot.uncertainty else None
        self.snapshot = snapshot
        with suppress(ConfigError):  # another method's result leaves the preset as it is
            config = PinnConfig.from_json(snapshot.fit.config)
            self.preset, self.settings[config.preset] = config.preset, config.changes()

    def choose(
        self,
        vehicles: Sequence[int] | None = None,
        window: Window | None = None,
        case: Case | None = None,
        exclude_regimes: tuple[str, ...] | None = None,
    ) -> None:
        """Change the segment or the case; what was trained before is let go."""
        self.archive_and_stop()
        self.snapshot = None
        self.vehicles = tuple(vehicles or self.vehicles)
        self.window, self.case = window or self.window, case or self.case
        self.leave_out = self.leave_out if exclude_regimes is None else exclude_regimes
        if self.recording is None:
            return
        try:
            window = self.window
            whole = cut(self.recording, window.start, window.duration, self.vehicles)
            self.segment = regimes.exclude_regimes(
                whole, regimes.label_regimes(whole, self.recording), self.leave_out
            )
            self.fault = ""
        except SegmentError as fault:
            self.segment, self.fault = None, str(fault)

    def train(
        self, config: PinnConfig, warm: "WarmStart | None" = None, anew: bool = False
    ) -> None:
        """Queue a training of the segment.

        It may begin with the weights of ``warm``, or ``anew`` where an earlier one stopped.
        """
        if self.segment:
            self._remember([self.fit] if self.fit else [])
            self.job = task_queue().submit(self.id, self.segment, self.case, config, warm, anew)

    @property
    def warm(self) -> "WarmStart | None":
        """The network of the snapshot shown, if it has one."""
        snapshot = self.snapshot
        if snapshot is None or not snapshot.fit.arrays:
            return None
        from accpinn.methods.pinn.warm_start import WarmStart  # torch takes a second to import

        return WarmStart.of(snapshot.fit, f"snapshot {snapshot.id}")

    def compare(self) -> None:
        """Queue all methods on the segment."""
        segment, case, recording = self.segment, self.case, self.recording
        if segment is None:
            return

        def rows(means: TaskContext) -> Iterator[MethodResult | MethodFailure]:
            yield from compare(segment, case, recording=recording, context=means)

        self._remember([row.fit for row in self.compared])
        self.comparison = task_queue().run(
            Series(
                self.id,
                "comparison",
                tuple(METHODS),
                rows,
                [method.typical_seconds for method in METHODS.values()],
            )
        )

    def train_starts(self, config: PinnConfig) -> None:
        """Queue a training of the segment from each of five initial values."""
        segment, case = self.segment, self.case
        if segment is None:
            return

        def trials(means: TaskContext) -> Iterator[Trial]:
            return multistart(segment, case, config, context=means)

        names = tuple(f"start {k} of {len(STARTS)}" for k in range(1, len(STARTS) + 1))
        series = Series(self.id, "series of starts", names, trials, (1.0,) * len(names))
        self.starts = task_queue().run(series)

    def archive_and_stop(self) -> None:
        """Keep what the present fits say among the earlier runs, and end what still runs.

        A training that is stopped leaves its checkpoint, from which the same request goes on.
        """
        self._remember([row.fit for row in self.compared] + ([self.fit] if self.fit else []))
        for task in (self.job, self.comparison, self.starts):
            if task:
                task_queue().stop(task)
        self.job = self.comparison = self.starts = None
        if self.laws.source in (None, "fit"):
            self.drive.forget()
            self.map.held = -1

    def _remember(self, fits: Sequence[Fit]) -> None:
        if self.segment is None:
            return
        for fit in fits:
            run = FitRecord.of(self.segment, fit)
            others = [other for other in self.runs if not other.same_as(run)]
            self.runs = (*others, run)[-KEPT_RUNS:]

    @property
    def compared(self) -> tuple[MethodResult, ...]:
        """What the methods say of the segment, as far as they were run."""
        if self.comparison:
            return results_among(self.comparison.results)
        return self.snapshot.methods if self.snapshot else ()

    @property
    def fit(self) -> Fit | None:
        """The result of the training, or else of the snapshot shown, if there is one yet."""
        if self.job:
            return self.job.fit
        return self.snapshot.fit if self.snapshot else None

    @property
    def described(self) -> SegmentInfo | None:
        """What the fit is of; it is known also where the data are not."""
        if self.segment:
            return self.segment.info
        return self.snapshot.info if self.snapshot else None

    @property
    def true_parameters(self) -> Parameters | None:
        """One entry a follower of the segment; nothing where the truth is not known."""
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


def sync_widget(key: str, value: object) -> str:
    """Let the widget of that key show ``value``, whatever it showed before; returns the key.

    The workspace is the one place where choices live: a widget reports a change through its
    callback and is told here what to show, so page switches and reloads lose nothing. Give the
    widget the same value as its default, too: a browser that is still loading may miss what is
    told here, and would then report the default as the user's choice.
    """
    if st.session_state.get(key) != value:
        st.session_state[key] = value
    return key
