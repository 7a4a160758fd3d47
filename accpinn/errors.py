"""Faults of the user's data, files and settings: one sentence with place, fault and cure."""


def shown(value: object) -> str:
    """A value as a message has it: in one line, and cut after some fifty characters."""
    try:
        text = " ".join(repr(value).split())
    except Exception:  # whatever somebody's object does
        text = f"a {type(value).__name__}"
    return text if len(text) <= 60 else f"{text[:50]} …"


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
