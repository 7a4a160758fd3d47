"""The rules of the house that no tool checks: what imports what, how long, and what stays out."""

import ast
import re
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from graphlib import TopologicalSorter
from itertools import combinations
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).parent.parent
CORE = sorted((ROOT / "accpinn").rglob("*.py"))
PAGES = [path for path in (ROOT / "app.py", *(ROOT / "pages").glob("[0-9]*.py")) if path.exists()]

ORDER = (
    "units",
    "errors",
    "channels",
    "runs",
    "openacc",
    "cthp",
    "segment",
    "regression",
    "seconds",
    "synthetic",
    "published",
    "fit",
    "packing",
    "store",
    "estimators",
    "pinn",
    "evaluation",
    "jobs",
    "stability",
    "uncertainty",
    "platoon",
    "identifiability",
    "comparison",
    "sensitivity",
    "tables",
    "figures",
    "snapshot",
    "report",
    "api",
    "cli",
    "__main__",
)
"""The rooms of the core as data flows: each may import only what stands before it."""

LONGEST_MODULE = 350
LONGEST_PAGE = 100


def module_name(path: Path) -> str:
    parts = path.relative_to(ROOT).with_suffix("").parts
    return ".".join(part for part in parts if part != "__init__")


MODULES = {module_name(path): path for path in CORE}


def room(module: str) -> str:
    """accpinn.methods.pinn.loss -> pinn; the package itself has no room."""
    return module.partition(".")[2].partition(".")[0]


def imports(path: Path) -> Iterator[str]:
    """Modules of the core that a file imports, also those inside functions."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names if room(alias.name))
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path.name}: write imports in full, from accpinn..."
            base = node.module or ""
            for alias in node.names:
                whole = f"{base}.{alias.name}"
                yield whole if whole in MODULES else base


def core_imports(path: Path) -> set[str]:
    return {name for name in imports(path) if name in MODULES and room(name)}


def length(path: Path) -> int:
    return len(path.read_text(encoding="utf-8").splitlines())


@pytest.mark.parametrize("module", [name for name in MODULES if room(name)])
def test_imports_run_downstream_only(module: str) -> None:
    here = room(module)
    assert here in ORDER, f"accpinn.{here}: put it into ORDER where its imports allow"
    for name in core_imports(MODULES[module]):
        assert room(name) == here or ORDER.index(room(name)) < ORDER.index(here), (
            f"{module} imports {name}, which stands downstream of it"
        )


def test_modules_form_no_circle() -> None:
    graph = {
        # A package's __init__ only gathers; its modules do not import it back.
        name: {other for other in core_imports(path) if other != name}
        for name, path in MODULES.items()
    }
    order = list(TopologicalSorter(graph).static_order())  # raises CycleError
    assert set(order) >= set(graph)


def test_core_imports_neither_the_app_nor_anything_slow() -> None:
    names = [name for name in MODULES if not name.endswith("__main__")]
    code = (
        "import importlib, sys\n"
        f"for name in {names!r}: importlib.import_module(name)\n"
        "print(sorted({'streamlit', 'control', 'matplotlib'} & set(sys.modules)))\n"
    )
    found = subprocess.run(
        [sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True
    )
    assert found.stdout.strip() == "[]", "import control late, and streamlit only in pages"


@pytest.mark.parametrize("path", CORE, ids=lambda path: module_name(path))
def test_modules_are_short(path: Path) -> None:
    assert length(path) <= LONGEST_MODULE


@pytest.mark.parametrize("path", PAGES, ids=lambda path: path.name)
def test_pages_are_short(path: Path) -> None:
    assert length(path) <= LONGEST_PAGE


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


class TestTheme:
    @pytest.fixture
    def config(self) -> dict[str, Any]:
        return tomllib.loads((ROOT / ".streamlit" / "config.toml").read_text(encoding="utf-8"))

    def test_nothing_leaves_the_computer(self, config: dict[str, Any]) -> None:
        assert config["browser"]["gatherUsageStats"] is False
        assert config["server"]["showEmailPrompt"] is False
        assert config["server"]["address"] == "localhost"

    @pytest.mark.parametrize("side", ["light", "dark"])
    def test_can_be_read(self, config: dict[str, Any], side: str) -> None:
        theme = config["theme"][side]
        for background in (theme["backgroundColor"], theme["secondaryBackgroundColor"]):
            assert contrast(theme["textColor"], background) > 7
            assert contrast(theme["linkColor"], background) > 4.5

    @pytest.mark.parametrize("side", ["light", "dark"])
    def test_has_a_visible_colour_for_eleven_vehicles(
        self, config: dict[str, Any], side: str
    ) -> None:
        theme = config["theme"][side]
        colours = theme["chartCategoricalColors"]
        assert len(colours) == 11
        assert all(contrast(colour, theme["backgroundColor"]) >= 3 for colour in colours)
        assert all(one != other for one, other in combinations(colours, 2))


def contrast(one: str, other: str) -> float:
    """Contrast ratio of two #rrggbb colours, 1 to 21 (WCAG 2, relative luminance)."""
    dark, light = sorted((luminance(one), luminance(other)))
    return (light + 0.05) / (dark + 0.05)


def luminance(colour: str) -> float:
    channels = [int(colour[i : i + 2], 16) / 255 for i in (1, 3, 5)]
    linear = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in channels]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]


def test_an_installed_package_has_every_file_it_reads() -> None:
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    patterns = settings["tool"]["setuptools"]["package-data"]["accpinn"]
    declared = {path for pattern in patterns for path in (ROOT / "accpinn").glob(pattern)}
    tracked = [ROOT / name for name in project_files() if name.startswith("accpinn/")]
    assert {path for path in tracked if path.suffix != ".py"} == declared
