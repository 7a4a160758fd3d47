"""Every page for those who cannot see it as it is drawn: axe-core finds no serious violation."""

import pytest
from axe_playwright_python.sync_playwright import Axe
from playwright.sync_api import Page

from tests.browser.conftest import Open
from tests.browser.running import go, idle, open_sample

pytestmark = pytest.mark.browser

SERIOUS = ("serious", "critical")


def violations(page: Page) -> list[str]:
    """What axe-core calls serious or critical: rule, element and reason."""
    return [
        f"{found['id']}: {node['target']} {node['failureSummary']}"
        for found in Axe().run(page).response["violations"]
        if found["impact"] in SERIOUS
        for node in found["nodes"]
    ]


@pytest.mark.parametrize("theme", ["light", "dark"])
def test_no_page_has_a_serious_violation(opened: Open, theme: str) -> None:
    page = opened()
    page.emulate_media(color_scheme="dark" if theme == "dark" else "light")
    found = {"Home": violations(page)}
    go(page, "Data")
    open_sample(page)
    found["Data"] = violations(page)
    page.get_by_role("button", name="Train on this window").click()
    page.get_by_role("button", name="Next: do these vehicles amplify").wait_for()
    idle(page)
    for title in ("Train", "Stability", "Platoon", "Compare", "Snapshots"):
        go(page, title)
        found[title] = violations(page)
    page.emulate_media(color_scheme="light")
    assert {title: wrong for title, wrong in found.items() if wrong} == {}
