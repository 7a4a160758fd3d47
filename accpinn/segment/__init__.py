"""Segments: a window of a recording and a platoon in it, with nothing missing."""

from accpinn.segment.missing import BRIDGE, MINIMUM_DURATION, Window, complete_windows
from accpinn.segment.selection import MAX_FOLLOWERS, chains, default_vehicles, parse_vehicles
from accpinn.segment.window import DURATION, Segment, cut

__all__ = [
    "BRIDGE",
    "DURATION",
    "MAX_FOLLOWERS",
    "MINIMUM_DURATION",
    "Segment",
    "Window",
    "chains",
    "complete_windows",
    "cut",
    "default_vehicles",
    "parse_vehicles",
]
