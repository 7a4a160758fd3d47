"""A browser that looks at the running app, and what journeys and pictures do on its pages."""

import os
import re
import shutil
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from playwright.sync_api import (
    Browser,
    ConsoleMessage,
    Dialog,
    Error,
    Locator,
    Page,
    TimeoutError,
    expect,
    sync_playwright,
)

FLAGS = [
    "--no-sandbox",
    "--disable-gpu",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-quic",
    "--disable-sync",
    "--no-first-run",
]
PROBE = re.compile(r"/\w+/_stcore/(health|host-config)$")
"""On a direct link to a page, Streamlit first asks below that page where the server is."""
OVERTAKEN = re.compile(r"/media/\w+\.(csv|tex|zip|html)$|source error - 404")
"""Streamlit looks up what a download button offers; a page drawn anew meanwhile offers it under a
new name. A button that offered nothing would fail the tests that press it."""
ESTIMATES = "Parameters (90"
"""In the headings of the table with the parameters that were learned."""
PATIENCE_MS = 60_000
"""How long the page may take to show something; the machine may be busy."""
TRIES_MS = (1_000, 2_000, 4_000, 8_000, 16_000, 30_000)
"""How long a list is waited for each time it is opened, until it stays open."""
TRAINING_MS = 180_000
"""How long a fast training, or all methods on a short window, may take then."""


def installed() -> str:
    """The browser to drive: $CHROMIUM, or the first one found on the path; "" if there is none.

    The shell without windows comes first: it draws and runs the same, an eighth faster.
    """
    shells = ("chromium-headless-shell", "chrome-headless-shell")
    names = (os.environ.get("CHROMIUM", ""), *shells, "chromium", "chromium-browser")
    found = (shutil.which(name) for name in (*names, "google-chrome") if name)
    return next((path for path in found if path), "")


@contextmanager
def launched(chromium: str) -> Iterator[Browser]:
    """A browser without a window."""
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=chromium, args=FLAGS)
        try:
            yield browser
        finally:
            browser.close()


def watched(page: Page) -> list[str]:
    """What goes wrong on the page from now on: console errors, uncaught exceptions, dialogs."""
    faults: list[str] = []

    def heard(message: ConsoleMessage) -> None:
        url = message.location.get("url", "")
        harmless = PROBE.search(url) or OVERTAKEN.search(url) or OVERTAKEN.search(message.text)
        if message.type == "error" and not harmless:
            faults.append(f"{message.text} ({url})")

    def caught(fault: Error) -> None:
        faults.append(str(fault))

    def asked(dialog: Dialog) -> None:
        faults.append(f"a script ran: {dialog.message}")
        dialog.dismiss()

    page.on("console", heard)
    page.on("dialog", asked)
    page.on("pageerror", caught)
    page.set_default_timeout(PATIENCE_MS)
    return faults


def exceptions(page: Page) -> list[str]:
    """The exceptions that a page shows in place of its content."""
    return page.get_by_test_id("stException").all_inner_texts()


def idle(page: Page) -> None:
    """Wait until the script has run to its end without an exception and the page stands."""
    page.locator('[data-testid="stApp"][data-test-script-state="notRunning"]').wait_for()
    if shown := exceptions(page):
        raise AssertionError("\n".join(shown))


DRAWN = """!document.querySelector('[data-testid=stSkeleton]')
    && [...document.querySelectorAll('[data-testid=stPlotlyChart]')]
    .every(chart => chart.querySelector('.js-plotly-plot .main-svg'))"""
"""Whether nothing of a page is still to come."""


# What journeys and pictures do on the pages.


WORDS = """isFold => {
  const main = document.querySelector("[data-testid=stMainBlockContainer]");
  const apart = ".js-plotly-plot, svg, style, script, [data-testid=stIconMaterial]";
  const texts = document.createTreeWalker(main, NodeFilter.SHOW_TEXT);
  const words = [];
  for (let text; (text = texts.nextNode());) {
    const place = text.parentElement;
    if (place.closest(apart) || !place.checkVisibility({ visibilityProperty: true })) continue;
    const range = document.createRange();
    range.selectNodeContents(text);
    const box = range.getBoundingClientRect();
    if (!box.width || !box.height || (isFold && box.top >= innerHeight)) continue;
    words.push(...text.data.split(/\\s+/).filter((word) => /[\\p{L}\\p{N}]/u.test(word)));
  }
  return words;
}"""
"""What is read on the main area without its charts: the open tab and cells of tables included."""


def words(page: Page, is_fold: bool = False) -> list[str]:
    """The words and numbers that the page shows, or those that it shows without scrolling."""
    return list(page.evaluate(WORDS, is_fold))


CROWDED = """() => {
  const found = [];
  const meets = (a, b, room) => a.left < b.right + room && b.left < a.right + room
    && a.top < b.bottom + room && b.top < a.bottom + room;
  for (const chart of document.querySelectorAll(".js-plotly-plot")) {
    if (!chart.checkVisibility({ visibilityProperty: true })) continue;
    const key = chart.closest("[class*=st-key-]")?.className.match(/st-key-(\\S+)/)?.[1];
    const frame = chart.querySelector(".main-svg").getBoundingClientRect();
    if (!frame.width) continue;
    const boxes = (selector) => [...chart.querySelectorAll(selector)]
      .map((text) => [text.textContent, text.getBoundingClientRect()])
      .filter(([, box]) => box.width && box.height);
    const titles = boxes(".infolayer [class*=title] text, .infolayer text[class*=title]");
    const labels = boxes(".xtick text, .ytick text, [class$=tick] text");
    titles.forEach(([name, title], k) => {
      for (const [label, box] of labels)
        if (meets(title, box, 0.5)) found.push(`${key}: "${name}" meets the tick "${label}"`);
      for (const [other, box] of titles.slice(k + 1))
        if (meets(title, box, 0)) found.push(`${key}: "${name}" meets "${other}"`);
      if (title.left < frame.left - 1 || title.right > frame.right + 1
          || title.top < frame.top - 1 || title.bottom > frame.bottom + 1)
        found.push(`${key}: "${name}" is cut off`);
    });
  }
  return found;
}"""
"""Titles of charts and axes that meet tick labels or each other, or stand out of their chart."""


def crowded(page: Page) -> list[str]:
    """What meets or is cut off in the charts that the page shows, each once."""
    return list(dict.fromkeys(page.evaluate(CROWDED)))


def go(page: Page, title: str) -> None:
    """To another page by the sidebar."""
    page.get_by_test_id("stSidebar").get_by_role("link", name=title, exact=True).click()
    idle(page)


LASTING = ":not([aria-label^='Help']):not([data-stale=true] *)"
"""Neither the icon beside a button, "Help for ..", nor what the page is about to replace."""


def button(page: Page, name: str | re.Pattern[str], exact: bool = False) -> Locator:
    """The button of that name, or of which that is a part of the name."""
    return page.get_by_role("button", name=name, exact=exact).and_(page.locator(LASTING))


def number(page: Page, label: str) -> Locator:
    """A field for a number."""
    return page.get_by_role("spinbutton", name=label)


def fill(page: Page, label: str, value: str) -> None:
    """Type a value and leave the field."""
    field = page.get_by_label(label).and_(page.locator("input"))  # not its tooltip
    field.fill(value)
    field.press("Enter")


def choose(page: Page, label: str, option: str) -> None:
    """Choose from a list, which closes again when the page below it moves or is drawn anew."""
    offered = page.get_by_role("option", name=option)
    choice = page.get_by_role("combobox", name=label)
    for patience in TRIES_MS:
        choice.scroll_into_view_if_needed()  # a list below the screen closes by itself
        choice.press("ArrowDown")
        with suppress(TimeoutError):
            offered.click(timeout=patience)
            break
    else:
        raise AssertionError(f"The list {label!r} does not offer {option!r}.")
    idle(page)


def open_tab(page: Page, title: str) -> None:
    """Open a tab; only the open one is drawn."""
    page.get_by_role("tab", name=title, exact=True).click()
    idle(page)


def table(page: Page, containing: str) -> Locator:
    """The first table with that text."""
    return page.locator("table.figures").filter(has_text=containing).first


def rows(page: Page, containing: str) -> list[list[str]]:
    """The cells of the first table with that text, row by row."""
    found = table(page, containing)
    expect(found).to_be_visible(timeout=TRAINING_MS)
    return [row.locator("td").all_inner_texts() for row in found.locator("tbody tr").all()]


def downloaded(page: Page, button: Locator) -> tuple[str, bytes]:
    """Name and content of what a button saves."""
    with page.expect_download(timeout=TRAINING_MS) as download:
        button.click()
    return download.value.suggested_filename, Path(download.value.path()).read_bytes()


def estimate(cell: str) -> float:
    """The value before its interval, without its marks."""
    return float(cell.split()[0].rstrip("○□†"))


def chart(page: Page, key: str) -> Locator:
    """A chart by its key, once it is drawn and the one it takes the place of is gone."""
    found = page.locator(f".st-key-{key} .js-plotly-plot")
    expect(found).to_have_count(1)
    found.wait_for()
    return found


def upload(page: Page, file: Path | tuple[str, bytes]) -> None:
    """On Data: open a file, whichever state the page is in."""
    field, closed = page.locator('input[type="file"]'), page.get_by_text("Open another recording")
    field.or_(closed).first.wait_for(state="attached")
    if not field.count():
        closed.click()
    give(page, file)


def give(page: Page, file: Path | tuple[str, bytes]) -> None:
    """Give a file, or name and content of one, to the page's field for files."""
    field = page.locator('input[type="file"]')
    if isinstance(file, Path):
        field.set_input_files(file)
    else:
        field.set_input_files({"name": file[0], "mimeType": "", "buffer": file[1]})
