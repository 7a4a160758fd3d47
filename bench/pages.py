"""Duration of a switch of pages in a browser, on a warm server with a trained recording.

Each switch is timed from the click in the sidebar until the script has ended and the page's chart
is drawn.
"""

import time
from collections.abc import Iterator
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory

from playwright.sync_api import Page

from accpinn.units import Seconds
from bench.measurement import Measurement
from bench.speed import CASES
from tests.browser.running import ESTIMATES, TRAINING_MS, give, go, idle, launched, table
from tests.support.server import running

PAGES = {
    "Data": "data_overview",
    "Train": "train_tracking",
    "Stability": "stability_bode",
    "Platoon": "platoon_growth",
    "Snapshots": "",
}
"""Pages and the key of the chart that is waited for; empty if the page has none."""
LIMIT: Seconds = 0.6
SWITCHES = 10
"""Switches to each page."""


def measure(folder: Path, chromium: str) -> Iterator[Measurement]:
    """Time a switch to each page, with each of two recordings."""
    with TemporaryDirectory() as place, launched(chromium) as browser:
        with running(Path(place) / "cache", Path(place) / "log") as server:
            for case in CASES[:2]:
                page = browser.new_page(
                    base_url=server.address, viewport={"width": 1440, "height": 900},
                    reduced_motion="reduce",
                )  # fmt: skip
                _train(page, folder / case.file)
                for name, taken in _switch(page).items():
                    yield Measurement(
                        name=f"{name}, {case.name}", value=median(taken), at_most=LIMIT
                    )
                page.close()


def _train(page: Page, recording: Path) -> None:
    page.goto("/")
    idle(page)
    give(page, recording)
    button = page.get_by_test_id("stBaseButton-primary").filter(has_text="Train on ")
    button.click(timeout=TRAINING_MS)
    table(page, ESTIMATES).wait_for(timeout=TRAINING_MS)
    idle(page)


def _switch(page: Page) -> dict[str, list[Seconds]]:
    """Return the seconds of each switch by page, without the first round, which fills caches."""
    taken: dict[str, list[Seconds]] = {name: [] for name in PAGES}
    for _ in range(SWITCHES + 1):
        for name, chart in PAGES.items():
            began = time.perf_counter()
            go(page, name)
            if chart:
                page.locator(f".st-key-{chart} .js-plotly-plot .main-svg").first.wait_for()
            taken[name].append(time.perf_counter() - began)
    return {name: seconds[1:] for name, seconds in taken.items()}
