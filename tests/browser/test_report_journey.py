"""The report in a real browser without network: drawn, both themes, harmless, printable."""

import re
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import pytest
from playwright.sync_api import Browser, Page

from accpinn.results.report import render_report
from accpinn.study.result import Result
from tests.browser.running import watched
from tests.support.snapshots import whole

Show = Callable[..., Page]
NAME = "</script><script>alert(1)</script>"


@pytest.fixture
def shown(browser: Browser, tmp_path: Path) -> Iterator[Show]:
    """Opens a snapshot's report from disk, with no network at all."""
    pages: list[Page] = []
    faults: list[list[str]] = []

    def show(snapshot: Result, theme: str = "light") -> Page:
        place = tmp_path / "report.html"
        place.write_text(render_report(snapshot), encoding="utf-8")
        page = browser.new_page(
            viewport={"width": 1000, "height": 800}, color_scheme=theme, offline=True
        )
        pages.append(page)
        faults.append(found := watched(page))
        page.on("request", lambda made: found.append(made.url) if "http" in made.url[:4] else None)
        page.goto(place.as_uri())
        page.locator("html[data-drawn]").wait_for()
        return page

    yield show
    for page in pages:
        page.close()
    assert [fault for found in faults for fault in found] == []


def background(page: Page) -> str:
    return page.evaluate("getComputedStyle(document.body).backgroundColor")


def test_of_a_hostile_name_it_is_drawn_in_both_themes_printed_saved_and_fits_a_narrow_screen(
    shown: Show, tmp_path: Path
) -> None:
    infos = (replace(whole().info, names=(NAME,) * 5),)
    page = shown(replace(whole(), name=NAME, note=NAME, infos=infos), "dark")
    plots = page.locator(".plot")
    count = plots.count()
    assert count >= 12
    for k in range(count):
        assert plots.nth(k).locator(".main-svg path").count() > 3, f"figure {k} is empty"
    assert background(page) == "rgb(16, 22, 29)"
    assert page.locator("h1").inner_text() == NAME
    assert page.locator("script:not([type])").count() == 2
    assert page.locator("dd", has_text=NAME).count() >= 2

    content = page.pdf(prefer_css_page_size=True)
    assert len(re.findall(rb"/Type\s*/Page\b", content)) >= 5
    assert re.search(rb"/MediaBox\s*\[\s*0 0 594\.\d+ 841\.\d+", content), "A4"

    page.get_by_role("button", name="Light").click()
    assert background(page) == "rgb(255, 255, 255)"
    ink = page.locator(".plot .xtitle").first.evaluate("text => getComputedStyle(text).fill")
    assert ink == "rgb(27, 39, 51)"
    with page.expect_download() as download:
        page.get_by_role("button", name="SVG").first.click()
    assert Path(download.value.path()).read_bytes().startswith(b"<svg")
    with page.expect_download() as download:
        page.get_by_role("link", name="CSV").first.click()
    assert "time_gap_at_100_kmh_s,time_gap_at_100_kmh_s_low" in Path(
        download.value.path()
    ).read_text(encoding="utf-8")
    with page.expect_download() as download:
        page.get_by_role("link", name="CSV").nth(1).click()
    assert "closed_loop_simulation_mae" in Path(download.value.path()).read_text(encoding="utf-8")
    with page.expect_download() as download:
        page.get_by_role("button", name="HTML").first.click()
    alone = tmp_path / download.value.suggested_filename
    download.value.save_as(alone)

    page.set_viewport_size({"width": 400, "height": 800})
    page.reload()
    page.locator("html[data-drawn]").wait_for()
    assert page.locator(".plot .main-svg").first.evaluate("drawn => drawn.clientWidth") < 400
    assert page.evaluate("document.documentElement.scrollWidth") <= 400

    page.goto(alone.as_uri())
    assert page.locator(".main-svg path").count() > 3
    assert page.locator("script").count() == 2
