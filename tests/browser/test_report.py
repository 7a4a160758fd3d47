"""The report in a real browser without network: drawn, both themes, harmless, printable."""

import re
from dataclasses import replace
from pathlib import Path

import pytest
from playwright.sync_api import Browser

from accpinn.results.report import render_report
from tests.browser.running import downloaded, watched
from tests.support.snapshots import whole

pytestmark = pytest.mark.browser


def test_a_report_of_a_hostile_name_is_drawn_in_both_themes_printed_saved_and_fits_a_narrow_screen(
    browser: Browser, tmp_path: Path
) -> None:
    hostile = "</script><script>alert(1)</script>"
    infos = (replace(whole().info, names=(hostile,) * 5),)
    result = replace(whole(), name=hostile, note=hostile, infos=infos)
    place, alone = tmp_path / "report.html", tmp_path / "alone.html"
    place.write_text(render_report(result), encoding="utf-8")
    page = browser.new_page(
        viewport={"width": 400, "height": 800}, color_scheme="dark", offline=True
    )
    faults = watched(page)
    page.on("request", lambda made: faults.append(made.url) if "http" in made.url[:4] else None)
    page.goto(place.as_uri())
    page.locator("html[data-drawn]").wait_for()
    assert page.locator(".plot .main-svg").first.evaluate("drawn => drawn.clientWidth") < 400
    assert page.evaluate("document.documentElement.scrollWidth") <= 400
    cut = "of => of.filter(box => box.scrollWidth > box.clientWidth + 1).length"
    assert page.locator("figure.figures > div").evaluate_all(cut) == 0, "no column is cut off"
    plots = page.locator(".plot")
    count = plots.count()
    assert count >= 12
    for k in range(count):
        assert plots.nth(k).locator(".main-svg path").count() > 3, f"figure {k} is empty"

    def background() -> str:
        return page.evaluate("getComputedStyle(document.body).backgroundColor")

    assert background() == "rgb(16, 22, 29)"
    assert page.locator("h1").inner_text() == hostile
    assert page.locator("script:not([type])").count() == 2
    assert page.locator("dd", has_text=hostile).count() >= 2
    printed = page.pdf(prefer_css_page_size=True)
    assert len(re.findall(rb"/Type\s*/Page\b", printed)) >= 5
    assert re.search(rb"/MediaBox\s*\[\s*0 0 594\.\d+ 841\.\d+", printed), "A4"

    page.get_by_role("button", name="Light").click()
    assert background() == "rgb(255, 255, 255)"
    ink = page.locator(".plot .xtitle").first.evaluate("text => getComputedStyle(text).fill")
    assert ink == "rgb(27, 39, 51)"
    button, link = (page.get_by_role(role) for role in ("button", "link"))
    assert downloaded(page, button.filter(has_text="SVG").first)[1].startswith(b"<svg")
    table = downloaded(page, link.filter(has_text="CSV").first)[1].decode()
    header = table.splitlines()[0]
    assert header.index("time_gap_at_50_kmh_s,") < header.index("time_gap_at_100_kmh_s,")
    alone.write_bytes(downloaded(page, button.filter(has_text="HTML").first)[1])

    page.goto(alone.as_uri())
    assert page.locator(".main-svg path").count() > 3
    assert page.locator("script").count() == 2
    page.close()
    assert faults == []
