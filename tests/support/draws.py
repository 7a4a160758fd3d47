"""How many draws the posterior takes in a test; run as a program, the app with few of them."""

from collections.abc import Iterator
from contextlib import contextmanager

from accpinn.inference import intervals, posterior

USERS = (posterior.STAGES, posterior.FURTHER)
FEW = ((60, 60, 200), 0)


def take_few() -> None:
    """From now on: a tenth of the time, and intervals whose ends move by some per cent."""
    posterior.STAGES, posterior.FURTHER = FEW


@contextmanager
def as_users_have() -> Iterator[None]:
    """All of them; nothing that was kept of one number of draws is taken for the other."""
    before = posterior.STAGES, posterior.FURTHER
    intervals._shared.cache_clear()
    posterior.STAGES, posterior.FURTHER = USERS
    try:
        yield
    finally:
        intervals._shared.cache_clear()
        posterior.STAGES, posterior.FURTHER = before


if __name__ == "__main__":
    from streamlit.web import cli

    take_few()
    cli.main()
