"""Five questions to a window before anything is estimated from it, each with a grade.

    complete      is every sample measured?
    excited       do leader and followers move enough to identify α, β and τ?
    following     are the followers in car-following, for which the model is meant?
    driver        does ACC, not a driver, control the followers?
    consistent    does each gap change as the two speeds demand?

The limits are those of the findings of `segment.quality`, `segment.cut` and `recordings.recording`.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from enum import Enum
from typing import Literal

import numpy as np

from accpinn.findings import Finding
from accpinn.recordings.recording import (
    HUMAN_FLAG,
    GapContradictsSpeeds,
    LittleLeaderMotion,
    Mode,
    Recording,
    agreement,
)
from accpinn.segment.cut import SLACK
from accpinn.segment.quality import GapsNegative, LittleCarFollowing, NearEquilibrium, Quality
from accpinn.segment.segment import BlocksMissing, Bridged, DrivenByHand, Segment

Question = Literal["complete", "excited", "following", "driver", "consistent"]


class Grade(Enum):
    """How a window stands to one question."""

    GOOD = "good"
    FAIR = "fair"
    POOR = "poor"
    UNKNOWN = "not known"


@dataclass(frozen=True)
class Rating:
    """The answer to one question."""

    question: Question
    grade: Grade
    findings: tuple[Finding, ...] = ()
    """Why it is not good."""
    values: tuple[float, ...] = ()
    """What it rests on: the share of samples missing; each follower's condition number; each one's
    share of car-following; the largest share driven by hand; each gap's correlation with the
    speeds, nan where it is not known."""


def rate(segment: Segment, recording: Recording, quality: Quality) -> tuple[Rating, ...]:
    """All ratings of a window, in the order of the questions.

    Args:
        segment: the window.
        recording: what it was cut from.
        quality: the segment's.
    """
    return (
        _complete(segment),
        _excited(quality),
        _following(quality),
        _driver(segment, recording),
        _consistent(segment, recording, quality),
    )


def _complete(segment: Segment) -> Rating:
    found = _of(segment.findings, BlocksMissing | Bridged)
    share = 0.0 if segment.missing is None else float(segment.missing.any(axis=1).mean())
    grade = Grade.FAIR if found else Grade.GOOD
    return Rating("complete", Grade.POOR if segment.blocks_missing else grade, found, (share,))


def _excited(quality: Quality) -> Rating:
    found = _of(quality.findings, LittleLeaderMotion | NearEquilibrium)
    near = any(isinstance(one, NearEquilibrium) for one in found)
    grade = Grade.POOR if near else Grade.FAIR if found else Grade.GOOD
    return Rating("excited", grade, found, quality.condition)


def _following(quality: Quality) -> Rating:
    found = _of(quality.findings, LittleCarFollowing)
    return Rating("following", Grade.POOR if found else Grade.GOOD, found, quality.car_following)


def _driver(segment: Segment, recording: Recording) -> Rating:
    within = recording.time + SLACK >= segment.window.start
    within &= recording.time - SLACK <= segment.window.end
    modes = recording.mode[within][:, np.array(segment.vehicles[1:]) - 1]
    found = _of(segment.findings, DrivenByHand)
    if (modes == Mode.UNKNOWN).all():
        by_flag = recording.acc_flag == HUMAN_FLAG
        return Rating("driver", Grade.POOR if by_flag else Grade.UNKNOWN, found)
    share = float((modes == Mode.HUMAN).mean(axis=0).max())
    if found or share:
        return Rating("driver", Grade.POOR if found else Grade.FAIR, found, (share,))
    if (modes == Mode.UNKNOWN).any():
        return Rating("driver", Grade.UNKNOWN, found)
    return Rating("driver", Grade.GOOD, found, (share,))


def _consistent(segment: Segment, recording: Recording, quality: Quality) -> Rating:
    """Over the whole recording, where the correlation has the most to go by."""
    ahead = segment.vehicles[:-1]
    contradicting = _of(recording.findings, GapContradictsSpeeds)
    found = tuple(one for one in contradicting if getattr(one, "vehicle", 0) in ahead)
    negative = _of(quality.findings, GapsNegative)
    each = [agreement(recording, number) for number in ahead]
    values = tuple(np.nan if value is None else value for value in each)
    grade = Grade.UNKNOWN if None in each else Grade.GOOD
    grade = Grade.POOR if found or negative else grade
    return Rating("consistent", grade, (*found, *negative), values)


def _of(findings: Iterable[Finding], kind: object) -> tuple[Finding, ...]:
    return tuple(one for one in findings if isinstance(one, kind))  # type: ignore[arg-type]
