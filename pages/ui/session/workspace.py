"""What one browser has loaded, chosen and trained; setting an early step drops the later ones."""

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from hashlib import sha256
from typing import Any, Literal, TypeVar

from accpinn.errors import ConfigError, SegmentError, SnapshotError
from accpinn.inference.model_adequacy import Adequacy
from accpinn.methods import Segments
from accpinn.methods.pinn.config import DEFAULT, PRESET_INFOS, PRESETS, PinnConfig, PresetName
from accpinn.methods.registry import PRESET_METHOD, VARIANTS, recommended_method, variant_name
from accpinn.model.cthp import Parameters
from accpinn.model.spec import ModelSpec
from accpinn.recordings import Recording, Window
from accpinn.recordings.files import File
from accpinn.recordings.mapping import CsvMapping
from accpinn.segment import Segment, SegmentInfo
from accpinn.segment.cut import DURATION, complete_windows, default_vehicles, first_window
from accpinn.study import Analysis, Source
from accpinn.study.comparison import Refused
from accpinn.study.dropped import Dropped
from accpinn.study.judge import Judgement, Subject
from accpinn.study.result import Result
from accpinn.study.run import analysis_of
from accpinn.study.snapshot import prepare_snapshot
from accpinn.study.store import Entry
from accpinn.study.verification import Verification
from accpinn.tasks import (
    Part,
    Task,
    comparison_task,
    judgement_task,
    series_task,
    starts_task,
    training_task,
    verification_task,
)
from pages.ui.session import resources
from pages.ui.session.pending import Pending
from pages.ui.session.resources import library

Found = TypeVar("Found")
ParameterSource = Literal["estimate", "several", "published", "snapshot", "hand"]
"""Where the vehicles on pages Stability and Platoon are from."""
KEPT_RECORDINGS, KEPT_EARLIER = 4, 2 * len(VARIANTS)
"""Recordings that a session keeps open; results of two comparisons, and as many changes of the
segment that can be undone."""
NOTHING = Analysis(Source("", "", None, ""), (), (Window(0.0, DURATION),))
"""What is asked before anything is open."""
TITLE_OF = {preset: about.title for preset, about in PRESET_INFOS.items()}
"""The presets' names on pages, in their order."""
Step = tuple[Analysis, tuple[float, ...] | None, Result | None]
"""What was asked, the starts of the windows, and the result."""
TRAINING, LEFT = "training", "earlier training"
"""Kinds of the present training and of one that was left, which a new training does not end."""


def digest(secret: str) -> str:
    """What the server keeps in place of a secret, as of a session's name."""
    return sha256(secret.encode()).hexdigest()


@dataclass(frozen=True, eq=False)
class Left:
    """A training that goes on while something else is open, and what was open with it."""

    task: Task[Result]
    recording: Recording | None
    restored: Result | None
    """The result that was shown until it has one; its data where there is no recording."""


@dataclass(eq=False)
class Workspace:
    """The steps of one user, first to last: recording, segment, result."""

    id: str
    """Its secret name, which nobody but its own browser learns."""
    owner: str = ""
    """Who uses it, as the store keeps that: see `pages.ui.session.sessions.owner_mark`."""
    browsers: set[str] = field(default_factory=set)
    """Digests of the cookies of the browsers that began it or agreed to use it."""
    recording: Recording | None = None
    pending: Pending | None = None
    """A table whose columns, or one of whose runs, are to be confirmed before it is opened."""
    table: File | None = None
    """The table that was opened last by a mapping, to be read by another one."""
    mappings: dict[tuple[str, ...], CsvMapping] = field(default_factory=dict)
    """Mappings that nothing in the data contradicted, by the names of the columns they served."""
    awaited: Analysis | None = None
    """What was on the screen before a restart of the server, until a recording is opened."""
    asked: Analysis = NOTHING
    """Vehicles, window, Case and excluded regimes as chosen; see `analysis`."""
    window_starts: tuple[float, ...] | None = None
    """Starts of the windows in car-following to train on; None for all of them, empty for the
    chosen window alone."""
    segment: Segment | None = None
    fault: str = ""
    """Why there is no segment."""
    preset: PresetName = DEFAULT
    """This one stands for the recommended method of the model, whichever that is."""
    settings: dict[str, dict[str, Any]] = field(default_factory=dict)
    """Per preset, the settings that differ from it."""
    specs: dict[str, ModelSpec] = field(default_factory=dict)
    """Per preset, the model that was chosen in place of its usual one."""
    training: Task[Result] | None = None
    comparison: Task[Result | Refused | Adequacy] | None = None
    """All methods on the windows, while they run and when they are done."""
    starts: Task[Result] | None = None
    """Trainings of the windows from several initial values."""
    reproduction: Task[Result] | None = None
    """Trainings of what the paper's tables take, whatever recording is open."""
    judgement: Task[tuple[Judgement, ...]] | None = None
    """Car-following models on the recording's windows."""
    cars: dict[int, Task[Result]] = field(default_factory=dict)
    """Followers estimated alone, by their numbers in the open recording."""
    verifications: dict[str, Task[Verification]] = field(default_factory=dict)
    """Running and ended verifications of snapshots, by the snapshots' short names."""
    left: tuple["Left", ...] = ()
    """Trainings that go on although something else was opened or chosen, the latest last."""
    ended: tuple[str, ...] = ()
    """Kinds of other tasks that ended because something else was opened or chosen, until said."""
    restored: Result | None = None
    """The result shown while no newer training has one: a snapshot, or an earlier training."""
    validation: Segment | None = None
    """The window on which the learned parameters are validated."""
    earlier: tuple[Result, ...] = ()
    """Results that are no longer current, as rows of a table, oldest first."""
    viewed: str = ""
    """Short name of the snapshot that page Snapshots shows in full; empty for the list."""
    chosen_source: ParameterSource = "estimate"
    """As chosen last; see `parameter_source`."""
    source_result: Result | None = None
    """The result when the source was chosen; a newer one is shown in place of the choice."""
    choices: dict[str, Any] = field(default_factory=dict)
    """What else was chosen, by the widget's key: a page switch or a reload loses none of it."""
    dropped: Dropped = field(default_factory=Dropped)
    """Files that were dropped on page Database for a batch that is not started yet."""
    opened: dict[str, Recording] = field(default_factory=dict)
    """The recordings opened last, by their SHA-256."""
    steps: tuple[Step, ...] = ()
    """What `undo` goes back to, the last one first."""
    kept_judgements: tuple[Judgement, ...] = ()
    """Those that the store has."""
    kept: bytes = b""
    """What the store was last told of this session; see `pages.ui.session.sessions`."""

    @property
    def key(self) -> str:
        """What the store keeps in place of its name."""
        return digest(self.id)

    # What is on the screen

    @property
    def is_empty(self) -> bool:
        """Whether nothing was opened in it yet."""
        return self.recording is None and self.restored is None and not self.opened

    @property
    def nbytes(self) -> int:
        """Memory that its recordings take, and the files of its tables and batches, in bytes."""
        known = sum(recording.nbytes for recording in self.opened.values())
        held = {id(file): file for file in (self.table, self.pending and self.pending.file) if file}
        others = {id(one.recording): one.recording for one in self.left if one.recording}
        away = (other for other in others.values() if self.opened.get(other.sha256) is not other)
        files = sum(file.nbytes for file in held.values())
        return known + files + self.dropped.nbytes + sum(other.nbytes for other in away)

    @property
    def spec(self) -> ModelSpec:
        """The model that a training estimates."""
        return self._spec_of(self.preset)

    def _spec_of(self, preset: PresetName) -> ModelSpec:
        return self.specs.get(preset, PRESET_METHOD.usual_spec(PRESETS[preset]))

    def analysis(self, preset: PresetName | None = None) -> Analysis | None:
        """What a training by a preset, by default the chosen one, would answer.

        It is None where no data are at hand.

        Raises:
            ConfigError: a setting outside its range, as one sentence.
        """
        preset = preset or self.preset
        asked = replace(self.asked, spec=self._spec_of(preset))
        if self.recording:
            asked = replace(asked, source=Source.of(self.recording), windows=self.windows)
        elif self.restored and self.segment:
            # The key is that of the data at hand: what a file says of its recording is unchecked.
            asked = analysis_of(self.restored.segments, asked)
        else:
            return None
        if preset == DEFAULT:
            method = recommended_method(asked.spec.model)
            if method != PRESET_METHOD.key:
                return asked.with_method(method)
        settings = PRESETS[preset].to_json() | self.settings.get(preset, {})
        return asked.with_method(PRESET_METHOD.key, PinnConfig.from_json(settings))

    @property
    def several_windows(self) -> tuple[Window, ...]:
        """The windows in car-following of the recording, if these are chosen; else empty."""
        starts = self.window_starts
        if not self.recording or starts == ():
            return ()
        every = resources.windows_in_car_following(self.recording, self.asked.vehicles)
        return tuple(window for window in every if window.start in (starts or ())) or every

    @property
    def windows(self) -> tuple[Window, ...]:
        """What a training takes: several windows, or the chosen one."""
        if self.restored and not self.recording:
            return self.restored.analysis.windows
        return self.several_windows or (self.asked.window,)

    @property
    def segments(self) -> Segments:
        """(K,) the data of these windows; empty where the chosen one cannot be used.

        Raises:
            SegmentError: where one of several cannot be used.
        """
        recording = self.recording
        if recording and self.several_windows:
            return tuple(self._segment_of(recording, window) for window in self.windows)
        if self.restored and not recording:
            return self.restored.segments
        return (self.segment,) if self.segment else ()

    @property
    def result(self) -> Result | None:
        """The training's, or until it has one, the result before it; None before there is any."""
        return (self.training and self.training.result) or self.restored

    @property
    def info(self) -> SegmentInfo | None:
        """What is known of the segment; None where there is none."""
        return self.segment.info if self.segment else None

    @property
    def true_parameters(self) -> Parameters | None:
        """One entry a follower of the segment; None where the truth is not known."""
        truth = resources.truth_of(self.recording) if self.recording else None
        followers = [number - 2 for number in self.asked.vehicles[1:]]
        return truth.parameters[followers] if truth else None

    @property
    def compared(self) -> tuple[Result, ...]:
        """The results of the methods, as far as they were run, the recommended one first."""
        rows = self.restored.compared if self.restored else ()
        if self.comparison:
            rows = tuple(row for row in self.comparison.results if isinstance(row, Result))
        places = {name: place for place, name in enumerate(VARIANTS)}

        def place(row: Result) -> tuple[bool, int]:
            asked = row.analysis
            is_recommended = asked.method == recommended_method(asked.spec.model)
            name = variant_name(asked.method, asked.settings)
            return not (is_recommended and asked.has_posterior), places.get(name, len(places))

        return tuple(sorted(rows, key=place))

    def compared_with_training(self) -> tuple[Result, ...]:
        """The same, and the training finished on the same windows with settings of its own."""
        rows, result = self.compared, self.result
        if not rows or result is None or not result.is_finished:
            return rows
        asked = result.analysis
        if asked.windows != rows[0].analysis.windows:
            return rows
        return rows if any(row.analysis.key == asked.key for row in rows) else (*rows, result)

    @property
    def runs(self) -> tuple[Entry, ...]:
        """The finished trainings that this session has shown, the newest first."""
        entries = resources.store().entries(session=self.key)
        return tuple(entry for entry in entries if not entry.fault)

    def as_snapshot(self, name: str = "", note: str = "") -> Result:
        """The current result with all that the session knows of it.

        Raises:
            SnapshotError: where there is no result.
        """
        result, restored = self.result, self.restored
        if result is None:
            raise SnapshotError("There is no result to save; train on a window.")
        facts = result.facts or (restored.facts if restored else {})
        rows = tuple(row for row in self.compared if _data_of(row) == _data_of(result))
        whole = replace(result, facts=facts, compared=rows, judgements=self.judgements)
        return prepare_snapshot(whole, name, note)

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
            asked = Analysis.of(recording, (window,), vehicles)
        self._leave()
        self._leave_recording()
        self.recording = recording
        self.segment = self.validation = None
        self.remember(recording)
        self._ask(asked)
        self.window_starts, self.steps = starts, ()

    @property
    def table_of_recording(self) -> File | None:
        """The table from which the open recording was read by a mapping; None without it."""
        recording, table = self.recording, self.table
        if not (recording and recording.mapping and table):
            return None
        is_same = table.content.sha256(recording.trajectory) == recording.sha256
        return table if is_same else None

    def remember(self, recording: Recording) -> None:
        """Put a recording among those opened last."""
        self.opened = {**self.opened, recording.sha256: recording}
        for oldest in list(self.opened)[:-KEPT_RECORDINGS]:
            del self.opened[oldest]

    def remember_beside(self, recording: Recording) -> None:
        """The same of one that is not shown; the recording that is shown stays the latest."""
        self.remember(recording)
        if self.recording:
            self.opened.pop(self.recording.sha256, None)
            self.remember(self.recording)

    def restore(self, result: Result, recording: Recording | None = None) -> None:
        """Show a result on every page.

        The open recording stays if the result is of it, unless another is given.
        """
        self._leave()
        given = recording or self.recording
        result = result.found_in(given)
        if result.recording is not self.recording:
            self._leave_recording()
        self.recording = given if result.recording else None
        if self.recording:
            self.remember(self.recording)
        self.segment, self.fault = result.segment, ""
        self.choose_source("estimate")
        self.restored, self.steps = result, ()
        self.take(result.analysis)

    def take(self, asked: Analysis) -> None:
        """Choose all that an analysis asks, as far as page Train offers its method."""
        self.asked = replace(asked, windows=(asked.window,))
        self.window_starts = _starts(asked)
        if asked.method == PRESET_METHOD.key:
            with suppress(ConfigError):
                config = PinnConfig.from_json(asked.settings)
                self.preset, self.settings[config.preset] = config.preset, config.changes()
        elif asked.has_posterior:
            self.preset = DEFAULT
        else:
            return
        self.specs[self.preset] = asked.spec

    def choose(self, window: Window | None = None, **changes: Any) -> None:
        """Change the window or other parts of what is asked; earlier results become rows.

        Args:
            window: by default the present one.
            changes: fields of an `Analysis`: vehicles, case or excluded.
        """
        self._ask(replace(self.asked, windows=(window or self.asked.window,), **changes))

    def choose_all(self, asked: Analysis) -> None:
        """Choose all that an analysis asks of the open recording; earlier results become rows."""
        self.choose(asked.window, vehicles=asked.vehicles, case=asked.case, excluded=asked.excluded)
        self.take(asked)

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
        self._cut()

    def _cut(self) -> None:
        """Cut the chosen window; where that is impossible, the reason is kept."""
        try:
            if self.recording:
                self.segment = self._segment_of(self.recording, self.asked.window)
            elif self.restored:
                self.segment = self.restored.segment
            self.fault = ""
        except SegmentError as fault:
            self.segment, self.fault = None, str(fault)

    def undo(self) -> None:
        """Take back the last change of the segment; what was learned before it is shown again."""
        *steps, (asked, starts, result) = self.steps
        self._ask(asked)
        self.window_starts, self.restored, self.steps = starts, result, tuple(steps)
        with suppress(ConfigError):  # the page shows what is wrong with a setting
            if self.left and (asked_now := self.analysis()):
                self._rejoined(asked_now)

    def choose_model(self, model: str) -> None:
        """Choose the model of the present preset, by its key; results stay."""
        self.specs[self.preset] = ModelSpec(model)

    def train(self, anew: bool = False) -> None:
        """Queue a training of the windows; ``anew``: from no checkpoint of an earlier one.

        Raises:
            ConfigError: a setting outside its range, or a model that the preset cannot have.
        """
        asked = self.analysis()
        if asked and self.segment:
            if not (self.restored and self.restored.id):
                self.restored = self.result
            self._record([self.result])
            self.choose_source("estimate")
            if self._rejoined(asked):
                return
            task = training_task(
                self.id, asked, self.recording, resources.store(), self._data, anew,
                shown_to=self._shown_to,
            )  # fmt: skip
            self.training = self._submit(task)

    def estimate_car(self, vehicle: int, model: str) -> None:
        """Queue the estimate of one follower alone, in its own windows in car-following."""
        recording, pair = self.recording, (vehicle - 1, vehicle)
        if recording is None:
            return
        windows = resources.windows_in_car_following(recording, pair) or self.windows
        asked = Analysis.of(recording, windows, pair, excluded=self.asked.excluded, model=model)
        kind = f"estimate of {recording.label(vehicle)}"
        task = training_task(
            self.id, asked, recording, resources.store(), kind=kind, shown_to=self._shown_to
        )
        self.cars[vehicle] = self._submit(task)
        self.choose_source("several")

    def verify(self, snapshot: Result, recording: Recording | None) -> None:
        """Queue the verification of a snapshot, also against its recording where that is given."""
        task = verification_task(self.id, snapshot, recording, library())
        self.verifications[snapshot.id] = self._submit(task)

    def use_models(self, models: Mapping[int, str]) -> None:
        """Let followers have models, by number: those of another than the result's are estimated.

        Pages Stability and Platoon then show the cars together.
        """
        result = self.result if self.result and self.result.is_finished else None
        for vehicle, model in models.items():
            task = self.cars.get(vehicle)
            if result and vehicle in result.info.vehicles[1:] and result.estimate.model == model:
                if task:
                    task.stop()
                self.cars.pop(vehicle, None)
            elif not (task and task.analysis and task.analysis.spec.model == model and (
                task.is_active or task.result
            )):  # fmt: skip
                if task:
                    task.stop()
                self.estimate_car(vehicle, model)
        self.choose_source("several" if self.cars else "estimate")

    def _submit(self, task: Task[Found]) -> Task[Found]:
        """Queue a task; all sessions of a user take turns with others as one."""
        return resources.task_queue().submit(task, self.owner or self.key)

    @property
    def _shown_to(self) -> tuple[str, ...]:
        """Who may list what is found here: the session, and whoever uses it."""
        return tuple(dict.fromkeys((self.key, self.owner or self.key)))

    @property
    def own_results(self) -> dict[int, Result]:
        """The finished results of followers estimated alone, by number."""
        known = {vehicle: task.result for vehicle, task in self.cars.items()}
        return {k: result for k, result in known.items() if result and result.is_finished}

    @property
    def _data(self) -> Segments:
        """The data of a task where there is no recording to cut them from."""
        return () if self.recording else self.segments

    def _segment_of(self, recording: Recording, window: Window) -> Segment:
        return resources.segment_of(recording, window, self.asked.vehicles, self.asked.excluded)

    def compare(self) -> None:
        """Queue all methods on the windows."""
        asked = self.analysis(DEFAULT)
        if asked and self.segment:
            self._record(self.compared)
            task = comparison_task(self.id, asked, self.recording, self.segments)
            self.comparison = self._submit(task)

    def train_starts(self, preset: PresetName) -> None:
        """Queue a training on the windows from each of five initial values."""
        asked = self.analysis(preset)
        if asked and self.segment:
            task = starts_task(self.id, asked, self.recording, resources.store(), self._data)
            self.starts = self._submit(task)

    def reproduce(self, parts: Sequence[Part]) -> None:
        """Queue the trainings of the paper's tables."""
        task = series_task(
            self.id, "reproduction", parts, resources.store(), shown_to=self._shown_to
        )
        self.reproduction = self._submit(task)

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
        self.judgement = self._submit(judgement_task(self.id, self.subjects, models))

    @property
    def judgements(self) -> tuple[Judgement, ...]:
        """What was judged, now or with the result; empty before that."""
        known = self.result.judgements if self.result else ()
        return (self.judgement and self.judgement.result) or known

    def keep_judgements(self) -> None:
        """Keep what was judged with the result; a snapshot's does not enter the store."""
        result, judged = self.result, self.judgements
        if not result or result.id or judged in (result.judgements, self.kept_judgements):
            return
        self.kept_judgements = judged
        if result.is_finished:
            resources.store().keep(replace(result, judgements=judged))

    @property
    def tasks(self) -> tuple[Task[Any], ...]:
        """All that were asked for."""
        others = (self.reproduction,) if self.reproduction else ()
        verifying, left = self.verifications.values(), (one.task for one in self.left)
        return (*self._of_segment, *self.cars.values(), *others, *verifying, *left)

    @property
    def _of_segment(self) -> tuple[Task[Any], ...]:
        every = (self.training, self.comparison, self.starts, self.judgement)
        return tuple(task for task in every if task)

    def _leave(self) -> None:
        """Make rows of the present results, and end what still runs on this segment.

        A training goes on: its result is among the session's runs once it is there.
        """
        self._record([*self.compared, self.result])
        self.chosen_source = self.parameter_source
        if self.training:
            self._leave_running(self.training)
        for task in self._of_segment:
            if task is not self.training:
                self.ended += (task.kind,) * task.is_active
                task.stop()
        self.training = self.comparison = self.starts = self.judgement = self.restored = None

    def _rejoined(self, asked: Analysis) -> bool:
        """Whether a training of an equal analysis was left and still runs; it is the present one.

        A training is not run twice.
        """
        for left in self.left:
            earlier = left.task.analysis
            if left.task.is_active and earlier and earlier.key == asked.key:
                self._take_up(left)
                return True
        return False

    def _leave_running(self, task: Task[Result]) -> None:
        """Put a training that runs or waits among those that were left."""
        if task.is_active and not task.is_stopping:
            task.kind = LEFT
            self.left = (*self.left, Left(task, self.recording, self.restored))

    def go_back(self, left: Left) -> None:
        """Open again what was open with a training that was left, and that training."""
        asked = left.task.analysis
        assert asked is not None
        self._leave()
        if left.recording is not self.recording:
            self._leave_recording()
        self.recording, self.restored, self.steps = left.recording, left.restored, ()
        if self.recording:
            self.remember(self.recording)
        self.validation = None
        self.take(asked)
        self.choose_source("estimate")
        self._cut()
        self._take_up(left)

    def forget(self, left: Left) -> None:
        """Name a training that was left no longer; its result stays among the runs."""
        self.left = tuple(one for one in self.left if one is not left)

    def _take_up(self, left: Left) -> None:
        """Make a training that was left the present one again."""
        self.forget(left)
        left.task.kind = TRAINING
        self.training = left.task

    def _leave_recording(self) -> None:
        """Forget the cars of the recording; the estimates that still run go on."""
        for task in self.cars.values():
            self._leave_running(task)
        self.cars = {}

    def _record(self, results: Sequence[Result | None]) -> None:
        """Keep results as rows, in place of earlier ones of equal analyses."""
        for result in filter(None, results):
            key = result.analysis.key
            others = [row for row in self.earlier if row.analysis.key != key]
            self.earlier = (*others, result)[-KEPT_EARLIER:]

    # Parameters of pages Stability and Platoon

    @property
    def parameter_source(self) -> ParameterSource:
        """Where the parameters on Stability and Platoon are from: as chosen, or a newer result."""
        is_newer = self.result is not None and self.result is not self.source_result
        return "estimate" if is_newer else self.chosen_source

    def choose_source(self, source: ParameterSource) -> None:
        """Choose where those parameters are from, until there is a newer result."""
        self.chosen_source, self.source_result = source, self.result

    def keep(self, key: str) -> Callable[[Any], None]:
        """What keeps a choice under that key."""
        return lambda value: self.choices.update({key: value})


def _data_of(result: Result) -> list[str]:
    """What tells whether two results are of the same data."""
    return [info.digest for info in result.infos]


def _starts(asked: Analysis) -> tuple[float, ...]:
    """The starts of several windows; empty for a single one."""
    starts = tuple(window.start for window in asked.windows)
    return starts if len(starts) > 1 else ()
