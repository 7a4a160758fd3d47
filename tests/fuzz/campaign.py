"""One example, within bounds of time and memory."""

import sys
import tempfile
import time
import traceback
import warnings
from pathlib import Path
from unittest.mock import patch

from accpinn.errors import AccpinnError
from tests.fuzz.kinds import Kind

LONGEST_SENTENCE = 1000
PLACES = ("ACCPINN_CACHE", "ACCPINN_MAPPINGS", "ACCPINN_SNAPSHOTS", "ACCPINN_RECORDINGS")


def attempt(kind: Kind, content: bytes) -> tuple[str, str]:
    """Use an example: "loaded", "refused" in a sentence, or else "finding" and what was found."""
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
        except AccpinnError as fault:
            said, done = str(fault), False
            if not said.endswith(".") or "\n" in said or len(said) > LONGEST_SENTENCE:
                return "finding", f"a sentence of {len(said)} characters: {said[:300]!r}"
        except Exception as fault:
            return "finding", "".join(traceback.format_exception(fault))
        seconds, memory = time.process_time() - started, _peak() - taken
    if seconds > kind.most_seconds or memory > kind.most_bytes:
        return "finding", f"{seconds:.1f} s, {memory / 1e6:.0f} MB"
    return ("loaded" if done else "refused"), ""


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
