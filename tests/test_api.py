import re
import shutil
from pathlib import Path

import pytest

from accpinn import api
from accpinn.errors import ConfigError
from accpinn.snapshot import check
from tests.samples import FOLDER, NOISY, sample

ROOT = Path(__file__).parent.parent


def test_readmes_lines_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    [lines] = re.findall(r"```python\n(.*?)```", text, re.DOTALL)
    assert len([line for line in lines.splitlines() if line]) == 3
    shutil.copy(FOLDER / f"{NOISY}.csv", tmp_path / "recording.csv")
    monkeypatch.chdir(tmp_path)
    names: dict[str, object] = {}
    exec(lines, names)
    study, kept = names["study"], api.load("result.accpinn.zip")
    assert isinstance(study, api.Study)
    assert kept.fit.parameters == study.parameters
    truth = sample(NOISY).truth[0]
    assert study.parameters[0].tau == pytest.approx(truth[2], rel=0.05)
    assert api.verify("result.accpinn.zip", study.recording).ok


def test_a_study_knows_its_worth() -> None:
    study = api.fit(FOLDER / f"{NOISY}.csv", 10, 60, method="splines")
    assert study.segment.start == 10
    assert study.uncertainty.lower[0, 2] < study.parameters[0].tau
    assert study.assessment.unseen_seconds > 100
    assert study.stability.vehicles[0].parameters == study.parameters[0]
    snapshot = study.snapshot(name="mine", with_data=True)
    assert snapshot.name == "mine"
    assert check(snapshot).ok


def test_an_unknown_method_is_named() -> None:
    with pytest.raises(ConfigError, match="guess"):
        api.fit(FOLDER / f"{NOISY}.csv", method="guess")
