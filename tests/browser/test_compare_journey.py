"""All methods on one window, in a real browser."""

import pytest
from playwright.sync_api import expect

from tests.browser.conftest import Open
from tests.browser.running import idle

pytestmark = pytest.mark.browser

ALL_METHODS_MS = 100_000
"""They take some 5 s for four followers and a minute, longer while other tests run."""


def test_methods_run_stop_survive_a_reload_and_are_held_against_earlier_ones(opened: Open) -> None:
    page = opened("/Compare")
    expect(page.get_by_text("Nothing to compare on yet")).to_be_visible()
    page.get_by_role("link", name="Go to Data").click()
    page.get_by_role("button", name="Open this sample").click()
    expect(page.get_by_text("Preview of the window")).to_be_visible()
    idle(page)
    page.get_by_label("and lasts").fill("60")  # enough to see, and soon done
    page.get_by_label("and lasts").press("Enter")
    expect(page.get_by_test_id("stSidebar")).to_contain_text("Window 0–60 s")
    idle(page)

    page.get_by_role("link", name="Compare").click()
    page.get_by_role("button", name="Run all methods").click()
    page.get_by_role("button", name="Stop", exact=True).click()
    expect(page.get_by_text("Stopped: ")).to_be_visible()
    page.get_by_role("button", name="Run all methods").click()
    expect(page.get_by_text("Identifiability")).to_be_visible(timeout=ALL_METHODS_MS)
    intervals, methods = page.locator("table.figures").first, page.locator("table.figures").nth(1)
    expect(methods.locator("tbody tr")).to_have_count(8)
    expect(methods).to_contain_text("Dual UKF")
    expect(intervals).to_contain_text("90 % interval")
    expect(intervals.locator("tbody tr")).to_have_count(4)
    idle(page)

    page.locator(".st-key-compare_estimates .xy .points path").nth(3).click(force=True)
    expect(page.get_by_text("Splines against the data")).to_be_visible()
    idle(page)

    page.reload()
    expect(page.locator("table.figures").nth(1).locator("tbody tr")).to_have_count(8)
    idle(page)

    page.get_by_role("link", name="Data").click()
    page.get_by_text("Case I", exact=True).click()
    idle(page)
    page.get_by_role("link", name="Compare").click()
    expect(page.get_by_text("Kept from earlier in this session: 8 fits.")).to_be_visible()
    idle(page)
