"""Batches and downloads as tasks: each tells its progress in its own terms."""

from collections.abc import Iterator
from functools import partial
from pathlib import Path
from shutil import rmtree

from accpinn.errors import RecordingError
from accpinn.methods import TaskContext
from accpinn.recordings.download import Download, DownloadState, download
from accpinn.recordings.openacc import PUBLISHED_AT, Run
from accpinn.study.batch import BatchProgress, run_request
from accpinn.study.studies import DROPPED, Request
from accpinn.tasks import Task


def batch_task(owner: str, study: Path, request: Request) -> Task[BatchProgress]:
    """A batch of estimations; its workers are processes of their own.

    Files that were handed over for it are removed once it has come to its end.
    """

    def steps(context: TaskContext) -> Iterator[BatchProgress]:
        tell = partial(setattr, task, "latest")
        tell(run_request(study, request, tell, context.should_stop))
        if not task.latest.stopped:
            rmtree(study / DROPPED, ignore_errors=True)
            yield task.latest

    task = Task(owner, "batch", steps)
    return task


def download_task(owner: str, run: Run, folder: Path, base: str = PUBLISHED_AT) -> Task[Download]:
    """The download of one run, which is named by its key."""

    def steps(context: TaskContext) -> Iterator[Download]:
        for ended in download(
            (run,), folder, base,
            on_transfer=partial(setattr, task, "latest"), should_stop=context.should_stop,
        ):  # fmt: skip
            if ended.state is DownloadState.FAILED:
                raise RecordingError(ended.reason)
            if ended.state is not DownloadState.STOPPED:
                yield ended

    task = Task(owner, "download", steps, (run.key,))
    return task
