"""From a learned vehicle to a platoon and back, in a real browser."""

import re
from pathlib import Path

import pytest
from playwright.sync_api import Locator, Page, expect

from tests.browser.conftest import Open
from tests.browser.running import chart, choose, go, idle, open_example, open_tab

pytestmark = pytest.mark.browser

CURVE = """
(chart) => {
  // Where on the screen the second vehicle's curve has its 200th point.
  const axes = chart._fullLayout, box = chart.getBoundingClientRect();
  const point = chart.calcdata[1][200];
  return [
    box.left + axes.xaxis._offset + axes.xaxis.c2p(point.x),
    box.top + axes.yaxis._offset + axes.yaxis.c2p(point.y),
  ];
}
"""


def frequency(page: Page) -> Locator:
    return page.get_by_role("spinbutton", name="Frequency")


def test_a_click_on_the_response_carries_its_frequency_to_the_platoon(opened: Open) -> None:
    page = opened("/Stability")
    open_example(page)
    expect(page.get_by_text("All four vehicles amplify disturbances")).to_be_visible()
    expect(page.get_by_text("necessary but not sufficient").first).to_be_visible()
    bode = chart(page, "stability_bode")
    bode.scroll_into_view_if_needed()
    at = bode.evaluate(CURVE)
    page.mouse.move(*at)
    label = bode.locator(".hoverlayer")
    expect(label).to_contain_text("BMW X5")
    shown = re.search(r"dB at ([\d.]+) rad/s", label.text_content() or "")
    page.mouse.click(*at)

    expect(page).to_have_url(re.compile(r"/Platoon\?session="))
    expect(frequency(page)).to_have_value(re.compile(rf"^{shown[1][:4]}"))
    carried = frequency(page).input_value()
    assert float(carried) == pytest.approx(float(shown[1]), abs=6e-4)
    expect(page.locator(".vehicle-key").first).to_contain_text("Follower 8: BMW X5")
    expect(chart(page, "platoon_profiles").locator(".scatterlayer").first).to_be_visible()

    # Back again, it is not carried a second time, and the choice stays.
    go(page, "Stability")
    chart(page, "stability_bode")
    expect(page).to_have_url(re.compile(r"/Stability\?session="))
    go(page, "Platoon")
    expect(frequency(page)).to_have_value(carried)


def test_the_wave_plays_and_can_be_dragged(opened: Open) -> None:
    page = opened("/Platoon")
    open_example(page)
    chart(page, "platoon_time_space")
    open_tab(page, "Animation")
    wave = chart(page, "platoon_wave")
    wave.scroll_into_view_if_needed()
    moment = wave.locator(".slider-label").first
    before = moment.text_content()
    speeds = "chart => Array.from(chart.data[1].y)"
    start = wave.evaluate(speeds)
    wave.get_by_text("Play").click()
    expect(moment).not_to_have_text(before or "")
    wave.get_by_text("Pause").click()
    assert wave.evaluate(speeds) != start
    rail = wave.locator(".slider-rail-touch-rect")
    box = rail.bounding_box()
    rail.click(position={"x": box["width"] - 3, "y": box["height"] / 2})
    expect(moment).to_have_text("t = 500.0 s")


def saved(page: Page, key: str) -> tuple[str, bytes]:
    """Name and content of what a chart's one button saves."""
    drawn = chart(page, key)
    drawn.hover()
    with page.expect_download() as download:
        drawn.locator(".modebar-btn").click()
    return download.value.suggested_filename, Path(download.value.path()).read_bytes()


def test_a_chart_is_saved_as_svg_and_as_png_and_values_by_hand_are_typed_into_the_table(
    opened: Open,
) -> None:
    page = opened("/Stability")
    open_example(page)
    open_tab(page, "Map")
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

    choose(page, "Published set", "Ispra-Casale")
    page.get_by_text("By hand").click()
    expect(page.get_by_text("Hyundai amplifies disturbances up to 1.49 times")).to_be_visible()
    table = page.get_by_test_id("stDataFrame").locator("canvas").first
    expect(table).to_be_visible()
    box = table.bounding_box()
    page.mouse.dblclick(box["x"] + 0.68 * box["width"], box["y"] + 52)
    cell = page.locator(".gdg-input")
    expect(cell).to_have_value("0.0718")
    cell.fill("1.5")
    cell.press("Enter")
    expect(page.get_by_text("Hyundai does not amplify any frequency")).to_be_visible()
    # What was typed is there on the other page, too.
    go(page, "Platoon")
    expect(page.get_by_text("The oscillation fades to")).to_be_visible()
