"""Batches and downloads as tasks: each tells its progress in its own terms."""

from collections.abc import Iterator
from functools import partial
from pathlib import Path

from accpinn.errors import RecordingError
from accpinn.methods import TaskContext
from accpinn.recordings.download import Download, DownloadState, Transfer, download
from accpinn.recordings.openacc import PUBLISHED_AT, Run
from accpinn.study.batch import BatchProgress, run_request
from accpinn.study.studies import Request
from accpinn.tasks import Task


class StudyTask(Task[BatchProgress]):
    """A batch of estimations; its workers are processes of their own."""

    def __init__(self, owner: str, study: Path, request: Request) -> None:
        """Queued."""
        super().__init__(owner, "batch", self._work)
        self._study, self._request = study, request
        self.latest = BatchProgress()
        self.summary: BatchProgress | None = None
        """Also of a batch that was stopped; None before its end."""

    def _work(self, context: TaskContext) -> Iterator[BatchProgress]:
        latest = partial(setattr, self, "latest")
        self.summary = run_request(self._study, self._request, latest, context.should_stop)
        if not self.summary.stopped:
            yield self.summary

    @property
    def share(self) -> float:
        """The share of the work that is done, 0 to 1."""
        return self.latest.share


class DownloadTask(Task[Download]):
    """The download of one run."""

    def __init__(self, owner: str, run: Run, folder: Path, base: str = PUBLISHED_AT) -> None:
        """Queued."""
        super().__init__(owner, "download", self._work)
        self.run, self._folder, self._base = run, folder, base
        self.latest: Transfer | None = None
        """How far it is; None before the first byte."""

    def _work(self, context: TaskContext) -> Iterator[Download]:
        for progress in download(
            (self.run,), self._folder, self._base,
            on_transfer=partial(setattr, self, "latest"), should_stop=context.should_stop,
        ):  # fmt: skip
            if progress.state is DownloadState.FAILED:
                raise RecordingError(progress.reason)
            if progress.state is not DownloadState.STOPPED:
                yield progress

    @property
    def share(self) -> float:
        """The share of the file that has arrived, 0 to 1."""
        now = self.latest
        return min(1.0, now.received / now.size) if now and now.size else 0.0
