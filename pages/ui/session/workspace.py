"""A session's state: recording, choices, tasks and results; an earlier step drops later ones."""

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
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
from accpinn.segment.cut import DURATION, default_vehicles
from accpinn.segment.windows import complete_windows, first_window
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
from pages.ui.session.users import digest

R = TypeVar("R")
ParameterSource = Literal["estimate", "several", "published", "snapshot", "hand"]
"""Source of the vehicles on pages Stability and Platoon."""
MOST_RECORDINGS, MOST_EARLIER = 4, 2 * len(VARIANTS)
"""Largest number of open recordings; of earlier results, two
comparisons; of changes of the segment that can be undone, as many."""
NOTHING = Analysis(Source("", "", None, ""), (), (Window(0.0, DURATION),))
"""The selection before anything is open."""
TITLE_OF = {preset: about.title for preset, about in PRESET_INFOS.items()}
"""Names of the presets on pages, in their order."""
Step = tuple[Analysis, tuple[float, ...] | None, Result | None]
"""A former selection, its starts of windows, and its result."""
TRAINING, LEFT = "training", "earlier training"
"""Kinds of task: the present training, and one that was left, which a new training does not end."""


@dataclass(frozen=True, eq=False)
class Left:
    """A training that goes on while something else is open, with its recording and result."""

    task: Task[Result]
    recording: Recording | None
    restored: Result | None
    """The result shown until the training has one; its data where there is no recording."""


@dataclass(eq=False)
class Workspace:
    """What one session has open and does: recording, selection, tasks, result."""

    id: str
    """Secret name, which only the session's browser learns."""
    owner: str = ""
    """Digest of its user; see `pages.ui.session.users.owner_mark`."""
    browsers: set[str] = field(default_factory=set)
    """Digests of the cookies of the browsers that began it or agreed to use it."""
    recording: Recording | None = None
    pending: Pending | None = None
    """A table whose columns, or one of whose runs, are to be confirmed before it is opened."""
    table: File | None = None
    """The table opened last by a mapping, which another mapping can read again."""
    mappings: dict[tuple[str, ...], CsvMapping] = field(default_factory=dict)
    """Mappings that no data contradicted, by the names of the columns they read."""
    awaited: Analysis | None = None
    """The analysis on the screen before a restart of the server, until a recording is opened."""
    selection: Analysis = NOTHING
    """Vehicles, window, Case and excluded regimes as chosen; `analysis` adds model and method."""
    window_starts: tuple[float, ...] | None = None
    """Starts of the windows in car-following to train on; None for all of them, empty for the
    chosen window alone."""
    segment: Segment | None = None
    fault: str = ""
    """The reason why there is no segment, as a sentence."""
    preset: PresetName = DEFAULT
    """The chosen preset; the default one stands for the model's recommended method."""
    settings: dict[str, dict[str, Any]] = field(default_factory=dict)
    """Settings that differ from the preset, by preset."""
    specs: dict[str, ModelSpec] = field(default_factory=dict)
    """Models chosen in place of a preset's usual one, by preset."""
    training: Task[Result] | None = None
    comparison: Task[Result | Refused | Adequacy] | None = None
    """The run of all methods on the windows."""
    restarts: Task[Result] | None = None
    """Trainings of the windows from several initial values."""
    reproduction: Task[Result] | None = None
    """Trainings for the paper's tables, whatever recording is open."""
    judgement: Task[tuple[Judgement, ...]] | None = None
    """The comparison of car-following models on the recording's windows."""
    cars: dict[int, Task[Result]] = field(default_factory=dict)
    """Estimates of single followers, by their numbers in the open recording."""
    verifications: dict[str, Task[Verification]] = field(default_factory=dict)
    """Verifications of snapshots, running or ended, by the snapshots' short names."""
    left: tuple["Left", ...] = ()
    """Trainings that go on although something else was opened or chosen, newest last."""
    ended: tuple[str, ...] = ()
    """Kinds of tasks that ended because something else was opened, until a page reports them."""
    restored: Result | None = None
    """A snapshot or an earlier training, shown until the present training has a result."""
    validation: Segment | None = None
    """The window on which the learned parameters are validated."""
    earlier: tuple[Result, ...] = ()
    """Results that are no longer current, oldest first."""
    viewed: str = ""
    """Short name of the snapshot that page Snapshots shows in full; empty for the list."""
    chosen_source: ParameterSource = "estimate"
    """The source chosen last; `parameter_source` also considers newer results."""
    source_result: Result | None = None
    """The result when the source was chosen; a newer one replaces the choice."""
    choices: dict[str, Any] = field(default_factory=dict)
    """Values of other widgets by their keys, which survive a page switch and a reload."""
    dropped: Dropped = field(default_factory=Dropped)
    """Files dropped on page Database for a batch that has not started."""
    opened: dict[str, Recording] = field(default_factory=dict)
    """The recordings opened last, by SHA-256, newest last."""
    undo_stack: tuple[Step, ...] = ()
    """Former selections that `undo` goes back to, newest last."""
    stored_judgements: tuple[Judgement, ...] = ()
    """The judgements that the store has."""
    stored: bytes = b""
    """The document of this session in the store; see `pages.ui.session.sessions`."""

    @property
    def key(self) -> str:
        """The digest that the store keeps in place of the secret name."""
        return digest(self.id)

    # What is on the screen

    @property
    def is_empty(self) -> bool:
        """Whether nothing has been opened yet."""
        return self.recording is None and self.restored is None and not self.opened

    @property
    def nbytes(self) -> int:
        """Memory of its recordings and of the files of its tables and batches, in bytes."""
        recordings = [*self.opened.values(), *(left.recording for left in self.left)]
        tables = [self.table, self.pending and self.pending.file]
        held = {id(part): part.nbytes for part in (*recordings, *tables) if part}
        return sum(held.values()) + self.dropped.nbytes

    @property
    def spec(self) -> ModelSpec:
        """The model that a training will estimate."""
        return self._spec_of(self.preset)

    def _spec_of(self, preset: PresetName) -> ModelSpec:
        return self.specs.get(preset, PRESET_METHOD.usual_spec(PRESETS[preset]))

    def analysis(self, preset: PresetName | None = None) -> Analysis | None:
        """The analysis of a training by a preset, by default the chosen one; None without data.

        Raises:
            ConfigError: a setting outside its range, as one sentence.
        """
        preset = preset or self.preset
        analysis = replace(self.selection, spec=self._spec_of(preset))
        if self.recording:
            analysis = replace(analysis, source=Source.of(self.recording), windows=self.windows)
        elif self.restored and self.segment:
            # The key is that of the data at hand: a file's word on its recording is unchecked.
            analysis = analysis_of(self.restored.segments, analysis)
        else:
            return None
        if preset == DEFAULT:
            method = recommended_method(analysis.spec.model)
            if method != PRESET_METHOD.key:
                return analysis.with_method(method)
        settings = PRESETS[preset].to_json() | self.settings.get(preset, {})
        return analysis.with_method(PRESET_METHOD.key, PinnConfig.from_json(settings))

    @property
    def several_windows(self) -> tuple[Window, ...]:
        """The recording's windows in car-following if several are chosen; else empty."""
        starts = self.window_starts
        if not self.recording or starts == ():
            return ()
        windows = resources.windows_in_car_following(self.recording, self.selection.vehicles)
        return tuple(window for window in windows if window.start in (starts or ())) or windows

    @property
    def windows(self) -> tuple[Window, ...]:
        """The windows of a training: several, or the chosen one."""
        if self.restored and not self.recording:
            return self.restored.analysis.windows
        return self.several_windows or (self.selection.window,)

    @property
    def segments(self) -> Segments:
        """The data of these windows (K,); empty where the chosen one cannot be used.

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
        """The training's result, or until it has one the result before it; None without any."""
        return (self.training and self.training.result) or self.restored

    @property
    def info(self) -> SegmentInfo | None:
        """Vehicles, window and source of the segment; None without one."""
        return self.segment.info if self.segment else None

    @property
    def true_parameters(self) -> Parameters | None:
        """True parameters of the segment's followers; None where they are unknown."""
        truth = resources.truth_of(self.recording) if self.recording else None
        followers = [number - 2 for number in self.selection.vehicles[1:]]
        return truth.parameters[followers] if truth else None

    @property
    def compared(self) -> tuple[Result, ...]:
        """The results of the methods that have run, the recommended one first."""
        rows = self.restored.compared if self.restored else ()
        if self.comparison:
            rows = tuple(row for row in self.comparison.results if isinstance(row, Result))
        places = {name: place for place, name in enumerate(VARIANTS)}

        def place(row: Result) -> tuple[bool, int]:
            analysis = row.analysis
            is_recommended = analysis.method == recommended_method(analysis.spec.model)
            name = variant_name(analysis.method, analysis.settings)
            return not (is_recommended and analysis.has_posterior), places.get(name, len(places))

        return tuple(sorted(rows, key=place))

    def compared_with_training(self) -> tuple[Result, ...]:
        """These results, and that of a training of the same windows with other settings."""
        rows, result = self.compared, self.result
        if not rows or result is None or not result.is_finished:
            return rows
        analysis = result.analysis
        if analysis.windows != rows[0].analysis.windows:
            return rows
        return rows if any(row.analysis.key == analysis.key for row in rows) else (*rows, result)

    @property
    def runs(self) -> tuple[Entry, ...]:
        """The finished trainings that this session has shown, newest first."""
        entries = resources.store().entries(session=self.key)
        return tuple(entry for entry in entries if not entry.fault)

    def as_snapshot(self, name: str = "", note: str = "") -> Result:
        """The current result with the comparison and the judgements of the same data.

        Raises:
            SnapshotError: where there is no result.
        """
        result, restored = self.result, self.restored
        if result is None:
            raise SnapshotError("There is no result to save; train on a window.")
        facts = result.facts or (restored.facts if restored else {})
        digests = [info.digest for info in result.infos]
        rows = tuple(row for row in self.compared if digests == [i.digest for i in row.infos])
        whole = replace(result, facts=facts, compared=rows, judgements=self.judgements)
        return prepare_snapshot(whole, name, note)

    # Steps

    def open(self, recording: Recording) -> None:
        """Open a recording and select its longest platoon and the first window without holes.

        The recording of a restored result completes that; the one that is open changes nothing.
        """
        awaited, self.awaited = self.awaited, None
        restored, present = self.restored, self.recording
        if present and (present.sha256, present.digest) == (recording.sha256, recording.digest):
            return
        if restored and not self.recording and restored.found_in(recording).recording:
            self.restore(restored, recording)
            return
        vehicles = default_vehicles(recording)
        if awaited and awaited.source.sha256 == recording.sha256:
            selection, starts = replace(awaited, windows=(awaited.window,)), _window_starts(awaited)
        else:
            window, starts = first_window(recording, complete_windows(recording, vehicles)), None
            selection = Analysis.of(recording, (window,), vehicles)
        self._leave()
        self._leave_recording()
        self.recording = recording
        self.segment = self.validation = None
        self.remember(recording)
        self._select(selection)
        self.window_starts, self.undo_stack = starts, ()

    @property
    def table_of_recording(self) -> File | None:
        """The table from which the open recording was read by a mapping; None without it."""
        recording, table = self.recording, self.table
        if not (recording and recording.mapping and table):
            return None
        is_same = table.content.sha256(recording.trajectory) == recording.sha256
        return table if is_same else None

    def remember(self, recording: Recording) -> None:
        """Add a recording to those opened last."""
        self.opened = {**self.opened, recording.sha256: recording}
        for oldest in list(self.opened)[:-MOST_RECORDINGS]:
            del self.opened[oldest]

    def remember_beside(self, recording: Recording) -> None:
        """Add a recording that is not shown; the shown one stays the latest."""
        self.remember(recording)
        if self.recording:
            self.opened.pop(self.recording.sha256, None)
            self.remember(self.recording)

    def restore(self, result: Result, recording: Recording | None = None) -> None:
        """Show a result on every page.

        The open recording stays if the result is of it, unless another is given.
        """
        self._leave()
        recording = recording or self.recording
        result = result.found_in(recording)
        if result.recording is not self.recording:
            self._leave_recording()
        self.recording = recording if result.recording else None
        if self.recording:
            self.remember(self.recording)
        self.segment, self.fault = result.segment, ""
        self.choose_source("estimate")
        self.restored, self.undo_stack = result, ()
        self.take(result.analysis)

    def take(self, analysis: Analysis) -> None:
        """Select the data of an analysis, and its method and model where page Train offers them."""
        self.selection = replace(analysis, windows=(analysis.window,))
        self.window_starts = _window_starts(analysis)
        if analysis.method == PRESET_METHOD.key:
            with suppress(ConfigError):
                config = PinnConfig.from_json(analysis.settings)
                self.preset, self.settings[config.preset] = config.preset, config.changes()
        elif analysis.has_posterior:
            self.preset = DEFAULT
        else:
            return
        self.specs[self.preset] = analysis.spec

    def choose(self, window: Window | None = None, **changes: Any) -> None:
        """Change the window or other parts of the selection; earlier results become rows.

        Args:
            window: by default the present one.
            changes: fields of an `Analysis`: vehicles, case or excluded.
        """
        self._select(replace(self.selection, windows=(window or self.selection.window,), **changes))

    def choose_all(self, analysis: Analysis) -> None:
        """Choose an analysis of the open recording; earlier results become rows."""
        data = {name: getattr(analysis, name) for name in ("vehicles", "case", "excluded")}
        self.choose(analysis.window, **data)
        self.take(analysis)

    def _select(self, selection: Analysis) -> None:
        before, self.selection = self.selection, selection
        if selection == before and self.segment:
            return
        step = before, self.window_starts, self.result
        self.undo_stack = (*self.undo_stack, step)[-MOST_EARLIER:]
        self._leave()
        if selection.window != before.window:
            self.window_starts = ()
        elif selection.vehicles != before.vehicles:  # other vehicles have other windows
            self.window_starts = None if self.window_starts else self.window_starts
        self._cut()

    def _cut(self) -> None:
        """Cut the chosen window, or keep the reason why that is impossible."""
        try:
            if self.recording:
                self.segment = self._segment_of(self.recording, self.selection.window)
            elif self.restored:
                self.segment = self.restored.segment
            self.fault = ""
        except SegmentError as fault:
            self.segment, self.fault = None, str(fault)

    def undo(self) -> None:
        """Take back the last change of the segment, and show the result before it again."""
        *steps, (selection, starts, result) = self.undo_stack
        self._select(selection)
        self.window_starts, self.restored, self.undo_stack = starts, result, tuple(steps)
        with suppress(ConfigError):  # the page shows what is wrong with a setting
            if self.left and (analysis := self.analysis()):
                self._rejoin(analysis)

    def choose_model(self, model: str) -> None:
        """Choose the model of the present preset by its key; results stay."""
        self.specs[self.preset] = ModelSpec(model)

    def train(self, anew: bool = False) -> None:
        """Queue a training of the windows; ``anew`` ignores the checkpoint of an earlier one.

        Raises:
            ConfigError: a setting outside its range, or a model that the preset cannot have.
        """
        analysis = self.analysis()
        if analysis and self.segment:
            if not (self.restored and self.restored.id):
                self.restored = self.result
            self._record([self.result])
            self.choose_source("estimate")
            if self._rejoin(analysis):
                return
            task = training_task(
                self.id, analysis, self.recording, resources.store(), self._data, anew,
                shown_to=self._shown_to,
            )  # fmt: skip
            self.training = self._submit(task)

    def estimate_car(self, vehicle: int, model: str) -> None:
        """Queue the estimate of a single follower in its windows in car-following."""
        recording, pair = self.recording, (vehicle - 1, vehicle)
        if recording is None:
            return
        windows = resources.windows_in_car_following(recording, pair) or self.windows
        excluded = self.selection.excluded
        analysis = Analysis.of(recording, windows, pair, excluded=excluded, model=model)
        kind = f"estimate of {recording.label(vehicle)}"
        task = training_task(
            self.id, analysis, recording, resources.store(), kind=kind, shown_to=self._shown_to
        )
        self.cars[vehicle] = self._submit(task)
        self.choose_source("several")

    def verify(self, snapshot: Result, recording: Recording | None) -> None:
        """Queue the verification of a snapshot, and of its data where a recording is given."""
        task = verification_task(self.id, snapshot, recording, library())
        self.verifications[snapshot.id] = self._submit(task)

    def use_models(self, models: Mapping[int, str]) -> None:
        """Choose models by follower number, and estimate the followers whose result has another.

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

    def _submit(self, task: Task[R]) -> Task[R]:
        """Queue a task; all sessions of one user share the user's turn."""
        return resources.task_queue().submit(task, self.owner or self.key)

    @property
    def _shown_to(self) -> tuple[str, ...]:
        """Digests of those who may list a result of this session: the session and its user."""
        return tuple(dict.fromkeys((self.key, self.owner or self.key)))

    @property
    def own_results(self) -> dict[int, Result]:
        """The finished estimates of single followers, by number."""
        results = {vehicle: task.result for vehicle, task in self.cars.items()}
        return {k: result for k, result in results.items() if result and result.is_finished}

    @property
    def _data(self) -> Segments:
        """The data of a task without a recording to cut them from."""
        return () if self.recording else self.segments

    def _segment_of(self, recording: Recording, window: Window) -> Segment:
        return resources.segment_of(
            recording, window, self.selection.vehicles, self.selection.excluded
        )

    def compare(self) -> None:
        """Queue all methods on the windows."""
        analysis = self.analysis(DEFAULT)
        if analysis and self.segment:
            self._record(self.compared)
            task = comparison_task(self.id, analysis, self.recording, self.segments)
            self.comparison = self._submit(task)

    def train_restarts(self, preset: PresetName) -> None:
        """Queue a training on the windows from each of five initial values."""
        analysis = self.analysis(preset)
        if analysis and self.segment:
            task = starts_task(self.id, analysis, self.recording, resources.store(), self._data)
            self.restarts = self._submit(task)

    def reproduce(self, parts: Sequence[Part]) -> None:
        """Queue the trainings of the paper's tables."""
        task = series_task(
            self.id, "reproduction", parts, resources.store(), shown_to=self._shown_to
        )
        self.reproduction = self._submit(task)

    @property
    def subjects(self) -> tuple[Subject, ...]:
        """The followers to judge models on, in all windows or in blocks of the chosen one.

        Raises:
            SegmentError: where the chosen window is too short.
        """
        if self.recording is None:
            return ()
        vehicles, window = self.selection.vehicles, self.selection.window
        return resources.judged_subjects(self.recording, vehicles, window)

    def judge_models(self, models: Sequence[str]) -> None:
        """Queue the comparison of car-following models on the recording."""
        self.judgement = self._submit(judgement_task(self.id, self.subjects, models))

    @property
    def judgements(self) -> tuple[Judgement, ...]:
        """The present judgements, else those of the result; empty without any."""
        earlier = self.result.judgements if self.result else ()
        return (self.judgement and self.judgement.result) or earlier

    def keep_judgements(self) -> None:
        """Store the judgements with the result, unless that is a snapshot."""
        result, judgements = self.result, self.judgements
        if not result or result.id or judgements in (result.judgements, self.stored_judgements):
            return
        self.stored_judgements = judgements
        if result.is_finished:
            resources.store().keep(replace(result, judgements=judgements))

    @property
    def tasks(self) -> tuple[Task[Any], ...]:
        """All tasks of the session."""
        reproduction = (self.reproduction,) if self.reproduction else ()
        verifications, trainings = self.verifications.values(), (left.task for left in self.left)
        return (*self._of_segment, *self.cars.values(), *reproduction, *verifications, *trainings)

    @property
    def _of_segment(self) -> tuple[Task[Any], ...]:
        tasks = (self.training, self.comparison, self.restarts, self.judgement)
        return tuple(task for task in tasks if task)

    def _leave(self) -> None:
        """Make rows of the present results, and end the tasks on this segment except a training.

        That goes on, and its result will be among the session's runs.
        """
        self._record([*self.compared, self.result])
        self.chosen_source = self.parameter_source
        if self.training:
            self._leave_running(self.training)
        for task in self._of_segment:
            if task is not self.training:
                self.ended += (task.kind,) * task.is_active
                task.stop()
        self.training = self.comparison = self.restarts = self.judgement = self.restored = None

    def _rejoin(self, analysis: Analysis) -> bool:
        """Make a running training of an equal analysis that was left the present one again.

        Returns False where there is none.
        """
        for left in self.left:
            earlier = left.task.analysis
            if left.task.is_active and earlier and earlier.key == analysis.key:
                self._take_up(left)
                return True
        return False

    def _leave_running(self, task: Task[Result]) -> None:
        """Add a training that runs or waits to those that were left."""
        if task.is_active and not task.is_stopping:
            task.kind = LEFT
            self.left = (*self.left, Left(task, self.recording, self.restored))

    def go_back(self, left: Left) -> None:
        """Show a training that was left again, with the recording and the result of then."""
        analysis = left.task.analysis
        assert analysis is not None
        self._leave()
        if left.recording is not self.recording:
            self._leave_recording()
        self.recording, self.restored, self.undo_stack = left.recording, left.restored, ()
        if self.recording:
            self.remember(self.recording)
        self.validation = None
        self.take(analysis)
        self.choose_source("estimate")
        self._cut()
        self._take_up(left)

    def forget(self, left: Left) -> None:
        """Drop a training that was left from the list; its result stays among the runs."""
        self.left = tuple(other for other in self.left if other is not left)

    def _take_up(self, left: Left) -> None:
        """Make a training that was left the present one again."""
        self.forget(left)
        left.task.kind = TRAINING
        self.training = left.task

    def _leave_recording(self) -> None:
        """Drop the estimates of single followers; those that still run go on."""
        for task in self.cars.values():
            self._leave_running(task)
        self.cars = {}

    def _record(self, results: Sequence[Result | None]) -> None:
        """Add results to the earlier ones, in place of those of equal analyses."""
        for result in filter(None, results):
            key = result.analysis.key
            others = [row for row in self.earlier if row.analysis.key != key]
            self.earlier = (*others, result)[-MOST_EARLIER:]

    # Parameters of pages Stability and Platoon

    @property
    def parameter_source(self) -> ParameterSource:
        """The source of the parameters on Stability and Platoon: as chosen, or a newer result."""
        is_newer = self.result is not None and self.result is not self.source_result
        return "estimate" if is_newer else self.chosen_source

    def choose_source(self, source: ParameterSource) -> None:
        """Choose the source of those parameters until there is a newer result."""
        self.chosen_source, self.source_result = source, self.result

    def keep(self, key: str) -> Callable[[Any], None]:
        """A function that keeps a choice under that key."""
        return lambda value: self.choices.update({key: value})


def _window_starts(analysis: Analysis) -> tuple[float, ...]:
    """The starts of several windows; empty for a single one."""
    starts = tuple(window.start for window in analysis.windows)
    return starts if len(starts) > 1 else ()
