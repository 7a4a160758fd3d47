"""Results that travel, in real browsers: saved, opened by link, compared, sent, and harmless."""

import re
from pathlib import Path

import pytest
from playwright.sync_api import Page, expect

from accpinn.study.snapshot import load
from accpinn.study.snapshot_library import Library
from tests.browser.conftest import App, Open
from tests.browser.running import (
    ESTIMATES,
    TRAINING_MS,
    chart,
    give,
    go,
    idle,
    open_tab,
    table,
    upload,
)
from tests.support.openacc_files import csv, metadata, platoon
from tests.support.snapshots import small

pytestmark = pytest.mark.browser

NASTY = "<script>alert(1)</script><b>*x*</b>$y$_z_"


def save(page: Page, name: str, note: str = "") -> str:
    """Save the current result and its data from the page Snapshots; its short name."""
    page.get_by_label("Name", exact=True).fill(name)
    page.get_by_label("Note", exact=True).fill(note)
    if not page.get_by_role("checkbox", name="Include the data slice").is_checked():
        page.get_by_text("Include the data slice").click()
    page.get_by_role("button", name="Save", exact=True).click()
    expect(page.get_by_text("Saved as “")).to_be_visible()
    idle(page)
    page.get_by_role("button", name="Share").click()
    link = page.get_by_test_id("stCode").inner_text()
    page.keyboard.press("Escape")
    return re.search("snapshot=([0-9a-f]{16})", link)[1]


def send(page: Page, content: bytes) -> str:
    """Bring a file to the server that was made elsewhere; its short name."""
    name = load(content).id
    page.reload()  # the field of the file before this one goes
    idle(page)
    back, field = page.get_by_role("button", name="All snapshots"), page.locator("[type=file]")
    back.or_(field).first.wait_for(state="attached")
    if back.count():
        back.click()
    give(page, ("sent.accpinn.zip", content))
    expect(page.get_by_text(f"is whole and now kept as {name}")).to_be_visible()
    idle(page)
    return name


def downloaded(page: Page, button: str | re.Pattern[str]) -> tuple[str, bytes]:
    """Name and content of what a button saves."""
    with page.expect_download(timeout=TRAINING_MS) as download:
        page.get_by_role("button", name=button).click()
    return download.value.suggested_filename, Path(download.value.path()).read_bytes()


def harmless(page: Page) -> None:
    """Nothing of the hostile name became a part of the page."""
    assert page.locator(".stApp script").count() == 0
    assert page.locator(".stApp b, .stApp em").filter(has_text="x").count() == 0


def test_of_a_hostile_name_it_is_saved_opened_by_link_elsewhere_sent_back_and_compared(
    opened: Open, app: App, tmp_path: Path
) -> None:
    first = opened("/Data")
    file = f"{NASTY.replace('/', '')}.csv"
    upload(first, (file, csv(platoon(vehicles=2), metadata((NASTY, "Follower")))))
    expect(first.get_by_text("Preview of the window")).to_be_visible()
    expect(first.locator(".vehicle-key").first).to_contain_text(NASTY)
    expect(first.locator("strong").filter(has_text=file).first).to_be_visible()
    first.get_by_role("button", name="Train on this window").click()
    expect(table(first, "Surrogate fit")).to_contain_text(f"1 {NASTY}", timeout=TRAINING_MS)
    parameters = table(first, ESTIMATES).locator("tbody tr").last.inner_text().split("\t")
    go(first, "Snapshots")
    name = save(first, NASTY, "look at τ")
    expect(first.get_by_role("heading", name=NASTY)).to_be_visible()
    first.get_by_role("button", name="Open on every page").click()
    expect(first.get_by_text("Opened: every page now shows this snapshot")).to_be_visible()

    second = opened(f"/Train?snapshot={name}")
    expect(second.get_by_text("its data came with it")).to_be_visible()
    row = table(second, ESTIMATES).locator("tbody tr").last
    assert row.inner_text().split("\t")[1:4] == parameters[1:4]
    for title in ("Home", "Data", "Train", "Stability", "Platoon", "Compare", "Snapshots"):
        go(second, title)
        expect(second).to_have_url(re.compile(f"snapshot={name}"))
        expect(second.get_by_text(NASTY).first).to_be_visible()
        harmless(second)
    expect(second.get_by_text("look at τ")).to_be_visible()
    report = tmp_path / "report.html"
    report.write_bytes(downloaded(second, "Report")[1])
    sent, content = downloaded(second, re.compile("Download$"))
    assert re.fullmatch(r"\w+\.accpinn\.zip", sent)

    expect(second.get_by_role("button", name="Delete")).to_have_count(0)
    second.get_by_role("button", name="All snapshots").click()
    second.get_by_role("button", name="Delete").click()
    expect(second.get_by_text("Deleted: ")).to_be_visible()
    harmless(second)
    give(second, ("sent.accpinn.zip", content[:-40] + bytes(40)))
    expect(second.get_by_text("get the file anew")).to_be_visible()
    idle(second)
    Library(app.snapshots).add(small())
    assert send(second, content) == name

    open_tab(second, "Beside another")
    expect(second.get_by_text("What differs")).to_be_visible()
    chart(second, "snapshots_bode")
    second.goto(report.as_uri())
    expect(second.locator("h1")).to_have_text(NASTY)
