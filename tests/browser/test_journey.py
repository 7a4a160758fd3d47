"""What a person does in a real browser: data, training, comparison; a vehicle and its platoon."""

import re
from pathlib import Path

import numpy as np
import pytest
from playwright.sync_api import Browser, Locator, Page, expect

from accpinn.methods.registry import METHODS
from accpinn.model.registry import FOLLOWING
from tests.browser.conftest import Open
from tests.browser.running import (
    ESTIMATES,
    TRAINING_MS,
    chart,
    choose,
    estimate,
    exceptions,
    fill,
    give,
    go,
    idle,
    number,
    open_example,
    open_sample,
    open_tab,
    rows,
    table,
    upload,
    watched,
)
from tests.support.following import driven
from tests.support.server import ROOT

pytestmark = pytest.mark.browser


def drag(chart: Locator, start: float, end: float) -> None:
    """Mark a stretch of a chart's width, given as shares of it."""
    expect(chart).to_be_visible()
    box = chart.bounding_box()
    mouse, y = chart.page.mouse, box["y"] + box["height"] / 2
    mouse.move(box["x"] + start * box["width"], y)
    mouse.down()
    mouse.move(box["x"] + (start + end) / 2 * box["width"], y, steps=4)
    mouse.move(box["x"] + end * box["width"], y, steps=4)
    mouse.up()


def window(page: Page, shown: str) -> None:
    expect(page.get_by_test_id("stSidebar")).to_contain_text(f"Window {shown} s")
    idle(page)


def test_what_goes_wrong_on_a_page_is_noticed(browser: Browser) -> None:
    """The test of the tests: an exception, an error and a dialog all come to light."""
    page = browser.new_page()
    faults = watched(page)
    page.set_content(
        "<div data-testid='stApp' data-test-script-state='notRunning'>"
        "<p data-testid='stException'>ValueError: no</p></div>"
        "<script>console.error('console'); alert('dialog'); throw Error('uncaught')</script>"
    )
    assert exceptions(page) == ["ValueError: no"]
    with pytest.raises(AssertionError, match="ValueError: no"):
        idle(page)
    page.close()
    assert all(word in " ".join(faults) for word in ("console", "dialog", "uncaught"))


def count_clicks(page: Page) -> None:
    """Count every click from now on, as `clicks` tells."""
    page.evaluate("window.clicks = 0; addEventListener('click', () => window.clicks++, true)")


def clicks(page: Page) -> int:
    """How many there were; a file that is dropped takes none."""
    return int(page.evaluate("window.clicks"))


def test_the_whole_journey_with_a_real_recording(opened: Open, openacc_dir: Path) -> None:
    page = opened()
    count_clicks(page)
    give(page, openacc_dir / "Casale" / "part7.csv")
    expect(page.locator("strong").filter(has_text="part7.csv").first).to_be_visible()
    expect(page.get_by_text("1,523 s at 10 Hz")).to_be_visible()
    expect(page.get_by_text("Samples complete")).to_be_visible()
    page.get_by_text(re.compile("All . windows in car-following")).click()
    page.get_by_role("button", name="Train on this window").click()
    leader, follower = rows(page, ESTIMATES)
    checks = page.get_by_role("button", name="of the method's estimate passed")
    expect(checks).to_be_visible()
    assert clicks(page) <= 3, "from a new session to parameters and their checks, and the drop"
    checks.click()
    for check in ("Converged", "Inside the interval", "Identified", "Residual explained"):
        expect(page.locator("strong").filter(has_text=check)).to_be_visible()
    page.keyboard.press("Escape")
    assert follower[0] == "2 Hyundai"
    alpha, beta, tau = map(estimate, follower[1:4])
    assert alpha == pytest.approx(0.0134, abs=0.0002), "without the bias of the paper's loss"
    assert beta == pytest.approx(0.092, abs=0.0015)
    assert tau == pytest.approx(1.55, abs=0.01)
    assert leader[0] == "1 Rexton"
    assert float(follower[7]) <= 0.10
    assert float(follower[9]) > 5, "the closed-loop error is another thing than the surrogate's"

    go(page, "Data")
    expect(number(page, "Window starts at")).to_have_value("0.0")
    solved = rows(page, "Least-squares estimate")[0]
    assert float(solved[1]) == pytest.approx(0.0105, abs=0.0003)
    go(page, "Train")
    assert rows(page, ESTIMATES)[1] == follower

    open_tab(page, "Export")
    page.get_by_role("button", name="Save the table").click()
    with page.expect_download() as download:
        page.get_by_role("button", name="LaTeX").click()
    text = Path(download.value.path()).read_text(encoding="utf-8")
    assert r"\begin{tabular}" in text
    assert follower[1].replace("\n", " ").replace("–", "--") in text

    go(page, "Data")
    fill(page, "Window starts at", "40")
    window(page, "40–340")
    page.get_by_role("button", name="Suggested: 915").click()
    page.get_by_role("button", name="Take 915").click()
    window(page, "915–1215")
    page.get_by_role("slider").first.press("ArrowLeft")  # the handle at the window's start
    window(page, "914.9–1215")


def test_the_five_starts_of_table_i_from_a_new_session(opened: Open) -> None:
    page = opened()
    count_clicks(page)
    open_tab(page, "Reproduce the paper")
    page.get_by_role("button", name="Five starts on the sample").click()
    expect(page.get_by_text("All 5 trainings end within")).to_be_visible(timeout=TRAINING_MS)
    assert clicks(page) <= 4
    for start in rows(page, "Start (α, β, τ)")[:5]:
        assert float(start[1]) == pytest.approx(0.08, rel=0.02)


def test_dragging_sets_the_window_and_a_corrupt_file_loses_nothing(
    opened: Open, openacc_dir: Path
) -> None:
    page = opened("/Data")
    open_sample(page)
    overview = page.locator(".js-plotly-plot .nsewdrag").first
    drag(overview, 0.25, 0.75)
    start, length = number(page, "Window starts at"), number(page, "and lasts")
    expect(start).not_to_have_value("0.0")
    idle(page)
    assert float(start.input_value()) == pytest.approx(100, abs=2)
    assert float(length.input_value()) == pytest.approx(200, abs=3)
    drag(overview, 0.50, 0.60)  # and again, over a chart that was drawn anew
    expect(length).to_have_value(re.compile(r"^(39|4\d)\."))

    upload(page, openacc_dir / "corrupt" / "ZalaZone_handling_part12_TRUNCATED_NUL.csv")
    expect(page.get_by_text("NUL bytes instead of text")).to_be_visible()
    expect(page.get_by_text("The recording opened before is kept")).to_be_visible()
    expect(page.get_by_text("Preview of the window")).to_be_visible()


def number_in(pattern: str, shown: Locator) -> int:
    found = re.search(pattern, shown.inner_text())
    return int(found[1].replace(",", ""))


def test_a_paper_training_is_watched_stopped_and_continued(opened: Open) -> None:
    page = opened("/Train")  # a direct link works on its own
    expect(page).to_have_url(re.compile(r"session=[\w-]{20,}"))
    go(page, "Home")
    expect(page).to_have_url(re.compile(r"session=[\w-]{20,}"))
    go(page, "Data")
    open_sample(page)
    fill(page, "and lasts", "60")
    window(page, "0–60")
    go(page, "Train")
    page.get_by_text("Paper", exact=True).click()
    page.get_by_role("button", name="Start training").click()
    progress = page.get_by_text(re.compile(r"iteration [1-9][\d,]* of 20,000"))
    expect(progress).to_be_visible()
    expect(page.get_by_text("iterations/s")).to_be_visible()

    page.reload()  # a training outlives its page
    expect(progress).to_be_visible()
    live = page.get_by_test_id("stPlotlyChart")
    expect(live).to_have_count(5)  # the network's curves, too
    page.get_by_role("button", name="Stop training").click()
    expect(page.get_by_text("Stopped by the user")).to_be_visible()

    count = page.get_by_text(re.compile(r"[\d,]+ iterations in")).first
    expect(count).to_be_visible()
    stopped_at = number_in(r"([\d,]+) iterations in", count)
    page.get_by_role("button", name="Continue").click()
    expect(page.get_by_role("button", name="Stop training")).to_be_visible()
    expect(progress).to_be_visible()
    assert number_in(r"iteration ([\d,]+)", progress) >= stopped_at
    page.get_by_role("button", name="Stop training").click()
    expect(page.get_by_text(f"Continued from iteration {stopped_at:,}")).to_be_visible()


def test_methods_run_stop_survive_a_reload_and_are_held_against_earlier_ones(opened: Open) -> None:
    page = opened("/Compare")
    expect(page.get_by_text("Nothing to compare on yet")).to_be_visible()
    page.get_by_role("link", name="Go to Data").click()
    upload(page, ROOT / "sample_data" / "synthetic_paper_study.csv")
    page.get_by_text("Preview of the window").wait_for()
    idle(page)
    fill(page, "and lasts", "40")  # enough to see, and soon done
    window(page, "0–40")

    go(page, "Compare")
    page.get_by_role("button", name="Run all methods").click()
    page.get_by_role("button", name="Stop", exact=True).click()
    expect(page.get_by_text("Stopped: ")).to_be_visible()
    page.get_by_role("button", name="Run all methods").click()
    intervals = table(page, "Maximum likelihood (90")
    expect(intervals).to_be_visible(timeout=TRAINING_MS)
    expect(intervals.locator("tbody tr")).to_have_count(1)
    expect(intervals.locator("tbody tr").last).to_be_in_viewport()  # of the first screen
    dots = chart(page, "compare_estimates").locator(".xy .points path")
    expect(dots).to_have_count(len(METHODS) + 1)  # and the answer
    methods = table(page, "Collides at")
    expect(methods.locator("tbody tr")).to_have_count(len(METHODS))
    expect(methods).to_contain_text("Dual UKF")

    page.reload()
    expect(methods.locator("tbody tr")).to_have_count(len(METHODS))  # the same tab is open
    idle(page)

    go(page, "Data")
    fill(page, "and lasts", "30")
    window(page, "0–30")
    go(page, "Compare")
    expect(
        page.get_by_text(f"Kept from earlier in this session: {len(METHODS)} fits.")
    ).to_be_visible()


# From a learned vehicle to a platoon and back

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
    page.get_by_role("button", name="Charts").click()
    page.get_by_text("PNG", exact=True).click()
    page.keyboard.press("Escape")
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


def test_which_model_does_this_car_follow(opened: Open) -> None:
    """From a table of one's own to the answer and its evidence in four clicks."""
    idm = FOLLOWING["idm"]
    windows = driven(idm, idm.typical[None], 4, 0.05, seconds=400.0)[0]
    values = [windows.time, windows.speeds[:, 0], windows.speeds[:, 1], windows.gaps[:, 0]]
    lines = "".join(f"{t:.1f},{u:.3f},{v:.3f},{p:.3f}\n" for t, u, v, p in np.array(values).T)
    page = opened("/Data")
    upload(page, ("own.csv", f"time,v_lead,v_ego,gap_ego\n{lines}".encode()))
    opened_now = page.get_by_text("Preview of the window")
    mapped = page.get_by_role("button", name="Open with these columns")
    opened_now.or_(mapped).first.wait_for()
    if mapped.count():
        mapped.click()
    opened_now.wait_for()
    idle(page)
    go(page, "Compare")
    page.get_by_text("Car-following models").click()
    page.get_by_role("button", name="Judge 4 models").click()
    expect(page.get_by_text(re.compile("the IDM describes this car best"))).to_be_visible(
        timeout=TRAINING_MS
    )
    expect(chart(page, "models_peak")).to_be_visible()
    assert not exceptions(page)
