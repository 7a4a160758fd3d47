"""Sentences on the answer, made from the answer alone."""

from dataclasses import replace

import pytest

from accpinn.inference.answer import Answer, HeterogeneousWindows, answer
from accpinn.inference.gain_check import GainCheck
from accpinn.methods import least_squares
from accpinn.methods.pinn.config import CALIBRATED, FAST, PAPER, PinnConfig
from accpinn.model.published import ParameterSet
from accpinn.results.messages.answer import cards, differing_windows, papers_estimate
from accpinn.results.tables.answer import answer_table
from accpinn.results.vehicles import KnownVehicles
from accpinn.segment.segment import Segment
from tests.support.samples import PLATOON, sample


@pytest.fixture(scope="module")
def segment() -> Segment:
    return sample(PLATOON).segment


@pytest.fixture(scope="module")
def answered(segment: Segment) -> Answer:
    return answer((segment,), model="cthp")


def subject(segment: Segment, answered: Answer) -> KnownVehicles:
    vehicles = ParameterSet(
        segment.source, segment.names[1:], answered.parameters, segment.vehicles, segment.labels[1:]
    )
    return KnownVehicles(vehicles, answered.uncertainty)


def test_followers_that_share_their_parameters_have_one_card_and_one_row(segment: Segment) -> None:
    for case, count in (("I", 1), ("II", segment.followers)):
        answered = answer((segment,), case, "cthp")
        said = cards(segment.info, answered, subject(segment, answered))
        assert len(said) == len(answer_table(segment.info, answered, case).rows) == count
    (said,) = cards(segment.info, answer((segment,), "I", "cthp"), subject(segment, answered))
    assert said.lead.startswith("All followers keep ")


def test_a_card_has_time_gap_gains_disturbances_and_trust(
    segment: Segment, answered: Answer
) -> None:
    known = subject(segment, answered)
    card = cards(segment.info, answered, known)[0]
    span = answered.time_gap(answered.stated_speed, 0)
    assert f"keeps {span.value:.2f} s at 100 km/h" in card.lead
    gain = known.report.vehicles[0].peak.gain
    assert f"Disturbances grow by up to {100 * (gain - 1):.0f} %." in card.lead
    assert card.trust.startswith("Known from one window alone. Reproduces the drive within ")
    check = GainCheck(segment.vehicles[1], 9, rms=3.0, contradiction="apart")
    against = replace(known, checks=(check,))
    card = cards(segment.info, answered, against)[0]
    assert "by the model" in card.lead
    assert card.trust.endswith("The measured gain contradicts the model (3.0 dB apart).")


def test_slow_followers_have_their_time_gap_stated_at_the_lower_speed(
    segment: Segment, answered: Answer
) -> None:
    slow = replace(answered, speeds=0.0 * answered.speeds + 5.0)
    assert "at 50 km/h" in cards(segment.info, slow, subject(segment, slow))[0].lead


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
    assert not papers_estimate(replace(fit, model="idm"))
    assert not papers_estimate(least_squares.fit(segment))
