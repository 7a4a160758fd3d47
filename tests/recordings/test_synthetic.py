"""The sample recordings: reproducible, realistic, and their truth can be recovered."""

from pathlib import Path

import numpy as np
import pytest

from accpinn.errors import RecordingError
from accpinn.recordings import openacc, synthetic
from accpinn.recordings.synthetic import SCENARIOS, Scenario, Truth
from tests.support.samples import FOLDER

LAST_DIGIT = 1e-4
BY_NAME = {scenario.name: scenario for scenario in SCENARIOS}

every_scenario = pytest.mark.parametrize("scenario", SCENARIOS, ids=BY_NAME)


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("samples")
    assert synthetic.main([str(folder / "new")]) == 0
    return folder / "new"


@every_scenario
def test_committed_files_are_what_the_generator_writes(scenario: Scenario, written: Path) -> None:
    expected = {f"{s.name}{ending}" for s in SCENARIOS for ending in (".csv", ".truth.json")}
    assert {path.name for path in FOLDER.iterdir()} == expected
    truth = f"{scenario.name}.truth.json"
    assert (FOLDER / truth).read_bytes() == (written / truth).read_bytes()
    found, made = (openacc.read(place / f"{scenario.name}.csv") for place in (FOLDER, written))
    for name in ("time", "speed", "gap", "mode"):
        # Another machine's sine may differ in the last bit and so turn a rounding.
        one, other = getattr(found, name), getattr(made, name)
        np.testing.assert_allclose(one, other, rtol=0, atol=1.01 * LAST_DIGIT)
    for name in ("vehicles", "date", "acc_flag", "distance_setting", "findings"):
        assert getattr(found, name) == getattr(made, name)
    assert found.findings == ()
    assert tuple(vehicle.name for vehicle in found.vehicles) == scenario.vehicles
    assert all("-like" in name or "Synthetic" in name for name in scenario.vehicles)
    assert (found.sample_time, found.duration) == pytest.approx((0.1, scenario.duration))


class TestTruth:
    @every_scenario
    def test_loads_what_the_scenario_used(self, scenario: Scenario) -> None:
        truth = synthetic.load_truth(synthetic.truth_path(FOLDER / f"{scenario.name}.csv"))
        origin = (scenario.description, scenario.parameters, scenario.noise, scenario.seed)
        assert truth == Truth(*origin, synthetic.GENERATOR_VERSION)

    @pytest.mark.parametrize(
        "content", ["", "[]", '{"description": "", "parameters": [{"alpha": 1}], "noise": null}']
    )
    def test_what_is_no_truth_file_is_one_sentence(self, tmp_path: Path, content: str) -> None:
        path = tmp_path / "x.truth.json"
        path.write_text(content)
        with pytest.raises(RecordingError, match=r"^x\.truth\.json: not a truth file .*\.$"):
            synthetic.load_truth(path)
        assert synthetic.main(["a", "b"]) == 2, "it takes one folder"
        with pytest.raises(RecordingError, match=r"gone\.truth\.json: there is no such truth"):
            synthetic.load_truth(tmp_path / "gone.truth.json")
