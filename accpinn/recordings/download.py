"""Downloading runs of the catalogue: with checksums, resumable, several at a time.

Pooch decides what has to be fetched and compares checksums; the transfer itself goes on with the
part of a file that an earlier attempt left. The checksum of a run whose contents are not in the
catalogue is recorded when it is first downloaded, in the file `SHA256SUMS` of its folder.
"""

import logging
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor, as_completed
from contextlib import suppress
from dataclasses import dataclass
from enum import Enum
from functools import partial
from pathlib import Path
from urllib.parse import quote, urlsplit

import pooch
import requests

from accpinn.channels import METADATA
from accpinn.errors import RecordingError
from accpinn.recordings.catalogue import Run
from accpinn.recordings.source import LIMIT_BYTES
from accpinn.units import Seconds

PUBLISHED_AT = "https://jeodpp.jrc.ec.europa.eu/ftp/jrc-opendata/TransportExpData/JRCDBT0001/LATEST"
CHECKSUMS = "SHA256SUMS"
"""Checksums by file, as the program sha256sum writes and checks them."""
CONNECTIONS = 4
"""At a time, so as not to burden the publisher."""
ATTEMPTS = 5
"""Each goes on where the one before it ended."""
PAUSE: Seconds = 1.0
"""Before the second attempt; doubled before each further one."""
LONGEST_PAUSE: Seconds = 30.0
CONNECT: Seconds = 10.0
"""After which a server that does not answer counts as unreachable."""
STALL: Seconds = 30.0
"""Without a byte for so long, an attempt is given up."""
_CHUNK = 1 << 13
"""Bytes; what a broken connection leaves of one is lost."""


class DownloadState(Enum):
    """How the download of one run ended."""

    DOWNLOADED = "downloaded"
    PRESENT = "present"
    """It was there already."""
    FAILED = "failed"
    STOPPED = "stopped"
    """By the caller; what was received is kept for the next time."""


@dataclass(frozen=True)
class Download:
    """What became of one run."""

    run: Run
    path: Path
    state: DownloadState
    size: int
    """Bytes; 0 where there is no file."""
    reason: str = ""
    """Why it failed: one sentence."""


@dataclass(frozen=True)
class Transfer:
    """How far a transfer has got."""

    run: Run
    received: int
    """Bytes, those of earlier attempts included."""
    size: int | None
    """Bytes of the whole file; None where the server does not say."""


OnTransfer = Callable[[Transfer], None]
"""Called from several threads."""


class _Refused(RecordingError):
    """No further attempt would help."""


class _Unreachable(_Refused):
    """No server answers."""


class _Stopped(Exception):
    """The caller said so."""


def download(
    runs: Sequence[Run],
    folder: Path,
    base: str = PUBLISHED_AT,
    *,
    connections: int = CONNECTIONS,
    on_transfer: OnTransfer | None = None,
    should_stop: Callable[[], bool] | None = None,
    pause: Seconds = PAUSE,
    stall: Seconds = STALL,
) -> Iterator[Download]:
    """Download runs, and yield what became of each as it is known.

    Args:
        runs: of the catalogue.
        folder: where to; each campaign has its own folder below it.
        base: address of the folder that has the campaigns.
        connections: how many at a time.
        on_transfer: called while bytes arrive.
        should_stop: asked often; True ends all transfers, which keep what they have.
        pause: before the second attempt.
        stall: how long an attempt waits for the next bytes.

    Raises:
        RecordingError: when nothing can be written there.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as fault:
        raise RecordingError(f"{folder}: no folder can be made ({fault.strerror}).") from None
    pooch.get_logger().setLevel(logging.WARNING)
    sums = _Checksums(folder)
    registry = {run.key: f"sha256:{known}" if (known := sums.of(run)) else None for run in runs}
    urls = {run.key: f"{base.rstrip('/')}/{quote(run.key)}" for run in runs}
    fetcher = pooch.create(path=folder, base_url="", registry=registry, urls=urls)
    wishes = _Wishes(on_transfer, should_stop or (lambda: False), pause, stall)
    fetch = partial(_fetch, fetcher, sums, threading.Event(), wishes)
    with ThreadPoolExecutor(max(1, connections)) as pool:
        futures: list[Future[Download]] = [pool.submit(fetch, run) for run in runs]
        for future in as_completed(futures):
            yield future.result()


@dataclass(frozen=True)
class _Wishes:
    """What the caller of `download` asks for; see there."""

    on_transfer: OnTransfer | None
    should_stop: Callable[[], bool]
    pause: Seconds
    stall: Seconds


def _fetch(
    fetcher: pooch.Pooch, sums: "_Checksums", down: threading.Event, wishes: _Wishes, run: Run
) -> Download:
    """One run; no further one is asked for once the server is ``down``."""
    path = run.path(Path(fetcher.path))
    host = urlsplit(fetcher.urls[run.key]).netloc

    def failed(reason: str) -> Download:
        return Download(run, path, DownloadState.FAILED, 0, reason)

    known = sums.of(run)
    try:
        there = path.is_file()
        if there and known and pooch.file_hash(path) != known:
            return failed(f"{path}: this is not the published file; move it away to download it.")
        if not there and down.is_set():
            return failed(_no_network(run, host))
        transfer = _Resuming(run, wishes, checked=known is not None)
        try:
            fetcher.fetch(run.key, downloader=transfer)
        except ValueError:  # another checksum, perhaps as two versions were put together
            if not transfer.resumed:
                raise
            fetcher.fetch(run.key, downloader=transfer)
        if not known:
            sums.record(run, pooch.file_hash(path))
        state = DownloadState.PRESENT if there else DownloadState.DOWNLOADED
        return Download(run, path, state, path.stat().st_size)
    except _Stopped:
        return Download(run, path, DownloadState.STOPPED, 0)
    except _Unreachable:
        down.set()
        return failed(_no_network(run, host))
    except RecordingError as fault:
        return failed(str(fault))
    except ValueError:
        return failed(
            f"{run.key}: what {host} sends is not the published file (its SHA-256 differs); it was"
            " not kept."
        )
    except OSError as fault:
        reason = fault.strerror or type(fault).__name__
        return failed(f"{run.key}: the file cannot be written ({reason}).")


def _no_network(run: Run, host: str) -> str:
    return f"{run.key}: {host} cannot be reached; check the network connection, or the proxy."


class _Resuming:
    """Pooch's downloader that goes on with what earlier attempts have received."""

    def __init__(self, run: Run, wishes: _Wishes, checked: bool) -> None:
        self.resumed = False
        self._run, self._wishes, self._checked = run, wishes, checked

    def __call__(self, url: str, output_file: str, fetcher: pooch.Pooch) -> None:
        """Transfer a file to ``output_file``."""
        target = self._run.path(Path(fetcher.path))
        part = target.with_name(f".{target.name}.part")
        version = target.with_name(f".{target.name}.version")
        pause, fault = self._wishes.pause, "it breaks off"
        for attempt in range(ATTEMPTS):
            if attempt:
                self._wait(pause)
                pause = min(2.0 * pause, LONGEST_PAUSE)
            try:
                more = self._attempt(url, part, version)
            except requests.ConnectTimeout:
                raise _Unreachable from None
            except requests.ConnectionError as error:
                if not _broke_off(error):
                    raise _Unreachable from None
                fault = "the connection breaks off"
                continue
            except requests.Timeout:
                fault = f"nothing arrives for {self._wishes.stall:g} s"
                continue
            except requests.RequestException:
                fault = "the connection breaks off"
                continue
            if more is None:
                version.unlink(missing_ok=True)
                if not self._checked:
                    _require_run(self._run, part)
                part.replace(output_file)
                return
            fault, asked = more
            pause = max(pause, min(asked, LONGEST_PAUSE))
        host = urlsplit(url).netloc
        raise _Refused(
            f"{self._run.key}: {host} does not deliver the file ({fault}, {ATTEMPTS} attempts);"
            " what arrived is kept, try again later."
        )

    def _attempt(self, url: str, part: Path, version: Path) -> tuple[str, Seconds] | None:
        """One request; None once the file is whole, else what is wrong and how long to wait."""
        have = part.stat().st_size if part.is_file() else 0
        # Without the name of its version, and a checksum, a part might belong to another one.
        tag = version.read_text(encoding="utf-8") if have and version.is_file() else ""
        if have and not tag and not self._checked:
            part.unlink()
            have = 0
        headers = {"Accept-Encoding": "identity"}
        if have:
            headers |= {"Range": f"bytes={have}-"} | ({"If-Range": tag} if tag else {})
        timeout = (CONNECT, self._wishes.stall)
        with requests.get(url, headers=headers, stream=True, timeout=timeout) as answer:
            status = answer.status_code
            if status == 416:  # the part is as long as the file, or longer
                whole = answer.headers.get("Content-Range", "").rpartition("/")[2]
                if whole == str(have):
                    return None
                part.unlink(missing_ok=True)
                return "the part does not fit", 0.0
            if status in (429, 500, 502, 503, 504):
                asked = answer.headers.get("Retry-After", "")
                return f"status {status}", float(asked) if asked.isdigit() else 0.0
            if status not in (200, 206):
                missing = "it is not there" if status in (404, 410) else "it is refused"
                host = urlsplit(url).netloc
                raise _Refused(f"{self._run.key}: {missing} on {host} (status {status}).")
            if status == 206 and _start_of(answer.headers) != have:
                part.unlink(missing_ok=True)
                return "the part does not fit", 0.0
            if status == 200:
                have = 0
            self.resumed |= have > 0
            return self._receive(answer, part, version, have)

    def _receive(
        self, answer: requests.Response, part: Path, version: Path, have: int
    ) -> tuple[str, Seconds] | None:
        length = answer.headers.get("Content-Length", "")
        size = have + int(length) if length.isdigit() else None
        tag = answer.headers.get("ETag") or answer.headers.get("Last-Modified") or ""
        if tag.startswith("W/"):  # such a name may not be asked for
            tag = answer.headers.get("Last-Modified", "")
        if have == 0:
            version.write_text(tag, encoding="utf-8")
        with part.open("ab" if have else "wb") as file:
            for chunk in answer.iter_content(_CHUNK):
                file.write(chunk)
                have += len(chunk)
                if have > LIMIT_BYTES:
                    raise _Refused(f"{self._run.key}: the file is far too large for a recording.")
                if self._wishes.on_transfer:
                    self._wishes.on_transfer(Transfer(self._run, have, size))
                if self._wishes.should_stop():
                    raise _Stopped
        return None if size is None or have == size else ("the connection breaks off", 0.0)

    def _wait(self, pause: Seconds) -> None:
        end = time.monotonic() + pause
        while (left := end - time.monotonic()) > 0:
            if self._wishes.should_stop():
                raise _Stopped
            time.sleep(min(left, 0.1))


def _broke_off(error: requests.ConnectionError) -> bool:
    """Whether there was a connection that ended, rather than none."""
    text = repr(error)
    return "NewConnectionError" not in text and "NameResolutionError" not in text


def _start_of(headers: Mapping[str, str]) -> int | None:
    start = headers.get("Content-Range", "").removeprefix("bytes ").partition("-")[0]
    return int(start) if start.isdigit() else None


def _require_run(run: Run, part: Path) -> None:
    """Refuse what is no run at all; all else a checksum alone could tell."""
    with part.open("rb") as file:
        first = file.read(200).lstrip(b"\xef\xbb\xbf \r\n").decode("utf-8", "replace")
    if first.partition(",")[0].strip().lower() not in {key.lower() for key in METADATA}:
        part.unlink()
        raise _Refused(f"{run.key}: what the server sends is no OpenACC run; it was not kept.")


class _Checksums:
    """Those of the catalogue, and those recorded when a file was first downloaded."""

    def __init__(self, folder: Path) -> None:
        self._file, self._lock = folder / CHECKSUMS, threading.Lock()
        self._known: dict[str, str] = {}
        with suppress(OSError):
            for line in self._file.read_text(encoding="utf-8").splitlines():
                digest, _, key = line.partition("  ")
                if len(digest) == 64 and key:
                    self._known[key] = digest

    def of(self, run: Run) -> str | None:
        return run.sha256 or self._known.get(run.key)

    def record(self, run: Run, digest: str) -> None:
        with self._lock:
            self._known[run.key] = digest
            with self._file.open("a", encoding="utf-8") as file:
                file.write(f"{digest}  {run.key}\n")
