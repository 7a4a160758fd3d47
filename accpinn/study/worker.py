"""Methods on one segment, some of them in a second process, as a comparison runs them.

Most methods are loops over small arrays, which threads would not run side by side. The second
process is an interpreter of its own (`python -m accpinn.study.worker`): a copy of this one is not
safe beside threads, and `multiprocessing` would run the caller's script again. It takes the longest
methods first, while the caller works through its list; an estimate is the same wherever it is made.
"""

import os
import pickle
import subprocess
import sys
import threading
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from accpinn.errors import AccpinnError
from accpinn.evaluation.evaluation import Evaluation, evaluate
from accpinn.methods.fit import Fit, ShouldStop
from accpinn.methods.method import TaskContext
from accpinn.methods.registry import METHODS
from accpinn.model.cthp import Case
from accpinn.recordings.recording import Recording
from accpinn.segment.cut import DURATION
from accpinn.segment.segment import Segment
from accpinn.units import Seconds

WORTH: Seconds = 4.0
"""Typical time of the methods below which a second process would hardly have started."""
POLL: Seconds = 0.1
ROOT = Path(__file__).parents[2]

Answer = tuple[Fit, Evaluation] | AccpinnError
"""A method's fit with its evaluation, or why it could not serve the segment."""


@dataclass(frozen=True, eq=False)
class Job:
    """What methods are applied to."""

    segment: Segment
    case: Case
    recording: Recording | None
    """With it the errors outside the window are computed as well."""
    settings: Mapping[str, Any]
    """By method, for methods that have some; their defaults otherwise."""

    def run(self, key: str, context: TaskContext) -> Answer | None:
        """The answer of a method, blocks held out included; None once the context says stop."""
        settings = self.settings.get(key)
        estimate = partial(METHODS[key].fit, case=self.case, settings=settings, context=context)
        try:
            fit = estimate(self.segment)
            if context.should_stop and context.should_stop():
                return None
            return fit, evaluate(self.segment, fit, estimate, self.recording)
        except AccpinnError as fault:  # the others may well serve
            return fault


def helpful(methods: Iterable[str]) -> list[str]:
    """The methods that a second process can run: those without progress and checkpoints."""
    return [key for key in methods if not METHODS[key].is_iterative]


def is_worthwhile(segment: Segment, methods: Iterable[str], context: TaskContext) -> bool:
    """Whether a second process shortens a comparison: two processors, and enough to do."""
    share = min(1.0, segment.window.duration / DURATION)
    lasting = share * sum(METHODS[key].typical_seconds for key in helpful(methods))
    return context.threads != 1 and (os.cpu_count() or 1) > 1 and lasting >= WORTH


class Worker:
    """The second process; what it fails at is left to the caller."""

    def __init__(self, job: Job, methods: Iterable[str]) -> None:
        """Start it.

        Args:
            job: the data.
            methods: those it may take.
        """
        self._left = sorted(methods, key=lambda key: METHODS[key].typical_seconds)
        self._running = ""
        self._answers: dict[str, Answer] = {}
        self._changed = threading.Condition()
        self._process: subprocess.Popen[bytes] | None = None
        threading.Thread(target=self._serve, args=(job,), daemon=True).start()

    def answer(self, key: str, should_stop: ShouldStop) -> Answer | None:
        """Its answer, waited for; None for a method that is the caller's to run.

        Args:
            key: of a method.
            should_stop: asked while waiting; True ends that with None.
        """
        with self._changed:
            if key in self._left:
                self._left.remove(key)
            while key == self._running and not should_stop():
                self._changed.wait(POLL)
            return self._answers.get(key)

    def close(self) -> None:
        """End the process, whatever it is at."""
        with self._changed:
            self._left.clear()
            if self._process:
                self._process.kill()

    def _serve(self, job: Job) -> None:
        try:
            with self._begin() as process:
                assert process.stdin
                assert process.stdout
                pickle.dump(job, process.stdin)
                while key := self._next():
                    pickle.dump(key, process.stdin)
                    process.stdin.flush()
                    answer = pickle.load(process.stdout)
                    with self._changed:
                        self._answers[key] = answer
        except (OSError, EOFError, pickle.PickleError):  # killed, or it could not start
            pass
        finally:
            with self._changed:
                self._left.clear()
                self._running = ""
                self._changed.notify_all()

    def _begin(self) -> subprocess.Popen[bytes]:
        path = os.pathsep.join(filter(None, (str(ROOT), os.environ.get("PYTHONPATH"))))
        process = subprocess.Popen(
            [sys.executable, "-m", __name__],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            env={**os.environ, "PYTHONPATH": path, "OMP_NUM_THREADS": "1"},
        )
        with self._changed:
            self._process = process
        return process

    def _next(self) -> str:
        """The longest method that is left; empty where none is."""
        with self._changed:
            self._running = self._left.pop() if self._left else ""
            self._changed.notify_all()
            return self._running


def main() -> int:
    """Answer the methods named on standard input, for the job that comes first."""
    answers, sys.stdout = sys.stdout.buffer, sys.stderr
    job: Job = pickle.load(sys.stdin.buffer)
    while True:
        try:
            key = pickle.load(sys.stdin.buffer)
        except EOFError:
            return 0
        pickle.dump(job.run(key, TaskContext(threads=1)), answers)
        answers.flush()


if __name__ == "__main__":
    sys.exit(main())
