"""How many draws the posterior takes in a test; run as a program, the app with few of them."""

import os
from collections.abc import Iterator
from contextlib import contextmanager

from accpinn.inference import answer, intervals, posterior, window_posterior

USERS = (posterior.STAGES, posterior.FURTHER, window_posterior.STAGES)
FEW = ((60, 60, 200), 0, (60, 60, 100))
PRELOAD = "DASK_DISTRIBUTED__WORKER__PRELOAD"
"""The variable that names a module whose `dask_setup` the workers of a batch call first."""


def take(draws: tuple[tuple[int, ...], int, tuple[int, ...]]) -> None:
    """From now on; nothing that was kept of another number of draws is taken for theirs."""
    posterior.STAGES, posterior.FURTHER, window_posterior.STAGES = draws
    os.environ[PRELOAD] = "tests.support.draws" if draws == FEW else ""
    for known in (intervals.shared, window_posterior.window_posterior, answer._answer):
        known.cache_clear()


def take_few() -> None:
    """From now on: a tenth of the time, and intervals whose ends move by some per cent."""
    take(FEW)


def dask_setup(_: object) -> None:
    """Few in a worker of a batch, too."""
    take_few()


@contextmanager
def as_users_have() -> Iterator[None]:
    """All of them."""
    before = posterior.STAGES, posterior.FURTHER, window_posterior.STAGES
    take(USERS)
    try:
        yield
    finally:
        take(before)


if __name__ == "__main__":
    from streamlit.web import cli

    take_few()
    cli.main()
