"""The workers of a batch, by dask.distributed: on this machine, or of a scheduler elsewhere.

Scheduler and workers on this machine live below a process of their own (`python -m
accpinn.study.cluster`), which says its address and ends with its standard input. So they do not
import the caller's main module again, as multiprocessing would, which in the app is a page; and
they end with the caller, however that ends.

Whoever reaches a scheduler or a worker of dask has it run any code. Those on this machine take
connections by TLS alone, with a certificate that is made for the batch and known to its processes
only, since every user of the machine reaches their ports. What protects a scheduler elsewhere is
its operator's; see `plain_scheduler`.
"""

import json
import os
import re
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, wait
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from accpinn import __version__
from accpinn.errors import AccpinnError, ConfigError, RecordingError
from accpinn.units import Seconds

if TYPE_CHECKING:
    from distributed import Client, Security

Job = TypeVar("Job")

MODULE = "accpinn.study.cluster"
"""This module's name, also where it is run by itself."""
AHEAD = 2
"""Jobs that a worker elsewhere has at a time, so that it need not wait for the next. A worker here
has one, so that no other job is to blame when it dies."""
POLL: Seconds = 0.2
DEATHS = 1
"""A job is tried again after this many workers died at it."""
CONNECT: Seconds = 20.0
"""Longest wait for a scheduler to answer, and to have a worker."""
WORKERLESS: Seconds = 180.0
"""Longest time without a worker on this machine; a busy machine may take long to start one."""


@contextmanager
def connected(workers: int | None, scheduler: str | None) -> "Iterator[Client]":
    """A client of a scheduler with workers: the one at an address, or one on this machine.

    By default there is one worker on this machine for each processor.

    Raises:
        RecordingError: when it cannot be reached, has no workers, or these lack the package.
    """
    if scheduler:
        if not re.search(r":\d+/?$", scheduler):
            raise ConfigError(
                f'scheduler: "{scheduler[:60]}" is no address; write one as tls://HOST:8786.'
            )
        with _client(scheduler, CONNECT) as client:
            _require_package(client, scheduler)
            yield client
        return
    count = str(workers or os.cpu_count() or 1)
    places = (str(Path(__file__).parents[2]), os.environ.get("PYTHONPATH"))
    path = os.pathsep.join(place for place in places if place)
    with subprocess.Popen(
        [sys.executable, "-P", "-m", MODULE, count],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        env={**os.environ, "PYTHONPATH": path},
    ) as process:
        assert process.stdin
        assert process.stdout
        from distributed import Security  # while the other process imports it, too

        answer = process.stdout.readline().strip()
        try:
            if not answer.startswith("{"):
                raise RecordingError(
                    "The workers on this machine cannot be started"
                    f" ({answer or 'their process died'}); ask for fewer, or try again when it is"
                    " less busy."
                )
            endpoint = json.loads(answer)
            security = Security(
                require_encryption=True,
                tls_ca_file=endpoint["certificate"],
                tls_client_cert=endpoint["certificate"],
                tls_client_key=endpoint["key"],
            )
            with _client(endpoint["address"], WORKERLESS, security) as client:
                yield client
        finally:
            process.stdin.close()


def plain_scheduler(scheduler: str) -> str:
    """A warning of a scheduler that is reached without TLS; empty for one that is."""
    if scheduler.startswith("tls://"):
        return ""
    return (
        f"{scheduler[:60]} is not protected: whoever reaches that port, or is on the way to it, can"
        " run any code there, read the recordings and change results. Use it only in a network of"
        " your own, or set up TLS and write tls://; see docs/database.md."
    )


@contextmanager
def _client(
    address: str, patience: Seconds, security: "Security | None" = None
) -> "Iterator[Client]":
    """A client; by default with the certificates that dask's own configuration names."""
    import dask
    from distributed import Client

    quiet = {"distributed.admin.large-graph-warning-threshold": "1GB"}
    with dask.config.set(quiet):
        try:
            client = Client(address, timeout=patience, set_as_default=False, security=security)
        except (OSError, ValueError, TypeError, RuntimeError, TimeoutError) as fault:
            raise RecordingError(
                f"{address}: no scheduler answers there ({_first_line(fault)}); check the address,"
                " and for tls:// dask's certificates."
            ) from None
        with client:
            try:
                client.wait_for_workers(1, timeout=patience)
            except TimeoutError:
                raise RecordingError(
                    f"{address}: the scheduler has no workers; start some, as with dask worker"
                    f" {address}."
                ) from None
            yield client


def _first_line(fault: BaseException) -> str:
    return str(fault).split("\n")[0][:120] or type(fault).__name__


def _version() -> str:
    return __version__


def _require_package(client: "Client", scheduler: str) -> None:
    """Refuse workers elsewhere that cannot run jobs, before every job fails there."""
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


def _lost() -> RecordingError:
    return RecordingError(
        "The scheduler no longer answers; what was finished is kept, and the same call goes on"
        " from there."
    )


def sentence_of(fault: BaseException) -> str:
    """Why something failed, in words for the list of failures."""
    if type(fault).__name__ == "KilledWorker":
        return "every worker died at it"
    return str(fault) if isinstance(fault, AccpinnError) else f"{type(fault).__name__}: {fault}"


def run_all(
    client: "Client", run: Callable[[Job], Any], jobs: Iterator[Job], *, is_local: bool
) -> Iterator[tuple[Job, Any, int] | None]:
    """Keep workers busy until all jobs have ended, or the caller asks for no more.

    A job is asked for when a worker has room for it.

    Yields:
        Each job that has ended, its answer or the exception in place of one, and how many jobs run
        at a time; None several times a second meanwhile.

    Raises:
        RecordingError: when the scheduler is away, or the workers of this machine have died and no
            others start.
    """
    executor, alive = client.get_executor(pure=False), time.monotonic()
    running: dict[Future[Any], Job] = {}
    try:
        while True:
            try:
                slots, now = sum(client.nthreads().values()), time.monotonic()
            except Exception as fault:  # the connection broke
                raise _lost() from fault
            alive = now if slots or not is_local else alive
            if now - alive > WORKERLESS:
                raise RecordingError(
                    "The workers have died and no others start; what was finished is kept, and"
                    " the same call goes on from there."
                )
            room = max(1, slots) * (1 if is_local else AHEAD)
            # What has ended is written before another file is read.
            while (
                len(running) < room
                and not any(future.done() for future in running)
                and (job := next(jobs, None))
            ):
                running[executor.submit(run, job)] = job
            if not running:
                return
            for future in wait(running, POLL, FIRST_COMPLETED).done:
                if future.cancelled():
                    raise _lost()
                yield running.pop(future), future.exception() or future.result(), slots
            yield None
    finally:
        executor.shutdown(wait=False)


def serve(workers: int) -> None:
    """Be scheduler and workers until standard input ends."""
    import dask
    from distributed import LocalCluster, Security

    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl+C is for the caller, who ends this
    answer = os.dup(1)
    os.dup2(2, 1)  # what workers print is no answer
    settings = {
        "distributed.scheduler.allowed-failures": DEATHS,
        "distributed.comm.timeouts.connect": f"{WORKERLESS:g}s",
        # Their web servers, which ask nobody for a certificate, answer nothing.
        "distributed.scheduler.http.routes": [],
        "distributed.worker.http.routes": [],
    }
    try:
        security = Security.temporary()
        with (
            tempfile.TemporaryDirectory(prefix="accpinn-") as space,
            dask.config.set(settings),
            LocalCluster(
                n_workers=workers,
                threads_per_worker=1,
                protocol="tls://",
                security=security,
                host="127.0.0.1",
                dashboard_address="127.0.0.1:0",
                local_directory=space,
                memory_limit=0,
                silence_logs=50,
            ) as cluster,
        ):
            endpoint = {
                "address": cluster.scheduler_address,
                "certificate": security.tls_client_cert,
                "key": security.tls_client_key,
            }
            os.write(answer, f"{json.dumps(endpoint)}\n".encode())
            sys.stdin.read()
    except (OSError, RuntimeError, TimeoutError, ImportError) as fault:
        os.write(answer, f"{_first_line(fault)}\n".encode())


if __name__ == "__main__":
    serve(int(sys.argv[1]))
