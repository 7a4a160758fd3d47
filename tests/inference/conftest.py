"""Inference is tested with all draws."""

from collections.abc import Iterator

import pytest

from tests.support import draws


@pytest.fixture(autouse=True)
def all_draws() -> Iterator[None]:
    """As many as users have."""
    with draws.as_users_have():
        yield
