"""A running app, a browser, and pages whose faults fail the test."""

from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Browser, Page, expect

from tests.browser.running import PATIENCE_MS, idle, launched, served, watched

Open = Callable[[str], Page]


@pytest.fixture(scope="module")
def app(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """The address of an app that nobody used before."""
    place = tmp_path_factory.mktemp("app")
    with served(place / "cache", place / "log.txt") as address:
        yield address


@pytest.fixture(scope="module")
def browser(chromium: str) -> Iterator[Browser]:
    """A browser without a window."""
    expect.set_options(timeout=PATIENCE_MS)
    with launched(chromium) as running:
        yield running


@pytest.fixture
def opened(app: str, browser: Browser) -> Iterator[Open]:
    """Opens a page of the app in a browser profile of its own."""
    contexts, pages = [], []

    def open_page(path: str = "") -> Page:
        context = browser.new_context(viewport={"width": 1440, "height": 1000})
        contexts.append(context)
        page = context.new_page()
        pages.append((page, watched(page)))
        page.goto(app + path)
        idle(page)
        return page

    yield open_page
    faults = [fault for _, found in pages for fault in found]
    exceptions = [
        text for page, _ in pages for text in page.get_by_test_id("stException").all_inner_texts()
    ]
    for context in contexts:
        context.close()
    assert exceptions == []
    assert faults == []


@pytest.fixture(scope="session")
def casale(openacc_dir: Path) -> Path:
    """The real recording of the main job."""
    return openacc_dir / "Casale" / "part7.csv"
