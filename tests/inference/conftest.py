"""What is said of intervals is tested with all draws."""

from collections.abc import Iterator

import pytest

from tests.support import draws


@pytest.fixture(scope="module")
def all_draws() -> Iterator[None]:
    """As many as users have; the tests of a module share what they are of."""
    with draws.as_users_have():
        yield
