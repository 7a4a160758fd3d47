"""What a recording says of itself, as snapshots and documents have it."""

from typing import TypedDict

from accpinn.recordings.recording import Recording


class Facts(TypedDict, total=False):
    """What a recording says of itself; None where it does not."""

    campaign: str | None
    date: str | None
    """ISO 8601."""
    acc_flag: int | None
    """0 human, 1 ACC, 2 mixed."""
    distance_setting: str | None
    samples: int | None
    duration: float | None
    """In s."""
    sample_time: float | None
    """In s."""


def facts_of(recording: Recording | None) -> Facts:
    """Those of a recording; none without one."""
    if recording is None:
        return {}
    return {
        "campaign": recording.campaign,
        "date": recording.date.isoformat() if recording.date else None,
        "acc_flag": recording.acc_flag,
        "distance_setting": recording.distance_setting,
        "samples": recording.samples,
        "duration": recording.duration,
        "sample_time": recording.sample_time,
    }
