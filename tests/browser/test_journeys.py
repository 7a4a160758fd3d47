"""What people do in a real browser, from a file to a result that travels; one journey a test."""

import re
import shutil
from html import escape
from pathlib import Path
from typing import Any

import pandas as pd
import pytest
from axe_playwright_python.sync_playwright import Axe
from playwright.sync_api import Browser, Locator, Page, expect

from accpinn.methods.registry import COMPARED
from tests.browser.conftest import App, Open
from tests.browser.running import (
    ESTIMATES,
    TRAINING_MS,
    button,
    chart,
    choose,
    crowded,
    downloaded,
    estimate,
    exceptions,
    fill,
    give,
    go,
    idle,
    number,
    open_tab,
    rows,
    table,
    upload,
    watched,
    words,
)
from tests.browser.test_words import FOLD, PAGE
from tests.support import own_tables
from tests.support.openacc_files import csv, metadata, platoon
from tests.support.samples import FOLDER, frame
from tests.support.studies import row, write_study

pytestmark = pytest.mark.browser


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


# Every page: also for those who cannot see it as it is drawn, or not all of it

LIVE_NETWORK = """() => [...document.querySelectorAll('.st-key-train_live_curves *')]
    .filter(chart => chart.data?.some?.(line => line.name === 'network'))
    .map(chart => chart.getBoundingClientRect())
    .find(box => box.height)"""
"""Where the network's curves are on the page while it trains."""
SERIOUS = ("serious", "critical")
TALLEST = 2400
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
NASTY = "<script>alert(1)</script><b>*x*</b>$y$_z_"


AXE = """options => axe.run(
    {exclude: ['.main-svg']}, {...options, resultTypes: ['violations'], elementRef: false}
).then(found => found.violations)"""
"""Of the drawings inside charts it knows no colour, and a chart's other tests judge them."""


def violations(page: Page, **options: Any) -> list[str]:
    """What axe-core calls serious or critical: rule, element and reason."""
    if not page.evaluate("'axe' in window"):
        page.evaluate(Axe().axe_script)
    return [
        f"{found['id']}: {node['target']} {node['failureSummary']}"
        for found in page.evaluate(AXE, options)
        if found["impact"] in SERIOUS
        for node in found["nodes"]
    ]


def cut_off(page: Page) -> list[str]:
    """Controls that stand out of a page's sides on a telephone; a row of tabs scrolls."""
    page.set_viewport_size({"width": 420, "height": 900})
    found = page.get_by_test_id("stMain").evaluate(OUTSIDE) + crowded(page)
    page.set_viewport_size({"width": 1440, "height": 1000})
    return found


def look(page: Page) -> None:
    """The page has no serious violation in either theme, is not too tall, cut off or scripted.

    It is left in the other theme, as a theme takes long to change.
    """
    idle(page)
    assert page.get_by_test_id("stMainBlockContainer").bounding_box()["height"] <= TALLEST
    found = violations(page) + crowded(page)
    is_dark = page.evaluate("matchMedia('(prefers-color-scheme: dark)').matches")
    page.emulate_media(color_scheme="light" if is_dark else "dark")
    # Of the other theme the colours alone are others.
    found += [*violations(page, runOnly=["color-contrast"]), *cut_off(page)]
    assert found == [], page.url
    assert page.locator(".stApp script").count() == 0
    assert page.locator(".stApp b, .stApp em").filter(has_text="x").count() == 0


def test_a_result_of_a_hostile_name_is_saved_opened_by_link_on_every_page_and_sent_back(
    opened: Open, app: App
) -> None:
    makes = (row(f"Make {k}", file="a.csv", start=0.0, duration=60.0, sha256="0") for k in range(9))
    write_study(app.studies / "nine makes", *makes)
    three = pd.read_csv(FOLDER / "synthetic_astazero_like.csv", skiprows=5, nrows=900)  # soon done
    columns = ["Time", "Speed1", "Speed2", "Speed3", "IVS1", "IVS2"]
    names = (f"Audi({NASTY})", "Audi(A6-like)", "Tesla(Model3-like)")
    sample = csv(three[columns], metadata(names))
    file = f"{NASTY.replace('/', '')}.csv"
    first = opened()
    look(first)
    give(first, (file, sample))
    expect(first.get_by_text("Preview of the window")).to_be_visible()
    expect(first.locator("strong").filter(has_text=file).first).to_be_visible()
    button(first, re.compile("Train on ")).click()
    learned, *_ = rows(first, ESTIMATES)
    assert learned[0] == "2 Audi (A6-like)"
    assert estimate(learned[2]) == pytest.approx(1.19, rel=0.03)
    assert estimate(learned[4]) == pytest.approx(0.0612, rel=0.05)
    open_tab(first, "Export")
    sent, content = downloaded(first, button(first, "Download all"))  # of what is not saved yet
    assert sent.endswith("_accpinn.zip")
    assert content.startswith(b"PK")
    go(first, "Snapshots")
    first.get_by_label("Name", exact=True).fill(NASTY)
    first.get_by_label("Note", exact=True).fill("look at τ")
    button(first, "Save", exact=True).click()
    expect(first.get_by_text("Saved as “")).to_be_visible()
    idle(first)
    button(first, "Share").click()
    name = re.search("snapshot=([0-9a-f]{16})", first.get_by_test_id("stCode").inner_text())[1]

    page = opened(f"/Train?snapshot={name}")
    expect(page.get_by_text("data came with it")).to_be_visible()
    assert rows(page, ESTIMATES)[0] == learned
    look(page)
    open_tab(page, "Training")
    expect(page.locator(".js-plotly-plot")).to_have_count(3)
    button(page, "Next: string stability").click()
    expect(page.locator(".strip-mark.unstable[data-name=L₂]")).to_have_count(2)
    expect(page.locator("table.figures").first).to_contain_text("Tesla (Model3-like)")
    look(page)
    for title in ("Data", "Compare", "Database", "Platoon"):
        go(page, title)
        expect(page).to_have_url(re.compile(f"snapshot={name}"))
        look(page)
    choose(page, "Disturbance", "As recorded")
    expect(page.locator(".vehicle-key")).to_contain_text("recorded")
    expect(page.locator(".vehicle-key")).to_contain_text("3 Tesla (Model3-like)")
    go(page, "Snapshots")
    expect(page.get_by_role("heading", name=NASTY)).to_be_visible()
    expect(page.get_by_text("look at τ")).to_be_visible()
    look(page)
    button(page, "Report").click()
    report = downloaded(page, button(page, "Download the report"))[1].decode()
    page.keyboard.press("Escape")
    assert f"<h1>{escape(NASTY)}</h1>" in report
    sent, content = downloaded(page, button(page, re.compile("Download$")))
    assert re.fullmatch(r"\w+\.accpinn\.zip", sent)

    expect(button(page, "Delete")).to_have_count(0)
    button(page, "All snapshots").click()
    button(page, "Delete").click()
    expect(page.get_by_text("Deleted: ")).to_be_visible()
    look(page)
    give(page, ("sent.accpinn.zip", content))
    expect(page.get_by_text(f"is whole and now kept as {name}")).to_be_visible()


# A recording, its window and its parameters


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


def test_a_real_recording_is_dropped_trained_on_and_its_window_moved(
    opened: Open, openacc_dir: Path
) -> None:
    page = opened()
    page.evaluate("window.clicks = 0; addEventListener('click', () => window.clicks++, true)")
    give(page, openacc_dir / "Casale" / "part7.csv")
    expect(page.locator("strong").filter(has_text="part7.csv").first).to_be_visible()
    expect(page.get_by_text("1,523 s at 10 Hz")).to_be_visible()
    expect(page.get_by_text("Samples measured")).to_be_visible()
    page.get_by_text("One window", exact=True).click()
    expect(page.get_by_text("Samples complete")).to_be_visible()
    button(page, "Train on this window").click()
    (follower,) = rows(page, ESTIMATES)
    checks = button(page, re.compile("checks failed|All checks passed"))
    expect(checks).to_be_visible()
    assert page.evaluate("window.clicks") <= 3, "to parameters and their checks, and the drop"
    assert follower[0] == "2 Hyundai"
    alpha, beta, tau = map(estimate, follower[4:7])
    assert alpha == pytest.approx(0.0119, abs=0.0002), "without the bias of the paper's loss"
    assert beta == pytest.approx(0.1005, abs=0.0015)
    assert tau == pytest.approx(1.39, abs=0.01), "with s₀ and a delay"

    go(page, "Data")
    expect(number(page, "Window starts at")).to_have_value("0.0")
    solved = rows(page, "Least-squares estimate")[0]
    assert float(solved[1]) == pytest.approx(0.0105, abs=0.0003)
    fill(page, "Window starts at", "40")
    window(page, "40–340")
    button(page, "Suggested: 915").click()
    button(page, "Take 915").click()
    window(page, "915–1215")
    page.get_by_role("slider").first.press("ArrowLeft")  # the handle at the window's start
    window(page, "914.9–1215")


def test_an_address_in_a_name_is_no_link(opened: Open) -> None:
    page = opened("/Data")
    named = "www.evil.org me@evil.org"
    rows = platoon(2, 600), metadata((named, f"see http://evil.org/x {named}"))
    upload(page, (f"{named}.csv", csv(*rows)))
    page.get_by_text("Preview of the window").wait_for()
    for title in ("Data", "Train", "Home"):
        go(page, title)
        idle(page)
        expect(page.get_by_text("evil.org").first).to_be_visible()
        expect(page.locator("a[href*=evil]")).to_have_count(0)


def test_the_network_bends_into_the_data_on_the_first_screen_while_it_trains(
    opened: Open,
) -> None:
    page = opened("/Data")
    button(page, "Open this sample").click()
    button(page, re.compile("Train on ")).wait_for()
    go(page, "Train")
    page.get_by_text("Paper", exact=True).click()
    idle(page)
    live = page.locator(".st-key-train_live_curves .js-plotly-plot")
    expect(live).to_have_count(1)
    button(page, "Start training").click()
    box = page.wait_for_function(LIVE_NETWORK).json_value()
    expect(page.get_by_text(re.compile(r"Adam · iteration .* left"))).to_be_visible()
    assert box["bottom"] < 1000
    assert box["width"] > 0.5 * page.get_by_test_id("stMainBlockContainer").bounding_box()["width"]
    assert len(words(page, is_fold=True)) <= FOLD
    assert len(words(page)) <= PAGE
    button(page, "Stop training").click()
    button(page, re.compile("Continue from")).wait_for(timeout=TRAINING_MS)


def test_a_window_is_dragged_twice_and_all_methods_on_it_run_stop_and_survive_a_reload(
    opened: Open,
) -> None:
    page = opened("/Data")
    upload(page, FOLDER / "synthetic_paper_study.csv")
    page.get_by_text("Preview of the window").wait_for()
    idle(page)
    overview = page.locator(".js-plotly-plot .nsewdrag").first
    drag(overview, 0.25, 0.75)
    start, length = number(page, "Window starts at"), number(page, "and lasts")
    expect(start).not_to_have_value("0.0")
    idle(page)
    assert float(start.input_value()) == pytest.approx(75, abs=2)
    assert float(length.input_value()) == pytest.approx(150, abs=3)
    drag(overview, 0.50, 0.63)  # and again, over a chart that was drawn anew
    expect(length).to_have_value(re.compile(r"^(3[6-9]|4[0-2])\."))  # enough to see, and soon done
    idle(page)
    go(page, "Compare")
    button(page, "Run all methods").click()
    button(page, "Stop", exact=True).click()
    expect(page.get_by_text("Stopped: ")).to_be_visible()
    button(page, "Run all methods").click()
    methods = table(page, "Inside the interval")
    expect(page.get_by_text("with the recommended estimate")).to_be_visible(timeout=TRAINING_MS)
    estimates = chart(page, "compare_estimates")
    expect(estimates).to_be_in_viewport()  # of the first screen
    dots = estimates.locator(".xy .points path")
    expect(dots).to_have_count(len(COMPARED))
    page.reload()
    expect(methods.locator("tbody tr")).to_have_count(len(COMPARED))  # the same tab is open
    expect(methods).to_contain_text("Dual UKF")


# Vehicles and platoons

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


def test_a_click_on_the_response_drives_a_platoon_and_values_by_hand_are_typed(
    opened: Open,
) -> None:
    page = opened("/Stability")
    button(page, "Open a published example").click()
    expect(page.get_by_text("necessary but not sufficient").first).to_be_visible()
    bode = chart(page, "stability_bode")
    bode.scroll_into_view_if_needed()
    at = bode.evaluate(CURVE)
    page.mouse.move(*at)
    label = bode.locator(".hoverlayer")
    expect(label).to_contain_text("BMW X5")
    shown = re.search(r"dB at ([\d.]+) rad/s", label.text_content() or "")
    page.mouse.click(*at)

    expect(page.get_by_role("combobox", name="Platoon")).to_have_value("8 × BMW X5")
    slider = page.get_by_role("slider", name="Frequency of the leader's speed")
    expect(slider).to_have_attribute("aria-valuetext", re.compile(rf"^{shown[1][:4]}.* rad/s"))
    button(page, "Next: platoon").click()
    expect(page).to_have_url(re.compile(r"/Platoon\?session="))
    frequency = number(page, "Frequency")
    expect(frequency).to_have_value(re.compile(rf"^{shown[1][:4]}"))
    assert float(frequency.input_value()) == pytest.approx(float(shown[1]), abs=6e-4)
    expect(page.locator(".vehicle-key").first).to_contain_text("BMW X5:")
    expect(chart(page, "platoon_profiles").locator(".scatterlayer").first).to_be_visible()
    road = page.get_by_role("img", name="The cars on the road")
    road.scroll_into_view_if_needed()
    start = road.get_attribute("data-places") or ""
    assert start.count(",") == 8
    button(page, "Play").click()
    expect(road).not_to_have_attribute("data-places", start)
    button(page, "Pause").click()
    time = page.get_by_role("slider", name="Time in the simulation")
    time.press("End")
    end = float(time.get_attribute("max") or "nan")
    expect(time).to_have_attribute("aria-valuetext", f"{end:.1f} s")

    # Back again, the frequency is not carried a second time.
    go(page, "Stability")
    open_tab(page, "Region")
    expect(page).to_have_url(re.compile(r"/Stability\?session="))
    drawn = chart(page, "stability_map")
    drawn.hover()
    name, content = downloaded(page, drawn.locator(".modebar-btn"))
    assert name == "accpinn_stability_map.svg"
    assert content.startswith(b"<svg")
    assert "time headway" in content.decode()

    choose(page, "Published set", "Ispra-Casale")
    page.get_by_text("By hand").click()
    expect(page.locator(".strip-row", has_text="Hyundai")).to_contain_text("1.49×")
    page.get_by_test_id("stPopover").filter(has_text="Parameters").get_by_role("button").click()
    cells = page.get_by_test_id("stDataFrame").locator("canvas").first
    expect(cells).to_be_visible()
    box = cells.bounding_box()
    page.mouse.dblclick(box["x"] + 0.46 * box["width"], box["y"] + 52)
    cell = page.locator(".gdg-input")
    expect(cell).to_have_value("0.0718")
    cell.fill("1.5")
    cell.press("Enter")
    expect(page.locator(".strip-mark.stable[data-name=L₂]")).to_be_visible()


def test_a_table_of_ones_own_gets_from_home_to_a_result_in_two_clicks(opened: Open) -> None:
    page = opened()
    give(page, ("drive.csv", own_tables.iso_with_units()))
    chart(page, "data_beginning")
    look(page)
    button(page, "Open", exact=True).click()
    button(page, re.compile("Train on ")).click()
    (learned,) = rows(page, ESTIMATES)
    alpha, beta, headway = own_tables.LAW
    assert estimate(learned[2]) == pytest.approx(headway, rel=0.03)
    assert estimate(learned[4]) == pytest.approx(alpha, rel=0.1)
    assert estimate(learned[5]) == pytest.approx(beta, rel=0.1)


def test_a_batch_runs_on_without_a_browser_is_filtered_and_a_window_opened(
    opened: Open, app: App
) -> None:
    shutil.rmtree(app.studies, ignore_errors=True)
    folder = app.recordings / "short"
    folder.mkdir(parents=True, exist_ok=True)
    for k, make in enumerate(("Audi(A8)", "Tesla(Model3)")):
        (folder / f"run{k}.csv").write_bytes(csv(frame(620, k), metadata(("Lead", make))))
    page = opened("/Database")
    button(page, "Start your own").click()
    choose(page, "Windows", "60 s")
    fill(page, "Workers", "1")
    idle(page)
    expect(page.get_by_text("2 files: 2 windows")).to_be_visible()
    button(page, "Start the batch").click()
    button(page, "Stop", exact=True).wait_for()
    idle(page)  # what is on the screen is kept once the page has run to its end
    page.reload()
    done = page.get_by_text("Done: 2 files, 2 recordings, 2 windows")
    done.wait_for(timeout=TRAINING_MS)
    expect(page.get_by_text("2 follower windows, 2 vehicles, 2 makes")).to_be_visible()
    idle(page)

    button(page, "Filter").click()
    choose(page, "Make", "Tesla")
    page.keyboard.press("Escape")
    page.keyboard.press("Escape")
    expect(page.get_by_text("1 follower window, 1 vehicle, 1 make")).to_be_visible()
    expect(page).to_have_url(re.compile("make=Tesla"))
    open_tab(page, "All rows")
    page.locator(".dvn-scroller").click(position={"x": 18, "y": 54})
    button(page, "Open this window").click()
    expect(page.get_by_text("Preview of the window")).to_be_visible()
    expect(page.locator("strong").filter(has_text=re.compile("run[13579].csv"))).to_be_visible()
