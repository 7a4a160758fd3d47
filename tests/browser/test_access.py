"""Every page for those who cannot see it as it is drawn, or not all of it at once."""

import pytest
from axe_playwright_python.sync_playwright import Axe
from playwright.sync_api import Page

from tests.browser.conftest import App, Open
from tests.browser.running import go, idle, open_sample
from tests.support.studies import row, write_study

pytestmark = pytest.mark.browser

SERIOUS = ("serious", "critical")
TALLEST = 2600
"""Pixels of a page at a width of 1440."""


def violations(page: Page) -> list[str]:
    """What axe-core calls serious or critical: rule, element and reason."""
    return [
        f"{found['id']}: {node['target']} {node['failureSummary']}"
        for found in Axe().run(page).response["violations"]
        if found["impact"] in SERIOUS
        for node in found["nodes"]
    ]


def height(page: Page) -> float:
    """Pixels from the page's top to its end."""
    box = page.get_by_test_id("stMainBlockContainer").bounding_box()
    assert box
    return box["height"]


@pytest.mark.parametrize("theme", ["light", "dark"])
def test_no_page_has_a_serious_violation_or_is_too_tall(opened: Open, app: App, theme: str) -> None:
    page = opened()
    page.emulate_media(color_scheme="dark" if theme == "dark" else "light")
    found, heights = {"Home": violations(page)}, {"Home": height(page)}
    go(page, "Data")
    open_sample(page)
    found["Data"], heights["Data"] = violations(page), height(page)
    page.get_by_role("button", name="Train on this window").click()
    page.get_by_role("button", name="Next: do these vehicles amplify").wait_for()
    idle(page)
    makes = (row(f"Make {k}", file="a.csv", start=0.0, duration=60.0, sha256="0") for k in range(9))
    write_study(app.studies / "nine makes", *makes)
    for title in ("Train", "Stability", "Platoon", "Compare", "Database", "Snapshots"):
        go(page, title)
        found[title], heights[title] = violations(page), height(page)
    page.emulate_media(color_scheme="light")
    assert {title: wrong for title, wrong in found.items() if wrong} == {}
    assert max(heights.values()) <= TALLEST, heights
