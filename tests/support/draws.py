"""How many draws the posterior takes in a test; run as a program, the app with few of them."""

import os
from collections.abc import Iterator
from contextlib import contextmanager

from accpinn.inference import population, posterior, typical, window_posterior
from accpinn.methods.pinn import training

Draws = tuple[tuple[int, ...], int, int, int]
USERS: Draws = (posterior.STAGES, posterior.FURTHER, population.BURN, population.KEPT)
FEW: Draws = ((60, 60, 100), 0, 8, 20)
PRELOAD = "DASK_DISTRIBUTED__WORKER__PRELOAD"
"""The variable that names a module whose `dask_setup` the workers of a batch call first."""


taken = USERS


def take(draws: Draws) -> Draws:
    """From now on, in place of those returned; what was kept of another number counts no more."""
    global taken
    before, taken = taken, draws
    posterior.STAGES, posterior.FURTHER, population.BURN, kept = draws
    population.KEPT = typical.KEPT = kept
    if draws == FEW:
        os.environ[PRELOAD] = "tests.support.draws"
    else:
        os.environ.pop(PRELOAD, None)
    window_posterior.window_posterior.cache_clear()
    return before


def take_few() -> None:
    """From now on: a tenth of the time, and intervals whose ends move by some per cent."""
    take(FEW)


def dask_setup(_: object) -> None:
    """Few in a worker of a batch, too."""
    take_few()


@contextmanager
def as_users_have() -> Iterator[None]:
    """All of them."""
    before = take(USERS)
    try:
        yield
    finally:
        take(before)


if __name__ == "__main__":
    from streamlit.web import cli

    training.CHECKPOINT_EVERY = 1.0  # no test need wait longer for one
    take_few()
    cli.main()
