"""Results that travel, in real browsers: saved, opened by link, compared, sent, and harmless."""

import re
from dataclasses import replace
from pathlib import Path

import pytest
from playwright.sync_api import Download, Locator, Page, expect

from accpinn.results.snapshot import Snapshot
from accpinn.results.snapshot.archive import load, to_bytes
from tests.browser.conftest import Open
from tests.browser.running import idle
from tests.support.openacc_files import csv, metadata, platoon
from tests.support.snapshots import whole

pytestmark = pytest.mark.browser

TRAINING_MS = 90_000
"""How long a fast training may take on a machine that has more to do."""
NASTY = "<script>alert(1)</script>"


def trained(page: Page) -> None:
    """The first sample's result, from Home at one click."""
    page.get_by_role("button", name="Train a sample now").click()
    expect(table(page, "Surrogate fit")).to_be_visible(timeout=TRAINING_MS)
    idle(page)


def go(page: Page, title: str) -> None:
    page.get_by_test_id("stSidebar").get_by_role("link", name=title).click()
    idle(page)


def table(page: Page, containing: str) -> Locator:
    return page.locator("table.figures").filter(has_text=containing).first


def save(page: Page, name: str, note: str = "", with_data: bool = False) -> str:
    """Save the current result from the page Snapshots; its short name."""
    page.get_by_label("Name", exact=True).fill(name)
    page.get_by_label("Note", exact=True).fill(note)
    if with_data:
        page.get_by_text("Include the data slice").click()
    page.get_by_role("button", name="Save", exact=True).click()
    expect(page.get_by_text("Saved as “")).to_be_visible()
    idle(page)
    link = page.get_by_test_id("stCode").inner_text()
    return re.search("snapshot=([0-9a-f]{16})", link)[1]  # type: ignore[index]


def upload(page: Page, content: bytes) -> None:
    file = {"name": "sent.accpinn.zip", "mimeType": "application/zip", "buffer": content}
    page.locator('input[type="file"]').set_input_files(file)  # type: ignore[arg-type]


def send(page: Page, snapshot: Snapshot) -> str:
    """Bring a file to the server that was made elsewhere; its short name."""
    content = to_bytes(snapshot)
    name = load(content).id
    upload(page, content)
    expect(page.get_by_text(f"is whole and now in the list as {name}")).to_be_visible()
    idle(page)
    return name


def downloaded(page: Page, button: str | re.Pattern[str]) -> Download:
    with page.expect_download(timeout=TRAINING_MS) as download:
        page.get_by_role("button", name=button).click()
    return download.value


def test_two_are_compared(opened: Open) -> None:
    page = opened("/Snapshots")
    longer = replace(whole().fit, iterations=60, config=whole().fit.config | {"iterations": 60})
    send(page, replace(whole(), name="the first"))
    send(page, replace(whole(), name="with more iterations", fit=longer))
    page.get_by_text("Show both side by side").click()
    differing = table(page, "Setting").locator("tbody tr").filter(has_text="iterations")
    expect(differing).to_have_text([re.compile("done.*60.*20"), re.compile("iterations.*60.*20")])
    expect(page.locator(".js-plotly-plot .main-svg path").first).to_be_attached()


def test_saved_opened_by_link_elsewhere_and_sent_back(opened: Open) -> None:
    first = opened("")
    trained(first)
    parameters = table(first, "Surrogate fit").locator("tbody tr").nth(1).inner_text().split("\t")
    go(first, "Snapshots")
    name = save(first, "For Anna", "look at τ", with_data=True)
    expect(first.locator("code").filter(has_text=f"?snapshot={name}")).to_be_visible()

    second = opened(f"/Train?snapshot={name}")
    expect(second.get_by_text("its data came with it")).to_be_visible()
    row = table(second, "Surrogate fit").locator("tbody tr").nth(1)
    assert row.inner_text().split("\t")[1:4] == parameters[1:4]
    expect(second.locator(".js-plotly-plot")).to_have_count(5)
    for title in ("Data", "Stability", "Compare"):
        go(second, title)
        expect(second).to_have_url(re.compile(f"snapshot={name}"))
        expect(second.get_by_text("For Anna").first).to_be_visible()

    go(second, "Snapshots")
    expect(second.get_by_text("look at τ")).to_be_visible()
    page = Path(downloaded(second, "Report").path()).read_text(encoding="utf-8")
    assert "For Anna" in page
    file = downloaded(second, re.compile("Download"))
    assert file.suggested_filename == "For_Anna.accpinn.zip"
    content = Path(file.path()).read_bytes()

    second.get_by_role("button", name="Delete").click()
    second.get_by_role("button", name="Yes, delete it").click()
    expect(second.get_by_text("Deleted: For Anna")).to_be_visible()
    upload(second, content[:-40] + bytes(40))
    expect(second.get_by_text("get the file anew")).to_be_visible()
    idle(second)
    upload(second, content)
    expect(second.get_by_text(f"is whole and now in the list as {name}")).to_be_visible()
    idle(second)


def test_a_hostile_name_does_nothing_on_any_page_or_in_the_report(
    opened: Open, tmp_path: Path
) -> None:
    page = opened("/Data")
    page.on("dialog", lambda dialog: pytest.fail("a script ran"))
    raw = csv(platoon(vehicles=2), metadata((NASTY, "Follower")))
    page.get_by_text("Upload", exact=True).click()
    page.locator('input[type="file"]').set_input_files(
        {"name": f"{NASTY.replace('/', '')}.csv", "mimeType": "text/csv", "buffer": raw}
    )
    expect(page.get_by_text("Preview of the window")).to_be_visible()
    page.get_by_role("button", name="Train on this window").click()
    expect(table(page, "Surrogate fit")).to_contain_text(NASTY, timeout=TRAINING_MS)
    go(page, "Snapshots")
    save(page, NASTY, NASTY, with_data=True)
    expect(table(page, "Recording")).to_contain_text(NASTY)
    page.locator(".st-key-snapshots_open button").click()
    expect(page.get_by_text("Opened: every page now shows this snapshot")).to_be_visible()
    for title in ("Home", "Data", "Train", "Stability", "Platoon", "Compare", "Snapshots"):
        go(page, title)
    assert page.locator(".stApp script").count() == 0
    report = tmp_path / "report.html"
    report.write_bytes(Path(downloaded(page, "Report").path()).read_bytes())
    page.goto(report.as_uri())
    expect(page.locator("h1")).to_have_text(NASTY)


def test_two_browsers_saving_at_once_lose_nothing(opened: Open) -> None:
    first = opened("/Snapshots")
    address = f"/Snapshots?snapshot={send(first, whole())}"
    pages = {f"browser {k}": opened(address) for k in (1, 2)}
    for name, page in pages.items():
        page.get_by_label("Name", exact=True).fill(name)
    for page in pages.values():
        page.get_by_role("button", name="Save", exact=True).click()
    for page in pages.values():
        expect(page.get_by_text("Saved as “")).to_be_visible()
    first.reload()
    for name in pages:
        expect(table(first, "Recording")).to_contain_text(name)
    idle(first)
