"""How long a switch of pages takes in a browser, on a warm server with a trained recording.

    OPENACC_DIR=... CHROMIUM=... python -m bench.pages [--switches 10]

Each switch is timed from the click in the sidebar until the script has run to its end and the
page's last chart or table stands. Needs what the tests need.
"""

import argparse
import os
import shutil
import tempfile
import time
from pathlib import Path
from statistics import median

from playwright.sync_api import Page

from tests.browser.running import ESTIMATES, TRAINING_MS, give, go, idle, launched, served, table

RUNS = {
    "Casale, one follower": "Casale/part7.csv",
    "AstaZero, four followers": "AstaZero/ASta_040719_platoon5.csv",
}
PAGES = {
    "Data": "data_overview",
    "Train": "train_tracking",
    "Stability": "stability_bode",
    "Platoon": "platoon_amplitude",
    "Snapshots": "",
}
"""The chart that each page is waited for; none for a page without."""


def main() -> None:
    """Print a line a recording and page."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--switches", type=int, default=10, help="of each page")
    switches = parser.parse_args().switches
    recordings = Path(os.environ["OPENACC_DIR"])
    chromium = os.environ.get("CHROMIUM") or shutil.which("chromium") or "chromium"
    with tempfile.TemporaryDirectory() as place, launched(chromium) as browser:
        with served(Path(place) / "cache", Path(place) / "log") as address:
            for title, file in RUNS.items():
                page = browser.new_page(
                    base_url=address, viewport={"width": 1440, "height": 900},
                    reduced_motion="reduce",
                )  # fmt: skip
                _train(page, recordings / file)
                for name, taken in _switch(page, switches).items():
                    print(f"{title:26} {name:10} median {median(taken):.2f} s,"
                          f" {min(taken):.2f} to {max(taken):.2f} s")  # fmt: skip
                page.close()


def _train(page: Page, recording: Path) -> None:
    page.goto("/")
    idle(page)
    give(page, recording)
    button = page.get_by_role("button", name="Train on this window")
    button.click(timeout=TRAINING_MS)
    table(page, ESTIMATES).wait_for(timeout=TRAINING_MS)
    idle(page)


def _switch(page: Page, switches: int) -> dict[str, list[float]]:
    """Seconds of each switch, by page; the first round, which fills the caches, does not count."""
    taken: dict[str, list[float]] = {name: [] for name in PAGES}
    for _ in range(switches + 1):
        for name, chart in PAGES.items():
            began = time.perf_counter()
            go(page, name)
            if chart:
                page.locator(f".st-key-{chart} .js-plotly-plot .main-svg").first.wait_for()
            taken[name].append(time.perf_counter() - began)
    return {name: found[1:] for name, found in taken.items()}


if __name__ == "__main__":
    main()
