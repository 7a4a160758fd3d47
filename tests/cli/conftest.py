"""Every test of a command has a cache of its own."""

from pathlib import Path

import pytest


@pytest.fixture(autouse=True)
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Its folder."""
    folder = tmp_path / "cache"
    monkeypatch.setenv("ACCPINN_CACHE", str(folder))
    return folder
