"""Findings of simulated platoons have their sentences."""

from typing import get_args

import pytest

from accpinn.platoon.simulation import (
    Collision,
    NeverSettles,
    PlatoonFinding,
    Reversal,
    TooShort,
    TransientLeft,
)
from accpinn.results.messages import message
from accpinn.results.messages.stability import PLACES

SENTENCES = {
    Collision(4, 33.94): "Follower 4 collides with the vehicle ahead at 33.9 s.",
    Reversal(0, 5.0): "The leader drives backwards from 5.0 s on",
    NeverSettles(2): "Follower 2 never settles",
    TooShort(25.13, 67.0): "25.1 s; a duration of 67 s is enough.",
    TransientLeft(8, 767.0): "Follower 8 is still in its transient",
}


def test_every_finding_is_tried() -> None:
    assert {type(finding) for finding in SENTENCES} == set(get_args(PlatoonFinding))


@pytest.mark.parametrize("finding", SENTENCES, ids=lambda finding: type(finding).__name__)
def test_a_finding_has_its_sentence(finding: PlatoonFinding) -> None:
    assert SENTENCES[finding] in message(finding, PLACES)
