"""The sample recordings: reproducible, realistic, and their truth can be recovered."""

from pathlib import Path

import numpy as np
import pytest

from accpinn.errors import RecordingError
from accpinn.recordings import openacc, synthetic
from accpinn.recordings.synthetic import SCENARIOS, Scenario, Truth
from accpinn.units import FloatArray
from tests.support.samples import FOLDER

LAST_DIGIT = 1e-4
BY_NAME = {scenario.name: scenario for scenario in SCENARIOS}

every_scenario = pytest.mark.parametrize("scenario", SCENARIOS, ids=BY_NAME)


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("samples")
    for scenario in SCENARIOS:
        synthetic.write(scenario, folder)
    return folder


def table(path: Path) -> tuple[bytes, list[list[str]]]:
    """The six header rows as they are, and the cells below."""
    lines = path.read_bytes().split(b"\r\n")
    return b"\r\n".join(lines[:6]), [line.decode().split(",") for line in lines[6:-1]]


def numbers(rows: list[list[str]], columns: int) -> FloatArray:
    return np.array([row[:columns] for row in rows], dtype=float)


class TestCommittedFiles:
    @every_scenario
    def test_are_what_the_generator_writes(self, scenario: Scenario, written: Path) -> None:
        name, truth = f"{scenario.name}.csv", f"{scenario.name}.truth.json"
        assert (FOLDER / truth).read_bytes() == (written / truth).read_bytes()
        expected = {f"{s.name}{ending}" for s in SCENARIOS for ending in (".csv", ".truth.json")}
        assert {path.name for path in FOLDER.iterdir()} == expected
        header, rows = table(FOLDER / name)
        new_header, new_rows = table(written / name)
        assert header == new_header
        assert len(rows) == len(new_rows)
        columns = 2 * len(scenario.vehicles)
        assert [row[columns:] for row in rows] == [row[columns:] for row in new_rows]
        # Another machine's sine may differ in the last bit and so turn a rounding.
        np.testing.assert_allclose(
            numbers(rows, columns), numbers(new_rows, columns), rtol=0, atol=1.01 * LAST_DIGIT
        )

    @every_scenario
    def test_read_as_recordings_without_findings(self, scenario: Scenario) -> None:
        recording = openacc.read(FOLDER / f"{scenario.name}.csv")
        assert recording.findings == ()
        assert tuple(vehicle.name for vehicle in recording.vehicles) == scenario.vehicles
        assert all("-like" in name or "Synthetic" in name for name in scenario.vehicles)
        assert recording.sample_time == pytest.approx(0.1, abs=1e-9)
        assert recording.duration == pytest.approx(scenario.duration)


class TestTruth:
    @every_scenario
    def test_loads_what_the_scenario_used(self, scenario: Scenario) -> None:
        truth = synthetic.load_truth(synthetic.truth_path(FOLDER / f"{scenario.name}.csv"))
        origin = (scenario.description, scenario.parameters, scenario.noise, scenario.seed)
        assert truth == Truth(*origin, synthetic.GENERATOR_VERSION)

    @pytest.mark.parametrize(
        "content",
        ["", "[]", '{"description": "", "parameters": [{"alpha": 1}], "noise": null}'],
    )
    def test_what_is_no_truth_file_is_one_sentence(self, tmp_path: Path, content: str) -> None:
        path = tmp_path / "x.truth.json"
        path.write_text(content)
        with pytest.raises(RecordingError, match=r"^x\.truth\.json: not a truth file .*\.$"):
            synthetic.load_truth(path)
        with pytest.raises(RecordingError, match=r"gone\.truth\.json: there is no such truth"):
            synthetic.load_truth(tmp_path / "gone.truth.json")


def test_the_command_writes_everything_into_a_new_folder(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert synthetic.main([str(tmp_path / "new")]) == 0
    assert len(list((tmp_path / "new").iterdir())) == 2 * len(SCENARIOS)
    assert capsys.readouterr().out.count("\n") == len(SCENARIOS)
    assert synthetic.main(["a", "b"]) == 2
    assert capsys.readouterr().err.startswith("usage:")
