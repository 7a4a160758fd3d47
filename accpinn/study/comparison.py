"""All methods on identical data: results whose analyses differ in the method alone.

Most methods are loops over small arrays, which threads would not run side by side. Where that saves
time a second process takes the longest methods, while the caller works through its list from the
quickest one on; an estimate is the same wherever it is made. The process is loky's: a fork is not
safe beside threads, and the standard library's spawn would run the caller's script again.
"""

import os
import threading
import time
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace

from loky import ProcessPoolExecutor

from accpinn.errors import AccpinnError, ConfigError
from accpinn.evaluation.evaluation import Evaluation
from accpinn.methods.fit import Fit
from accpinn.methods.method import TaskContext
from accpinn.methods.registry import METHODS, segment_for
from accpinn.recordings.recording import Recording
from accpinn.segment.cut import DURATION
from accpinn.segment.segment import Segment
from accpinn.study.analysis import Analysis
from accpinn.study.result import Result, result_of
from accpinn.study.run import estimate
from accpinn.units import Seconds

WORTH: Seconds = 4.0
"""Typical time of the methods below which a second process would hardly have started."""
POLL: Seconds = 0.1


@dataclass(frozen=True)
class Refused:
    """A method that could not serve the data."""

    analysis: Analysis
    fault: AccpinnError

    @property
    def method(self) -> str:
        """Key of the method."""
        return self.analysis.method


Answer = tuple[Fit, Evaluation] | AccpinnError
"""A method's fit with its evaluation, or why it could not serve the data."""


def parse_methods(text: str) -> tuple[str, ...]:
    """The methods of a text as "all" or "pinn,splines", each once.

    Raises:
        ConfigError: for a method that is not known.
    """
    if text == "all":
        return tuple(METHODS)
    chosen = tuple(dict.fromkeys(part.strip() for part in text.split(",")))
    for name in chosen:
        if name not in METHODS:
            raise ConfigError(
                f'methods: "{name[:40]}" is not known; choose all or {", ".join(METHODS)}.'
            )
    return chosen


def compare(
    analysis: Analysis,
    recording: Recording | None,
    methods: Sequence[str] = tuple(METHODS),
    *,
    segments: tuple[Segment, ...] = (),
    context: TaskContext | None = None,
) -> Iterator[Result | Refused]:
    """Run methods on the same data, and yield each result once it and those before it are known.

    A method that cannot serve the data is `Refused`, and the others run on.

    Args:
        analysis: what is asked; its own method and settings do not count.
        recording: that it is asked of; None where only the data of its window are at hand.
        methods: keys of `METHODS`, with their default settings.
        segments: those data; by default they are cut from the recording.
        context: threads and stop; a method that was not finished has no result.

    Raises:
        SegmentError: where samples are missing that one of the methods needs.
    """
    if recording and not segments:
        window = analysis.window
        segment_for(methods, recording, window.start, window.duration, analysis.vehicles)
    analyses = [analysis.with_method(key) for key in methods]
    segments = analyses[0].segments(recording, segments)
    work = _Work(analyses, segments, recording, context or TaskContext())
    try:
        for asked in analyses:
            answer = work.answer(asked)
            if answer is None:
                return
            if isinstance(answer, AccpinnError):
                yield Refused(asked, answer)
                continue
            fit, evaluation = answer
            result = result_of(asked, segments, (fit,), recording)
            result.parts.evaluation = evaluation
            yield result
    finally:
        work.close()


def results_among(outcomes: Iterable[object]) -> tuple[Result, ...]:
    """The methods that have a result."""
    return tuple(outcome for outcome in outcomes if isinstance(outcome, Result))


def refused_among(outcomes: Iterable[object]) -> tuple[Refused, ...]:
    """The methods that could not serve the data."""
    return tuple(outcome for outcome in outcomes if isinstance(outcome, Refused))


def _run(
    analysis: Analysis,
    segments: tuple[Segment, ...],
    recording: Recording | None,
    context: TaskContext,
) -> Answer | None:
    """The answer of a method, blocks held out included; None once the context says stop."""
    try:
        result = estimate(analysis, segments, recording, context=context)
        if context.is_stopped:
            return None
        evaluation = result.with_holdout(context).evaluation
    except AccpinnError as fault:  # the others may well serve
        return fault
    return None if context.is_stopped else (result.fit, evaluation)


@dataclass
class _Work:
    """Answers of methods, some from a second process."""

    analyses: list[Analysis]
    segments: tuple[Segment, ...]
    recording: Recording | None
    context: TaskContext
    _answers: dict[str, Answer | None] = field(default_factory=dict)
    _lock: threading.Lock = field(default_factory=threading.Lock)
    _executor: ProcessPoolExecutor | None = None

    def __post_init__(self) -> None:
        """Start the second process where two processors and enough work are there."""
        self._left = sorted(self.analyses, key=lambda one: METHODS[one.method].typical_seconds)
        helpful = [METHODS[one.method] for one in self._left if _is_helpful(one)]
        share = min(1.0, self.segments[0].window.duration / DURATION)
        lasting = share * sum(method.typical_seconds for method in helpful)
        if self.context.threads != 1 and (os.cpu_count() or 1) > 1 and lasting >= WORTH:
            self.context = replace(self.context, threads=1)
            self._executor = ProcessPoolExecutor(max_workers=1, env={"OMP_NUM_THREADS": "1"})
            threading.Thread(target=self._help, daemon=True).start()

    def answer(self, asked: Analysis) -> Answer | None:
        """The answer of a method, once it is known; None once the context says stop."""
        while not self.context.is_stopped:
            with self._lock:
                if asked.method in self._answers:
                    return self._answers[asked.method]
                mine = asked if asked in self._left else next(iter(self._left), None)
                if mine:
                    self._left.remove(mine)
            if mine:
                answer = _run(mine, self.segments, self.recording, self.context)
                self._answers[mine.method] = answer
            else:
                time.sleep(POLL)
        return None

    def close(self) -> None:
        """End the second process, whatever it is at."""
        with self._lock:
            self._left.clear()
        if self._executor:
            self._executor.shutdown(wait=False, kill_workers=True)

    def _help(self) -> None:
        """Hand the longest methods that are left to the second process, one at a time."""
        assert self._executor
        while True:
            with self._lock:
                helpful = [analysis for analysis in self._left if _is_helpful(analysis)]
                if not helpful:
                    return
                asked = helpful[-1]
                self._left.remove(asked)
            try:
                future = self._executor.submit(
                    _run, asked, self.segments, self.recording, TaskContext(threads=1)
                )
                self._answers[asked.method] = future.result()
            except Exception:  # killed, or it could not start: the caller runs the method
                with self._lock:
                    self._left.append(asked)
                return


def _is_helpful(analysis: Analysis) -> bool:
    """Whether a second process can run a method: one without progress and checkpoints."""
    return not METHODS[analysis.method].is_iterative
