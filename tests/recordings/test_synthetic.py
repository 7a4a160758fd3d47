"""The sample recordings: reproducible, realistic, and their truth can be recovered."""

from dataclasses import replace
from pathlib import Path
from shutil import copy

import numpy as np
import pytest

from accpinn.errors import RecordingError
from accpinn.model.published import ASTAZERO, VICOLUNGO
from accpinn.recordings import openacc, synthetic
from accpinn.recordings.synthetic import Truth, load_truth
from tests.support.samples import FOLDER

LAST_DIGIT = 1e-4
TRUTHS = {
    path.name.removesuffix(synthetic.SUFFIX): load_truth(path)
    for path in sorted(FOLDER.glob(f"*{synthetic.SUFFIX}"))
}


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("samples")
    for path in FOLDER.glob(f"*{synthetic.SUFFIX}"):
        copy(path, folder)
    assert synthetic.main([str(folder)]) == 0
    return folder


@pytest.mark.parametrize(("name", "truth"), TRUTHS.items(), ids=TRUTHS)
def test_committed_files_are_what_the_generator_writes(
    name: str, truth: Truth, written: Path
) -> None:
    recordings = {path.name for path in FOLDER.iterdir() if path.is_file()}
    assert recordings == {path.name for path in written.iterdir()}
    committed, made = (openacc.read(place / f"{name}.csv") for place in (FOLDER, written))
    for channel in ("time", "speed", "gap", "mode"):
        # Another machine's sine may differ in the last bit and so turn a rounding.
        stored, other = getattr(committed, channel), getattr(made, channel)
        np.testing.assert_allclose(stored, other, rtol=0, atol=1.01 * LAST_DIGIT)
    for fact in ("vehicles", "date", "acc_flag", "distance_setting", "findings"):
        assert getattr(committed, fact) == getattr(made, fact)
    assert committed.findings == ()
    assert tuple(vehicle.name for vehicle in committed.vehicles) == truth.vehicles
    assert all("-like" in name or "Synthetic" in name for name in truth.vehicles)
    assert (committed.sample_time, committed.duration) == pytest.approx((0.1, truth.duration))


class TestTruth:
    def test_parameters_are_those_that_the_paper_prints(self) -> None:
        assert TRUTHS["synthetic_astazero_like"].parameters == ASTAZERO.parameters
        assert TRUTHS["synthetic_vicolungo_like"].parameters == VICOLUNGO.parameters
        noisy, exact = (TRUTHS[f"synthetic_paper_study{part}"] for part in ("", "_noise_free"))
        assert exact == replace(noisy, noise=None, description=exact.description)

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
