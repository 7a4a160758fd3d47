"""Results that travel: one file that says what was found, from what, and can be checked."""

from accpinn.snapshot.agreement import Check
from accpinn.snapshot.checking import Verification, check, recovered, verify
from accpinn.snapshot.content import Origin, Snapshot
from accpinn.snapshot.file import load, save, to_bytes, write_whole
from accpinn.snapshot.place import REPORT, SNAPSHOT, Kind, free_place
from accpinn.snapshot.schema import SUFFIX
from accpinn.snapshot.taking import check_texts, take

__all__ = [
    "REPORT",
    "SNAPSHOT",
    "SUFFIX",
    "Check",
    "Kind",
    "Origin",
    "Snapshot",
    "Verification",
    "check",
    "check_texts",
    "free_place",
    "load",
    "recovered",
    "save",
    "take",
    "to_bytes",
    "verify",
    "write_whole",
]
