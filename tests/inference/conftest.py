"""Inference is tested with all draws."""

import pytest

from accpinn.inference import posterior


@pytest.fixture(autouse=True)
def all_proposals(monkeypatch: pytest.MonkeyPatch) -> None:
    """As many as users have."""
    monkeypatch.setattr(posterior, "STAGES", (200, 200, 1000))
    monkeypatch.setattr(posterior, "FURTHER", 3)
