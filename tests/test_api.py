import re
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import accpinn
from accpinn.errors import AccpinnError, SnapshotError
from accpinn.inference.model_adequacy import FORMS
from accpinn.study.snapshot import named, to_bytes
from accpinn.study.verification import verify
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
    result, kept = names["result"], accpinn.load("result.accpinn.zip")
    assert isinstance(result, accpinn.Result)
    assert kept.parameters == result.parameters
    truth = sample(NOISY).truth[0]
    assert result.parameters[0].tau == pytest.approx(truth[2], rel=0.05)
    assert accpinn.verify("result.accpinn.zip", result.recording).ok
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


def test_a_result_computes_what_it_is_asked_for() -> None:
    result = accpinn.fit(FOLDER / f"{NOISY}.csv", 10, 60, method="splines")
    assert result.segment.start == 10
    assert result.uncertainty.lower[0].tau < result.parameters[0].tau
    assert result.evaluation.out_of_window_seconds > 100
    snapshot = accpinn.load(to_bytes(named(result, "mine", with_data=True)))
    assert (snapshot.name, snapshot.parts.adequacy) == ("mine", None)
    assert [form.form for form in result.adequacy.forms] == list(FORMS)
    snapshot = named(result, with_data=True)
    assert snapshot.adequacy is result.adequacy
    assert verify(snapshot).ok


def test_several_windows_and_several_methods() -> None:
    file = FOLDER / f"{NOISY}.csv"
    joint = accpinn.fit(file, windows=[(0, 60), (60, 120)], method="maximum-likelihood")
    assert joint.analysis == accpinn.analyse(
        accpinn.read(file), windows="0-60,60-120", method="maximum-likelihood"
    )
    assert joint.answer.time_gap(20.0, 0).value == pytest.approx(1.5, rel=0.05)
    rows = list(accpinn.compare(file, 0, 60, methods=("least-squares", "splines")))
    assert [row.analysis.method for row in rows] == ["least-squares", "splines"]


@pytest.mark.parametrize("regime", ["catching-up", "catching up", ["catching up"]])
def test_arguments_may_be_spelt_as_on_the_command_line(regime: str | list[str]) -> None:
    result = accpinn.fit(
        FOLDER / f"{NOISY}.csv", 0, 60, "1-2", method="least-squares", exclude=regime
    )
    assert result.segment.vehicles == (1, 2)


@pytest.mark.parametrize("name", [None, 5, "\ud800"])
def test_a_name_that_is_no_text_is_refused_before_anything_is_written(
    tmp_path: Path, name: Any
) -> None:
    result = accpinn.fit(FOLDER / f"{NOISY}.csv", 0, 60, method="least-squares")
    with pytest.raises(SnapshotError, match="name is no text"):
        accpinn.save(result, tmp_path / "a.accpinn.zip", name=name)
    assert not list(tmp_path.iterdir())
    path = accpinn.save(result, tmp_path / "a.accpinn.zip")
    assert accpinn.verify(path, FOLDER / f"{NOISY}.csv").ok


def test_a_recording_with_missing_samples_is_fitted_whole() -> None:
    frame = platoon(vehicles=2)
    frame.loc[100:149, ["Speed2", "IVS1"]] = np.nan
    result = accpinn.fit(recording(frame, "AB"), method="maximum-likelihood")
    assert result.segment.samples == len(frame)
    assert len(result.segment.blocks_missing) == 1
    assert result.evaluation.closed_loop is not None
    with pytest.raises(AccpinnError, match=r"Speed2 is missing .* or choose maximum-likelihood"):
        accpinn.fit(recording(frame, "AB"), method="least-squares")
