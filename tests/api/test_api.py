import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import accpinn
from accpinn.cli import main
from tests.support.command import ROOT
from tests.support.samples import FOLDER, NOISY

NUMBER = r"\d+(?:\.\d+)?"


def shown(document: str) -> list[tuple[str, str]]:
    """The pieces of code or command lines of a document, and what it says that they print."""
    text = (ROOT / document).read_text(encoding="utf-8")
    if document.endswith(".ipynb"):
        cells = [cell for cell in json.loads(text)["cells"] if cell["cell_type"] == "code"]
        outputs = ("".join("".join(one["text"]) for one in cell["outputs"]) for cell in cells)
        return [("".join(cell["source"]), said) for cell, said in zip(cells, outputs, strict=True)]
    return re.findall(r"```(?:python)?\n([^`]*)```\n\n```text\n(.*?)```", text, re.DOTALL)


def same(printed: str, expected: str) -> bool:
    """Whether two texts are the same but for one in the last digit of numbers, or 3 %."""
    found, given = (re.findall(NUMBER, text) for text in (printed, expected))
    words = [re.sub(NUMBER, "", text) for text in (printed, expected)]
    return words[0] == words[1] and all(
        float(number) == pytest.approx(float(other), rel=0.03, abs=1.01 * last_digit(other))
        for number, other in zip(found, given, strict=True)
    )


def last_digit(number: str) -> float:
    """What one in the last digit of a printed number is worth."""
    return float(10.0 ** -len(number.partition(".")[2]))


@pytest.mark.usefixtures("all_draws")
@pytest.mark.parametrize(
    ("document", "pieces", "report"),
    [
        ("README.md", 2, "report.html"),
        ("docs/tutorial.md", 7, "two_followers.html"),
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
    found, names = shown(document), dict[str, object]()
    assert len(found) == pieces
    assert document != "README.md" or len((ROOT / document).read_text().splitlines()) <= 120
    for code, expected in found:
        if command := re.match(r"python -m accpinn (.*)", code):
            assert main(command[1].split()) == 0
            assert same(capsys.readouterr().out.splitlines()[0], expected.strip())
        else:
            exec(code, names)
            assert same(capsys.readouterr().out, expected), code
    if report:
        assert (tmp_path / report).stat().st_size > 1e6


def read_files(package: Path) -> set[Path]:
    """All files of a package that are no code."""
    files = (path for path in package.rglob("*.*") if path.suffix not in (".py", ".pyc"))
    return {path.relative_to(package) for path in files}


def test_a_wheel_has_the_command_and_every_file_that_the_package_reads(tmp_path: Path) -> None:
    """Built as `pip install .` builds it, with the tools at hand, and without the sources."""
    copy, place = tmp_path / "copy", tmp_path / "installed"
    copy.mkdir()
    for name in ("accpinn", "pyproject.toml", "README.md", "LICENSE", "requirements.txt"):
        (shutil.copytree if (ROOT / name).is_dir() else shutil.copy)(ROOT / name, copy / name)
    pip = (sys.executable, "-m", "pip", "install", "--quiet", "--no-deps", "--no-index")
    options = ("--no-build-isolation", "--target", str(place), str(copy))
    subprocess.run([*pip, *options], check=True, capture_output=True)
    assert read_files(place / "accpinn") == read_files(ROOT / "accpinn")
    done = subprocess.run(
        [str(place / "bin" / "accpinn"), "info", str(FOLDER / f"{NOISY}.csv"), "--json"],
        cwd=tmp_path, env=os.environ | {"PYTHONPATH": str(place)}, capture_output=True, text=True,
        check=True,
    )  # fmt: skip
    assert json.loads(done.stdout)["duration"] == 300


def test_several_methods() -> None:
    file = FOLDER / f"{NOISY}.csv"
    rows = list(accpinn.compare(file, 0, 60, methods=("least-squares", "splines")))
    assert [row.analysis.method for row in rows] == ["least-squares", "splines"]
