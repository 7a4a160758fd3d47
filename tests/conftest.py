"""Fixtures that several test modules share."""

import os
import shutil
from pathlib import Path

import pytest
from hypothesis import settings

# The same examples on every run, and no time limit an example: machines and their load differ.
settings.register_profile("house", derandomize=True, deadline=None)
settings.load_profile("house")


@pytest.fixture(scope="session")
def openacc_dir() -> Path:
    """Folder of the real OpenACC recordings; they are never part of the project."""
    folder = os.environ.get("OPENACC_DIR", "")
    if not folder or not Path(folder).is_dir():
        pytest.skip("OPENACC_DIR does not name a folder with the OpenACC recordings")
    return Path(folder)


@pytest.fixture(scope="session")
def chromium() -> str:
    """The browser that Playwright drives: $CHROMIUM, or the first one found on the path."""
    names = (os.environ.get("CHROMIUM", ""), "chromium", "chromium-browser", "google-chrome")
    found = next((path for name in names if name and (path := shutil.which(name))), None)
    if found is None:
        pytest.skip("no Chromium on this machine; install it, or name it in CHROMIUM")
    return found


@pytest.fixture(autouse=True)
def shelf_of_its_own(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """No test sees or changes the snapshots of whoever runs it."""
    monkeypatch.setenv("ACCPINN_SNAPSHOTS", str(tmp_path / "snapshots"))
