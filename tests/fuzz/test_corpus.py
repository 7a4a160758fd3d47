"""Hostile input is refused in a sentence, or used; see `kinds`.

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
"""For each kind, after a small corpus that is the same on every run and machine."""
FINDINGS = Path("fuzz_findings")


@pytest.mark.timeout(180 + SECONDS)
@pytest.mark.parametrize("name", [name for name in KINDS if KINDS[name].examples or SECONDS])
def test_hostile_input_is_refused_in_a_sentence_or_used(name: str) -> None:
    kind, end = KINDS[name], time.monotonic() + SECONDS

    def is_used(draw: random.Random) -> bool:
        content = kind.draw(draw)
        try:
            return attempt(kind, content)
        except Exception:
            FINDINGS.mkdir(exist_ok=True)
            (FINDINGS / f"{name}{kind.ending}").write_bytes(content)
            raise

    # Seeds, as hypothesis draws otherwise where a folder above has another name.
    answers = {is_used(random.Random(seed)) for seed in range(kind.examples)}
    assert answers == {True, False} or not kind.examples, "both are among so many"

    @settings(settings.get_profile("default"), max_examples=kind.examples or 1, deadline=None)
    @given(st.randoms(use_true_random=False))
    def search(draw: random.Random) -> None:
        event("used" if is_used(draw) else "refused")

    while time.monotonic() < end:
        search()
