"""A running server with several browsers at once, by the messages that browsers send."""

import asyncio
import json
from collections.abc import Coroutine
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import psutil
import pytest
from streamlit.web.server.starlette.starlette_app_utils import (
    create_signed_value,
    generate_xsrf_token_string,
)
from websockets.asyncio.client import connect
from websockets.exceptions import InvalidStatus

from bench.browsing import XSRF, Browser
from bench.load import Load, wrong_results
from tests.support import draws
from tests.support.openacc_files import csv, platoon
from tests.support.server import Server, running

SECRET = "of the tests, and long enough to sign a cookie with it"
SIGN_IN = f"""
[auth]
redirect_uri = "http://127.0.0.1:8501/oauth2callback"
cookie_secret = "{SECRET}"
client_id = "accpinn"
client_secret = "none"
server_metadata_url = "http://127.0.0.1:9/.well-known/openid-configuration"
"""
HOSTILE = "../../<b>annsown</b>.csv"


def signed_in(server: Server, email: str, secret: str = SECRET) -> Browser:
    """A browser with the cookie that the server sets once the provider has named the user."""
    claims = {"origin": server.address, "is_logged_in": True, "email": email, "sub": email}
    cookie = create_signed_value(secret, "_streamlit_user", json.dumps(claims)).decode()
    token = generate_xsrf_token_string()
    return Browser(server.address, cookies={"_streamlit_user": cookie, XSRF: token})


def test_who_is_signed_in_sees_only_what_is_theirs(tmp_path: Path) -> None:
    secrets = tmp_path / "secrets.toml"
    secrets.write_text(SIGN_IN)

    async def visit(server: Server) -> None:
        ann, bob = signed_in(server, "ann@lab.org"), signed_in(server, "bob@lab.org")
        stranger, forger = Browser(server.address), signed_in(server, "ann@lab.org", SECRET[::-1])
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

    options = [f"--secrets.files={secrets}"]
    with running(tmp_path / "cache", tmp_path / "log", options=options) as server:
        _run(visit(server))
    assert not list(tmp_path.parent.glob("*annsown*"))


def _run(work: Coroutine[Any, Any, None]) -> None:
    """In a thread of its own, as the browser of another test may keep this one's loop."""
    with ThreadPoolExecutor(1) as thread:
        thread.submit(asyncio.run, work).result()


@pytest.mark.slow
def test_users_at_once_get_their_own_results_and_what_they_held_is_given_back(
    tmp_path: Path,
) -> None:
    options = ["--server.disconnectedSessionTTL=1"]
    with running(tmp_path / "cache", tmp_path / "log", options=options) as server:
        process, load, held = psutil.Process(server.process.pid), Load(server), []
        for journey in range(3):
            _run(load.journeys(2, journey))
            held.append((process.num_threads(), process.num_fds(), process.memory_info().rss))
    assert not load.faults
    with draws.as_users_have():
        assert not wrong_results(tmp_path / "snapshots", 2, 3)
    (_, *before), (_, *after) = held[1:]
    assert after[0] <= before[0] + 5
    assert after[1] <= before[1] + 40e6, "the first round has filled the caches"
