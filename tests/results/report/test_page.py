"""The report: complete, in order, escaped, self-contained, and true to its snapshot."""

import base64
import hashlib
import json
import re
from dataclasses import replace
from functools import cache
from html.parser import HTMLParser
from typing import Any

import numpy as np
import pytest

from accpinn.results.report import (
    fit_pictures,
    motion_picture,
    platoon_pictures,
    render_report,
    tables_of,
)
from accpinn.results.tables.estimates import name_of
from accpinn.results.tables.stability import GAIN
from accpinn.results.vehicles import known_vehicles
from accpinn.study.verification import QUICK, Verification, verify
from tests.support.snapshots import altered, delayed, small, whole

HOSTILE = "</script><script>alert(1)</script>\"'><img src=x onerror=alert(1)>$y$_z_&amp;"
ORDER = [
    "Data", "Parameters", "Fit", "String stability", "A platoon of such vehicles",
    "Methods compared", "Provenance", "How to cite",
]  # fmt: skip
VOID = {"meta", "img", "br", "link", "input"}


class Reader(HTMLParser):
    """Elements, texts and scripts of a page; anything left open or closed twice is a fault."""

    def __init__(self, page: str) -> None:
        """Read at once."""
        super().__init__()
        self.open: list[str] = []
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.texts: list[tuple[str, str]] = []
        self.feed(page)
        self.close()
        assert self.open == []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attrs)))
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        self.texts.append((self.open[-1] if self.open else "", data))

    def within(self, tag: str) -> list[str]:
        return [text for inside, text in self.texts if inside == tag]

    @property
    def warned(self) -> bool:
        return any(attributes.get("class") == "wrong" for _, attributes in self.tags)


@cache
def page() -> str:
    return render_report(whole())


@cache
def hostile_page() -> str:
    info = replace(whole().info, names=(HOSTILE,) * 5, source=HOSTILE)
    return render_report(
        altered(
            replace(whole(), name=HOSTILE, note=HOSTILE, facts={"campaign": HOSTILE}), info=info
        )
    )


def drawings(text: str) -> list[dict[str, Any]]:
    found = re.search(r'id="drawings">(.*?)</script>', text, re.DOTALL)
    return json.loads(found[1])


class TestPage:
    def test_has_its_sections_in_order(self) -> None:
        assert [text.strip() for text in Reader(page()).within("h2")] == ORDER

    def test_the_intervals_under_a_better_form_stand_beside_those_of_the_cthp(self) -> None:
        changed = altered(small(), adequacy=delayed())
        text = " ".join(text for _, text in Reader(render_report(changed, Verification(()))).texts)
        assert "(0.72–1.08)" in text, "of the delay"
        assert changed.adequacy.better[0].sentence(changed.info) in text

    def test_holds_plotly_once_loads_nothing_and_stays_below_6_mb(self) -> None:
        assert page().count("plotly.js v") == 1
        assert len(page().encode()) < 6_000_000
        allowed = ("data:", "https://creativecommons.org/", "https://doi.org/")
        for _, attributes in Reader(page()).tags:
            assert "src" not in attributes
            assert (attributes.get("href") or "data:").startswith(allowed)

    def test_only_its_own_scripts_may_run(self) -> None:
        policy = next(a["content"] for _, a in Reader(page()).tags if a.get("http-equiv"))
        assert "default-src 'none'" in policy
        scripts = re.findall(r"<script(?: id=\"plotly\")?>(.*?)</script>", page(), re.DOTALL)
        assert len(scripts) == 2
        for script in scripts:
            digest = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
            assert f"'sha256-{digest}'" in policy

    def test_every_drawing_has_a_place_and_few_digits(self) -> None:
        made = drawings(page())
        places = [int(a["data-place"] or -1) for _, a in Reader(page()).tags if "data-place" in a]
        assert places == list(range(len(made)))
        assert [drawing["name"] for drawing in made][:3] == ["fit_1", "bode", "motion"]
        packed = [trace[axis] for drawing in made for trace in drawing["data"] for axis in "xy"
                  if isinstance(trace.get(axis), dict)]  # fmt: skip
        assert "f4" in {numbers["dtype"] for numbers in packed}

    def test_a_bare_result_makes_a_page_too(self) -> None:
        bare = replace(small(), segments=(), compared=())
        headings = [text.strip() for text in Reader(render_report(bare)).within("h2")]
        assert headings == [title for title in ORDER if title != "Methods compared"]


class TestContents:
    def test_tables_hold_the_snapshots_numbers(self) -> None:
        cells = Reader(page()).within("td")
        for one in whole().fit.parameters:
            for number in (f"{one.alpha:.4f}", f"{one.tau:.3f}"):
                assert any(cell.startswith(number) for cell in cells)
        table = tables_of(whole())["stability"]
        at = table.columns.index(GAIN)
        for row, vehicle in zip(table.rows, known_vehicles(whole()).report.vehicles, strict=True):
            assert row[at].value == vehicle.linf_gain
            assert any(cell.startswith(GAIN.shown(row[at]).split()[0]) for cell in cells)

    def test_tables_are_offered_as_files(self) -> None:
        files = {a["download"]: a["href"] for _, a in Reader(page()).tags if "download" in a}
        assert {"parameters.csv", "parameters.tex", "stability.csv", "methods_1.csv"} <= set(files)
        address = files["parameters.csv"]
        text = base64.b64decode(address.split("base64,")[1]).decode()
        assert str(whole().fit.parameters.alpha[0]) in text

    def test_what_was_checked_stands_beside_what_was_found(self) -> None:
        reader, checks = Reader(page()), verify(whole(), refit_within=QUICK).checks
        cells = reader.within("td")
        assert checks
        for check in checks:
            assert {check.title, check.sentence} <= set(cells)
        assert not reader.warned

    def test_a_mismatch_is_shown(self) -> None:
        quality = whole().quality
        forged = replace(quality, mean_time_gap=(9.0, *quality.mean_time_gap[1:]))
        reader = Reader(render_report(altered(whole(), quality=forged)))
        assert "NO" in reader.within("td")
        assert reader.warned

    def test_curves_are_the_data_where_they_are_known(self) -> None:
        made, segment = motion_picture(whole()), whole().segment
        speed = next(t for t in made.figure.data if t.yaxis == "y2")
        assert np.max(speed.y) == pytest.approx(segment.speeds[:, 0].max())
        without = replace(whole(), segments=())
        made = motion_picture(without)
        assert "not part of this report" in made.caption
        names = {trace.name for picture in fit_pictures(without) for trace in picture.figure.data}
        assert names == {name_of(whole().fit)}

    def test_the_platoon_is_that_of_the_study(self) -> None:
        stability, made = known_vehicles(whole()).report, platoon_pictures(whole())
        run, pictures, who = made
        assert who == "The 4 followers in their order"
        assert run.leader.frequency == stability.platoon.peaks[-1].omega
        assert run.trajectories.gaps.shape[1] == 4
        assert [picture.name for picture in pictures] == ["platoon", "amplitude"]


class TestForeignText:
    def test_is_shown_as_it_is(self) -> None:
        reader = Reader(hostile_page())
        assert any(HOSTILE in text for text in reader.within("h1"))
        assert any(HOSTILE in text for text in reader.within("blockquote"))
        assert not any(tag == "img" for tag, _ in reader.tags)
        assert len([tag for tag, _ in reader.tags if tag == "script"]) == 3
        for _, attributes in reader.tags:
            assert not any(name.startswith("on") for name in attributes)

    def test_cannot_end_the_drawings(self) -> None:
        traces = [trace for drawn in drawings(hostile_page()) for trace in drawn["data"]]
        names = [str(trace.get("name", "")) for trace in traces]
        assert any("&lt;/script&gt;" in name for name in names), "plotly reads a little HTML"
        assert not any("<" in name for name in names if "alert" in name)
