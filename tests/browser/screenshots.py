"""Pictures of every page in its important states, in both themes and two widths, to be looked at.

With OPENACC_DIR set also those of real recordings.
"""

import argparse
import os
import re
import tempfile
from dataclasses import dataclass
from itertools import product
from pathlib import Path

from playwright.sync_api import Page, expect

from tests.browser.running import (
    DRAWN,
    PATIENCE_MS,
    TRAINING_MS,
    chart,
    choose,
    crowded,
    fill,
    give,
    idle,
    installed,
    launched,
    open_tab,
    upload,
)
from tests.support import own_tables
from tests.support.server import ROOT, running

SHOTS = ROOT / "tests" / "browser" / "shots"
REAL = Path(os.environ["OPENACC_DIR"]) if "OPENACC_DIR" in os.environ else None
WIDTHS = {"wide": (1440, 900), "narrow": (420, 900)}
THEMES = ("light", "dark")
SETTLE_MS = 700
"""Charts fade in; nothing on the page tells when they have."""
BATCH_MS = 20 * TRAINING_MS
SCENES = {
    "home": ("/", "tour home", "press Train a sample now", "wait Next: string stability",
             "tour train_sample", "press Next: string stability", "shoot stability_learned"),
    "data": ("/Data", "fold data_empty", "press Open this sample", "tour data_sample"),
    "mapping": ("/", "table own.csv", "shoot table_asks", "table swapped.csv",
                "fold table_contradicted", "press Exchange the speeds", "shoot table_cured",
                "tick Change columns", "shoot table_columns", "press Open", "shoot table_on_data"),
    "training": ("/Data", "press Open this sample", "to Train", "fold train_before", "tick Paper",
                 "tick Options", "shoot train_options", "fill Learning rate = -1",
                 "shoot train_refused", "press Back to the preset", "tick Options",
                 "press Start training", "wait · iteration", "fold train_live",
                 "shoot train_live_whole", "press Stop training", "wait Continue",
                 "shoot train_stopped", "tab Training", "fold train_course", "press Continue",
                 "wait · iteration", "fold train_again", "press Stop training", "wait Continue"),
    "stability": ("/Stability", "fold stability_empty", "press Open a published example",
                  "tour stability", "tick By hand", "shoot stability_by_hand",
                  "press Parameters",
                  "choose Model = FVDM with delay d", "press Parameters", "tab Waves",
                  "fold stability_waves_fold", "shoot stability_waves"),
    "platoon": ("/Platoon", "press Open a published example", "tour platoon",
                "press View", "tick From the leader", "tick Whole run", "press View",
                "tick One car", "shoot platoon_collision",
                "choose Disturbance = Brake", "shoot platoon_brake"),
    "reproduce": ("/Reproduce", "tour reproduce"),
    "compare": ("/Data", "press Open this sample", "to Compare", "press Run all methods",
                "wait Stop", "fold compare_running", "wait with the recommended estimate",
                "tab Repeatability", "press Five starts", "wait All 5 trainings", "tour compare",
                "tick Car-following models", "press Compare 5 models",
                "wait Use these models", "chart models_cars",
                "tour compare_models", "press Use these models", "wait Next: string stability",
                "fold compare_models_used"),
    "database": ("/Database", "tour database_supplied", "press Start your own",
                 "shoot database_form"),
    "snapshots": ("/", "press Train a sample now", "wait Next: string stability", "to Snapshots",
                  "fill Name = Before the update",
                  "wait Saved as", "press All snapshots", "fill Name = After the update",
                  "wait Saved as", "press All snapshots", "shoot snapshots",
                  "press Before the update", "tour snapshot", "press Verify, about",
                  "wait numbers computed again agree", "tour snapshot_verified", "press Share",
                  "link Data",
                  "shoot snapshot_on_data", "to Train", "shoot snapshot_on_train", "to Compare",
                  "shoot snapshot_on_compare"),
}  # fmt: skip
"""The page where it begins, and what is done there, each time with one of the verbs below."""
JOURNEYS = {"fill": fill, "choose": choose, "chart": chart, "tab": open_tab}
"""Verbs that are those of journeys."""
OF_REAL_RECORDINGS = {
    "refused": ("/Data", "file corrupt/ZalaZone_handling_part12_TRUNCATED_NUL.csv",
                "shoot data_corrupt"),
    "recordings": ("/Data", "file Vicolungo/JRC-VC_260219_part3.csv", "shoot data_vicolungo",
                   "file JRC low speed/part12.csv", "shoot data_low_speed",
                   "file Cherasco/JRC-Cher_300818_rec1_part2.csv", "shoot data_cherasco",
                   "file ZalaZone/handling_part10.csv", "tab Regimes", "check Standstill",
                   "check Catching up", "shoot data_zalazone"),
    "casale": ("/Data", "file Casale/part7.csv", "tick Δv", "fold data_relative", "tick Time gap",
               "fold data_time_gap", "press Train on 8 windows", "wait Next: string stability",
               "tour train_casale", "to ", "shoot home_session", "to Data", "tab Validation",
               "press Validate on", "tour data_casale", "to Stability", "tab Measured",
               "shoot stability_casale", "to Platoon",
               "choose Disturbance = As recorded", "shoot platoon_casale"),
    "astazero": ("/Data", "file AstaZero/ASta_040719_platoon5.csv", "tick One window",
                 "fill Window starts at = 320", "press Train on this window",
                 "wait Next: string stability", "to Stability",
                 "tab Measured", "shoot stability_astazero", "to Platoon",
                 "choose Disturbance = As recorded", "shoot platoon_astazero"),
    "reproduced": ("/Reproduce", "press Reproduce all", "wait done", "fold reproduce_running",
                   "wait Reproduce all", "tour reproduced"),
    "compared": ("/Data", "file Casale/part7.csv", "to Compare", "press Run all methods",
                 "wait with the recommended estimate", "tour compare_casale",
                 "tick Car-following models", "press Compare 5 models",
                "wait Use these models", "chart models_cars",
                 "tour compare_models_casale"),
    "batch": ("/Database", "press Start your own", "press Start the batch", "wait rows so far",
              "fold database_running", "wait Done: ", "tour database_own"),
}  # fmt: skip


@dataclass(frozen=True)
class Camera:
    """A page in a profile of its own, and the pictures that are taken of it."""

    page: Page
    folder: Path
    theme: str
    width: str

    def fold(self, name: str) -> None:
        """Keep what the page shows at first."""
        self.page.wait_for_function(DRAWN)
        self.page.wait_for_timeout(SETTLE_MS)
        for fault in crowded(self.page):
            print(f"{name}, {self.theme}, {self.width}: {fault}")
        self.page.screenshot(path=self.folder / f"{name}_{self.theme}_{self.width}.png")

    def shoot(self, name: str) -> None:
        """Keep the page to its end."""
        width, height = WIDTHS[self.width]
        content, needed = self.page.get_by_test_id("stMainBlockContainer"), 0.0
        while needed != (needed := content.bounding_box()["height"]):
            self.page.set_viewport_size({"width": width, "height": int(needed) + 20})
            self.page.wait_for_timeout(SETTLE_MS)
        self.fold(name)
        self.page.set_viewport_size({"width": width, "height": height})

    def tour(self, name: str) -> None:
        """Keep what the page shows at first, then each of its tabs to the end of the page."""
        for title in self.page.get_by_role("tab").all_inner_texts()[:1]:
            open_tab(self.page, title)
        self.page.mouse.move(0, 0)
        self.page.evaluate("document.querySelector('[data-testid=stMain]').scrollTo(0, 0)")
        self.fold(f"{name}_fold")
        for title in self.page.get_by_role("tab").all_inner_texts() or [""]:
            if title:
                open_tab(self.page, title)
            self.shoot("_".join([name, *re.findall(r"\w+", title.lower())]))

    def press(self, button: str) -> None:
        self.page.wait_for_function(DRAWN)  # a click on a page that still grows may miss
        self.page.get_by_role("button", name=button).first.click()

    def tick(self, text: str) -> None:
        """Click on a choice, a toggle or a fold that says just this."""
        self.page.get_by_text(text, exact=True).first.click()

    def check(self, text: str) -> None:
        self.page.get_by_test_id("stCheckbox").filter(has_text=text).click()

    def wait(self, text: str) -> None:
        self.page.get_by_text(text).filter(visible=True).first.wait_for(timeout=BATCH_MS)

    def to(self, title: str) -> None:
        """To another page with the same session; the sidebar is folded on a narrow screen."""
        self.page.goto(re.sub(r"/\w*\?", f"/{title}?", self.page.url))

    def link(self, title: str) -> None:
        """To that page by the link to a snapshot, as somebody else follows it."""
        address = self.page.locator("code").filter(has_text="?snapshot=").inner_text()
        self.page.goto(address.replace("Snapshots", title))

    def file(self, name: str) -> None:
        """On Data: a real recording, or why it is refused."""
        place = REAL / name
        upload(self.page, place)
        opened = self.page.locator("strong").filter(has_text=place.name)
        opened.or_(self.page.get_by_role("alert").filter(has_text=place.name)).first.wait_for()

    def table(self, name: str) -> None:
        """Drop a table of one's own on page Home."""
        leader, follower = own_tables.pair()[1].T
        tables = {
            "own.csv": own_tables.plain(lead_speed=3.6 * leader, ego_speed=3.6 * follower),
            "swapped.csv": own_tables.plain(lead_speed=follower, ego_speed=leader),
        }
        cancel = self.page.get_by_role("button", name="Cancel")
        if cancel.count():
            cancel.click()
        give(self.page, (name, tables[name]))
        chart(self.page, "data_beginning")

    def act(self, steps: list[str]) -> None:
        """Do one after the other."""
        for step in steps:
            verb, _, words = step.partition(" ")
            if verb in JOURNEYS:
                JOURNEYS[verb](self.page, *words.split(" = "))
            else:
                getattr(self, verb)(words)
            idle(self.page)


def main() -> None:
    """Take all pictures, or those asked for."""
    parser = argparse.ArgumentParser(
        prog="python -m tests.browser.screenshots", description=__doc__
    )
    scenes = SCENES | (OF_REAL_RECORDINGS if REAL else {})
    parser.add_argument("--folder", type=Path, default=SHOTS, help="of the pictures")
    parser.add_argument("--scene", action="append", choices=scenes, help="only this one (all)")
    given = parser.parse_args()
    chromium = installed()
    if not chromium:
        parser.error("no Chromium on this machine; install it, or name it in CHROMIUM")
    given.folder.mkdir(parents=True, exist_ok=True)
    expect.set_options(timeout=PATIENCE_MS)
    for theme, width in product(THEMES, WIDTHS):
        with (
            tempfile.TemporaryDirectory() as temporary,
            launched(chromium) as browser,
            running(Path(temporary) / "cache", Path(temporary) / "log", REAL) as server,
        ):
            for path, *steps in (scenes[name] for name in given.scene or scenes):
                size = dict(zip(("width", "height"), WIDTHS[width], strict=True))
                page = browser.new_page(base_url=server.address, viewport=size, color_scheme=theme)
                page.set_default_timeout(TRAINING_MS)
                page.goto(path)
                idle(page)
                Camera(page, given.folder, theme, width).act(steps)
                page.close()
    print(f"{len(list(given.folder.glob('*.png')))} pictures in {given.folder}")


if __name__ == "__main__":
    main()
