"""PyTorch, which takes a second or two to be imported, loaded while something else is done."""

from contextlib import suppress
from functools import cache
from threading import Thread

from accpinn.errors import AccpinnError


@cache
def start_loading() -> Thread:
    """Begin to import PyTorch in a thread; called as soon as a training is asked for."""
    thread = Thread(target=_try_import, name="torch-loading", daemon=True)
    thread.start()
    return thread


def wait_until_loaded() -> None:
    """Wait for the import to end.

    Raises:
        AccpinnError: where PyTorch cannot be loaded.
    """
    start_loading().join()
    try:
        _import()
    except (ImportError, OSError) as fault:  # the latter for a library of another system
        raise AccpinnError(
            f"PyTorch, which the PiNN needs, cannot be loaded ({str(fault)[:80]}); install the"
            " packages of requirements.txt again, or choose another method."
        ) from fault


def _import() -> None:
    import torch  # noqa: F401


def _try_import() -> None:
    with suppress(ImportError, OSError):  # `wait_until_loaded` reports it
        _import()
