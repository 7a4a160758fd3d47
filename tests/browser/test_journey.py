"""What a person does with the app, in a real browser."""

import re
from pathlib import Path

import pytest
from playwright.sync_api import Locator, Page, expect

from tests.browser.conftest import Open
from tests.browser.running import idle
from tests.support.openacc_files import csv, metadata, platoon

pytestmark = pytest.mark.browser

TRAINING_MS = 90_000
"""How long a fast training may take on a machine that has more to do."""


def upload(page: Page, file: Path | dict[str, object]) -> None:
    page.get_by_text("Upload", exact=True).click()
    page.locator('input[type="file"]').set_input_files(file)  # type: ignore[arg-type]


def fill(page: Page, label: str, value: str) -> None:
    page.get_by_label(label).fill(value)
    page.get_by_label(label).press("Enter")


def rows(page: Page, containing: str) -> list[list[str]]:
    """The cells of the first table with that text, row by row."""
    table = page.locator("table.figures").filter(has_text=containing).first
    expect(table).to_be_visible(timeout=TRAINING_MS)
    return [row.locator("td").all_inner_texts() for row in table.locator("tbody tr").all()]


def drag(chart: Locator, start: float, end: float) -> None:
    """Mark a stretch of a chart's width, given as shares of it."""
    expect(chart).to_be_visible()
    box = chart.bounding_box()
    assert box
    mouse, y = chart.page.mouse, box["y"] + box["height"] / 2
    mouse.move(box["x"] + start * box["width"], y)
    mouse.down()
    mouse.move(box["x"] + (start + end) / 2 * box["width"], y, steps=4)
    mouse.move(box["x"] + end * box["width"], y, steps=4)
    mouse.up()


def test_one_click_from_home_to_a_trained_sample(opened: Open) -> None:
    page = opened("")
    page.get_by_role("button", name="Train a sample now").click()
    first = rows(page, "Surrogate fit")[1]
    assert first[0] == "2 Audi(A6-like)"
    assert float(first[1]) == pytest.approx(0.0612, rel=0.03)
    assert float(first[3]) == pytest.approx(1.19, rel=0.01)
    expect(page.locator(".js-plotly-plot")).to_have_count(5)


def test_the_whole_journey_with_a_real_recording(opened: Open, casale: Path) -> None:
    page = opened("")
    page.get_by_role("link", name="Load your own OpenACC recording").click()
    upload(page, casale)
    expect(page.locator("strong").filter(has_text="part7.csv").first).to_be_visible()
    expect(page.get_by_text("1,523 s at 10 Hz")).to_be_visible()

    fill(page, "Window starts at", "40")
    expect(page.get_by_test_id("stSidebar")).to_contain_text("Window 40–340 s")
    fill(page, "Window starts at", "0")
    expect(page.get_by_test_id("stSidebar")).to_contain_text("Window 0–300 s")
    idle(page)
    estimate = rows(page, "Least-squares estimate")[0]
    assert float(estimate[1]) == pytest.approx(0.0105, abs=0.0003)

    page.get_by_role("button", name="Train on this window").click()
    leader, follower = rows(page, "Surrogate fit")
    assert leader[0] == "1 Rexton"
    assert follower[0] == "2 Hyundai"
    alpha, beta, tau, _, gap, _, driven, _ = map(float, follower[1:])
    assert alpha == pytest.approx(0.0104, abs=0.0002)
    assert beta == pytest.approx(0.072, abs=0.0015)
    assert tau == pytest.approx(1.521, abs=0.01)
    assert gap <= 0.10
    assert driven > 5, "the closed-loop error is another thing than the surrogate's"

    page.reload()
    assert rows(page, "Surrogate fit")[1] == follower
    page.get_by_test_id("stSidebar").get_by_role("link", name="Data").click()
    expect(page.get_by_label("Window starts at")).to_have_value("0.0")
    page.get_by_test_id("stSidebar").get_by_role("link", name="Train").click()
    assert rows(page, "Surrogate fit")[1] == follower

    with page.expect_download() as download:
        page.get_by_role("button", name="LaTeX").click()
    text = Path(download.value.path()).read_text(encoding="utf-8")
    assert follower[1] in text
    assert r"\begin{tabular}" in text


def test_dragging_over_the_overview_sets_the_window(opened: Open) -> None:
    page = opened("/Data")
    page.get_by_role("button", name="Open this sample").click()
    chart = page.locator(".js-plotly-plot .nsewdrag").first
    drag(chart, 0.25, 0.75)
    start, length = page.get_by_label("Window starts at"), page.get_by_label("and lasts")
    expect(start).not_to_have_value("0.0")
    idle(page)
    assert float(start.input_value()) == pytest.approx(100, abs=2)
    assert float(length.input_value()) == pytest.approx(200, abs=3)
    drag(chart, 0.50, 0.60)  # and again, over a chart that was drawn anew
    expect(length).to_have_value(re.compile(r"^(39|4\d)\."))


def test_a_paper_training_is_stopped_and_continued(opened: Open) -> None:
    page = opened("/Data")
    page.get_by_role("button", name="Open this sample").click()
    expect(page.get_by_text("Preview of the window")).to_be_visible()
    page.get_by_test_id("stSidebar").get_by_role("link", name="Train").click()
    page.get_by_text("Paper", exact=True).click()
    page.get_by_role("button", name="Start training").click()
    expect(page.get_by_text(re.compile(r"iteration [1-9]\d*0 of 20,000"))).to_be_visible()
    expect(page.get_by_text("iterations/s")).to_be_visible()

    page.reload()  # a training outlives its page
    expect(page.get_by_text(re.compile(r"iteration \d+ of 20,000"))).to_be_visible()
    expect(page.locator(".js-plotly-plot")).to_have_count(4)

    page.get_by_role("button", name="Stop training").click()
    expect(page.get_by_text("Stopped by the user")).to_be_visible()
    count = page.get_by_text(re.compile(r"[\d,]+ iterations in")).first
    expect(count).to_be_visible()
    stopped_at = int(re.search(r"([\d,]+) iterations in", count.inner_text())[1])  # type: ignore[index]
    page.get_by_role("button", name="Continue").click()
    expect(page.get_by_role("button", name="Stop training")).to_be_visible()
    shown = page.get_by_text(re.compile(r"iteration \d+ of 20,000"))
    expect(shown).to_be_visible()
    assert int(re.search(r"iteration (\d+)", shown.inner_text())[1]) >= stopped_at  # type: ignore[index]
    page.get_by_role("button", name="Stop training").click()
    expect(page.get_by_text(f"Continued from iteration {stopped_at}")).to_be_visible()


def test_a_second_browser_waits_for_its_turn_and_is_told(opened: Open) -> None:
    first, second = opened("/Data"), opened("/Data")
    for page in (first, second):
        page.get_by_role("button", name="Open this sample").click()
        fill(page, "Window starts at", "10")  # nobody trained on this window yet
        expect(page.get_by_test_id("stSidebar")).to_contain_text("Window 10–310 s")
        page.get_by_test_id("stSidebar").get_by_role("link", name="Train").click()
    first.get_by_text("Paper", exact=True).click()
    first.get_by_role("button", name="Start training").click()
    expect(first.get_by_text("of 20,000")).to_be_visible()
    second.get_by_role("button", name="Start training").click()
    expect(second.get_by_text(re.compile("yours is next and starts in about"))).to_be_visible()
    first.get_by_role("button", name="Stop training").click()
    rows(second, "Surrogate fit")  # its turn comes by itself


def test_a_name_from_a_file_does_nothing(opened: Open) -> None:
    name = "<script>alert(1)</script><b>*x*</b>$y$_z_"
    page = opened("/Data")
    page.on("dialog", lambda dialog: pytest.fail("a script ran"))
    raw = csv(platoon(vehicles=2), metadata((name, "Follower")))
    upload(page, {"name": "<i>nasty</i>*run*.csv", "mimeType": "text/csv", "buffer": raw})
    expect(page.get_by_text("Preview of the window")).to_be_visible()
    expect(page.locator(".vehicle-key").first).to_contain_text(name)
    expect(page.locator("strong").filter(has_text="*run*.csv").first).to_be_visible()
    page.get_by_role("button", name="Train on this window").click()
    assert rows(page, "Surrogate fit")[0][0] == f"1 {name}"
    assert page.locator(".stApp b, .stApp em").filter(has_text="x").count() == 0


def test_a_corrupt_file_is_refused_and_nothing_is_lost(opened: Open, openacc_dir: Path) -> None:
    page = opened("/Data")
    page.get_by_role("button", name="Open this sample").click()
    expect(page.get_by_text("Preview of the window")).to_be_visible()
    page.get_by_text("Open another recording").click()
    upload(page, openacc_dir / "corrupt" / "ZalaZone_handling_part12_TRUNCATED_NUL.csv")
    expect(page.get_by_text("NUL bytes instead of text")).to_be_visible()
    expect(page.get_by_text("The recording opened before is kept")).to_be_visible()
    expect(page.get_by_text("Preview of the window")).to_be_visible()


@pytest.mark.parametrize("path", ["/Data", "/Train"])
def test_a_direct_link_works_on_its_own(opened: Open, path: str) -> None:
    page = opened(path)
    expect(page).to_have_url(re.compile(r"session=[\w-]{20,}"))
    page.get_by_test_id("stSidebar").get_by_role("link", name="Home").click()
    expect(page.get_by_role("button", name="Train a sample now")).to_be_visible()
    expect(page).to_have_url(re.compile(r"session=[\w-]{20,}"))
