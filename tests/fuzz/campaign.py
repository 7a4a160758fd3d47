"""One example after the other, each within bounds of time and memory; what breaks them is kept."""

import signal
import sys
import tempfile
import time
import traceback
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from random import Random
from types import FrameType
from typing import Any
from unittest.mock import patch

from accpinn.errors import AccpinnError
from tests.fuzz.kinds import Kind

MOST_BYTES = 1e9
"""Of memory that one example takes beyond what was taken before."""
HANGS_AFTER = 60.0
"""Seconds of processor time after which an example is given up."""
LONGEST_SENTENCE = 1000


@dataclass(frozen=True)
class Outcome:
    """What came of one example."""

    answer: str
    """ "loaded", "refused" or "finding"."""
    seconds: float = 0.0
    """Of processor time."""
    memory: float = 0.0
    """Bytes beyond what was taken before; 0 where that cannot be measured."""
    why: str = ""
    """Of a finding."""


class HangError(BaseException):
    """An example that takes too long; no handler of errors may take it for one."""


def example(kind: Kind, seed: int) -> bytes:
    """The content of an example, always the same for a seed."""
    return kind.draw(Random(seed))


def attempt(kind: Kind, content: bytes) -> Outcome:
    """Use an example; whatever is neither a result nor a refusal in a sentence is a finding."""
    answer, why = "finding", ""
    with tempfile.TemporaryDirectory() as folder, _mappings(folder), _bounded():
        (Path(folder) / "example").mkdir()
        taken, started = _reset_peak(), time.process_time()
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("error")
                warnings.simplefilter("ignore", DeprecationWarning)
                done = kind.use(content, Path(folder) / "example")
            answer = "loaded" if done else "refused"
        except AccpinnError as fault:
            said = str(fault)
            if said.endswith(".") and "\n" not in said and len(said) <= LONGEST_SENTENCE:
                answer = "refused"
            else:
                why = f"a sentence of {len(said)} characters: {said[:300]!r}"
        except (Exception, HangError) as fault:
            why = "".join(traceback.format_exception(fault))
        seconds, memory = time.process_time() - started, _peak() - taken
    if answer != "finding" and (seconds > kind.most_seconds or memory > MOST_BYTES):
        answer, why = "finding", f"{seconds:.1f} s, {memory / 1e6:.0f} MB"
    return Outcome(answer, seconds, memory, why)


@contextmanager
def _mappings(folder: str) -> Iterator[None]:
    with patch.dict("os.environ", {"ACCPINN_MAPPINGS": folder}):
        yield


@contextmanager
def _bounded() -> Iterator[None]:
    """End what hangs, where the platform has such a clock."""
    if not hasattr(signal, "setitimer"):
        yield
        return

    def end(_: int, __: FrameType | None) -> None:
        raise HangError(f"not ended after {HANGS_AFTER:g} s of processor time")

    before: Any = signal.signal(signal.SIGPROF, end)
    signal.setitimer(signal.ITIMER_PROF, HANGS_AFTER)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)
        signal.signal(signal.SIGPROF, before)


def _reset_peak() -> float:
    """Let the peak of memory begin anew; what is taken now, in bytes."""
    if sys.platform == "linux":
        try:
            Path("/proc/self/clear_refs").write_text("5")
        except OSError:
            return float("inf")
    return _peak()


def _peak() -> float:
    if sys.platform != "linux":
        return 0.0
    status = Path("/proc/self/status").read_text().splitlines()
    return next(1024.0 * int(line.split()[1]) for line in status if line.startswith("VmHWM"))
