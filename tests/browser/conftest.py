"""A running app, a browser, and pages whose faults fail the test."""

import shutil
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import pytest
from playwright.sync_api import Browser, Error, Page, expect

from tests.browser.running import PATIENCE_MS, exceptions, idle, installed, launched, watched
from tests.support.server import FEW_DRAWS, running

Open = Callable[..., Page]

STILL = """addEventListener("DOMContentLoaded", () => {
    const style = document.createElement("style");
    style.textContent = "*, ::before, ::after { animation: none !important; transition: none "
        + "!important }";
    document.head.append(style);
})"""
"""Spinners and fading cost an eighth of the browser's time, and no journey looks at them."""

OF_THE_BROWSER = [Error, r"^AssertionError: (Locator|Page)\b.* expected"]
"""Failures whose cause may be a busy machine: the browser could not do something, or the page did
not show something, in time. An exception on the page, or a value that is wrong, is none of them."""


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """A journey that failed in the browser is made once more, and counted so in the summary.

    A browser's own waits end before the test's, and say for what.
    """
    here = Path(__file__).parent
    for item in items:
        if item.path.is_relative_to(here):
            item.add_marker(pytest.mark.flaky(reruns=1, only_rerun=OF_THE_BROWSER))
            item.add_marker(pytest.mark.timeout(600))


@dataclass(frozen=True)
class App:
    address: str
    snapshots: Path
    recordings: Path
    studies: Path


@pytest.fixture(scope="session")
def app(tmp_path_factory: pytest.TempPathFactory) -> Iterator[App]:
    """One server for all journeys: it starts in seconds, and trains nothing twice."""
    place = tmp_path_factory.mktemp("app")
    with running(place / "cache", place / "log", program=FEW_DRAWS) as server:
        folders = (place / name for name in ("snapshots", "recordings", "studies"))
        yield App(server.address, *folders)


@pytest.fixture(scope="session")
def browser() -> Iterator[Browser]:
    """A browser without a window."""
    chromium = installed()
    if not chromium:
        pytest.skip("no Chromium on this machine; install it, or name it in CHROMIUM")
    expect.set_options(timeout=PATIENCE_MS)
    with launched(chromium) as running:
        yield running


@pytest.fixture(scope="session")
def tabs() -> list[tuple[Page, list[str]]]:
    """A tab in each profile so far, and its faults.

    They serve all journeys: one that has drawn charts before draws them three times as fast.
    """
    return []


@pytest.fixture
def opened(app: App, browser: Browser, tabs: list[tuple[Page, list[str]]]) -> Iterator[Open]:
    """Opens a page of the app, each time in a profile that no other page of the test has."""
    shutil.rmtree(app.snapshots, ignore_errors=True)
    used: list[tuple[Page, list[str]]] = []

    def open_page(path: str = "/") -> Page:
        if len(used) == len(tabs):
            context = browser.new_context(
                base_url=app.address,
                viewport={"width": 1440, "height": 1000},
                reduced_motion="reduce",
            )
            context.add_init_script(STILL)
            page = context.new_page()
            tabs.append((page, watched(page)))
        used.append(tabs[len(used)])
        page, _ = used[-1]
        page.goto(path)
        idle(page)
        return page

    yield open_page
    wrong = [text for _, faults in used for text in faults]
    with suppress(Error):  # a tab that is gone has failed the test before
        wrong += [text for page, _ in used for text in exceptions(page)]
    for tab in used:
        page, faults = tab
        try:
            page.goto("/_stcore/health")  # ends the session
            page.evaluate("localStorage.clear(); sessionStorage.clear()")
            page.context.clear_cookies()
            page.emulate_media(color_scheme="light")
        except Error:  # the next journey gets another one
            tabs.remove(tab)
        faults.clear()
    assert wrong == []
