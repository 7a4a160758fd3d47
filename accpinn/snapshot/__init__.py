"""Results that travel: one file that says what was found, from what, and can be checked."""

from accpinn.snapshot.agreement import Check
from accpinn.snapshot.checking import Verification, check, recovered, verify
from accpinn.snapshot.content import Origin, Snapshot
from accpinn.snapshot.file import load, save, to_bytes, write_whole
from accpinn.snapshot.schema import SUFFIX
from accpinn.snapshot.taking import take

__all__ = [
    "SUFFIX",
    "Check",
    "Origin",
    "Snapshot",
    "Verification",
    "check",
    "load",
    "recovered",
    "save",
    "take",
    "to_bytes",
    "verify",
    "write_whole",
]
