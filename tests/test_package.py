"""The package as a whole: what importing it offers and loads, and what its files hold."""

import re
import subprocess
from pathlib import Path

import pytest

import accpinn
from tests.support.command import loaded_after

ROOT = Path(__file__).parent.parent
PACKAGE = ROOT / "accpinn"


def test_importing_the_package_loads_nothing_slow() -> None:
    slow = ("numpy", "torch", "pandas", "scipy", "streamlit")
    assert not loaded_after("import accpinn.cli; dir(accpinn)", *slow)


SAMPLE = "sample_data/synthetic_paper_study.csv"
FIT = f"fit {SAMPLE} --duration 30 --no-cache"


@pytest.mark.parametrize(
    ("command", "slow"),
    [
        (f"info {SAMPLE}", "torch pandas scipy jinja2 pyarrow"),
        (FIT, "torch pandas scipy.signal streamlit control matplotlib"),
        (f"{FIT} --preset fast --iterations 5", "torch._dynamo pandas scipy.optimize scipy.signal"),
    ],
)
def test_a_command_waits_for_nothing_that_it_does_not_need(command: str, slow: str) -> None:
    few = (
        "from accpinn.inference import posterior; posterior.STAGES, posterior.FURTHER = (60, 60), 0"
    )
    code = f"from accpinn.cli import main; main({command.split()!r})"
    code = f"{few}\n{code}" if command.startswith("fit") else code
    assert not loaded_after(code, *slow.split())


def test_public_names_exist_and_are_documented() -> None:
    stub = (PACKAGE / "__init__.pyi").read_text(encoding="utf-8")
    assert sorted(accpinn.__all__) == sorted(re.findall(r"import \w+ as (\w+)", stub))
    for name in accpinn.__all__:
        assert getattr(accpinn, name) is not None
        assert re.search(rf"\b{name}\b", accpinn.__doc__), name


def project_files() -> list[str]:
    """All files of the project, relative to its root; new ones too."""
    listed = subprocess.run(
        ["git", "ls-files", "--cached", "--others", "--exclude-standard", "-z"],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )
    if listed.returncode:
        pytest.skip("not a git checkout, so there is no list of the project's files")
    return [name for name in listed.stdout.split("\0") if name and (ROOT / name).is_file()]


def test_no_file_names_a_place_on_one_machine() -> None:
    folders = "|".join(("work", "tmp", "home", "root", "Users", "opt"))
    hosts = "|".join(("pypi", "pythonhosted", "npmjs"))
    forbidden = re.compile(rf"(?<![\w.\-/*])/({folders})/\w|\b({hosts})\.(org|com)\b")
    found = [
        f"{name}:{number}: {line.strip()[:80]}"
        for name in project_files()
        if not name.startswith("sample_data/")
        for number, line in enumerate(
            (ROOT / name).read_text(encoding="utf-8", errors="replace").splitlines(), 1
        )
        if forbidden.search(line)
    ]
    assert found == []


def test_the_container_gets_all_that_the_app_needs() -> None:
    lines = (ROOT / "Containerfile").read_text(encoding="utf-8").splitlines()
    copied = [name for line in lines if line.startswith("COPY ") for name in line.split()[1:-1]]
    tracked = project_files()
    for name in copied:
        assert any(file == name or file.startswith(f"{name}/") for file in tracked), name
    scripts = [ROOT / "app.py", *(ROOT / "pages").rglob("*.py"), *PACKAGE.rglob("*.py")]
    code = "\n".join(path.read_text(encoding="utf-8") for path in scripts)
    imported = set(re.findall(r"^ *(?:from|import) (\w+)", code, re.MULTILINE))
    own = {path.name for path in ROOT.iterdir() if path.is_dir()}
    assert {"accpinn", "pages"} <= imported & own <= set(copied)
    assert {"app.py", "sample_data", "requirements.txt", ".streamlit/config.toml"} <= set(copied)
