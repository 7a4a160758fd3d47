"""Public objects as `print` and a notebook show them."""

from dataclasses import replace

import pytest

import accpinn
from accpinn.methods.estimate import Outcome
from tests.support.snapshots import recommended, small, trained, two_windows, whole

OBJECTS = {
    "recording": lambda: accpinn.sample("astazero_like"),
    "analysis": lambda: trained().analysis,
    "result": recommended,
    "point": whole,
    "windows": two_windows,
    "table": lambda: accpinn.parameter_table(recommended()),
    "stability": lambda: recommended().stability,
}


@pytest.mark.parametrize("name", OBJECTS)
def test_a_public_object_prints_in_some_ten_lines_also_in_a_notebook(name: str) -> None:
    shown = OBJECTS[name]()
    text, page = str(shown), shown._repr_html_()
    assert 2 <= len(text.splitlines()) <= 12
    assert "object at 0x" not in text
    assert "array(" not in text
    assert page.startswith("<")
    first = text.splitlines()[1].split()[0]
    assert first in page


def test_a_result_names_method_preset_model_outcome_and_each_follower() -> None:
    result = recommended()
    first, *others = str(result).splitlines()
    about = (result.analysis.method, result.analysis.settings["preset"])
    for word in (*about, result.estimate.following.title, "converged"):
        assert word in first
    for label in result.info.labels[1:]:
        assert any(line.startswith(label) for line in others)


@pytest.mark.parametrize("outcome", [Outcome.FINISHED, Outcome.STOPPED, Outcome.DIVERGED])
def test_an_estimate_that_has_not_converged_begins_with_its_outcome(outcome: Outcome) -> None:
    result = replace(trained(), estimate=replace(trained().estimate, outcome=outcome))
    assert str(result).splitlines()[0] == outcome.value


def test_an_analysis_shows_the_settings_that_differ_from_its_preset() -> None:
    recording = accpinn.sample("motorway")
    text = str(accpinn.analyse(recording, preset="fast", settings={"width": 20}))
    assert "width = 20" in text
    assert "learning_rate" not in text
    assert "a point" in text


def test_stability_has_a_line_a_vehicle_and_the_platoon() -> None:
    report = small().stability
    text = str(report)
    (vehicle,) = report.vehicles
    assert f"L₂ {vehicle.l2.word}" in text
    assert report.platoon.l2_weak.word in text
