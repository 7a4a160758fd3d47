import re
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from accpinn.results.snapshot.verification import verify

import accpinn
from accpinn.errors import AccpinnError, SnapshotError
from accpinn.methods.state_space import FORMS
from tests.support.command import ROOT
from tests.support.openacc_files import platoon, recording
from tests.support.samples import FOLDER, NOISY, sample

NUMBER = r"\d+(?:\.\d+)?"


def test_the_readmes_example_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    [lines] = re.findall(r"```python\n(.*?)```", text, re.DOTALL)
    shutil.copy(FOLDER / f"{NOISY}.csv", tmp_path / "recording.csv")
    monkeypatch.chdir(tmp_path)
    names: dict[str, object] = {}
    exec(lines, names)
    study, kept = names["study"], accpinn.load("result.accpinn.zip")
    assert isinstance(study, accpinn.Study)
    assert kept.fit.parameters == study.parameters
    truth = sample(NOISY).truth[0]
    assert study.parameters[0].tau == pytest.approx(truth[2], rel=0.05)
    assert accpinn.verify("result.accpinn.zip", study.recording).ok
    assert b"<!doctype html" in (tmp_path / "report.html").read_bytes()[:100].lower()


def test_the_tutorial_prints_what_it_says(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    text = (ROOT / "docs" / "tutorial.md").read_text(encoding="utf-8")
    (tmp_path / "sample_data").symlink_to(FOLDER)
    monkeypatch.chdir(tmp_path)
    names: dict[str, object] = {}
    shown = re.findall(r"```python\n(.*?)```\n\n```text\n(.*?)```", text, re.DOTALL)
    assert len(shown) == text.count("```python")
    for code, expected in shown:
        exec(code, names)
        printed = capsys.readouterr().out
        assert re.sub(NUMBER, "", printed) == re.sub(NUMBER, "", expected)
        # Of fewer draws than users have, the ends of intervals lie a little elsewhere.
        numbers, others = (list(map(float, re.findall(NUMBER, one))) for one in (printed, expected))
        assert numbers == pytest.approx(others, rel=0.03, abs=0.002), code
    assert (tmp_path / "two_followers.html").stat().st_size > 1e6


def test_a_study_computes_what_it_is_asked_for() -> None:
    study = accpinn.fit(FOLDER / f"{NOISY}.csv", 10, 60, method="splines")
    assert study.segment.start == 10
    assert study.uncertainty.lower[0].tau < study.parameters[0].tau
    assert study.evaluation.out_of_window_seconds > 100
    assert study.stability.vehicles[0].parameters == study.parameters[0]
    [transfer] = study.transfer_function()
    peak = study.stability.vehicles[0].peak
    assert abs(transfer(1j * peak.omega)) == pytest.approx(peak.gain)
    snapshot = study.snapshot(name="mine", with_data=True)
    assert (snapshot.name, snapshot.adequacy) == ("mine", None)
    assert [form.form for form in study.adequacy.forms] == list(FORMS)
    snapshot = study.snapshot(with_data=True)
    assert snapshot.adequacy is study.adequacy
    assert verify(snapshot).ok


@pytest.mark.parametrize(
    ("asked", "words"),
    [
        ({"recording": None}, "recording"),
        ({"recording": 5}, "recording"),
        ({"method": "guess"}, "guess"),
        ({"case": "III"}, "choose I or II"),
        ({"start": "0"}, "start"),
        ({"start": None}, "start"),
        ({"duration": True}, "duration"),
        ({"seed": "a"}, "seed"),
        ({"seed": 1.5}, "seed"),
        ({"vehicles": (1.0, 2.0)}, "vehicles"),
        ({"vehicles": "all"}, "1-5"),
        ({"exclude": "lunch"}, "catching-up"),
        ({"exclude": ["lunch"]}, "catching-up"),
        ({"method": "pinn", "threads": -1}, "threads"),
        ({"method": "pinn", "threads": "2"}, "threads"),
    ],
    ids=str,
)
def test_an_argument_out_of_range_is_named(asked: dict[str, Any], words: str) -> None:
    with pytest.raises(AccpinnError, match=words):
        accpinn.fit(**{"recording": FOLDER / f"{NOISY}.csv", "method": "splines"} | asked)


@pytest.mark.parametrize("regime", ["catching-up", "catching up", ["catching up"]])
def test_arguments_may_be_spelt_as_on_the_command_line(regime: str | list[str]) -> None:
    study = accpinn.fit(
        FOLDER / f"{NOISY}.csv", 0, 60, "1-2", method="least-squares", exclude=regime
    )
    assert study.segment.vehicles == (1, 2)


@pytest.mark.parametrize("name", [None, 5, "\ud800"])
def test_a_name_that_is_no_text_is_refused_before_anything_is_written(
    tmp_path: Path, name: Any
) -> None:
    study = accpinn.fit(FOLDER / f"{NOISY}.csv", 0, 60, method="least-squares")
    with pytest.raises(SnapshotError, match="name is no text"):
        study.save(tmp_path / "a.accpinn.zip", name=name)
    assert not list(tmp_path.iterdir())
    path = study.save(tmp_path / "a.accpinn.zip")
    assert accpinn.verify(path, FOLDER / f"{NOISY}.csv").ok


def test_a_recording_with_missing_samples_is_fitted_whole() -> None:
    frame = platoon(vehicles=2)
    frame.loc[100:149, ["Speed2", "IVS1"]] = np.nan
    study = accpinn.fit(recording(frame, "AB"), method="maximum-likelihood")
    assert study.segment.samples == len(frame)
    assert len(study.segment.blocks_missing) == 1
    assert study.evaluation.closed_loop is not None
    with pytest.raises(AccpinnError, match=r"Speed2 is missing .* or choose maximum-likelihood"):
        accpinn.fit(recording(frame, "AB"), method="least-squares")
