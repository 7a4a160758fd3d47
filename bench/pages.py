"""How long a switch of pages takes in a browser, on a warm server with a trained recording.

Each switch is timed from the click in the sidebar until the script has run to its end and the
page's chart stands.
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
from tests.browser.running import ESTIMATES, TRAINING_MS, give, go, idle, launched, served, table

PAGES = {
    "Data": "data_overview",
    "Train": "train_tracking",
    "Stability": "stability_bode",
    "Platoon": "platoon_amplitude",
    "Snapshots": "",
}
"""The chart that each page is waited for; none for a page without."""
LIMIT: Seconds = 1.0
SWITCHES = 10
"""Of each page."""


def measure(folder: Path, chromium: str) -> Iterator[Measurement]:
    """A switch to each page, with each of two recordings."""
    with TemporaryDirectory() as place, launched(chromium) as browser:
        with served(Path(place) / "cache", Path(place) / "log") as address:
            for case in CASES[:2]:
                page = browser.new_page(
                    base_url=address, viewport={"width": 1440, "height": 900},
                    reduced_motion="reduce",
                )  # fmt: skip
                _train(page, folder / case.file)
                for name, taken in _switch(page).items():
                    yield Measurement(f"{name}, {case.name}", median(taken), limit=LIMIT)
                page.close()


def _train(page: Page, recording: Path) -> None:
    page.goto("/")
    idle(page)
    give(page, recording)
    button = page.get_by_role("button", name="Train on this window")
    button.click(timeout=TRAINING_MS)
    table(page, ESTIMATES).wait_for(timeout=TRAINING_MS)
    idle(page)


def _switch(page: Page) -> dict[str, list[Seconds]]:
    """Seconds of each switch, by page; the first round, which fills the caches, does not count."""
    taken: dict[str, list[Seconds]] = {name: [] for name in PAGES}
    for _ in range(SWITCHES + 1):
        for name, chart in PAGES.items():
            began = time.perf_counter()
            go(page, name)
            if chart:
                page.locator(f".st-key-{chart} .js-plotly-plot .main-svg").first.wait_for()
            taken[name].append(time.perf_counter() - began)
    return {name: found[1:] for name, found in taken.items()}
