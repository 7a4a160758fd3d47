"""A running server with several browsers at once, by the messages that browsers send."""

import asyncio
import json
from collections.abc import Coroutine
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any, TypeVar

import psutil
import pytest
import requests
from streamlit.web.server.starlette.starlette_app_utils import (
    create_signed_value,
    generate_xsrf_token_string,
)
from websockets.asyncio.client import connect
from websockets.exceptions import InvalidStatus

from bench.browsing import XSRF, Browser
from bench.load import Load, all_requests, wrong_results
from tests.support.openacc_files import csv, platoon
from tests.support.provider import CLIENT, CLIENT_SECRET, Provider, provider
from tests.support.server import FEW_DRAWS, Server, free_port, running

SECRET = "of the tests, and long enough to sign a cookie with it"
SIGN_IN = """
[auth]
redirect_uri = "http://127.0.0.1:{port}/oauth2callback"
cookie_secret = "{secret}"
client_id = "{client}"
client_secret = "{client_secret}"
server_metadata_url = "{address}/.well-known/openid-configuration"
"""
Result = TypeVar("Result")
HOSTILE = "../../<b>annsown</b>.csv"


async def sign_in(server: Server, names: Provider, email: str) -> Browser:
    """A browser that pressed "Sign in" and was sent to the provider and back."""
    visitor = Browser(server.address)
    await visitor.open()
    await visitor.press("sign_in")
    await visitor.close()
    names.email = email
    with requests.Session() as session:
        back = await asyncio.to_thread(session.get, server.address + visitor.sent_to, timeout=60)
        assert back.ok
        assert back.url == f"{server.address}/"
        session.get(f"{server.address}/_stcore/health", timeout=60)  # sets the other cookie
        cookies = session.cookies.get_dict()
    return Browser(server.address, cookies=cookies)


def forged(server: Server, email: str, secret: str) -> Browser:
    """A browser with the cookie that says who is signed in, sealed by somebody."""
    claims = {"origin": server.address, "is_logged_in": True, "email": email, "sub": email}
    cookie = create_signed_value(secret, "_streamlit_user", json.dumps(claims)).decode()
    token = generate_xsrf_token_string()
    return Browser(server.address, cookies={"_streamlit_user": cookie, XSRF: token})


def test_who_is_signed_in_sees_only_what_is_theirs(tmp_path: Path) -> None:
    async def visit(server: Server, names: Provider) -> None:
        ann = await sign_in(server, names, "ann@lab.org")
        bob = await sign_in(server, names, "bob@lab.org")
        stranger = await sign_in(server, names, "")  # whom the provider does not know
        forger = forged(server, "ann@lab.org", SECRET[::-1])
        everyone = (ann, bob, stranger, forger)
        for one in everyone:
            await one.open()
        await ann.upload("data_upload", HOSTILE, csv(platoon()))
        for other in (bob, stranger, forger):
            other.session = ann.session
            await other.go("Data")
            assert "annsown" not in " ".join(other.texts())
        await ann.go("Data")
        assert "annsown" in " ".join(ann.texts())
        for nobody in (stranger, forger):
            assert nobody.widget("sign_in")
        assert bob.session != ann.session, "he got one of his own"
        assert not [fault for one in everyone for fault in one.faults]
        for one in everyone:
            await one.close()
        with pytest.raises(InvalidStatus):  # a name that somebody else's server leads here
            await connect(f"ws{server.address[4:]}/_stcore/stream", origin="http://evil.org",
                          additional_headers={"Host": "evil.org"})  # fmt: skip

    secrets, port = tmp_path / "secrets.toml", free_port()
    options = [f"--secrets.files={secrets}"]
    with provider() as names:
        secrets.write_text(
            SIGN_IN.format(
                port=port, secret=SECRET, client=CLIENT, client_secret=CLIENT_SECRET,
                address=names.address,
            )
        )  # fmt: skip
        place = tmp_path / "cache", tmp_path / "log"
        with running(*place, options=options, port=port) as server:
            _run(visit(server, names))
    assert not list(tmp_path.parent.glob("*annsown*"))


def _run(work: Coroutine[Any, Any, Result]) -> Result:
    """In a thread of its own, as the browser of another test may keep this one's loop."""
    with ThreadPoolExecutor(1) as thread:
        return thread.submit(asyncio.run, work).result()


def test_killed_in_mid_training_it_goes_on_under_the_same_address(tmp_path: Path) -> None:
    cache, name, own = tmp_path / "cache", "mine.csv", csv(platoon(2, 620))

    async def begin(server: Server) -> str:
        browser = Browser(server.address)
        await browser.open()
        await browser.upload("data_upload", name, own)
        await browser.set("data_length", 60.0)
        await browser.go("Train")
        await browser.set("train_preset", ("Paper",))
        await browser.press("train_start")
        while not list(cache.rglob("*.state.npz")):
            assert await browser.poll(), "it still trains"
        server.process.kill()
        server.process.wait()
        return browser.session

    async def go_on(server: Server, session: str) -> None:
        again = Browser(server.address, session)
        await again.open()
        assert again.session == session
        await again.upload("data_upload", name, own)  # the server keeps no uploads
        await again.go("Train")
        assert "0–60 s, vehicles 1–2" in " ".join(again.texts())
        assert "Continue from iteration" in again.widget("train_start").label
        await again.press("train_start")
        while not any("Adam: iteration" in text for text in again.texts()):
            assert await again.poll()
        await again.press("train_stop")
        while await again.poll():
            pass
        assert "Continued from iteration" in " ".join(again.texts())
        assert not again.faults
        await again.close()

    with running(cache, tmp_path / "log") as server:
        session = _run(begin(server))
    with running(cache, tmp_path / "log") as server:
        _run(go_on(server, session))


@pytest.mark.slow
def test_users_at_once_get_their_own_results_and_what_they_held_is_given_back(
    tmp_path: Path,
) -> None:
    options = ["--server.disconnectedSessionTTL=1"]
    place = tmp_path / "cache", tmp_path / "log"
    with running(*place, options=options, program=FEW_DRAWS) as server:
        process, load, held = psutil.Process(server.process.pid), Load(server), []
        for journey in range(3):
            _run(load.journeys(2, journey))
            held.append((process.num_threads(), process.num_fds(), process.memory_info().rss))
    assert not load.faults
    assert not wrong_results(tmp_path / "snapshots", all_requests(2, 3))
    (_, *before), (_, *after) = held[1:]
    assert after[0] <= before[0] + 5
    assert after[1] <= before[1] + 40e6, "the first round has filled the caches"
