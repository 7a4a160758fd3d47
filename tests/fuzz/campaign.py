"""One example, within bounds of time and memory."""

import sys
import tempfile
import time
from pathlib import Path
from unittest.mock import patch

from accpinn.errors import AccpinnError
from tests.fuzz.kinds import Kind

LONGEST_SENTENCE = 300
PLACES = ("ACCPINN_CACHE", "ACCPINN_MAPPINGS", "ACCPINN_SNAPSHOTS", "ACCPINN_RECORDINGS")


def attempt(kind: Kind, content: bytes) -> bool:
    """Whether an example is used, or refused in a sentence, within bounds of time and memory."""
    with (
        tempfile.TemporaryDirectory() as folder,
        patch.dict("os.environ", dict.fromkeys(PLACES, folder)),
    ):
        (Path(folder) / "example").mkdir()
        taken, started = _peak(reset=True), time.process_time()
        try:
            is_used = kind.use(content, Path(folder) / "example")
        except AccpinnError as fault:
            is_used, sentence = False, str(fault)
            assert sentence.endswith(".")
            assert "\n" not in sentence
            assert len(sentence) <= LONGEST_SENTENCE
        seconds, memory = time.process_time() - started, _peak() - taken
    assert seconds <= kind.most_seconds
    assert memory <= kind.most_bytes
    return is_used


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
