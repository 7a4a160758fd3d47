"""A batch in a process of its own, for a caller that must go on meanwhile, as a server.

The process reads its settings as one line of JSON from standard input, and writes lines of JSON to
standard output: how far it is, and at its end the summary or why it was refused. It stops once
standard input ends, so also when its caller dies. What it says besides goes to standard error.
"""

import math
import os
import queue
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import IO

import msgspec

from accpinn.errors import AccpinnError, ConfigError, RecordingError
from accpinn.model.cthp import Case
from accpinn.recordings.mapping import CsvMapping
from accpinn.study.batch import batch
from accpinn.study.batch_progress import BatchProgress, BatchSummary
from accpinn.units import Seconds

POLL: Seconds = 0.2
PATIENCE: Seconds = 60.0
"""How long a process that was asked to stop may take."""


@dataclass(frozen=True)
class BatchSettings:
    """What a batch is to do; the arguments of `batch`."""

    sources: tuple[str, ...]
    study: str
    window: Seconds | None
    """None for whole stretches."""
    methods: tuple[str, ...]
    case: Case = "II"
    workers: int | None = None
    mapping: CsvMapping | None = None


@dataclass(frozen=True)
class _Line:
    """What the process says."""

    progress: BatchProgress | None = None
    summary: BatchSummary | None = None
    refusal: str = ""
    is_setting: bool = False
    """Whether a setting was refused."""


def run_batch(
    settings: BatchSettings,
    on_progress: Callable[[BatchProgress], None] | None = None,
    should_stop: Callable[[], bool] | None = None,
) -> BatchSummary:
    """Run a batch in a process of its own, and wait for its end.

    Args:
        settings: what to do.
        on_progress: called after every task.
        should_stop: asked several times a second; True ends the batch, and all is kept.

    Raises:
        ConfigError: as `batch` does.
        RecordingError: as `batch` does, and when the process dies.
    """
    absolute = replace(
        settings,
        sources=tuple(map(os.path.abspath, settings.sources)),
        study=os.path.abspath(settings.study),
    )
    try:
        found = _run(absolute, on_progress, should_stop)
    except BrokenPipeError:  # it died before it could read
        found = None
    if found is None:
        raise RecordingError(
            "The batch's process has died; what was finished is kept, and the same batch goes on"
            " from there."
        )
    return found


def _run(
    settings: BatchSettings,
    on_progress: Callable[[BatchProgress], None] | None,
    should_stop: Callable[[], bool] | None,
) -> BatchSummary | None:
    """The summary; None where the process died."""
    with subprocess.Popen(
        [sys.executable, "-m", __name__],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        cwd=Path(__file__).parents[2],  # where the package is found
    ) as process:
        assert process.stdin
        assert process.stdout
        process.stdin.write(msgspec.json.encode(settings) + b"\n")
        process.stdin.flush()
        lines: queue.SimpleQueue[bytes] = queue.SimpleQueue()
        threading.Thread(target=_pass_on, args=(process.stdout, lines), daemon=True).start()
        asked: float | None = None
        while True:
            if asked is None and should_stop and should_stop():
                process.stdin.close()
                asked = time.monotonic()
            if asked is not None and time.monotonic() - asked > PATIENCE:
                process.kill()  # its workers end with it
            try:
                raw = lines.get(timeout=POLL)
            except queue.Empty:
                continue
            if not raw:
                return None
            line = msgspec.json.decode(raw, type=_Line)
            if line.refusal:
                raise (ConfigError if line.is_setting else RecordingError)(line.refusal)
            if line.summary:
                return line.summary
            if line.progress and on_progress:
                on_progress(line.progress)


def _pass_on(stream: IO[bytes], lines: "queue.SimpleQueue[bytes]") -> None:
    """Each line, and an empty one at the end."""
    for raw in stream:
        lines.put(raw)
    lines.put(b"")


def main() -> None:
    """The process's own side."""
    with os.fdopen(os.dup(sys.stdout.fileno()), "wb", buffering=0) as out:
        os.dup2(sys.stderr.fileno(), sys.stdout.fileno())

        def say(line: _Line) -> None:
            out.write(msgspec.json.encode(line) + b"\n")

        settings = msgspec.json.decode(sys.stdin.buffer.readline(), type=BatchSettings)
        stopped = threading.Event()

        def listen() -> None:
            while os.read(sys.stdin.fileno(), 1024):  # the buffer's lock would hold up the end
                pass
            stopped.set()

        threading.Thread(target=listen, daemon=True).start()
        try:
            found = batch(
                settings.sources,
                settings.study,
                window=math.inf if settings.window is None else settings.window,
                methods=settings.methods,
                case=settings.case,
                workers=settings.workers,
                mapping=settings.mapping,
                on_progress=lambda now: say(_Line(progress=now)),
                should_stop=stopped.is_set,
            )
        except AccpinnError as fault:
            say(_Line(refusal=str(fault), is_setting=isinstance(fault, ConfigError)))
        else:
            say(_Line(summary=found))


if __name__ == "__main__":
    main()
