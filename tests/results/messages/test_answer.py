"""Sentences on the answer, made from the answer alone."""

from dataclasses import replace

import pytest

from accpinn.inference.answer import Answer, HeterogeneousWindows, answer
from accpinn.methods import least_squares
from accpinn.methods.pinn.config import CALIBRATED, FAST, PAPER, PinnConfig
from accpinn.results.messages.answer import differing_windows, headlines, papers_estimate
from accpinn.results.tables.answer import answer_table
from accpinn.segment.segment import Segment
from tests.support.samples import PLATOON, sample


@pytest.fixture(scope="module")
def segment() -> Segment:
    return sample(PLATOON).segment


@pytest.fixture(scope="module")
def answered(segment: Segment) -> Answer:
    return answer((segment,), model="cthp")


def test_followers_that_share_their_parameters_have_one_sentence_and_one_row(
    segment: Segment, answered: Answer
) -> None:
    followers = segment.followers
    assert len(headlines(segment.info, answered)) == followers
    assert len(answer_table(segment.info, answered).rows) == followers
    (said,) = headlines(segment.info, answered, "I")
    assert said.startswith("All followers keep a time gap of ")
    assert len(answer_table(segment.info, answered, "I").rows) == 1


def test_slow_followers_have_their_time_gap_stated_at_the_lower_speed(
    segment: Segment, answered: Answer
) -> None:
    slow = replace(answered, speeds=0.0 * answered.speeds + 5.0)
    assert "at 50 km/h" in headlines(segment.info, slow)[0]


def test_windows_that_differ_are_one_sentence(segment: Segment, answered: Answer) -> None:
    assert differing_windows(segment.info, answered) == ""
    vehicle = segment.vehicles[1]
    finding = HeterogeneousWindows(vehicle, 5, 3e-35)
    said = differing_windows(segment.info, replace(answered, findings=(finding,)))
    assert said.startswith(f"The 5 windows of {segment.info.label(vehicle)} differ")
    assert "p < 0.001" in said


@pytest.mark.parametrize(("config", "said"), [(CALIBRATED, False), (FAST, True), (PAPER, True)])
def test_the_papers_presets_say_so(segment: Segment, config: PinnConfig, said: bool) -> None:
    fit = replace(least_squares.fit(segment), method="pinn", config=config.to_json())
    assert bool(papers_estimate(fit)) == said
    assert not papers_estimate(least_squares.fit(segment))
