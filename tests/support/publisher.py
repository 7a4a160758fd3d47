"""A publisher of files on this machine that also breaks off, stalls, refuses and sends nonsense."""

import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from urllib.parse import unquote


@dataclass
class Publisher:
    """Files by path, and what goes wrong with each: one word a request, then nothing."""

    files: dict[str, bytes]
    faults: dict[str, list[str]] = field(default_factory=dict)
    """Each is "break", "stall" or a status."""
    requests: list[str] = field(default_factory=list)
    """The path of each request."""
    url: str = ""
    at_once: int = 0
    most_at_once: int = 0


@contextmanager
def publisher(
    files: dict[str, bytes], port: int = 0, faults: dict[str, list[str]] | None = None
) -> Iterator[Publisher]:
    """The server, for as long as the block lasts; by default on any free port."""
    state, lock = Publisher(files, faults or {}), threading.Lock()

    class Handler(BaseHTTPRequestHandler):
        def log_message(self, *_: object) -> None:
            """Say nothing."""

        def do_GET(self) -> None:
            with lock:
                state.at_once += 1
                state.most_at_once = max(state.most_at_once, state.at_once)
            try:
                rest = self._answer()
            finally:
                with lock:
                    state.at_once -= 1
            self.wfile.write(rest)  # who has it whole may ask again before this line ends

        def _answer(self) -> bytes:
            """Answer, but for the end of the body, which is returned."""
            path = unquote(self.path).strip("/")
            with lock:
                state.requests.append(path)
                faults = state.faults.get(path, [])
                fault = faults.pop(0) if faults else ""
            content = state.files.get(path)
            if content is None or fault.isdigit():
                self.send_response(int(fault) if fault else 404)
                self.send_header("Content-Length", "0")
                self.end_headers()
                return b""
            self.send_response(200)
            self.send_header("Content-Length", str(len(content)))
            self.end_headers()
            if fault in ("break", "stall"):
                self.wfile.write(content[: len(content) // 2])
                self.wfile.flush()
                time.sleep(0.3 if fault == "stall" else 0.0)
                self.close_connection = True
                return b""
            time.sleep(0.02)
            return content

    server = ThreadingHTTPServer(("127.0.0.1", port), Handler)
    server.daemon_threads = True
    thread = threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.02})
    thread.start()
    state.url = f"http://127.0.0.1:{server.server_port}"
    try:
        yield state
    finally:
        server.shutdown()
        server.server_close()
        thread.join()
