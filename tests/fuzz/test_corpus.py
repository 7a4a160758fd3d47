"""A small corpus of what strangers may hand over: refused in a sentence, or used; see `kinds`."""

import random
import time
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.fuzz.campaign import Run, attempt
from tests.fuzz.kinds import KINDS, Kind

EXAMPLES = {
    "recording": 200, "pairs": 25, "mapping": 50, "snapshot": 50, "study": 40, "link": 25,
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


@pytest.mark.parametrize(
    ("clock", "answer"), [("monotonic", "loaded"), ("process_time", "finding")]
)
def test_only_processor_time_counts(clock: str, answer: str) -> None:
    """A machine that is halted or busy meanwhile makes no finding."""

    def use(_: bytes, __: Path) -> bool:
        now = getattr(time, clock)
        end = now() + 0.2
        while now() < end:
            if clock == "monotonic":
                time.sleep(0.05)
        return True

    kind = Kind("slow", lambda _: b"", use, "", most_seconds=0.1)
    assert attempt(kind, b"").answer == answer


def test_a_run_that_is_ended_still_counts_what_was_tried(tmp_path: Path) -> None:
    def use(_: bytes, __: Path) -> bool:
        if run.answers("any")["loaded"] == 2:
            run.end()
        return True

    run = Run([Kind("any", lambda draw: draw.randbytes(4), use, "")], tmp_path)
    run.go_on(0, 60.0)
    assert run.answers("any") == {"loaded": 3}
    assert run.table().splitlines()[-1].split()[:2] == ["any", "3"]
