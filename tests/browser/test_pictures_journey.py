"""A chart leaves the page as a picture, in the format that the user chose."""

from pathlib import Path

from playwright.sync_api import Page

from tests.browser.conftest import Open
from tests.browser.running import idle


def saved(page: Page, chart: str) -> tuple[str, bytes]:
    """Name and content of what the chart's one button saves."""
    drawn = page.locator(f".st-key-{chart} .js-plotly-plot")
    drawn.hover()
    with page.expect_download() as download:
        drawn.locator(".modebar-btn").click()
    return download.value.suggested_filename, Path(download.value.path()).read_bytes()


def test_a_chart_is_saved_as_svg_and_as_png(opened: Open) -> None:
    page = opened("/Stability")
    page.locator(".st-key-stability_map .js-plotly-plot").wait_for()
    name, content = saved(page, "stability_map")
    assert name == "accpinn_stability_map.svg"
    assert content.startswith(b"<svg")
    assert "time headway" in content.decode()
    page.get_by_test_id("stSidebar").get_by_text("PNG", exact=True).click()
    for _ in range(10):  # nothing tells when the chart has heard of the choice
        idle(page)
        name, content = saved(page, "stability_map")
        if name.endswith("png"):
            break
    assert name == "accpinn_stability_map.png"
    assert content.startswith(b"\x89PNG")
