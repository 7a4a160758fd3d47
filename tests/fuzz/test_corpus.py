"""What strangers may hand over is refused in a sentence, or used; see `kinds`.

`make fuzz` goes on for some minutes, with other examples on every run.
"""

import os
import random
import time
from pathlib import Path

import pytest
from hypothesis import event, given, settings
from hypothesis import strategies as st

from tests.fuzz.campaign import attempt
from tests.fuzz.kinds import KINDS

SECONDS = 60 * float(os.environ.get("FUZZ_MINUTES", "0")) / len(KINDS)
"""For each kind; 0 for a small corpus that is the same on every run."""
PROFILE = settings.get_profile("default" if SECONDS else "house")
FINDINGS = Path("fuzz_findings")


@pytest.mark.timeout(180 + SECONDS)
@pytest.mark.parametrize("name", [name for name in KINDS if KINDS[name].examples or SECONDS])
def test_what_a_stranger_hands_over(name: str) -> None:
    kind, answers, end = KINDS[name], set(), time.monotonic() + SECONDS

    @settings(PROFILE, max_examples=kind.examples or 1, deadline=None)
    @given(st.randoms(use_true_random=False))
    def holds(draw: random.Random) -> None:
        content = kind.draw(draw)
        answer, why = attempt(kind, content)
        event(answer)
        if answer == "finding":
            FINDINGS.mkdir(exist_ok=True)
            place = FINDINGS / f"{name}{kind.ending}"
            place.write_bytes(content)
            pytest.fail(f"{place}: {why}")
        answers.add(answer)

    holds()
    while time.monotonic() < end:
        holds()
    assert answers == {"loaded", "refused"} or not kind.examples, "both are among so many"
