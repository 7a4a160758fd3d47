"""Workers of a batch that start at once."""

from collections.abc import Iterator

import pytest
from distributed import LocalCluster


@pytest.fixture(scope="module")
def cluster() -> Iterator[str]:
    """The address of a scheduler with two workers; they are threads of this process."""
    options = {"protocol": "tcp://", "dashboard_address": "127.0.0.1:0"}
    with LocalCluster(2, 1, processes=False, **options) as local:
        yield local.scheduler_address
