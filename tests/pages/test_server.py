"""A running server with several browsers at once, by the messages that browsers send."""

import asyncio
import json
from collections.abc import Coroutine
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any, TypeVar

import psutil
import pytest
from streamlit.web.server.starlette.starlette_app_utils import (
    create_signed_value,
    generate_xsrf_token_string,
)
from websockets.asyncio.client import connect
from websockets.exceptions import InvalidStatus

from bench.browsing import XSRF, Browser
from bench.load import Load, Request, wrong_results
from tests.support.openacc_files import csv
from tests.support.samples import FOLDER, NOISY, VICOLUNGO, frame
from tests.support.server import FEW_DRAWS, Server, free_port, running

SECRET = "of the tests, and long enough to sign a cookie with it"
SIGN_IN = f"""
[auth]
redirect_uri = "http://127.0.0.1:8501/oauth2callback"
cookie_secret = "{SECRET}"
client_id = "accpinn"
client_secret = "known to both"
server_metadata_url = "http://127.0.0.1:9/.well-known/openid-configuration"
"""
Result = TypeVar("Result")
HOSTILE = "../../<b>annsown</b>.csv"


def signed_in(server: Server, email: str, secret: str = SECRET) -> Browser:
    """A browser with the cookie that says who is signed in, sealed with a secret."""
    claims = {"origin": server.address, "is_logged_in": True, "email": email, "sub": email}
    cookie = create_signed_value(secret, "_streamlit_user", json.dumps(claims)).decode()
    token = generate_xsrf_token_string()
    return Browser(server.address, cookies={"_streamlit_user": cookie, XSRF: token})


def _run(work: Coroutine[Any, Any, Result]) -> Result:
    """In a thread of its own, as the browser of another test may keep this one's loop."""
    with ThreadPoolExecutor(1) as thread:
        return thread.submit(asyncio.run, work).result()


def test_a_user_s_session_is_nobody_else_s_and_goes_on_after_a_kill_in_mid_training(
    tmp_path: Path,
) -> None:
    cache, own = tmp_path / "cache", csv(frame())

    async def begin(server: Server) -> str:
        ann, bob = (signed_in(server, f"{name}@lab.org") for name in ("ann", "bob"))
        stranger, forger = Browser(server.address), signed_in(server, "ann@lab.org", SECRET[::-1])
        everyone = (ann, bob, stranger, forger)
        for one in everyone:
            await one.open()
        await ann.upload("data_upload", HOSTILE, own)
        for other in (bob, stranger, forger):
            other.session = ann.session
            await other.go("Data")
            assert "annsown" not in " ".join(other.texts())
        assert bob.session != ann.session, "he got one of his own"
        await stranger.press("sign_in")
        assert stranger.sent_to.startswith("/auth/login")
        assert forger.widget("sign_in")
        await ann.go("Data")
        assert "annsown" in " ".join(ann.texts())
        with pytest.raises(InvalidStatus):  # a name that somebody else's server leads here
            await connect(f"ws{server.address[4:]}/_stcore/stream", origin="http://evil.org",
                          additional_headers={"Host": "evil.org"})  # fmt: skip

        await ann.set("data_length", 60.0)
        await ann.go("Train")
        await ann.set("train_preset", ("Paper",))
        await ann.press("train_start")
        while not list(cache.rglob("*.state.npz")):
            assert await ann.poll(), "it still trains"
        assert not [fault for one in everyone for fault in one.faults]
        server.process.kill()
        server.process.wait()
        return ann.session

    def at(browser: Browser) -> int:
        label = browser.widget("train_start").label
        return int(label.removeprefix("Continue from iteration ").replace(",", ""))

    async def go_on(server: Server, session: str) -> None:
        ann = signed_in(server, "ann@lab.org")
        ann.session = session
        await ann.open()
        assert ann.session == session
        await ann.upload("data_upload", HOSTILE, own)  # the server keeps no uploads
        await ann.go("Train")
        assert "0–60 s, vehicles 1–2" in " ".join(ann.texts())
        before = at(ann)
        await ann.press("train_start")
        while not any("iteration" in text for text in ann.texts()):
            assert await ann.poll()
        await ann.press("train_stop")
        while await ann.poll():
            pass
        assert at(ann) > before, "it went on where the killed one had been"
        assert not ann.faults
        await ann.close()

    secrets, port = tmp_path / "secrets.toml", free_port()
    secrets.write_text(SIGN_IN)
    place, options = (cache, tmp_path / "log"), [f"--secrets.files={secrets}"]
    with running(*place, options=options, port=port, program=FEW_DRAWS) as server:
        session = _run(begin(server))
    with running(*place, options=options, port=port, program=FEW_DRAWS) as server:
        _run(go_on(server, session))
    assert not list(tmp_path.parent.glob("*annsown*"))


@pytest.mark.slow
def test_users_at_once_get_their_own_results_and_what_they_held_is_given_back(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    few = [FOLDER / f"{name}.csv" for name in (NOISY, VICOLUNGO)]  # one and three followers
    monkeypatch.setattr("bench.load.SAMPLES", few)
    options = ["--server.disconnectedSessionTTL=1"]
    place = tmp_path / "cache", tmp_path / "log"
    with running(*place, options=options, program=FEW_DRAWS) as server:
        process, load, held = psutil.Process(server.process.pid), Load(server), []
        for journey, users in enumerate((2, 1)):
            _run(load.journeys(users, journey))
            held.append((process.num_threads(), process.num_fds(), process.memory_info().rss))
    assert not load.faults
    # The first round's results are right; of the second it is enough that they were saved.
    wrong = wrong_results(tmp_path / "snapshots", [Request.of(0), Request.of(1)])
    named = {fault.partition(":")[0] for fault in wrong}
    assert named == {Request.of(0, 1).name}
    (_, *before), (_, *after) = held
    assert after[0] <= before[0] + 5
    assert after[1] <= before[1] + 20e6, "the first round has filled the caches"
