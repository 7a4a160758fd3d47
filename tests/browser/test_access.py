"""Every page for those who cannot see it as it is drawn, or not all of it at once."""

import pytest
from axe_playwright_python.sync_playwright import Axe
from playwright.sync_api import Page

from tests.browser.conftest import App, Open
from tests.browser.running import TRAINING_MS, go, idle, open_sample
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


def cut_off(page: Page) -> list[str]:
    """Controls that stand out of a narrow page's sides; a row of tabs scrolls.

    At half the width of a usual screen, as where it is shown at twice the size, and on a telephone.
    """
    found = []
    for width, tall in ((720, 450), (420, 900)):
        page.set_viewport_size({"width": width, "height": tall})
        found += _outside(page)
    page.set_viewport_size({"width": 1440, "height": 1000})
    return found


def _outside(page: Page) -> list[str]:
    found: list[str] = page.get_by_test_id("stMain").evaluate(
        """main => [...main.querySelectorAll('button, input, [role=combobox]')]
            .filter(one => one.checkVisibility({visibilityProperty: true, opacityProperty: true}))
            .filter(one => !one.closest('.modebar, .main-svg, [data-testid=stDataFrame]'))
            .filter(one => {
                const box = one.getBoundingClientRect();
                return box.width > 1 && (box.right > innerWidth + 1 || box.left < -1);
            })
            .map(one => one.outerHTML.slice(0, 120))"""
    )
    return found


@pytest.mark.parametrize("theme", ["light", "dark"])
def test_no_page_has_a_serious_violation_is_too_tall_or_cut_off(
    opened: Open, app: App, theme: str
) -> None:
    page = opened()
    page.emulate_media(color_scheme="dark" if theme == "dark" else "light")
    found, heights = {"Home": violations(page)}, {"Home": height(page)}
    go(page, "Data")
    open_sample(page)
    found["Data"], heights["Data"] = violations(page), height(page)
    page.get_by_role("button", name="Train on this window").click()
    page.get_by_role("button", name="Next: do these vehicles amplify").wait_for(timeout=TRAINING_MS)
    idle(page)
    makes = (row(f"Make {k}", file="a.csv", start=0.0, duration=60.0, sha256="0") for k in range(9))
    write_study(app.studies / "nine makes", *makes)
    for title in ("Train", "Stability", "Platoon", "Compare", "Database", "Snapshots"):
        go(page, title)
        found[title], heights[title] = violations(page), height(page)
        if theme == "dark":
            found[title] += cut_off(page)
    page.emulate_media(color_scheme="light")
    assert {title: wrong for title, wrong in found.items() if wrong} == {}
    assert max(heights.values()) <= TALLEST, heights
