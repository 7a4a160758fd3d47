"""A server that others use: two browsers behind a proxy, foreign names, idle connections."""

import asyncio
import socket
import time
import urllib.error
import urllib.request
from collections.abc import Coroutine
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeVar

import psutil
import pytest
import requests
from streamlit.proto.ForwardMsg_pb2 import ForwardMsg

from accpinn.units import Seconds
from bench.browsing import Browser
from pages.ui.server import BROWSER
from tests.support.command import PLATOON
from tests.support.openacc_files import csv, metadata, platoon
from tests.support.proxy import NAME, proxy
from tests.support.server import FEW_DRAWS, Server, running

Result = TypeVar("Result")
PATIENCE: Seconds = 120.0
"""How long a busy machine may take to close connections; it needs some seconds."""
PAGES = (
    "Home", "Data", "Train", "Stability", "Platoon", "Compare", "Snapshots", "Database",
    "Reproduce",
)  # fmt: skip


def _run(work: Coroutine[Any, Any, Result]) -> Result:
    """In a thread of its own, as the browser of another test may keep this one's loop."""
    with ThreadPoolExecutor(1) as thread:
        return thread.submit(asyncio.run, work).result()


@dataclass(eq=False)
class Listener(Browser):
    """A browser with the cookies of a real one that keeps every byte it is sent."""

    heard: bytes = b""
    secrets: list[str] = field(default_factory=list)
    """What nobody else may hear."""

    async def arrive(self) -> None:
        """Do as a browser does before it opens its connection."""

        def ask() -> None:
            with requests.Session() as session:
                for path in ("health", "host-config"):
                    session.get(f"{self.address}/_stcore/{path}", timeout=60).raise_for_status()
                self.cookies.update(session.cookies.get_dict())

        await asyncio.to_thread(ask)
        await self.open()
        self.secrets += [self.session, *(self.cookies[name] for name in self.cookies)]

    async def _receive(self) -> ForwardMsg:
        message = await super()._receive()
        self.heard += message.SerializeToString()
        return message

    async def work(self, name: str) -> None:
        """Open a recording, train, save the result and begin a batch."""
        cars = tuple(f"{name}s {car}" for car in ("Audi", "Tesla"))
        await self.upload("data_upload", f"{name}s.csv", csv(platoon(2, 900), metadata(cars)))
        await self.go("Train")
        await self.press("train_start")
        while await self.poll():
            pass
        await self.go("Snapshots")
        await self.press("Save", snapshots_name=f"{name}s result")
        await self.go("Database")
        await self.set("database_new", True)
        await self.set("database_name", f"{name}s study")
        await self.press("database_start")
        self.secrets += [f"{name}s.csv", *cars, f"{name}s result", f"{name}s study"]

    async def look_around(self) -> None:
        """Open every page, in this session and in a new one."""
        for new in (False, True):
            self.session = "" if new else self.session
            for title in PAGES:
                await self.go(title)
        self.secrets.append(self.session)


def test_neither_of_two_browsers_behind_a_proxy_sees_a_trace_of_the_other(tmp_path: Path) -> None:
    recordings = tmp_path / "offered"
    recordings.mkdir()
    (recordings / PLATOON.name).write_bytes(PLATOON.read_bytes())

    async def visit(server: Server) -> None:
        async with proxy(server.address) as address:
            ann, ben = (Listener(address) for _ in range(2))
            for browser, name in ((ann, "ann"), (ben, "ben")):
                await browser.arrive()
                assert BROWSER in browser.cookies
                await browser.work(name)
            for browser in (ann, ben):
                await browser.look_around()
                assert not browser.faults
            for one, other in ((ann, ben), (ben, ann)):
                heard = other.heard.replace(b"\\", b"")
                assert [secret for secret in one.secrets if secret.encode() in heard] == []
                assert b"stay on this computer" not in heard
            heard = ann.heard.replace(b"\\", b"")
            not_sent = [secret for secret in ann.secrets if secret.encode() not in heard]
            assert set(not_sent) <= set(ann.cookies.values()), "what is heard is looked at"
            # What her own lists have is there in a new session of her browser.
            await ann.go("Home")
            run = next(w for w in map(str, ann.elements.values()) if "home_runs_open" in w)
            await ann.press(run.partition("home_runs_open_")[2][:64].join(("home_runs_open_", "")))
            await ann.go("Train")
            assert "anns Audi" in str(ann.elements)
            assert "bens" not in str(ann.elements)
            await ann.go("Snapshots")
            assert "anns result" in str(ann.elements)
            await ann.go("Database")
            assert "anns study" in str(ann.elements)
            # The address of her session says so before anything is opened in it.
            ben.session, before = ann.secrets[0], len(ben.heard)
            await ben.close()
            await ben.open()
            assert ben.widget("frame_own_session")
            assert b"anns" not in ben.heard[before:]
            with pytest.raises(LookupError):
                ben.widget("data_upload")
            await ann.close()
            await ben.close()

    options = [f"--server.allowedHosts={NAME}"]
    place = tmp_path / "cache", tmp_path / "log"
    with running(*place, recordings=recordings, options=options, program=FEW_DRAWS) as server:
        _run(visit(server))


def test_foreign_names_are_refused_and_idle_connections_exhaust_nothing(tmp_path: Path) -> None:
    def status(server: Server, host: str, path: str = "/") -> int:
        asked = urllib.request.Request(f"{server.address}{path}", headers={"Host": host})
        try:
            with urllib.request.urlopen(asked, timeout=20) as answer:
                assert answer.headers["Referrer-Policy"] == "same-origin"
                assert "frame-ancestors" in answer.headers["Content-Security-Policy"]
                return int(answer.status)
        except urllib.error.HTTPError as refusal:
            with refusal:
                return int(refusal.code)

    def connect(server: Server) -> socket.socket:
        port = int(server.address.rpartition(":")[2])
        return socket.create_connection(("127.0.0.1", port), timeout=20)

    async def browse(server: Server) -> None:
        browser = Browser(server.address)
        await browser.open()
        for title in ("Home", "Data", "Database"):
            await browser.go(title)
        assert not browser.faults
        await browser.close()

    place = tmp_path / "cache", tmp_path / "log"
    with running(*place, program="tests.support.few_descriptors") as server, ExitStack() as open_:
        assert status(server, "localhost:1") == 200
        for path in ("/", "/Data", "/_stcore/host-config", "/media/x"):
            assert status(server, "evil.org", path) == 421
        assert status(server, "evil.org", "/_stcore/health") == 200, (
            "tells nothing but that it runs"
        )

        process, idle = psutil.Process(server.process.pid), []
        for k in range(800):
            idle.append(open_.enter_context(connect(server)))
            if k % 3 == 1:
                idle[-1].sendall(b"GET / HTTP/1.1\r\nHost: localhost\r\n")  # and no more
            elif k % 3 == 2:
                idle[-1].sendall(
                    b"PUT /_stcore/upload_file/a/b HTTP/1.1\r\nHost: localhost\r\n"
                    b"Content-Length: 1000000\r\n\r\nbegun"
                )
        end = time.monotonic() + PATIENCE
        while process.num_fds() >= 600:
            assert time.monotonic() < end, "files have their share"
            time.sleep(0.1)
        _run(browse(server))
        end = time.monotonic() + PATIENCE
        while process.num_fds() > 60:
            assert time.monotonic() < end, "what is silent is closed"
            time.sleep(0.1)
    log = place[1].read_text()
    assert "Too many open files" not in log
    assert "Traceback" not in log
