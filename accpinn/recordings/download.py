"""Downloading runs of the catalogue, several at a time, with checksums.

Pooch decides what has to be fetched, compares checksums, and starts again when a connection breaks
off or the server is busy. Where the catalogue has no checksum, the first row alone is checked.
"""

import logging
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor, as_completed
from dataclasses import dataclass
from enum import Enum
from pathlib import Path
from urllib.parse import quote, urlsplit

import pooch
import requests

from accpinn.channels import METADATA
from accpinn.errors import RecordingError
from accpinn.recordings.containers import LIMIT_BYTES
from accpinn.recordings.openacc import PUBLISHED_AT, Run
from accpinn.storage import reason_of, reported
from accpinn.units import Seconds

CONNECTIONS = 4
"""Connections at a time, so as not to burden the publisher."""
ATTEMPTS = 5
"""Attempts at a file that breaks off, and at a server that is busy."""
CONNECT: Seconds = 10.0
"""Time after which a server that does not answer counts as unreachable."""
STALL: Seconds = 30.0
"""Time without a byte after which an attempt is given up."""
BUSY = (429, 500, 502, 503, 504)
"""Statuses of a server after which the request is repeated."""
_CHUNK = 1 << 13
"""Bytes between two reports of progress."""


class DownloadState(Enum):
    """The end of a run's download."""

    DOWNLOADED = "downloaded"
    PRESENT = "present"
    """The file was there already."""
    FAILED = "failed"
    STOPPED = "stopped"
    """The caller stopped it; nothing of the file is kept."""


@dataclass(frozen=True)
class Download:
    """A run that was, or was not, downloaded."""

    run: Run
    path: Path
    state: DownloadState
    size: int
    """Bytes of the file; 0 where there is none."""
    reason: str = ""
    """One sentence why it failed."""


@dataclass(frozen=True)
class Transfer:
    """The progress of a transfer."""

    run: Run
    received: int
    """Bytes that have arrived."""
    size: int | None
    """Bytes of the whole file; None where the server does not state it."""

    @property
    def share(self) -> float:
        """The share of the file that has arrived, 0 to 1; 0 where its size is not known."""
        return min(1.0, self.received / self.size) if self.size else 0.0


OnTransfer = Callable[[Transfer], None]
"""Called from several threads."""


class _Stopped(Exception):
    """The caller has requested to stop."""


def download(
    runs: Sequence[Run],
    folder: Path,
    base: str = PUBLISHED_AT,
    *,
    connections: int = CONNECTIONS,
    on_transfer: OnTransfer | None = None,
    should_stop: Callable[[], bool] | None = None,
    stall: Seconds = STALL,
) -> Iterator[Download]:
    """Download runs, and yield each as it ends.

    Args:
        runs: runs of the catalogue.
        folder: where to; each campaign has its own folder below it.
        base: address of the folder that has the campaigns.
        connections: how many at a time.
        on_transfer: called while bytes arrive.
        should_stop: asked often; True ends all transfers.
        stall: how long an attempt waits for the next bytes.

    Raises:
        RecordingError: when nothing can be written there.
    """
    with reported(lambda reason: RecordingError(f"{folder}: no folder can be made ({reason}).")):
        folder.mkdir(parents=True, exist_ok=True)
    pooch.get_logger().setLevel(logging.WARNING)
    fetcher = pooch.create(
        path=folder,
        base_url="",
        registry={run.key: f"sha256:{run.sha256}" if run.sha256 else None for run in runs},
        urls={run.key: f"{base.rstrip('/')}/{quote(run.key)}" for run in runs},
        retry_if_failed=ATTEMPTS - 1,
    )
    host, stops = urlsplit(base).netloc, should_stop or (lambda: False)
    publisher = _Publisher(host, stall, stops, on_transfer, threading.Event())
    with ThreadPoolExecutor(max(1, connections)) as pool:
        futures: list[Future[Download]] = [
            pool.submit(_fetch, fetcher, publisher, run) for run in runs
        ]
        for future in as_completed(futures):
            yield future.result()


def _fetch(fetcher: pooch.Pooch, publisher: "_Publisher", run: Run) -> Download:
    """Download a run that is not there yet."""
    path, host = run.path(Path(fetcher.path)), publisher.host

    def failed(reason: str) -> Download:
        return Download(run, path, DownloadState.FAILED, 0, reason)

    try:
        is_present = path.is_file()
        if is_present and run.sha256 and pooch.file_hash(path) != run.sha256:
            return failed(f"{path}: this is not the published file; move it away to download it.")
        path.parent.mkdir(parents=True, exist_ok=True)  # two transfers would both try, and one fail
        fetcher.fetch(run.key, downloader=lambda url, place, _: publisher.deliver(run, url, place))
        state = DownloadState.PRESENT if is_present else DownloadState.DOWNLOADED
        return Download(run, path, state, path.stat().st_size)
    except _Stopped:
        return Download(run, path, DownloadState.STOPPED, 0)
    except RecordingError as fault:
        return failed(str(fault))
    except requests.RequestException as fault:
        reason = "it breaks off"
        if isinstance(fault, requests.HTTPError):
            reason = f"status {_status(fault)}"
        elif "timed out" in str(fault):
            reason = f"nothing arrives for {publisher.stall:g} s"
        return failed(
            f"{run.key}: {host} does not deliver the file ({reason}, {ATTEMPTS} attempts); try"
            " again later."
        )
    except OSError as fault:
        return failed(f"{run.key}: the file cannot be written ({reason_of(fault)}).")


@dataclass(frozen=True)
class _Publisher:
    """The server that has the files; it delivers them to Pooch."""

    host: str
    stall: Seconds
    should_stop: Callable[[], bool]
    on_transfer: OnTransfer | None
    is_down: threading.Event
    """Set once the server cannot be reached, so that other runs need not wait for it."""

    def deliver(self, run: Run, url: str, place: str) -> None:
        """Transfer a file to a place, and check that it is the right one.

        Raises:
            RecordingError: where no further attempt would help.
            requests.RequestException: where one might.
        """
        unreachable = RecordingError(
            f"{run.key}: {self.host} cannot be reached; check the network connection, or the proxy."
        )
        if self.is_down.is_set():
            raise unreachable
        if self.should_stop():
            raise _Stopped
        Path(place).unlink()  # only its owner could read the file that Pooch makes
        try:
            self._transfer(run, url, Path(place))
        except requests.HTTPError as fault:
            status = _status(fault)
            if status in BUSY:
                raise
            missing = "it is not there" if status in (404, 410) else "it is refused"
            raise RecordingError(
                f"{run.key}: {missing} on {self.host} (status {status})."
            ) from None
        except requests.ConnectionError as fault:
            is_timeout = isinstance(fault, requests.ConnectTimeout)
            if is_timeout or "NewConnectionError" in repr(fault) or "NameReso" in repr(fault):
                self.is_down.set()
                raise unreachable from None
            raise
        if run.sha256 is None:  # the catalogue has none, so a header of OpenACC has to do
            with Path(place).open("rb") as file:
                first = file.read(200).lstrip(b"\xef\xbb\xbf \r\n").decode("utf-8", "replace")
            if first.partition(",")[0].strip().lower() not in {key.lower() for key in METADATA}:
                raise RecordingError(
                    f"{run.key}: what the server sends is no OpenACC run; it was not kept."
                )
        elif pooch.file_hash(place) != run.sha256:
            raise RecordingError(
                f"{run.key}: what {self.host} sends is not the published file (its SHA-256"
                " differs); it was not kept."
            )

    def _transfer(self, run: Run, url: str, place: Path) -> None:
        whole = {"Accept-Encoding": "identity"}  # so that lengths are those of the file
        patience = (CONNECT, self.stall)
        with (
            requests.get(url, stream=True, timeout=patience, headers=whole) as answer,
            place.open("wb") as file,
        ):
            answer.raise_for_status()
            size, received = int(answer.headers.get("Content-Length", 0)) or None, 0
            for chunk in answer.iter_content(_CHUNK):
                received += file.write(chunk)
                if received > LIMIT_BYTES:
                    raise RecordingError(f"{run.key}: the file is far too large for a recording.")
                if self.on_transfer:
                    self.on_transfer(Transfer(run, received, size))
                if self.should_stop():
                    raise _Stopped


def _status(fault: requests.HTTPError) -> int:
    return fault.response.status_code if fault.response is not None else 0
