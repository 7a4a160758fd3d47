"""All methods on one window, in a real browser."""

import pytest
from playwright.sync_api import expect

from tests.browser.conftest import Open
from tests.browser.running import idle

pytestmark = pytest.mark.browser


def test_all_methods_run_at_a_click_and_survive_a_reload(opened: Open) -> None:
    page = opened("/Compare")
    expect(page.get_by_text("Nothing to compare on yet")).to_be_visible()
    page.get_by_role("link", name="Go to Data").click()
    page.get_by_role("button", name="Open this sample").click()
    expect(page.get_by_text("What this window tells")).to_be_visible()
    idle(page)

    page.get_by_role("link", name="Compare").click()
    page.get_by_role("button", name="Run all methods").click()
    methods = page.locator("table.figures").last
    expect(methods.locator("tbody tr")).to_have_count(8)
    expect(methods).to_contain_text("Dual UKF")
    intervals = page.locator("table.figures").first
    expect(intervals).to_contain_text("90 % intervals")
    expect(intervals.locator("tbody tr")).to_have_count(4)
    idle(page)

    page.reload()
    expect(page.locator("table.figures").last.locator("tbody tr")).to_have_count(8)
    idle(page)
