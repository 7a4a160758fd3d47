"""Windows of a recording that are found once and kept: in car-following, as data, to be judged."""

from collections.abc import Sequence
from contextlib import suppress
from functools import lru_cache

from accpinn.errors import SegmentError
from accpinn.recordings.recording import Recording, Window
from accpinn.segment.cut import DURATION
from accpinn.segment.segment import Segment
from accpinn.study.analysis import Analysis
from accpinn.study.judge import Subject, subjects_of
from accpinn.study.plan import car_following
from accpinn.units import Seconds

KEPT_RECORDINGS = 4
"""Recordings whose windows are kept at once."""


@lru_cache(maxsize=KEPT_RECORDINGS)
def windows_in_car_following(recording: Recording, vehicles: tuple[int, ...]) -> tuple[Window, ...]:
    """The windows in which all followers are in car-following; empty for fewer than two."""
    with suppress(SegmentError):
        windows = car_following(recording, vehicles)
        return windows if len(windows) > 1 else ()
    return ()


@lru_cache(maxsize=KEPT_RECORDINGS)
def first_segment(
    recording: Recording, window: Window, vehicles: tuple[int, ...], excluded: tuple[str, ...]
) -> Segment:
    """The data of a window; it is cut once."""
    (segment,) = Analysis.of(recording, (window,), vehicles, excluded=excluded).segments(recording)
    return segment


@lru_cache(maxsize=KEPT_RECORDINGS)
def judged_subjects(
    recording: Recording, vehicles: tuple[int, ...], window: Window
) -> tuple[Subject, ...]:
    """Followers in their windows in car-following; in blocks of ``window`` where there is none."""
    with suppress(SegmentError):
        return subjects_of(recording, vehicles)
    return subjects_of(recording, vehicles, [window])


def first_window(
    recording: Recording, stretches: Sequence[Window], length: Seconds = DURATION
) -> Window:
    """The first complete stretch that is long enough, else the longest one."""
    length = min(length, recording.duration)
    usual = Window(0.0, min(length, DURATION))
    best = max(stretches, key=lambda window: min(window.duration, length), default=usual)
    return Window(best.start, min(best.end, best.start + length))
