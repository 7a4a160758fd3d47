"""The words for criteria, behaviours and factors; `test_reasons` tries the reasons of verdicts."""

import pytest

from accpinn.results.messages.stability import BEHAVIOURS, TITLES, factor
from accpinn.stability.report import Behaviour, Criterion


def test_every_criterion_and_behaviour_has_its_words() -> None:
    assert set(TITLES) == set(Criterion)
    assert set(BEHAVIOURS) == set(Behaviour)


@pytest.mark.parametrize(
    ("gain", "text"), [(1.4, "1.40"), (12.0, "12.0"), (123.4, "123"), (1.00002, "1 + 2e-05")]
)
def test_a_factor_keeps_its_digits(gain: float, text: str) -> None:
    assert factor(gain) == text
