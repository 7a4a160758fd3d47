"""Reasons for a suggested window, and who drives."""

from dataclasses import replace

import pytest

from accpinn.recordings.openacc import read
from accpinn.recordings.recording import Window
from accpinn.results.messages.recording import driver_summary, suggestion_reasons
from accpinn.segment.suggestion import Suggestion
from tests.support.samples import FOLDER, NOISY


@pytest.mark.parametrize(
    ("suggestion", "figures"),
    [
        (Suggestion(Window(330, 630), (1, 2), 0.963, None, 190, 300.0),
         ["330–630 s", "190 complete windows of 300 s", "96 %"]),
        (Suggestion(Window(32.4, 44.4), (1, 2), 0.62, 0.05, 1, 300.0), ["5 %", "300 s are usual"]),
        (Suggestion(Window(0, 300), (1, 2), 1.0, 0.0, 1, 300.0), ["all the time"]),
    ],
    ids=["modes not known", "short", "all well"],
)  # fmt: skip
def test_reasons_have_their_numbers(suggestion: Suggestion, figures: list[str]) -> None:
    said = " ".join(suggestion_reasons(suggestion, Window(10.0, 20.0), 0.504))
    assert [figure for figure in [*figures, "10–20 s", "50 %"] if figure not in said] == []
    assert len(suggestion_reasons(suggestion, suggestion.window, 1.0)) < said.count(".")


def test_drivers_are_told_by_their_modes_or_else_by_the_flag() -> None:
    recording = read(FOLDER / f"{NOISY}.csv")
    by_mode = driver_summary(recording)
    assert "2" in by_mode.partition("ACC: ")[2]
    vehicles = tuple(replace(vehicle, modes=None) for vehicle in recording.vehicles)
    assert "ACC" in driver_summary(replace(recording, vehicles=vehicles, acc_flag=1))
