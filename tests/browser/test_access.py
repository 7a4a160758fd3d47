"""Every page after one click, also for those who cannot see it as it is drawn, or not all of it."""

from typing import Any

import pytest
from axe_playwright_python.sync_playwright import Axe
from playwright.sync_api import Page, expect

from tests.browser.conftest import App, Open
from tests.browser.running import (
    ESTIMATES,
    choose,
    estimate,
    go,
    idle,
    open_tab,
    rows,
    train_sample,
)
from tests.support.studies import row, write_study

pytestmark = pytest.mark.browser

SERIOUS = ("serious", "critical")
TALLEST = 2600
"""Pixels of a page at a width of 1440."""
OUTSIDE = """main => [...main.querySelectorAll('button, input, [role=combobox]')]
    .filter(one => one.checkVisibility({visibilityProperty: true, opacityProperty: true}))
    .filter(one => !one.closest('.modebar, .main-svg'))
    .filter(one => !one.closest('[data-testid=stDataFrame], [data-testid=stSlider]'))
    .filter(one => {
        const box = one.getBoundingClientRect();
        return box.width > 1 && (box.right > innerWidth + 1 || box.left < -1);
    })
    .map(one => one.outerHTML.slice(0, 120))"""


def violations(page: Page, **options: Any) -> list[str]:
    """What axe-core calls serious or critical: rule, element and reason."""
    options["resultTypes"] = ["violations"]  # of the others it tells less, and is sooner done
    return [
        f"{found['id']}: {node['target']} {node['failureSummary']}"
        for found in Axe().run(page, options=options).response["violations"]
        if found["impact"] in SERIOUS
        for node in found["nodes"]
    ]


def height(page: Page) -> float:
    """Pixels from the page's top to its end."""
    box = page.get_by_test_id("stMainBlockContainer").bounding_box()
    return box["height"]


def cut_off(page: Page) -> list[str]:
    """Controls that stand out of a narrow page's sides; a row of tabs scrolls.

    At half the width of a usual screen, as where it is shown at twice the size, and on a telephone.
    """
    found = []
    for width, tall in ((720, 450), (420, 900)):
        page.set_viewport_size({"width": width, "height": tall})
        found += page.get_by_test_id("stMain").evaluate(OUTSIDE)
    page.set_viewport_size({"width": 1440, "height": 1000})
    return found


def test_from_one_click_on_home_through_every_page_in_both_themes(opened: Open, app: App) -> None:
    """No page has a serious violation, is too tall or cut off; the sample's answers are right."""
    found: dict[str, list[str]] = {}
    heights: dict[str, float] = {}
    page = opened()

    def look(title: str) -> None:
        idle(page)
        found[title], heights[title] = violations(page), height(page)
        page.emulate_media(color_scheme="dark")
        # Of the dark theme the colours alone are others.
        found[title] += [*violations(page, runOnly=["color-contrast"]), *cut_off(page)]
        page.emulate_media(color_scheme="light")

    makes = (row(f"Make {k}", file="a.csv", start=0.0, duration=60.0, sha256="0") for k in range(9))
    write_study(app.studies / "nine makes", *makes)
    look("Home")
    train_sample(page)
    first = rows(page, ESTIMATES)[1]
    assert first[0] == "2 Audi (A6-like)"
    assert estimate(first[1]) == pytest.approx(0.0612, rel=0.03)
    assert estimate(first[3]) == pytest.approx(1.19, rel=0.01)
    expect(page.locator(".js-plotly-plot")).to_have_count(1)
    look("Train")
    open_tab(page, "Training")
    expect(page.locator(".js-plotly-plot")).to_have_count(5)
    page.get_by_role("button", name="Next: do these vehicles amplify").click()
    expect(page.get_by_text("All four vehicles amplify disturbances")).to_be_visible()
    expect(page.locator("table.figures").first).to_contain_text("Tesla (Model3-like)")
    look("Stability")
    for title in ("Data", "Compare", "Database", "Snapshots", "Platoon"):
        go(page, title)
        look(title)
    choose(page, "Disturbance of the leader", "As recorded")
    expect(page.get_by_text("as recorded")).to_be_visible()
    expect(page.locator(".vehicle-key")).to_contain_text("5 Tesla (Model3-like)")
    assert {title: wrong for title, wrong in found.items() if wrong} == {}
    assert max(heights.values()) <= TALLEST, heights
