"""What one browser has loaded, chosen and trained; setting an early step drops the later ones."""

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from hashlib import sha256
from typing import Any, Literal

from accpinn.errors import ConfigError, SegmentError, SnapshotError
from accpinn.inference.model_adequacy import Adequacy
from accpinn.methods.pinn.config import PRESETS, PinnConfig, PresetName
from accpinn.methods.registry import METHODS
from accpinn.model.cthp import Parameters
from accpinn.model.registry import BEST
from accpinn.recordings import Recording, Window
from accpinn.recordings.files import File
from accpinn.segment import Segment, SegmentInfo
from accpinn.segment.cut import DURATION, complete_windows, default_vehicles, first_window
from accpinn.study import Analysis, Source
from accpinn.study.comparison import Refused
from accpinn.study.judge import Judgement, Subject
from accpinn.study.result import Result
from accpinn.study.snapshot import named
from accpinn.study.store import Entry
from accpinn.tasks import (
    Task,
    comparison_task,
    judgement_task,
    starts_task,
    training_task,
)
from pages.ui.session import resources

ParameterSource = Literal["fit", "published", "snapshot", "hand"]
"""Where the α, β and τ on pages Stability and Platoon are from."""
KEPT_RECORDINGS, KEPT_EARLIER = 4, 3 * len(METHODS)
"""Recordings that a session keeps open; results of three comparisons, and as many changes of the
segment that can be undone."""
NOTHING = Analysis(Source("", "", None, ""), (), (Window(0.0, DURATION),))
"""What is asked before anything is open."""
Step = tuple[Analysis, tuple[float, ...] | None, Result | None]
"""What was asked, the starts of the windows, and the result."""


@dataclass(eq=False)
class Workspace:
    """The steps of one user, first to last: recording, segment, result."""

    id: str
    recording: Recording | None = None
    pending: File | None = None
    """A file that asks for its columns, or for one of its trajectories, before it can be read."""
    awaited: Analysis | None = None
    """What was on the screen before a restart of the server, until a recording is opened."""
    asked: Analysis = NOTHING
    """Vehicles, window, Case, excluded regimes and the answer's model as chosen; see `analysis`."""
    window_starts: tuple[float, ...] | None = None
    """Starts of the windows in car-following to train on; None for all of them, empty for the
    chosen window alone."""
    segment: Segment | None = None
    fault: str = ""
    """Why there is no segment."""
    preset: PresetName = "calibrated"
    """To begin with the one that disturbances do not bias."""
    settings: dict[str, dict[str, Any]] = field(default_factory=dict)
    """Per preset, the settings that differ from it."""
    training: Task[Result] | None = None
    comparison: Task[Result | Refused | Adequacy] | None = None
    """All methods on the segment, while they run and when they are done."""
    starts: Task[Result] | None = None
    """Trainings of the segment from several initial values."""
    judgement: Task[tuple[Judgement, ...]] | None = None
    """Car-following models on the recording's windows."""
    restored: Result | None = None
    """The result shown while no newer training has one: a snapshot, or an earlier training."""
    validation: Segment | None = None
    """The window on which the learned parameters are validated."""
    earlier: tuple[Result, ...] = ()
    """Results that are no longer current, as rows of a table, oldest first."""
    viewed: str = ""
    """Short name of the snapshot that page Snapshots shows in full; empty for the list."""
    chosen_source: ParameterSource = "fit"
    """As chosen last; see `parameter_source`."""
    source_result: Result | None = None
    """The result when the source was chosen; a newer one is shown in place of the choice."""
    choices: dict[str, Any] = field(default_factory=dict)
    """What else was chosen, by the widget's key: a page switch or a reload loses none of it."""
    opened: dict[str, Recording] = field(default_factory=dict)
    """The recordings opened last, by their SHA-256."""
    steps: tuple[Step, ...] = ()
    """What `undo` goes back to, the last one first."""
    kept: bytes = b""
    """What the store was last told of this session; see `pages.ui.session.sessions`."""

    # What is on the screen

    @property
    def is_empty(self) -> bool:
        """Whether nothing was opened in it yet."""
        return self.recording is None and self.restored is None and not self.opened

    @property
    def nbytes(self) -> int:
        """Memory that its recordings take, and an upload that cannot be read yet, in bytes."""
        known = sum(recording.nbytes for recording in self.opened.values())
        return known + (len(self.pending.content.raw) if self.pending else 0)

    @property
    def config(self) -> PinnConfig:
        """The preset with the user's changes.

        Raises:
            ConfigError: a setting outside its range, as one sentence.
        """
        preset = PRESETS[self.preset].to_json()
        return PinnConfig.from_json(preset | self.settings.get(self.preset, {}))

    def analysis(self, config: PinnConfig, windows: tuple[Window, ...] = ()) -> Analysis | None:
        """What a training with these settings would answer; None where no data are at hand.

        The windows are by default the one chosen.
        """
        now, restored, asked = self.recording, self.restored, self.asked
        if now:
            same = replace(asked, source=Source.of(now), held=())
        elif self.segment and restored:
            # The key is that of the data at hand: what a file says of its recording is not checked.
            data = sha256(self.segment.info.digest.encode()).hexdigest()
            held = restored.analysis.held if restored.analysis.model == asked.model else ()
            same = replace(asked, source=replace(asked.source, data=data), held=held)
        else:
            return None
        fitted = "" if asked.model == BEST else asked.model
        same = replace(same, windows=windows or asked.windows, fitted=fitted)
        return same.with_method("pinn", config)

    def training_analysis(self, config: PinnConfig) -> Analysis | None:
        """What a training answers: `analysis`, on `several_windows` if these are chosen."""
        return self.analysis(config, self.several_windows if config.preset == "calibrated" else ())

    @property
    def several_windows(self) -> tuple[Window, ...]:
        """The windows in car-following, if chosen for a preset that takes several; else empty."""
        starts = self.window_starts
        if not self.recording or self.preset != "calibrated" or starts == ():
            return ()
        every = resources.windows_in_car_following(self.recording, self.asked.vehicles)
        return tuple(window for window in every if window.start in (starts or ())) or every

    @property
    def _data(self) -> tuple[Segment, ...]:
        """The data of a task where there is no recording to cut them from."""
        return (self.segment,) if self.segment and not self.recording else ()

    @property
    def result(self) -> Result | None:
        """The training's, or until it has one, the result before it; None before there is any."""
        return (self.training and self.training.result) or self.restored

    @property
    def info(self) -> SegmentInfo | None:
        """The segment; it is known also where a snapshot came without its data."""
        known = self.segment or self.restored
        return known.info if known else None

    @property
    def true_parameters(self) -> Parameters | None:
        """One entry a follower of the segment; None where the truth is not known."""
        truth = resources.truth_of(self.recording) if self.recording else None
        followers = [number - 2 for number in self.asked.vehicles[1:]]
        return truth.parameters[followers] if truth else None

    @property
    def compared(self) -> tuple[Result, ...]:
        """The results of the methods, as far as they were run."""
        if self.comparison:
            rows = [row for row in self.comparison.results if isinstance(row, Result)]
            return tuple(row for name in METHODS for row in rows if row.analysis.method == name)
        return self.restored.compared if self.restored else ()

    def compared_with_training(self) -> tuple[Result, ...]:
        """The same, and the training finished on the same window with settings of its own."""
        rows, result = self.compared, self.result
        if not rows or result is None or not METHODS[result.analysis.method].settings:
            return rows
        if result.analysis.windows != rows[0].analysis.windows or not result.is_finished:
            return rows
        asked = (result.analysis.method, result.analysis.settings)
        known = any((row.analysis.method, row.analysis.settings) == asked for row in rows)
        return rows if known else (*rows, result)

    def adequacy(self, info: SegmentInfo) -> Adequacy | None:
        """The forms of the model on a segment, as far as they were compared there."""
        results = filter(None, (*self.compared, self.result, self.restored))
        known = (r.parts.adequacy for r in results if r.info.digest == info.digest)
        return next(filter(None, known), None)

    @property
    def runs(self) -> tuple[Entry, ...]:
        """The finished trainings that this session has shown, the newest first."""
        entries = resources.store().entries(session=self.id)
        return tuple(entry for entry in entries if not entry.fault)

    def as_snapshot(self, name: str = "", note: str = "", with_data: bool = False) -> Result:
        """The current result with all that the session knows of it.

        Raises:
            SnapshotError: where there is no result, or its data are not open.
        """
        result, restored = self.result, self.restored
        if result is None or not result.segments:
            raise SnapshotError("There is no result with its data to save; train on a window.")
        facts = result.facts or (restored.facts if restored else {})
        parts = replace(
            result.parts, adequacy=self.adequacy(result.info), judgements=self.judgements or None
        )
        whole = replace(result, parts=parts, facts=facts, compared=self.compared)
        return named(whole, name, note, with_data)

    # Steps

    def open(self, recording: Recording) -> None:
        """Begin with a recording: its longest platoon, and the first window without holes.

        One that the restored result was learned from completes that; the open one changes nothing.
        """
        awaited, self.awaited = self.awaited, None
        restored, now = self.restored, self.recording
        if now and (now.sha256, now.digest) == (recording.sha256, recording.digest):
            return
        if restored and not self.recording and restored.found_in(recording).recording:
            self.restore(restored, recording)
            return
        vehicles = default_vehicles(recording)
        if awaited and awaited.source.sha256 == recording.sha256:
            asked, starts = replace(awaited, windows=(awaited.window,)), _starts(awaited)
        else:
            window, starts = first_window(recording, complete_windows(recording, vehicles)), None
            asked = Analysis.of(recording, (window,), vehicles, model=self.asked.model)
        self.recording = recording
        self.segment = self.validation = None
        self.remember(recording)
        self._ask(asked)
        self.window_starts, self.steps = starts, ()

    def remember(self, recording: Recording) -> None:
        """Put a recording among those opened last."""
        self.opened = {**self.opened, recording.sha256: recording}
        for oldest in list(self.opened)[:-KEPT_RECORDINGS]:
            del self.opened[oldest]

    def restore(self, result: Result, recording: Recording | None = None) -> None:
        """Show a result on every page.

        The open recording stays if the result is of it, unless another is given.
        """
        self._leave()
        given = recording or self.recording
        result = result.found_in(given)
        self.recording = given if result.recording else None
        if self.recording:
            self.remember(self.recording)
        self.segment, self.fault = result.segment, ""
        self.choose_source("fit")
        self.restored, self.steps = result, ()
        self.take(result.analysis)

    def take(self, asked: Analysis) -> None:
        """Choose all that an analysis asks; a method other than the PiNN has no preset."""
        self.asked = replace(asked, windows=(asked.window,))
        self.window_starts = _starts(asked)
        with suppress(ConfigError):
            config = PinnConfig.from_json(asked.settings)
            self.preset, self.settings[config.preset] = config.preset, config.changes()

    def choose(self, window: Window | None = None, **changes: Any) -> None:
        """Change the window or other parts of what is asked; earlier results become rows.

        Args:
            window: by default the present one.
            changes: fields of an `Analysis`: vehicles, case or excluded.
        """
        self._ask(replace(self.asked, windows=(window or self.asked.window,), **changes))

    def _ask(self, asked: Analysis) -> None:
        before, self.asked = self.asked, asked
        if asked == before and self.segment:
            return
        self.steps = (*self.steps, (before, self.window_starts, self.result))[-KEPT_EARLIER:]
        self._leave()
        if asked.window != before.window:
            self.window_starts = ()
        elif asked.vehicles != before.vehicles:  # whose windows are others
            self.window_starts = None if self.window_starts else self.window_starts
        try:
            if self.recording:
                self.segment = self._segment_of(self.recording, asked.window)
            self.fault = ""
        except SegmentError as fault:
            self.segment, self.fault = None, str(fault)

    def undo(self) -> None:
        """Take back the last change of the segment; what was learned before it is shown again."""
        *steps, (asked, starts, result) = self.steps
        self._ask(replace(asked, model=self.asked.model))
        self.window_starts, self.restored, self.steps = starts, result, tuple(steps)

    def choose_model(self, model: str) -> None:
        """Choose the answer's model, by its key; results stay."""
        self.asked = replace(self.asked, model=model)

    def train(self, config: PinnConfig, anew: bool = False) -> None:
        """Queue a training of the segment; ``anew``: from no checkpoint of an earlier one."""
        asked = self.training_analysis(config)
        if asked and self.segment:
            if not (self.restored and self.restored.id):
                self.restored = self.result
            self._record([self.result])
            self.choose_source("fit")
            task = training_task(
                self.id, asked, self.recording, resources.store(), self._data, anew
            )
            self.training = resources.task_queue().submit(task)

    @property
    def compared_segment(self) -> Segment | None:
        """What the methods are compared on: the chosen window, or the first one of several."""
        several = self.several_windows
        if several and self.recording:
            return self._segment_of(self.recording, several[0])
        return self.segment

    def _segment_of(self, recording: Recording, window: Window) -> Segment:
        return resources.segment_of(recording, window, self.asked.vehicles, self.asked.excluded)

    def compare(self) -> None:
        """Queue all methods on one window."""
        asked = self.analysis(PinnConfig(), self.several_windows[:1])
        if asked and self.segment:
            self._record(self.compared)
            task = comparison_task(self.id, asked, self.recording, self._data)
            self.comparison = resources.task_queue().submit(task)

    def train_starts(self, config: PinnConfig) -> None:
        """Queue a training on the same window from each of five initial values."""
        asked = self.analysis(config, self.several_windows[:1])
        if asked and self.segment:
            task = starts_task(self.id, asked, self.recording, resources.store(), self._data)
            self.starts = resources.task_queue().submit(task)

    @property
    def subjects(self) -> tuple[Subject, ...]:
        """The followers that models can be judged on: in all windows, or blocks of the chosen one.

        Raises:
            SegmentError: where the chosen window is too short.
        """
        now = self.recording
        return resources.judged_subjects(now, self.asked.vehicles, self.asked.window) if now else ()

    def judge_models(self, models: Sequence[str]) -> None:
        """Queue car-following models on the recording."""
        self.judgement = resources.task_queue().submit(
            judgement_task(self.id, self.subjects, models)
        )

    @property
    def judgements(self) -> tuple[Judgement, ...]:
        """What was judged, now or with the result; empty before that."""
        known = self.result.parts.judgements if self.result else None
        return (self.judgement and self.judgement.result) or known or ()

    def keep_judgements(self) -> None:
        """Keep what was judged with the result; a snapshot's does not enter the store."""
        result = self.result
        if result and result.parts.judgements != self.judgements:
            result.parts.judgements = self.judgements
            if result.is_finished and not result.id:
                resources.store().keep(result)

    @property
    def tasks(self) -> tuple[Task[Any], ...]:
        """All that were asked for on this segment."""
        every = (self.training, self.comparison, self.starts, self.judgement)
        return tuple(task for task in every if task)

    def _leave(self) -> None:
        """Make rows of the present results, and end what still runs.

        A training that is stopped leaves its checkpoint, from which an equal one goes on.
        """
        self._record([*self.compared, self.result])
        self.chosen_source = self.parameter_source
        for task in self.tasks:
            task.stop()
        self.training = self.comparison = self.starts = self.judgement = self.restored = None

    def _record(self, results: Sequence[Result | None]) -> None:
        """Keep results as rows, in place of earlier ones of equal analyses."""
        for result in filter(None, results):
            key = result.analysis.key
            others = [row for row in self.earlier if row.analysis.key != key]
            self.earlier = (*others, result.as_row())[-KEPT_EARLIER:]

    # Parameters of pages Stability and Platoon

    @property
    def parameter_source(self) -> ParameterSource:
        """Where the parameters on Stability and Platoon are from: as chosen, or a newer result."""
        is_newer = self.result is not None and self.result is not self.source_result
        return "fit" if is_newer else self.chosen_source

    def choose_source(self, source: ParameterSource) -> None:
        """Choose where those parameters are from, until there is a newer result."""
        self.chosen_source, self.source_result = source, self.result

    def keep(self, key: str) -> Callable[[Any], None]:
        """What keeps a choice under that key."""
        return lambda value: self.choices.update({key: value})


def _starts(asked: Analysis) -> tuple[float, ...]:
    """The starts of several windows; empty for a single one."""
    starts = tuple(window.start for window in asked.windows)
    return starts if len(starts) > 1 else ()
