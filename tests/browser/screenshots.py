"""Pictures of every page in its important states, in both themes and two widths, to be looked at.

With OPENACC_DIR set also those of real recordings.
"""

import argparse
import os
import re
import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from playwright.sync_api import Browser, Page, expect

from tests.browser.running import (
    ESTIMATES,
    PATIENCE_MS,
    TRAINING_MS,
    chart,
    choose,
    fill,
    idle,
    installed,
    launched,
    open_example,
    open_sample,
    open_tab,
    table,
    train_sample,
    upload,
)
from tests.support.server import ROOT, running

WIDTHS = {"wide": (1440, 900), "narrow": (420, 900)}
THEMES = ("light", "dark")
REAL = os.environ.get("OPENACC_DIR", "")
REAL_RUNS = {
    "data_Vicolungo": "Vicolungo/JRC-VC_260219_part3",
    "data_JRClowspeed": "JRC low speed/part12",
    "data_Cherasco": "Cherasco/JRC-Cher_300818_rec1_part2",
    "data_ZalaZone": "ZalaZone/handling_part10",
    "data_corrupt": "corrupt/ZalaZone_handling_part12_TRUNCATED_NUL",
    "data_casale": "Casale/part7",
}
SETTLE_MS = 700
"""Charts fade in; nothing on the page tells when they have."""


@dataclass(frozen=True)
class Camera:
    """Takes the pictures of one theme and width."""

    folder: Path
    browser: Browser
    address: str
    theme: str
    width: str

    @contextmanager
    def page(self, path: str = "/") -> Iterator[Page]:
        """A page in a profile of its own, without a session."""
        width, height = WIDTHS[self.width]
        page = self.browser.new_page(
            base_url=self.address,
            viewport={"width": width, "height": height},
            color_scheme=self.theme,
        )
        page.set_default_timeout(TRAINING_MS)
        page.goto(path)
        idle(page)
        try:
            yield page
        finally:
            page.close()

    def shoot(self, page: Page, name: str, whole: bool = True) -> None:
        """Keep what the page shows, to its end if ``whole``."""
        width, height = WIDTHS[self.width]
        page.wait_for_timeout(SETTLE_MS)
        content, needed = page.locator('[data-testid="stMainBlockContainer"]'), 0.0
        while whole and needed != (needed := content.bounding_box()["height"]):
            page.set_viewport_size({"width": width, "height": int(needed) + 20})
            page.wait_for_timeout(SETTLE_MS)
        page.screenshot(path=self.folder / f"{name}_{self.theme}_{self.width}.png")
        page.set_viewport_size({"width": width, "height": height})


def open_real(page: Page, name: str) -> None:
    """On Data: a real recording, or why it is refused."""
    file = Path(REAL) / f"{name}.csv"
    upload(page, file)
    opened = page.locator("strong").filter(has_text=file.name)
    opened.or_(page.get_by_role("alert").filter(has_text=file.name)).first.wait_for()
    idle(page)


def to(page: Page, title: str) -> None:
    """To another page with the same session; the sidebar is folded on a narrow screen."""
    page.goto(re.sub(r"/\w*\?", f"/{title}?", page.url))
    idle(page)


def home(camera: Camera) -> None:
    with camera.page() as page:
        page.locator(".js-plotly-plot").nth(3).wait_for()
        camera.shoot(page, "home", whole=False)
        for title in ("Published parameters", "Reproduce the paper"):
            open_tab(page, title)
            camera.shoot(page, f"home_{title.partition(' ')[0].lower()}")
        train_sample(page)
        camera.shoot(page, "train_sample_fold", whole=False)
        camera.shoot(page, "train_sample")
        page.get_by_text("Next: string stability in detail").click()
        chart(page, "stability_bode")
        idle(page)
        camera.shoot(page, "stability_learned")


def data(camera: Camera) -> None:
    with camera.page("/Train") as page:
        camera.shoot(page, "empty_train", whole=False)
    with camera.page("/Data") as page:
        camera.shoot(page, "empty_data", whole=False)
        open_sample(page)
        camera.shoot(page, "data_sample_fold", whole=False)
        camera.shoot(page, "data_sample")


def mapping(camera: Camera) -> None:
    """A table of one's own, which asks for its columns and who drives."""
    table_of_own = "".join(
        f"{k / 10},{20 + k % 7},{20 + k % 5},{30 + k % 3},{k % 2}\n" for k in range(400)
    )
    file = "own.csv", f"stamp,v_lead,v_ego,gap_ego,acc_ego\n{table_of_own}".encode()
    with camera.page("/Data") as page:
        upload(page, file)
        page.get_by_role("button", name="Open with these columns").wait_for()
        page.get_by_text("Who drives: ACC or a human").click()
        page.get_by_role("button", name="Open with these columns").scroll_into_view_if_needed()
        choose(page, "Mode of vehicle 2", "acc_ego")
        page.get_by_role("textbox", name="Under ACC it says").wait_for()
        idle(page)
        camera.shoot(page, "data_mapping")


def training(camera: Camera) -> None:
    with camera.page("/Data") as page, camera.page("/Data") as other:
        open_sample(page)
        to(page, "Train")
        page.get_by_text("Paper", exact=True).click()
        page.get_by_text("Options", exact=True).click()
        page.get_by_role("button", name="Back to the preset").wait_for()
        idle(page)
        camera.shoot(page, "train_options")
        fill(page, "Learning rate", "-1")
        page.get_by_role("alert").wait_for()
        camera.shoot(page, "train_refused")
        page.get_by_role("button", name="Back to the preset").click()
        page.get_by_text("Options", exact=True).click()
        page.get_by_role("button", name="Start training").click()
        page.get_by_text("left at most").wait_for()
        page.get_by_test_id("stPlotlyChart").nth(4).wait_for()  # the fit comes last
        camera.shoot(page, "train_live", whole=False)
        open_sample(other)
        fill(other, "Window starts at", "10")  # else an earlier result is shown
        idle(other)
        other.get_by_role("button", name="Train on this window").click()
        other.get_by_text("yours is next").wait_for()
        camera.shoot(other, "train_queued", whole=False)
        page.get_by_role("button", name="Stop training").click()
        page.get_by_role("button", name="Continue").wait_for()
        idle(page)
        camera.shoot(page, "train_stopped")


def real(camera: Camera) -> None:
    with camera.page("/Data") as page:
        for name, file in REAL_RUNS.items():
            open_real(page, file)
            camera.shoot(page, name)
        page.get_by_role("button", name=re.compile("Train on ")).click()
        table(page, ESTIMATES).wait_for()
        idle(page)
        camera.shoot(page, "train_casale")
        to(page, "")
        camera.shoot(page, "home_session")
        to(page, "Data")
        for title, name in (("Δv", "relative"), ("Time gap", "time_gap")):
            page.get_by_text(title, exact=True).first.click()
            idle(page)
            camera.shoot(page, f"data_casale_{name}", whole=False)
        page.get_by_role("button", name="Suggested: ").click()
        camera.shoot(page, "data_suggested", whole=False)
        page.keyboard.press("Escape")
        open_tab(page, "Validation")
        page.get_by_role("button", name="Validate on").click()
        table(page, "Validation").wait_for()
        for title in ("Validation", "Changes to the data", "About the recording"):
            open_tab(page, title)
            camera.shoot(page, f"data_{title.partition(' ')[0].lower()}")


def regimes(camera: Camera) -> None:
    with camera.page("/Data") as page:
        for name in ("data_casale", "data_ZalaZone"):
            open_real(page, REAL_RUNS[name])
            open_tab(page, "Regimes")
            for regime in ("Standstill", "Catching up"):
                idle(page)
                page.get_by_test_id("stCheckbox").filter(has_text=regime).click()
            page.get_by_text("Without").first.wait_for()
            if not page.get_by_text("Car-following only").first.is_visible():
                page.get_by_text("Show the sensitivity of the estimates").click()
            page.get_by_text("Car-following only").first.wait_for()
            idle(page)
            camera.shoot(page, name.replace("data", "regimes"))


def stability(camera: Camera) -> None:
    with camera.page("/Stability") as page:
        camera.shoot(page, "stability_empty", whole=False)
        open_example(page)
        chart(page, "stability_bode")
        camera.shoot(page, "stability_fold", whole=False)
        for title, drawn in (("Why", "bode"), ("Criteria", "criteria"), ("Map", "map")):
            open_tab(page, title)
            chart(page, f"stability_{drawn}")
            camera.shoot(page, f"stability_{title.lower()}")
        page.get_by_text("By hand").click()
        page.get_by_test_id("stDataFrame").wait_for()
        idle(page)
        camera.shoot(page, "stability_by_hand")


def platoon(camera: Camera) -> None:
    with camera.page("/Platoon") as page:
        open_example(page)
        chart(page, "platoon_amplitude")
        camera.shoot(page, "platoon_fold", whole=False)
        camera.shoot(page, "platoon")
        page.get_by_text("From the leader", exact=True).click()
        page.get_by_text("Whole run", exact=True).click()
        page.get_by_text("One car", exact=True).click()
        idle(page)
        camera.shoot(page, "platoon_collision")
        choose(page, "Disturbance of the leader", "Brake")
        open_tab(page, "Animation")
        chart(page, "platoon_wave")
        camera.shoot(page, "platoon_brake")
        open_tab(page, "The paper's four panels")
        chart(page, "platoon_panel_3")
        camera.shoot(page, "platoon_panels")


def platoon_recorded(camera: Camera) -> None:
    for name, file, start in (("casale", "Casale/part7", ""),
                              ("astazero", "AstaZero/ASta_040719_platoon5", "320")):  # fmt: skip
        with camera.page("/Data") as page:
            open_real(page, file)
            if start:
                fill(page, "Window starts at", start)
                idle(page)
            page.get_by_role("button", name=re.compile("Train on ")).click()
            table(page, "Surrogate fit").wait_for()
            idle(page)
            to(page, "Stability")
            chart(page, "stability_bode")
            camera.shoot(page, f"stability_{name}_fold", whole=False)
            open_tab(page, "Measured")
            chart(page, "stability_measured_gain")
            camera.shoot(page, f"stability_{name}_measured")
            to(page, "Platoon")
            choose(page, "Disturbance of the leader", "As recorded")
            page.get_by_text("begins in equilibrium").wait_for()
            idle(page)
            camera.shoot(page, f"platoon_{name}_recorded")


def compare(camera: Camera) -> None:
    with camera.page("/Data") as page:
        open_sample(page)
        to(page, "Compare")
        page.get_by_role("button", name="Run all methods").click()
        page.get_by_role("button", name="Stop", exact=True).wait_for()
        camera.shoot(page, "compare_running", whole=False)
        table(page, "Maximum likelihood (90").wait_for(timeout=TRAINING_MS)
        idle(page)
        camera.shoot(page, "compare_fold", whole=False)
        camera.shoot(page, "compare")
        for title in ("Methods", "Identifiability", "Model adequacy", "Repeatability"):
            open_tab(page, title)
            if title == "Repeatability":
                page.get_by_role("button", name="Five starts").click()
                page.get_by_text("All 5 trainings").wait_for(timeout=TRAINING_MS)
                idle(page)
            camera.shoot(page, f"compare_{title.lower().replace(' ', '_')}")
        page.get_by_text("Car-following models").click()
        page.get_by_role("button", name="Judge 4 models").click()
        chart(page, "models_peak")
        idle(page)
        camera.shoot(page, "compare_models_fold", whole=False)
        camera.shoot(page, "compare_models")


def snapshots(camera: Camera) -> None:
    with camera.page() as page:
        train_sample(page)
        to(page, "Snapshots")
        for name in ("Before the update", "After the update"):
            page.get_by_label("Name", exact=True).fill(name)
            if page.get_by_role("checkbox", name="Include the data slice").is_checked():
                page.get_by_text("Include the data slice").click()
            page.get_by_role("button", name="Save", exact=True).click()
            page.get_by_role("heading", name=name).wait_for()
            idle(page)
            page.get_by_role("button", name="All snapshots").click()
            idle(page)
        camera.shoot(page, "snapshots")
        page.get_by_role("button", name="Before the update").click()
        page.get_by_role("heading", name="Before the update").wait_for()
        for title in ("Verify", "Beside another"):
            open_tab(page, title)
            camera.shoot(page, f"snapshot_{title.partition(' ')[0].lower()}")
        page.get_by_role("button", name="Share").click()
        address = page.locator("code").filter(has_text="?snapshot=").inner_text()
    for path in ("Data", "Train", "Compare"):
        with camera.page(address.replace("Snapshots", path)) as page:
            page.get_by_text("it came without its data").wait_for()
            camera.shoot(page, f"snapshot_{path.lower()}")


def database(camera: Camera) -> None:
    with camera.page("/Database") as page:
        camera.shoot(page, "database_empty", whole=False)
        page.get_by_role("button", name="Start the batch").click()
        page.get_by_text("rows so far").wait_for()
        camera.shoot(page, "database_running", whole=False)
        page.get_by_text("Done: ").wait_for(timeout=20 * TRAINING_MS)
        chart(page, "database_forest")
        idle(page)
        camera.shoot(page, "database_fold", whole=False)
        for title, key in (("Groups", ""), ("Spread", ""), ("α–β plane", "plane"),
                           ("Time gap", "gaps"), ("All rows", ""), ("Failures", "")):  # fmt: skip
            open_tab(page, title)
            if key:
                chart(page, f"database_{key}")
            name = "plane" if key == "plane" else title.partition(" ")[0].lower()
            camera.shoot(page, f"database_{name}")


OF_REAL_RECORDINGS = (real, regimes, platoon_recorded, database)
SCENES: tuple[Callable[[Camera], None], ...] = (
    home, data, mapping, training, *(OF_REAL_RECORDINGS if REAL else ()), stability, platoon,
    compare, snapshots,
)  # fmt: skip


def main(arguments: list[str]) -> None:
    """Take all pictures, or those asked for."""
    parser = argparse.ArgumentParser(
        prog="python -m tests.browser.screenshots", description=__doc__
    )
    usual = ROOT / "tests" / "browser" / "shots"
    parser.add_argument("folder", nargs="?", type=Path, default=usual, help="of the pictures")
    names = [scene.__name__ for scene in SCENES]
    parser.add_argument("scenes", nargs="*", metavar="scene", help=f"of {', '.join(names)} (all)")
    given = parser.parse_args(arguments)
    if unknown := set(given.scenes) - set(names):
        parser.error(
            f"no scene is called {', '.join(sorted(unknown))}; there are {', '.join(names)}"
        )
    folder: Path = given.folder
    folder.mkdir(parents=True, exist_ok=True)
    chosen = [scene for scene in SCENES if not given.scenes or scene.__name__ in given.scenes]
    expect.set_options(timeout=PATIENCE_MS)
    chromium = installed()
    if not chromium:
        parser.error("no Chromium on this machine; install it, or name it in CHROMIUM")
    for theme in THEMES:
        for width in WIDTHS:
            with tempfile.TemporaryDirectory() as temporary, launched(chromium) as browser:
                place = Path(temporary)
                recordings = Path(REAL) if REAL else None
                with running(place / "cache", place / "log", recordings) as server:
                    for scene in chosen:
                        scene(Camera(folder, browser, server.address, theme, width))
    print(f"{len(list(folder.glob('*.png')))} pictures in {folder}")


if __name__ == "__main__":
    main(sys.argv[1:])
