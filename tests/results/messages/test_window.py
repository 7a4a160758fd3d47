"""Sentences about a suggested window: each has its numbers, and says what is not known."""

import pytest
from accpinn.results.messages.window import suggestion_reasons

from accpinn.recordings.recording import Window
from accpinn.segment.suggestion import Suggestion


@pytest.mark.parametrize(
    ("found", "words"),
    [
        (Suggestion(Window(330, 630), (1, 2), 0.963, None, 190, 300.0),
         ["330–630 s", "190 complete windows of 300 s", "96 %", "does not say who drives"]),
        (Suggestion(Window(32.4, 44.4), (1, 2), 0.62, 0.05, 1, 300.0),
         ["only complete window", "5 % of the time by hand", "Nothing longer", "300 s are usual"]),
        (Suggestion(Window(0, 300), (1, 2), 1.0, 0.0, 1, 300.0), ["ACC throughout", "100 %"]),
    ],
    ids=["modes not known", "short", "all well"],
)  # fmt: skip
def test_reasons_have_their_numbers(found: Suggestion, words: list[str]) -> None:
    said = " ".join(suggestion_reasons(found, Window(10.0, 20.0), 0.504))
    assert all(word in said for word in [*words, "10–20 s", "50 %"])
    assert "D-efficiency" not in " ".join(suggestion_reasons(found, found.window, 1.0))
