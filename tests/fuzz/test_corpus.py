"""A small corpus of what strangers may hand over: refused in a sentence, or used; see `kinds`."""

import random

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.fuzz.campaign import attempt
from tests.fuzz.kinds import KINDS

EXAMPLES = {
    "recording": 50, "pairs": 25, "mapping": 50, "snapshot": 100, "study": 40, "link": 25,
    "arguments": 20,
}  # fmt: skip
"""How many of each kind; `make fuzz` goes on from there."""


@pytest.mark.parametrize("name", EXAMPLES)
def test_what_a_stranger_hands_over(name: str) -> None:
    kind = KINDS[name]
    answers = set()

    @settings(max_examples=EXAMPLES[name])
    @given(st.randoms(use_true_random=False))
    def holds(draw: random.Random) -> None:
        found = attempt(kind, kind.draw(draw))
        assert found.answer in ("loaded", "refused"), found.why
        answers.add(found.answer)

    holds()
    assert answers == {"loaded", "refused"}, "both are among so many examples"
