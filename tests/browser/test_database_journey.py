"""From a folder of recordings to a table of makes and back to one window, in a real browser."""

import re
import shutil

import pytest
from playwright.sync_api import expect

from accpinn.recordings.catalogue import catalogue
from tests.browser.conftest import App, Open
from tests.browser.running import TRAINING_MS, choose, fill, idle, open_tab
from tests.support.openacc_files import csv, metadata, platoon
from tests.support.publisher import publisher

pytestmark = pytest.mark.browser

FILES = 4


def test_a_batch_is_stopped_continued_filtered_and_a_run_downloaded(opened: Open, app: App) -> None:
    shutil.rmtree(app.studies, ignore_errors=True)
    folder = app.recordings / "short"
    folder.mkdir(parents=True)
    for k in range(FILES):
        make = ("Audi(A8)", "Tesla(Model3)")[k % 2]
        frame = platoon(2, 620) + 0.001 * k
        (folder / f"run{k}.csv").write_bytes(csv(frame, metadata(("Lead", make))))
    page = opened("/Database")
    choose(page, "Windows", "60 s")
    page.locator('[data-baseweb="tag"]', has_text="Maximum likelihood").get_by_role("button").or_(
        page.get_by_role("button", name="Remove Maximum likelihood")
    ).first.click()
    idle(page)
    fill(page, "Workers", "1")
    idle(page)
    expect(page.get_by_text(f"{FILES} files: {FILES} windows")).to_be_visible()
    page.get_by_role("button", name="Start the batch").click()
    page.get_by_text(re.compile(r"[1-9] rows? so far")).wait_for(timeout=TRAINING_MS)
    page.get_by_role("button", name="Stop", exact=True).click()
    page.get_by_text("Stopped; what is finished is kept").wait_for(timeout=TRAINING_MS)
    page.get_by_role("button", name="Continue").click()
    page.get_by_role("button", name="Stop", exact=True).wait_for()
    page.reload()  # it runs on without a browser
    done = page.get_by_text(f"Done: {FILES} recordings, {FILES} windows")
    done.wait_for(timeout=TRAINING_MS)
    expect(page.get_by_text(f"{FILES} follower windows of 2 vehicles, 2 makes")).to_be_visible()
    idle(page)

    choose(page, "Make", "Tesla")
    page.keyboard.press("Escape")
    expect(page.get_by_text(f"{FILES // 2} follower windows of 1 vehicle, 1 make")).to_be_visible()
    expect(page).to_have_url(re.compile("make=Tesla"))
    open_tab(page, "All rows")
    page.locator(".dvn-scroller").click(position={"x": 18, "y": 54})
    page.get_by_role("button", name="Open this window").click()
    expect(page.get_by_text("Preview of the window")).to_be_visible()
    expect(page.locator("strong").filter(has_text=re.compile("run[13579].csv"))).to_be_visible()

    run = next(run for run in catalogue() if run.sha256 is None)
    content = csv(platoon(2, 400), metadata(("Lead", "Audi(A8)")))
    with publisher({run.key: content}, app.mirror, {run.key: ["break"]}) as server:
        page.get_by_text("Open another recording").click()
        choose(page, "Published OpenACC run", run.key)
        page.get_by_role("button", name="Download this run").click()
        page.get_by_role("button", name="Open this run").click()
        expect(page.locator("strong").filter(has_text=run.file)).to_be_visible()
    assert len(server.requests) == 2, "the first one broke off"
    idle(page)
