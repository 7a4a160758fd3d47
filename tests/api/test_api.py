"""Documents print what they say; the package as it is installed has all that it needs."""

import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import accpinn
from accpinn import AccpinnError
from accpinn.cli import main
from tests.support.command import ROOT
from tests.support.samples import FOLDER, NOISE_FREE, NOISY

NUMBER = r"\d+(?:\.\d+)?"


def shown(document: str) -> list[tuple[str, str]]:
    """The pieces of code or command lines of a document, and what it says that they print."""
    text = (ROOT / document).read_text(encoding="utf-8")
    if document.endswith(".ipynb"):
        cells = [cell for cell in json.loads(text)["cells"] if cell["cell_type"] == "code"]
        outputs = ("".join("".join(part["text"]) for part in cell["outputs"]) for cell in cells)
        return [
            ("".join(cell["source"]), output) for cell, output in zip(cells, outputs, strict=True)
        ]
    return re.findall(r"```(?:python)?\n([^`]*)```\n\n```text\n(.*?)```", text, re.DOTALL)


def same(printed: str, expected: str) -> bool:
    """Whether two texts are the same but for one in the last digit of numbers, or 3 %."""
    numbers, given = (re.findall(NUMBER, text) for text in (printed, expected))
    words = [re.sub(NUMBER, "", text) for text in (printed, expected)]
    return words[0] == words[1] and all(
        float(number) == pytest.approx(float(other), rel=0.03, abs=1.01 * last_digit(other))
        for number, other in zip(numbers, given, strict=True)
    )


def last_digit(number: str) -> float:
    """The value of one in the last digit of a printed number."""
    return float(10.0 ** -len(number.partition(".")[2]))


@pytest.mark.usefixtures("all_draws", "registries")
@pytest.mark.parametrize(
    ("document", "pieces", "report"),
    [
        ("README.md", 2, "report.html"),
        ("docs/tutorial.md", 28, "two_followers.html"),
        ("docs/quickstart.ipynb", 7, None),
    ],
)
def test_a_document_prints_what_it_says(
    document: str, pieces: int, report: str | None, tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    """Run one after the other, with as many draws as users have."""
    (tmp_path / "sample_data").symlink_to(FOLDER)
    monkeypatch.chdir(tmp_path)
    snippets, names = shown(document), dict[str, object]()
    assert len(snippets) == pieces
    assert document != "README.md" or len((ROOT / document).read_text().splitlines()) <= 120
    for code, expected in snippets:
        if command := re.match(r"accpinn (.*)", code):
            assert main(command[1].split()) == 0
            assert same(capsys.readouterr().out.splitlines()[0], expected.strip())
        else:
            exec(code, names)
            assert same(capsys.readouterr().out, expected), code
    if report:
        assert (tmp_path / report).stat().st_size > 1e6


def test_each_of_ten_tasks_takes_five_lines() -> None:
    text = (ROOT / "docs/tutorial.md").read_text(encoding="utf-8")
    tasks = text.partition("## Ten tasks")[2]
    assert re.findall(r"^(\d+)\. ", tasks, re.MULTILINE) == [str(k) for k in range(1, 11)]
    scripts = re.findall(r"```python\n([^`]*)```\n\n```text", tasks)
    assert len(scripts) >= 10
    assert max(len(script.splitlines()) for script in scripts) <= 5
    assert all(script.startswith("import accpinn\n") for script in scripts)


def read_files(package: Path) -> set[Path]:
    """All files of a package that are no code."""
    files = (path for path in package.rglob("*.*") if path.suffix not in (".py", ".pyc"))
    return {path.relative_to(package) for path in files}


PACKAGED = (
    "accpinn", "app.py", "pages", "sample_data", ".streamlit", "pyproject.toml", "setup.py",
    "README.md", "LICENSE", "requirements.txt",
)  # fmt: skip
INSTALLED = """
import sys, accpinn
from streamlit.testing.v1 import AppTest
from accpinn.storage import shipped
assert accpinn.sample("paper_study").duration == 300
assert shipped("sample_data").is_relative_to(sys.argv[1])
page = AppTest.from_file(str(shipped("app.py")), default_timeout=60).run()
assert not page.exception, page.exception
print(len(page.main), (shipped("app.py").parent / ".streamlit" / "config.toml").is_file())
"""


def test_a_wheel_has_the_command_the_app_the_samples_and_every_file_that_they_read(
    tmp_path: Path,
) -> None:
    """Built as `pip install .` builds it, with the tools at hand, and without the sources."""
    copy, place = tmp_path / "copy", tmp_path / "installed"
    copy.mkdir()
    unwanted = shutil.ignore_patterns("__pycache__")
    for name in PACKAGED:
        if (ROOT / name).is_dir():
            shutil.copytree(ROOT / name, copy / name, ignore=unwanted)
        else:
            shutil.copy(ROOT / name, copy / name)
    pip = (sys.executable, "-m", "pip", "install", "--quiet", "--no-deps", "--no-index")
    options = ("--no-build-isolation", "--target", str(place), str(copy))
    subprocess.run([*pip, *options], check=True, capture_output=True)
    package, app = place / "accpinn", place / "accpinn" / "app"
    assert read_files(ROOT / "accpinn") <= read_files(package)
    assert read_files(app / "pages") == read_files(ROOT / "pages")
    assert read_files(package / "sample_data") == read_files(FOLDER)
    assert {path.name for path in app.iterdir()} - {"__pycache__"} == {
        "app.py", "pages", ".streamlit",
    }  # fmt: skip
    variables = {"PYTHONPATH": str(place), "ACCPINN_CACHE": str(tmp_path / "cache")}
    of_process = {
        "cwd": tmp_path,
        "env": os.environ | variables,
        "capture_output": True,
        "text": True,
    }
    done = subprocess.run(
        [str(place / "bin" / "accpinn"), "info", str(FOLDER / f"{NOISY}.csv"), "--json"],
        check=True, **of_process,
    )  # fmt: skip
    assert json.loads(done.stdout)["duration"] == 300
    run = subprocess.run([sys.executable, "-c", INSTALLED, str(place)], check=False, **of_process)
    assert run.stdout.split()[1:] == ["True"], run.stderr
    assert int(run.stdout.split()[0]) > 2


FILE = FOLDER / f"{NOISY}.csv"
QUICK = {"method": "least-squares"}


def test_several_methods_on_several_windows() -> None:
    windows = [(0, 60), (100, 160)]
    rows = list(accpinn.compare(FILE, windows=windows, methods=("least-squares", "splines")))
    assert [row.analysis.method for row in rows] == ["least-squares", "splines"]
    for row in rows:
        alone = accpinn.fit(FILE, windows=windows, method=row.analysis.method)
        np.testing.assert_array_equal(row.parameters.values, alone.parameters.values)


def test_segments_in_place_of_a_recording_give_the_same() -> None:
    recording = accpinn.read(FILE)
    segments = [accpinn.cut(recording, start, 60) for start in (0, 100)]
    for given, options in (
        (segments[0], {"start": 0, "duration": 60}),
        (segments, {"windows": "0-60,100-160"}),
    ):
        result, expected = accpinn.fit(given, **QUICK), accpinn.fit(recording, **options, **QUICK)
        np.testing.assert_array_equal(result.parameters.values, expected.parameters.values)
        assert result.infos == expected.infos
        (row,) = accpinn.compare(given, methods=("least-squares",))
        np.testing.assert_array_equal(row.parameters.values, expected.parameters.values)


def test_segments_of_two_recordings_share_their_parameters() -> None:
    segments = [accpinn.cut(accpinn.read(FOLDER / f"{name}.csv"), 0, 60)
                for name in (NOISY, NOISE_FREE)]  # fmt: skip
    joint = accpinn.fit(segments, **QUICK)
    alone = [accpinn.fit(segment, **QUICK).parameters.alpha[0] for segment in segments]
    assert min(alone) < joint.parameters.alpha[0] < max(alone)
    assert [info.source for info in joint.infos] == [segment.source for segment in segments]


@pytest.mark.parametrize(
    ("options", "method", "preset", "model"),
    [
        ({}, "pinn", "calibrated", "cthp-s0-delay"),
        ({"model": "cthp"}, "pinn", "calibrated", "cthp"),
        ({"model": "idm"}, "simulation", None, "idm"),
        ({"preset": "fast"}, "pinn", "fast", "cthp"),
        ({"preset": "fast", "model": "idm"}, "pinn", "fast", "idm"),
        ({"method": "maximum-likelihood"}, "pinn", "calibrated", "cthp-s0-delay"),
        ({"method": "splines"}, "splines", None, "cthp"),
        ({"method": "simulation"}, "simulation", None, "cthp-s0-delay"),
    ],
)
def test_defaults_of_method_preset_and_model(
    options: dict[str, str], method: str, preset: str | None, model: str
) -> None:
    analysis = accpinn.analyse(accpinn.read(FILE), **options)
    assert (analysis.method, analysis.settings.get("preset"), analysis.spec.model) == (
        method,
        preset,
        model,
    )
    assert [(window.start, window.end) for window in analysis.windows] == [(0, 300)]


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"windows": "0-60", "start": 0}, "start: the windows say where they lie; leave start out"),
        ({"windows": [(0, 60)], "duration": 60}, "leave duration out"),
        ({"windows": []}, r"windows: \[\] is not allowed; choose pairs"),
        ({"windows": [3]}, "choose pairs of start and end"),
        ({"preset": "fast", "method": "splines"}, "the method splines has none; leave preset out"),
        ({"preset": "fast", "method": "maximum-likelihood"}, "means pinn with the preset calibr"),
        ({"preset": "calibrated", "model": "idm"}, "choose the method simulation"),
        ({"settings": {"depth": 3}}, "depth is not known; choose from preset"),
        ({"settings": {"iterations": 0}}, "iterations: 0 is not allowed"),
        ({"seed": True}, "choose a whole number"),
        ({"fixed": {"s0": 900.0}}, "s0 = 900 is not allowed"),
    ],
)
def test_contradicting_arguments_are_refused(options: dict[str, Any], words: str) -> None:
    with pytest.raises(AccpinnError, match=words):
        accpinn.fit(FILE, **options)


def test_wrong_sources_and_choices_that_segments_exclude_are_refused() -> None:
    segment = accpinn.cut(accpinn.read(FILE), 0, 60)
    for source, options, words in (
        (
            segment,
            {"vehicles": "1-2"},
            "vehicles: the segments are cut already; leave vehicles out",
        ),
        ([segment], {"start": 0}, "leave start out"),
        ([segment], {"exclude": "standstill"}, "leave exclude out"),
        ([], {}, "choose a file's path, a recording, or segments"),
        ([FILE], {}, "choose a file's path, a recording, or segments"),
        (3, {}, "choose a file's path"),
        ([segment, segment], {}, "overlap"),
    ):
        with pytest.raises(AccpinnError, match=words):
            accpinn.fit(source, **options, **QUICK)
