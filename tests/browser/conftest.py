"""A running app, a browser, and pages whose faults fail the test."""

import shutil
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest
from playwright.sync_api import Browser, Page, expect

from tests.browser.running import (
    PATIENCE_MS,
    exceptions,
    idle,
    launched,
    served,
    watched,
)
from tests.support.server import free_port

Open = Callable[..., Page]


@dataclass(frozen=True)
class App:
    address: str
    snapshots: Path
    recordings: Path
    studies: Path
    mirror: int
    """The port at which the app looks for published runs."""


@pytest.fixture(scope="session")
def app(tmp_path_factory: pytest.TempPathFactory) -> Iterator[App]:
    """One server for all journeys: it starts in seconds, and trains nothing twice."""
    place = tmp_path_factory.mktemp("app")
    mirror = free_port()
    extra = {"ACCPINN_MIRROR": f"http://127.0.0.1:{mirror}"}
    with served(place / "cache", place / "log.txt", extra=extra) as address:
        yield App(address, place / "snapshots", place / "recordings", place / "studies", mirror)


@pytest.fixture(scope="session")
def browser(chromium: str) -> Iterator[Browser]:
    """A browser without a window."""
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
            page = context.new_page()
            tabs.append((page, watched(page)))
        used.append(tabs[len(used)])
        page, _ = used[-1]
        page.goto(path)
        idle(page)
        return page

    yield open_page
    wrong = [text for page, faults in used for text in (*exceptions(page), *faults)]
    for page, faults in used:
        page.goto("/_stcore/health")  # ends the session
        page.evaluate("localStorage.clear(); sessionStorage.clear()")
        page.context.clear_cookies()
        faults.clear()
    assert wrong == []


@pytest.fixture(scope="session")
def casale(openacc_dir: Path) -> Path:
    """The real recording of the main job."""
    return openacc_dir / "Casale" / "part7.csv"
