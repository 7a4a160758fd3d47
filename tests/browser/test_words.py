"""How much there is to read on a page with a result, and the strip that stands for sentences."""

import os
import re
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from playwright.sync_api import Page, expect

from accpinn.study.snapshot_library import Library
from tests.browser.conftest import App, Open
from tests.browser.running import (
    DRAWN,
    TRAINING_MS,
    button,
    chart,
    choose,
    go,
    idle,
    open_tab,
    upload,
    words,
)
from tests.support.openacc_files import csv, metadata
from tests.support.samples import FOLDER, PLATOON

pytestmark = pytest.mark.browser
FOLD, PAGE = 150, 350
"""Most words on the screen of 1440 by 900 at first, and on the page."""
REAL = os.environ.get("OPENACC_DIR")
STABILITY_TABS = ("Poles and responses", "Region", "Margin", "Measured")
FOUR_CARS = "AstaZero/ASta_040719_platoon5.csv"
CASALE = "Casale/part7.csv"
LONGEST_MS = 3 * TRAINING_MS
SETTLE_MS = 250
MANY = 12
"""Snapshots, more than a list shows at once."""


Counts = dict[str, tuple[int, int]]
"""Words of the fold and of the page, by its title."""


def counted(page: Page) -> tuple[int, int]:
    """The words of the fold and of the page, once nothing of it changes any more."""
    idle(page)
    page.wait_for_function(DRAWN)
    earlier, now = (0, 0), (0, 0)
    while not now[0] or now != earlier:
        page.wait_for_timeout(SETTLE_MS)
        earlier, now = now, (len(words(page, is_fold=True)), len(words(page)))
    return now


def require_few(counts: Counts) -> None:
    """Refuse a page with too many words."""
    for name, (fold, whole) in counts.items():
        assert 0 < fold <= FOLD, (name, fold)
        assert fold <= whole <= PAGE, (name, whole)


def trained(page: Page, file: str = "") -> None:
    """A training of the sample, or of the windows of a real recording."""
    if file:
        upload(page, Path(REAL or "") / file)
        button(page, re.compile(r"Train on \d+ windows")).click()
    else:
        button(page, "Train a sample now").click()
    button(page, "Next: string stability").wait_for(timeout=LONGEST_MS)
    idle(page)


def test_a_page_holds_few_words(opened: Open, app: App) -> None:
    """With the recording of four followers where it is at hand, else with the sample."""
    page = opened("/")
    page.set_viewport_size({"width": 1440, "height": 900})
    counts: Counts = {"at first": counted(page)}
    trained(page, FOUR_CARS if REAL else "")
    for title in ("Home", "Data"):
        go(page, title)
        shown = page.locator(".runs .strip-row").first if title == "Home" else (
            page.locator(".js-plotly-plot").first
        )  # fmt: skip
        expect(shown).to_be_visible()
        idle(page)
        counts[title] = counted(page)
    for title in ("Train", "Stability", "Platoon"):
        go(page, title)
        expect(page.locator(".strip-row[data-row]").first).to_be_visible()
        expect(page.locator(".js-plotly-plot").first).to_be_visible()
        idle(page)
        counts[title] = counted(page)
        for tab in STABILITY_TABS if title == "Stability" else ():
            open_tab(page, tab)
            idle(page)
            counts[tab] = counts[title][0], counted(page)[1]
        if title == "Stability":
            button(page, "What if").click()
            counts["What if"] = counts[title][0], counted(page)[1]
    go(page, "Snapshots")
    save = button(page, "Save", exact=True)
    save.wait_for()
    idle(page)
    counts["Snapshots"] = counted(page)
    save.click()
    button(page, re.compile("Verify")).wait_for()
    expect(page.locator(".js-plotly-plot").first).to_be_visible()
    idle(page)
    counts["a snapshot"] = counted(page)
    library = Library(app.snapshots)
    result = library.read(library.entries()[0].id)
    for k in range(MANY - 1):
        library.add(replace(result, name=f"{result.name}, {k}"))
    button(page, "All snapshots").click()
    more = button(page, f"Show all {MANY}")
    more.wait_for()
    idle(page)
    counts["many snapshots"] = counted(page)
    more.click()
    page.get_by_text("search for the others").wait_for()
    idle(page)
    counts["all snapshots"] = counted(page)
    page.set_viewport_size({"width": 1440, "height": 1000})
    print(counts)
    require_few(counts)


def two_windows() -> bytes:
    """Five cars of a sample for 140 s, the leader's speed missing for 5 s in their middle."""
    drive = pd.read_csv(FOLDER / f"{PLATOON}.csv", skiprows=5, nrows=1400)
    drive.loc[650:700, "Speed1"] = np.nan
    return csv(drive, metadata([f"Maker{k}(Model {k})" for k in range(1, 6)]))


def test_compare_and_database_hold_few_words(opened: Open) -> None:
    page = opened("/Data")
    page.set_viewport_size({"width": 1440, "height": 900})
    upload(page, ("two windows.csv", two_windows()))
    button(page, "Train on 2 windows").wait_for()
    counts: Counts = {}

    def count(name: str, key: str) -> None:
        chart(page, key)
        idle(page)
        counts[name] = counted(page)

    go(page, "Compare")
    button(page, "Run all methods").click()
    page.get_by_role("tab", name="Numbers").wait_for(timeout=LONGEST_MS)
    count("methods", "compare_estimates")
    page.get_by_text("Car-following models", exact=True).click()
    button(page, re.compile(r"Compare \d+ models")).click()
    button(page, "Use these models").wait_for(timeout=LONGEST_MS)
    count("models", "models_cars")
    go(page, "Database")
    count("database", "database_forest")
    for tab in ("Numbers", "Parameters", "Spread"):
        open_tab(page, tab)
        count(f"database, {tab}", "database_forest")
    page.set_viewport_size({"width": 1440, "height": 1000})
    print(counts)
    require_few(counts)


@pytest.mark.skipif(not REAL, reason="no OpenACC")
def test_the_reproduced_paper_holds_few_words(opened: Open, app: App) -> None:
    for name in (FOUR_CARS, CASALE):
        (app.recordings / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(Path(REAL or "") / name, app.recordings / name)
    page, counts = opened("/Reproduce"), {}
    page.set_viewport_size({"width": 1440, "height": 900})
    everything = button(page, "Reproduce all")
    for state in ("before", "learned"):
        expect(page.locator(".js-plotly-plot")).to_have_count(11)
        idle(page)
        counts[state] = counted(page)
        if state == "before":
            everything.click()
            button(page, "Stop").wait_for()
            everything.wait_for(timeout=LONGEST_MS)
    page.set_viewport_size({"width": 1440, "height": 1000})
    print(counts)
    require_few(counts)


def test_waves_by_a_model_of_either_direction_hold_few_words(opened: Open) -> None:
    page = opened("/Stability")
    page.set_viewport_size({"width": 1440, "height": 900})
    button(page, "Open a published example").click()
    page.get_by_role("radio", name="By hand").click()
    button(page, "Parameters").click()
    choose(page, "Model", "CTHP with unequal gains and delay")
    page.keyboard.press("Escape")
    open_tab(page, "Waves")
    for key in ("stability_waves", "stability_waves_size"):
        chart(page, key)
    counts = {"waves": counted(page)}
    page.set_viewport_size({"width": 1440, "height": 1000})
    print(counts)
    require_few(counts)


def test_a_row_gives_its_reasons_and_opens_its_car(opened: Open) -> None:
    page = opened("/")
    trained(page)
    page.set_viewport_size({"width": 1440, "height": 900})
    require_few({"a sample": counted(page)})
    page.set_viewport_size({"width": 1440, "height": 1000})
    row = page.locator(".strip-row[data-row='1']")
    mark = row.locator(".strip-mark").first
    reason = mark.get_attribute("data-why")
    mark.focus()
    shown = mark.evaluate("mark => getComputedStyle(mark, '::after').content")
    assert reason
    assert reason in shown
    name = row.get_by_role("rowheader").inner_text()
    follower = page.get_by_role("combobox", name="Follower")
    expect(follower).not_to_have_value(name)
    row.get_by_role("rowheader").click()
    expect(follower).to_have_value(name)
    page.set_viewport_size({"width": 420, "height": 900})
    box, first = (of.bounding_box() for of in (mark, row.get_by_role("rowheader")))
    page.set_viewport_size({"width": 1440, "height": 1000})
    assert box
    assert first
    assert box["y"] > first["y"] + first["height"], "the row wraps under the car's name"
    assert box["x"] + box["width"] < 420
