"""Faults of what the user gave, and findings: what a computation noticed and a reader should know.

The message of a fault is one sentence with place, fault and cure. Every room defines its own
findings beside the code that makes them; `results.messages` turns each into its sentence. A finding
holds numbers, names and vehicle numbers, never prose.
"""

import msgspec


class AccpinnError(Exception):
    """Anything wrong with data, files or settings; its message is shown to the user verbatim."""


class RecordingError(AccpinnError):
    """A file that cannot be read as an OpenACC recording."""


class SegmentError(AccpinnError):
    """A choice of window and vehicles that the recording cannot serve."""


class ConfigError(AccpinnError):
    """A training setting outside its range, or settings that contradict each other."""


class SnapshotError(AccpinnError):
    """A snapshot that cannot be read, trusted or written."""


class ParameterError(AccpinnError):
    """Parameters, or settings of a simulation, that no vehicle can have."""


class Finding(msgspec.Struct, frozen=True, tag=True):
    """The base of all findings; a subclass's name is its kind."""
