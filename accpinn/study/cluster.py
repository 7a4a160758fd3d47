"""The workers of a batch, by dask.distributed: those on this machine, or of a scheduler elsewhere.

On this machine they are processes of one thread each.
"""

import os
import queue
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from typing import TYPE_CHECKING, Any, Protocol, TypeVar

from accpinn import __version__
from accpinn.errors import RecordingError
from accpinn.units import Seconds

if TYPE_CHECKING:
    from distributed import Client, Future

AHEAD = 2
"""Tasks that each worker has: one at work, and the next, so that none waits."""
POLL: Seconds = 0.2
DEATHS = 1
"""Of workers, after which a task is put off: it may have been another that they died at."""
CONNECT: Seconds = 20.0
"""How long a scheduler may take to answer, and to have a worker."""
WORKERLESS: Seconds = 180.0
"""Without a worker on this machine for so long, a batch ends: they cannot be started."""


class Keyed(Protocol):
    """A task that has a name of its own."""

    @property
    def key(self) -> str:
        """The name."""


T = TypeVar("T", bound=Keyed)


@contextmanager
def connected(
    workers: int | None, scheduler: str | None, processes: bool = True
) -> "Iterator[Client]":
    """A client of a scheduler with workers: the one at an address, or one on this machine.

    Args:
        workers: how many on this machine; by default one for each processor.
        scheduler: the address.
        processes: whether workers on this machine are processes of their own.

    Raises:
        RecordingError: when it cannot be reached, has no workers, or these lack the package.
    """
    import dask
    from distributed import Client, LocalCluster

    settings = {
        "distributed.admin.large-graph-warning-threshold": "1GB",
        "distributed.scheduler.allowed-failures": DEATHS,
    }
    if scheduler is None:  # a worker of a busy machine may take long to be heard of
        settings["distributed.comm.timeouts.connect"] = f"{WORKERLESS:g}s"
    with ExitStack() as opened:
        opened.enter_context(dask.config.set(settings))
        if scheduler is None:
            space = opened.enter_context(tempfile.TemporaryDirectory(prefix="accpinn-"))
            count = workers or os.cpu_count() or 1
            try:
                address: Any = opened.enter_context(
                    LocalCluster(
                        n_workers=count,
                        threads_per_worker=1,
                        processes=processes,
                        protocol="tcp://",
                        dashboard_address="127.0.0.1:0",
                        local_directory=space,
                        memory_limit=0,
                        silence_logs=50,
                    )
                )
            except (OSError, RuntimeError, TimeoutError) as fault:
                raise _no_workers(fault) from None
        else:
            address = scheduler
        patience = WORKERLESS if scheduler is None else CONNECT
        try:
            client = opened.enter_context(Client(address, timeout=patience, set_as_default=False))
        except (OSError, ValueError, TimeoutError) as fault:
            if scheduler is None:
                raise _no_workers(fault) from None
            reason = str(fault).split("\n")[0][:120]
            raise RecordingError(
                f"{scheduler}: no scheduler answers there ({reason}); check the address."
            ) from None
        try:
            client.wait_for_workers(1, timeout=patience)
        except TimeoutError as fault:
            if scheduler is None:
                raise _no_workers(fault) from None
            raise RecordingError(
                f"{scheduler}: the scheduler has no workers; start some, as with dask worker"
                f" {scheduler}."
            ) from None
        if scheduler is not None:
            _require_package(client, scheduler)
        yield client


def _no_workers(fault: Exception) -> RecordingError:
    reason = str(fault).split("\n")[0][:120] or type(fault).__name__
    return RecordingError(
        f"The workers on this machine cannot be started ({reason}); ask for fewer, or try again"
        " when it is less busy."
    )


def _version() -> str:
    return __version__


def _require_package(client: "Client", scheduler: str) -> None:
    """Refuse workers elsewhere that cannot run tasks, before every task fails there."""
    try:
        versions = set(client.run(_version).values())
    except Exception as fault:
        raise RecordingError(
            f"{scheduler}: its workers cannot run accpinn ({type(fault).__name__}:"
            f" {str(fault)[:100]}); install the package there."
        ) from None
    if versions != {__version__}:
        listed = ", ".join(sorted(versions))
        raise RecordingError(
            f"{scheduler}: its workers have accpinn {listed} and this is {__version__}; install the"
            " same version everywhere."
        )


def is_killed(future: "Future[Any]") -> bool:
    """Whether a task has no result because workers died."""
    return future.status == "error" and type(future.exception()).__name__ == "KilledWorker"


def threads_of(client: "Client") -> int:
    """Of all workers; they may come and go."""
    if client.status not in ("running", "connecting"):
        raise _lost()
    try:
        return sum(client.nthreads().values())
    except Exception:  # the connection broke while it was asked
        raise _lost() from None


def fault_of(future: "Future[Any]") -> str:
    """Why a task has no answer; empty where it has one.

    Raises:
        RecordingError: when the scheduler is away.
    """
    if future.status == "finished":
        return ""
    if future.status != "error":
        raise _lost()
    if is_killed(future):
        return "every worker died at it"
    fault = future.exception()
    return f"{type(fault).__name__}: {fault}"


def _lost() -> RecordingError:
    return RecordingError(
        "The scheduler no longer answers; what was finished is kept, and the same call goes on"
        " from there."
    )


def run_all(
    client: "Client",
    tasks: Iterator[T],
    run: Callable[[T], Any],
    finish: "Callable[[Future[Any], T], None]",
    *,
    is_local: bool,
    on_progress: Callable[[int], None],
    should_stop: Callable[[], bool],
) -> bool:
    """Keep workers at tasks until all have ended, or the caller says stop.

    A task at which workers died is put off, and tried alone at the end, so that nothing else is to
    blame when one dies again.

    Args:
        client: of their scheduler.
        tasks: taken as workers ask for more.
        run: what a worker does with a task.
        finish: what becomes of the answer; called here, in the order in which tasks end.
        is_local: whether the workers are those of this machine.
        on_progress: called after every task with the number of workers.
        should_stop: asked several times a second.

    Returns:
        Whether all tasks were taken and have ended.

    Raises:
        RecordingError: when the scheduler is away, or the workers of this machine have died and no
            others start.
    """
    ended: queue.SimpleQueue[Future[Any]] = queue.SimpleQueue()
    running: dict[str, tuple[Future[Any], T]] = {}
    put_off: list[T] = []
    waiting = next(tasks, None)
    alive = time.monotonic()
    slots, looked, alone = 0, -1.0, False
    try:
        while waiting or running or put_off:
            if should_stop():
                return False
            if time.monotonic() - looked > 1.0:
                slots, looked = threads_of(client), time.monotonic()
                alive = looked if slots or not is_local else alive
            if time.monotonic() - alive > WORKERLESS:
                raise RecordingError(
                    "The workers have died and no others start; what was finished is kept, and"
                    " the same call goes on from there."
                )
            if not waiting and not running:
                alone, waiting = True, put_off.pop(0)
            room = 1 if alone else AHEAD * max(1, slots)
            # What has ended is written before another file is read.
            while waiting and len(running) < room and ended.empty():
                key = f"{waiting.key}{'-alone' * alone}"
                future = client.submit(run, waiting, key=key, pure=False)
                running[key] = (future, waiting)
                future.add_done_callback(ended.put)
                waiting = None if alone else next(tasks, None)
            try:
                future = ended.get(timeout=POLL)
            except queue.Empty:
                continue
            if future.key in running:
                future, task = running.pop(future.key)
                if not alone and is_killed(future):
                    put_off.append(task)
                    continue
                finish(future, task)
                future.release()
                on_progress(slots)
        return True
    finally:
        for future, _ in running.values():
            future.cancel()
