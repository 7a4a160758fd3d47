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

from accpinn.errors import Finding
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
    """The grade of a window by one question."""

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
    """Findings that say why it is not good."""
    values: tuple[float, ...] = ()
    """Figures behind the grade: the share of samples missing; each follower's condition number;
    each follower's share of car-following; the largest share driven by hand; each gap's
    correlation with the speeds, nan where it is not known."""


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
    findings = _of(segment.findings, BlocksMissing | Bridged)
    share = 0.0 if segment.missing is None else float(segment.missing.any(axis=1).mean())
    grade = Grade.FAIR if findings else Grade.GOOD
    return Rating("complete", Grade.POOR if segment.blocks_missing else grade, findings, (share,))


def _excited(quality: Quality) -> Rating:
    findings = _of(quality.findings, LittleLeaderMotion | NearEquilibrium)
    is_near = any(isinstance(finding, NearEquilibrium) for finding in findings)
    grade = Grade.POOR if is_near else Grade.FAIR if findings else Grade.GOOD
    return Rating("excited", grade, findings, quality.condition)


def _following(quality: Quality) -> Rating:
    findings = _of(quality.findings, LittleCarFollowing)
    grade = Grade.POOR if findings else Grade.GOOD
    return Rating("following", grade, findings, quality.car_following)


def _driver(segment: Segment, recording: Recording) -> Rating:
    within = recording.time + SLACK >= segment.window.start
    within &= recording.time - SLACK <= segment.window.end
    modes = recording.mode[within][:, np.array(segment.vehicles[1:]) - 1]
    findings = _of(segment.findings, DrivenByHand)
    if (modes == Mode.UNKNOWN).all():
        by_flag = recording.acc_flag == HUMAN_FLAG
        return Rating("driver", Grade.POOR if by_flag else Grade.UNKNOWN, findings)
    share = float((modes == Mode.HUMAN).mean(axis=0).max())
    if findings or share:
        return Rating("driver", Grade.POOR if findings else Grade.FAIR, findings, (share,))
    if (modes == Mode.UNKNOWN).any():
        return Rating("driver", Grade.UNKNOWN)
    return Rating("driver", Grade.GOOD, values=(share,))


def _consistent(segment: Segment, recording: Recording, quality: Quality) -> Rating:
    """Rate the gaps over the whole recording, where the correlation is most certain."""
    ahead = segment.vehicles[:-1]
    contradicting = (f for f in recording.findings if isinstance(f, GapContradictsSpeeds))
    findings = (
        *(finding for finding in contradicting if finding.vehicle in ahead),
        *_of(quality.findings, GapsNegative),
    )
    correlations = [agreement(recording, number) for number in ahead]
    values = tuple(np.nan if value is None else value for value in correlations)
    grade = Grade.UNKNOWN if None in correlations else Grade.GOOD
    return Rating("consistent", Grade.POOR if findings else grade, findings, values)


def _of(findings: Iterable[Finding], kind: object) -> tuple[Finding, ...]:
    return tuple(f for f in findings if isinstance(f, kind))  # type: ignore[arg-type]
