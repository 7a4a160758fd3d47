"""Results that travel: one file that says what was found, from what, and can be checked."""

from accpinn.snapshot.content import Origin, Snapshot

__all__ = ["Origin", "Snapshot"]
