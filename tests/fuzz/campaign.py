"""One example, within bounds of time and memory."""

import sys
import tempfile
import time
import traceback
import warnings
from dataclasses import dataclass
from pathlib import Path
from unittest.mock import patch

from accpinn.errors import AccpinnError
from tests.fuzz.kinds import Kind

MOST_BYTES = 1e9
"""Memory that one example takes beyond what was taken before, in bytes."""
LONGEST_SENTENCE = 1000
PLACES = ("ACCPINN_CACHE", "ACCPINN_MAPPINGS", "ACCPINN_SNAPSHOTS", "ACCPINN_RECORDINGS")


@dataclass(frozen=True)
class Outcome:
    """What came of one example."""

    answer: str
    """ "loaded", "refused" or "finding"."""
    seconds: float
    """Processor time."""
    memory: float
    """Bytes beyond what was taken before; 0 where that cannot be measured."""
    why: str
    """What was found; empty for other answers."""


def attempt(kind: Kind, content: bytes) -> Outcome:
    """Use an example; whatever is neither a result nor a refusal in a sentence is a finding."""
    answer, why = "finding", ""
    with (
        tempfile.TemporaryDirectory() as folder,
        patch.dict("os.environ", dict.fromkeys(PLACES, folder)),
    ):
        (Path(folder) / "example").mkdir()
        taken, started = _peak(reset=True), time.process_time()
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
        except Exception as fault:
            why = "".join(traceback.format_exception(fault))
        seconds, memory = time.process_time() - started, _peak() - taken
    if answer != "finding" and (seconds > kind.most_seconds or memory > MOST_BYTES):
        answer, why = "finding", f"{seconds:.1f} s, {memory / 1e6:.0f} MB"
    return Outcome(answer, seconds, memory, why)


def _peak(reset: bool = False) -> float:
    """The most memory taken so far, or since it was reset, in bytes; 0 where it is not known."""
    if sys.platform != "linux":
        return 0.0
    if reset:
        try:
            Path("/proc/self/clear_refs").write_text("5")
        except OSError:
            return float("inf")
    status = Path("/proc/self/status").read_text().splitlines()
    return next(1024.0 * int(line.split()[1]) for line in status if line.startswith("VmHWM"))
