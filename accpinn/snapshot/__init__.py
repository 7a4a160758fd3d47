"""Results that travel: one file that says what was found, from what, and can be checked."""

from accpinn.snapshot.content import Origin, Snapshot
from accpinn.snapshot.file import load, save, to_bytes
from accpinn.snapshot.schema import SUFFIX
from accpinn.snapshot.taking import take

__all__ = ["SUFFIX", "Origin", "Snapshot", "load", "save", "take", "to_bytes"]
