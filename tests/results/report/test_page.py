"""The report as text: complete, in order, escaped, self-contained, and true to its snapshot."""

import base64
import hashlib
import json
import re
from dataclasses import replace
from functools import cache
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from accpinn.cli import main
from accpinn.methods.fit import Outcome
from accpinn.model.cthp import Parameters
from accpinn.results.messages.summary import about_data, summary, title
from accpinn.results.report.page import render_report
from accpinn.results.report.pictures import fits, motion
from accpinn.results.snapshot.create import stability as judged
from accpinn.results.snapshot.file import load, save
from accpinn.results.snapshot.verification import check
from tests.support.samples import FOLDER, PLATOON
from tests.support.snapshots import small, whole

HOSTILE = "</script><script>alert(1)</script>\"'><img src=x onerror=alert(1)>$y$_z_&amp;"
ORDER = (
    "Data", "Parameters", "Fit", "String stability", "A platoon of such vehicles",
    "Methods compared", "Provenance", "How to cite",
)  # fmt: skip
VOID = {"meta", "img", "br", "link", "input"}


class Reader(HTMLParser):
    """Elements, texts and scripts of a page; anything left open or closed twice is a fault."""

    def __init__(self) -> None:
        """Nothing read yet."""
        super().__init__()
        self.open: list[str] = []
        self.faults: list[str] = []
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.texts: list[tuple[str, str]] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attrs)))
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        if not self.open or self.open.pop() != tag:
            self.faults.append(f"</{tag}>")

    def handle_data(self, data: str) -> None:
        self.texts.append((self.open[-1] if self.open else "", data))

    def within(self, tag: str) -> list[str]:
        return [text for inside, text in self.texts if inside == tag]


def read(page: str) -> Reader:
    reader = Reader()
    reader.feed(page)
    reader.close()
    assert reader.faults == []
    assert reader.open == []
    return reader


@cache
def page() -> str:
    return render_report(whole())


@cache
def hostile_page() -> str:
    info = replace(
        whole().info, names=(HOSTILE,) * 5, source=HOSTILE, notes=(HOSTILE,), left_out=()
    )
    return render_report(
        replace(whole(), name=HOSTILE, note=HOSTILE, info=info, facts={"campaign": HOSTILE})
    )


def drawings(text: str) -> list[dict[str, Any]]:
    found: list[dict[str, Any]] = json.loads(
        re.search(r'id="drawings">(.*?)</script>', text, re.DOTALL)[1]  # type: ignore[index]
    )
    return found


class TestThePage:
    def test_tells_the_story_in_order(self) -> None:
        headings = [text.strip() for text in read(page()).within("h2")]
        assert headings == list(ORDER)

    def test_holds_plotly_once_and_stays_below_6_mb(self) -> None:
        assert page().count("plotly.js v") == 1
        assert len(page().encode()) < 6_000_000

    def test_loads_nothing(self) -> None:
        for _, attributes in read(page()).tags:
            assert "src" not in attributes
            address = attributes.get("href") or ""
            assert address.startswith(("data:", "https://creativecommons.org/", "https://doi.org/"))\
                or not address  # fmt: skip

    def test_only_its_own_scripts_may_run(self) -> None:
        reader = read(page())
        policy = next(a["content"] for t, a in reader.tags if a.get("http-equiv"))
        assert policy is not None
        assert "default-src 'none'" in policy
        scripts = re.findall(r"<script(?: id=\"plotly\")?>(.*?)</script>", page(), re.DOTALL)
        assert len(scripts) == 2
        for script in scripts:
            digest = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
            assert f"'sha256-{digest}'" in policy

    def test_every_drawing_has_a_place_and_few_digits(self) -> None:
        made = drawings(page())
        places = [int(a["data-place"] or -1) for _, a in read(page()).tags if "data-place" in a]
        assert places == list(range(len(made)))
        assert [d["name"] for d in made][:2] == ["motion", "fit_1"]
        for drawing in made:
            for trace in drawing["data"]:
                for axis in ("x", "y"):
                    assert isinstance(trace[axis], list), "bytes that no digits were taken from"
                    numbers = [v for v in trace[axis] if isinstance(v, float)]
                    assert all(v == float(f"{v:.5g}") for v in numbers)

    def test_a_bare_result_makes_a_page_too(self) -> None:
        bare = replace(
            small(), uncertainty=None, evaluation=None, stability=None, segment=None, rows=()
        )
        headings = [text.strip() for text in read(render_report(bare)).within("h2")]
        assert "Methods compared" not in headings
        assert "String stability" in headings
        assert "leave the headway undetermined" in render_report(bare)


class TestItIsTrue:
    def test_tables_hold_the_snapshots_numbers(self) -> None:
        cells = read(page()).within("td")
        for law in whole().fit.parameters:
            assert f"{law.alpha:.4f}" in cells
            assert f"{law.tau:.3f}" in cells
        stability = whole().stability
        assert stability is not None
        for vehicle in stability.vehicles:
            assert f"{vehicle.linf_gain:.3f}" in cells

    def test_its_title_agrees_in_number(self) -> None:
        assert title(replace(whole(), name="")) == "How 4 vehicles follow the vehicle ahead"
        assert "follows the vehicle ahead" in title(replace(small(), name=""))

    def test_the_summary_gives_headway_amplification_and_how_sure(self) -> None:
        text = " ".join(summary(whole()))
        for law in whole().fit.parameters:
            assert f"τ {law.tau:.2f} s" in text
        assert "All 4 vehicles amplify" in text
        assert "so many are string stable" in text

    def test_the_summary_says_how_sure_the_headway_is_and_who_collides(self) -> None:
        uncertainty, worth = whole().uncertainty, whole().evaluation
        assert uncertainty is not None
        assert worth is not None
        text = " ".join(summary(whole()))
        assert (
            f"(90 % interval: {uncertainty.lower[0, 2]:.2f} to {uncertainty.upper[0, 2]:.2f} s)"
            in text
        )
        assert "runs into" not in text
        touched = replace(worth, collisions=np.array([np.nan, 12.34, np.nan, np.nan]))
        text = " ".join(summary(replace(whole(), evaluation=touched)))
        assert "1 of 4 laws runs into the vehicle ahead: 3 " in text
        assert "at 12.3 s." in text
        alone = small().evaluation
        assert alone is not None
        touched = replace(alone, collisions=np.array([222.6]))
        text = " ".join(summary(replace(small(), evaluation=touched)))
        assert "the law runs into the vehicle ahead at 222.6 s." in text

    @pytest.mark.parametrize("lost", [(3,), (2, 3), (0, 1, 2, 3)])
    def test_the_summary_names_followers_that_have_no_errors(self, lost: tuple[int, ...]) -> None:
        worth = whole().evaluation
        assert worth is not None
        assert worth.closed_loop is not None
        gaps = np.array([1.23, 2.34, 3.45, 4.56])
        gaps[list(lost)] = np.nan
        errors = replace(worth.closed_loop, gap_mae=gaps)
        changed = replace(whole(), evaluation=replace(worth, closed_loop=errors))
        (said,) = (text for text in summary(changed) if text.startswith("Driving by itself"))
        assert "nan" not in said
        named = ", ".join(whole().info.labels[1 + k] for k in lost)
        assert (f"(without {named}, whose simulation diverges)" in said) == (len(lost) < 4)
        assert ("misses the space-gap by 1.2" in said) == (len(lost) < 4)
        assert ("the learned law diverges" in said) == (len(lost) == 4)

    def test_a_stopped_training_is_called_so_first(self) -> None:
        fit = replace(whole().fit, outcome=Outcome.STOPPED, iterations=12)
        first = summary(replace(whole(), fit=fit))[0]
        assert first.startswith("Training was stopped at 12 of 20 iterations; these are not yet")

    def test_the_files_flag_is_not_called_a_vehicles_mode(self) -> None:
        rows = dict(about_data(replace(whole(), facts={"acc_flag": 1})))
        assert rows["ACC flag of the file"].startswith("1 (ACC), for the recording as a whole")
        assert "Driven by" not in rows

    def test_one_quiet_vehicle_is_called_so(self) -> None:
        fit = replace(small().fit, parameters=(Parameters(0.05, 0.6, 3.0),))
        calm = replace(small(), fit=fit, stability=judged(fit))
        assert "no frequency of a disturbance is amplified" in " ".join(summary(calm))

    def test_stored_stands_beside_recomputed(self) -> None:
        checked = check(whole())
        cells = read(page()).within("td")
        for one in checked.checks:
            assert one.stored in cells
            assert one.recomputed in cells
        assert "yes" in cells

    def test_an_honest_snapshot_comes_without_a_warning(self) -> None:
        assert not any(attributes.get("class") == "wrong" for _, attributes in read(page()).tags)

    def test_a_mismatch_is_shown(self) -> None:
        stability = whole().stability
        assert stability is not None
        first = stability.vehicles[0]
        first = replace(first, linf_exact=replace(first.linf_exact, value=9.0))
        wrong = replace(
            whole(), stability=replace(stability, vehicles=(first, *stability.vehicles[1:]))
        )
        reader = read(render_report(wrong))
        assert any(cell.startswith("NO: ") for cell in reader.within("td"))
        assert any(attributes.get("class") == "wrong" for _, attributes in reader.tags)
        assert "9.000" not in reader.within("td"), "stability is shown as it was recomputed"

    def test_curves_are_those_of_the_snapshot(self) -> None:
        made = motion(whole())
        assert made is not None
        segment = whole().segment
        assert segment is not None
        speed = next(t for t in made.figure.data if t.yaxis == "y2")
        assert np.max(speed.y) == pytest.approx(segment.speeds[:, 0].max())
        without = motion(replace(whole(), segment=None))
        assert without is not None
        assert "not part of this report" in without.caption

    def test_without_data_no_data_are_drawn(self) -> None:
        names = [
            trace.name
            for picture in fits(replace(whole(), segment=None))
            for trace in picture.figure.data
        ]
        assert set(names) == {"network"}


class TestForeignText:
    def test_is_shown_as_it_is(self) -> None:
        reader = read(hostile_page())
        assert any(HOSTILE in text for text in reader.within("h1"))
        assert any(HOSTILE in text for text in reader.within("blockquote"))
        assert not any(tag == "img" for tag, _ in reader.tags)
        assert len([tag for tag, _ in reader.tags if tag == "script"]) == 3

    def test_cannot_end_the_drawings(self) -> None:
        names = [
            str(trace.get("name", "")) for d in drawings(hostile_page()) for trace in d["data"]
        ]
        assert any("&lt;/script&gt;" in name for name in names), "plotly reads a little HTML"
        assert not any("<" in name for name in names if "alert" in name)

    def test_in_attributes_stays_inside(self) -> None:
        for _, attributes in read(hostile_page()).tags:
            assert not any(name.startswith("on") for name in attributes)


def runs(words: list[str], capsys: pytest.CaptureFixture[str]) -> tuple[int, str, str]:
    status = main(words)
    done = capsys.readouterr()
    return status, done.out, done.err


class TestCommand:
    @pytest.fixture
    def file(self, tmp_path: Path) -> Path:
        return save(small(), tmp_path / "small.accpinn.zip")

    def test_writes_beside_the_snapshot(
        self, file: Path, capsys: pytest.CaptureFixture[str]
    ) -> None:
        status, out, _ = runs(["report", str(file)], capsys)
        written = file.with_name("small.html")
        assert status == 0
        assert out.strip() == str(written)
        assert load(file).id in written.read_text(encoding="utf-8")

    def test_what_does_not_agree_is_written_and_said(
        self, tmp_path: Path, capsys: pytest.CaptureFixture[str]
    ) -> None:
        laws = tuple(replace(law, beta=2 * law.beta) for law in small().fit.parameters)
        forged = replace(small(), fit=replace(small().fit, parameters=laws))
        file = save(forged, tmp_path / "forged.accpinn.zip")
        status, out, err = runs(["report", str(file)], capsys)
        assert status == 1
        assert Path(out.strip()).exists()
        assert "figures differ" in err
        assert err.endswith("with a warning at its top.\n")

    def test_a_recording_brings_the_data_back(
        self, tmp_path: Path, capsys: pytest.CaptureFixture[str]
    ) -> None:
        file = save(replace(whole(), segment=None), tmp_path / "no_data.accpinn.zip")
        words = ["report", str(file), "--recording", str(FOLDER / f"{PLATOON}.csv")]
        assert runs(words, capsys)[0] == 0
        text = (tmp_path / "no_data.html").read_text(encoding="utf-8")
        assert "Measured space-gaps and speeds" in text
        assert any(cell.startswith("gap MAE") for cell in read(text).within("td"))

    def test_writes_where_it_is_told(
        self, file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
    ) -> None:
        assert runs(["report", str(file), "-o", str(tmp_path / "r.html")], capsys)[0] == 0
        assert (tmp_path / "r.html").stat().st_size > 4_000_000

    def test_what_is_no_snapshot_is_refused_in_a_sentence(
        self, tmp_path: Path, capsys: pytest.CaptureFixture[str]
    ) -> None:
        (tmp_path / "x.accpinn.zip").write_bytes(b"no zip")
        status, _, err = runs(["report", str(tmp_path / "x.accpinn.zip")], capsys)
        assert status == 1
        assert err.startswith("error: ")
        assert not (tmp_path / "x.html").exists()

    def test_a_place_that_cannot_be_written_is_named(
        self, file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
    ) -> None:
        status, _, err = runs(["report", str(file), "-o", str(tmp_path / "no" / "r.html")], capsys)
        assert status == 1
        assert "the report could not be written" in err
