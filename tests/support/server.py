"""The app as a process of its own."""

import os
import socket
import subprocess
import sys
import time
import urllib.request
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

from tests.support.command import ROOT

FEW_DRAWS = "tests.support.draws"
"""The program whose posterior takes a tenth of the time, beside `streamlit`."""


@dataclass(frozen=True)
class Server:
    """A running app."""

    address: str
    """As "http://127.0.0.1:8501"."""
    process: "subprocess.Popen[bytes]"


@contextmanager
def running(
    cache: Path,
    log: Path,
    recordings: Path | None = None,
    options: Sequence[str] = (),
    port: int | None = None,
    program: str = "streamlit",
) -> Iterator[Server]:
    """An app with an empty cache; all its other folders lie beside that.

    Args:
        cache: the folder of results and checkpoints.
        log: what it prints.
        recordings: a folder it offers.
        options: of the server, as "--server.disconnectedSessionTTL=1".
        port: of the server; a free one by default.
        program: the module that starts the server.
    """
    port = port or free_port()
    environment = os.environ | {"ACCPINN_CACHE": str(cache), "OMP_NUM_THREADS": "1"}
    for name in ("snapshots", "recordings", "studies", "mappings"):
        environment[f"ACCPINN_{name.upper()}"] = str(cache.with_name(name))
    if recordings:
        environment["ACCPINN_RECORDINGS"] = str(recordings)
    command = [sys.executable, "-m", program, "run", "app.py", f"--server.port={port}"]
    with log.open("w") as output:
        process = subprocess.Popen(
            [*command, "--server.headless=true", "--server.address=127.0.0.1", *options],
            cwd=ROOT, env=environment, stdout=output, stderr=subprocess.STDOUT,
        )  # fmt: skip
        try:
            address = f"http://127.0.0.1:{port}"
            _await_health(process, address, log)
            yield Server(address, process)
        finally:
            process.terminate()
            try:
                process.wait(30)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()


def free_port() -> int:
    """A port of this machine that nobody uses yet."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        return int(free.getsockname()[1])


def _await_health(process: "subprocess.Popen[bytes]", address: str, log: Path) -> None:
    for _ in range(1200):
        with suppress(OSError), urllib.request.urlopen(f"{address}/_stcore/health", timeout=5):
            return
        if process.poll() is not None:
            break
        time.sleep(0.1)
    raise AssertionError(f"the app did not start:\n{log.read_text()}")
