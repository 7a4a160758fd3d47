import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import accpinn
from tests.support import draws
from tests.support.command import ROOT
from tests.support.samples import FOLDER, NOISY, sample

NUMBER = r"\d+(?:\.\d+)?"


def run_as_users_do(folder: Path, *command: str) -> str:
    """What a program of its own prints, with as many draws as users have."""
    (folder / "sample_data").symlink_to(FOLDER)
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "ACCPINN_CACHE": str(folder / "cache")}
    program = [sys.executable, *command]
    done = subprocess.run(
        program, cwd=folder, env=environment, capture_output=True, text=True, check=True
    )
    return done.stdout


def same(printed: str, expected: str) -> bool:
    """Whether two texts are the same but for the last digits of numbers."""
    numbers, others = (list(map(float, re.findall(NUMBER, one))) for one in (printed, expected))
    words = [re.sub(NUMBER, "", one) for one in (printed, expected)]
    return words[0] == words[1] and numbers == pytest.approx(others, rel=0.03, abs=0.101)


def test_the_readme_prints_what_it_says(tmp_path: Path) -> None:
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    assert len(text.splitlines()) <= 120
    shown = re.findall(r"```(?:python)?\n([^`]*)```\n\n```text\n(.*?)```", text, re.DOTALL)
    (code, printed), (command, first) = shown
    assert same(run_as_users_do(tmp_path, "-c", code), printed)
    kept = accpinn.load(tmp_path / "result.accpinn.zip")
    assert kept.answer.time_gap(20.0, 0).lower < sample(NOISY).truth[0][2]
    assert b"<!doctype html" in (tmp_path / "report.html").read_bytes()[:100].lower()
    (tmp_path / "sample_data").unlink()
    assert same(run_as_users_do(tmp_path, *command.split()[1:]).splitlines()[0], first.strip())


def test_the_quick_start_prints_what_it_says(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Its cells run one after the other, as a notebook does."""
    (tmp_path / "sample_data").symlink_to(FOLDER)
    monkeypatch.chdir(tmp_path)
    notebook = json.loads((ROOT / "docs" / "quickstart.ipynb").read_text(encoding="utf-8"))
    cells = [cell for cell in notebook["cells"] if cell["cell_type"] == "code"]
    names: dict[str, object] = {}
    with draws.as_users_have():
        for cell in cells:
            exec("".join(cell["source"]), names)
            said = "".join("".join(output["text"]) for output in cell["outputs"])
            assert same(capsys.readouterr().out, said)


def test_a_wheel_has_the_command_and_the_package(tmp_path: Path) -> None:
    """Built as `pip install .` builds it, with the tools at hand, and without the sources."""
    copy, place = tmp_path / "copy", tmp_path / "installed"
    copy.mkdir()
    for name in ("accpinn", "pyproject.toml", "README.md", "LICENSE", "requirements.txt"):
        (shutil.copytree if (ROOT / name).is_dir() else shutil.copy)(ROOT / name, copy / name)
    pip = (sys.executable, "-m", "pip", "install", "--quiet", "--no-deps", "--no-index")
    options = ("--no-build-isolation", "--target", str(place), str(copy))
    subprocess.run([*pip, *options], check=True, capture_output=True)
    environment = {**os.environ, "PYTHONPATH": str(place)}
    done = subprocess.run(
        [str(place / "bin" / "accpinn"), "info", str(FOLDER / f"{NOISY}.csv"), "--json"],
        cwd=tmp_path, env=environment, capture_output=True, text=True, check=True,
    )  # fmt: skip
    assert json.loads(done.stdout)["duration"] == 300
    where = "import accpinn; print(accpinn.__file__)"
    found = subprocess.run(
        [sys.executable, "-P", "-c", where], cwd=tmp_path, env=environment, capture_output=True,
        text=True, check=True,
    )  # fmt: skip
    assert found.stdout.startswith(str(place))


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


def test_several_windows_and_several_methods() -> None:
    file = FOLDER / f"{NOISY}.csv"
    joint = accpinn.fit(file, windows=[(0, 60), (60, 120)], method="maximum-likelihood")
    assert joint.analysis == accpinn.analyse(
        accpinn.read(file), windows="0-60,60-120", method="maximum-likelihood"
    )
    assert joint.answer.time_gap(20.0, 0).value == pytest.approx(1.5, rel=0.05)
    rows = list(accpinn.compare(file, 0, 60, methods=("least-squares", "splines")))
    assert [row.analysis.method for row in rows] == ["least-squares", "splines"]
