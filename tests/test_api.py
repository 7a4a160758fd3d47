import re
import shutil
from pathlib import Path
from typing import Any

import pytest

from accpinn import api
from accpinn.errors import AccpinnError, ConfigError, SnapshotError
from accpinn.results.snapshot.checking import check
from tests.support.samples import FOLDER, NOISY, sample

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
    assert study.evaluation.out_of_window_seconds > 100
    assert study.stability.vehicles[0].parameters == study.parameters[0]
    snapshot = study.snapshot(name="mine", with_data=True)
    assert snapshot.name == "mine"
    assert check(snapshot).ok


def test_an_unknown_method_is_named() -> None:
    with pytest.raises(ConfigError, match="guess"):
        api.fit(FOLDER / f"{NOISY}.csv", method="guess")


@pytest.mark.parametrize(
    ("asked", "words"),
    [
        ({"case": "III"}, "choose I or II"),
        ({"start": "0"}, "start"),
        ({"start": None}, "start"),
        ({"duration": True}, "duration"),
        ({"seed": "a"}, "seed"),
        ({"seed": 1.5}, "seed"),
        ({"vehicles": (1.0, 2.0)}, "vehicles"),
        ({"vehicles": "all"}, "1-5"),
        ({"leaving_out": "lunch"}, "catching-up"),
        ({"leaving_out": ["lunch"]}, "catching-up"),
        ({"method": "pinn", "threads": -1}, "threads"),
        ({"method": "pinn", "threads": "2"}, "threads"),
    ],
    ids=str,
)
def test_what_cannot_be_asked_is_said(asked: dict[str, Any], words: str) -> None:
    with pytest.raises(AccpinnError, match=words):
        api.fit(FOLDER / f"{NOISY}.csv", **{"method": "splines"} | asked)


@pytest.mark.parametrize("source", [None, 5])
def test_what_is_no_file_is_said(source: Any) -> None:
    with pytest.raises(ConfigError, match="recording"):
        api.fit(source)


@pytest.mark.parametrize("regime", ["catching-up", "catching up", ["catching up"]])
def test_choices_may_be_spelt_as_on_the_command_line(regime: str | list[str]) -> None:
    study = api.fit(
        FOLDER / f"{NOISY}.csv", 0, 60, "1-2", method="least-squares", leaving_out=regime
    )
    assert study.segment.vehicles == (1, 2)


@pytest.mark.parametrize("name", [None, 5, "\ud800"])
def test_a_name_that_is_no_text_is_refused_unwritten(tmp_path: Path, name: Any) -> None:
    study = api.fit(FOLDER / f"{NOISY}.csv", 0, 60, method="least-squares")
    with pytest.raises(SnapshotError, match="name is no text"):
        study.save(tmp_path / "a.accpinn.zip", name=name)
    assert not list(tmp_path.iterdir())


def test_verifying_takes_the_recordings_path(tmp_path: Path) -> None:
    study = api.fit(FOLDER / f"{NOISY}.csv", 0, 60, method="least-squares")
    path = study.save(tmp_path / "a.accpinn.zip")
    assert api.verify(path, FOLDER / f"{NOISY}.csv").ok
