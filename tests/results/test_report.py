"""The report, self-contained and true to its snapshot; and everything of a result in one file."""

import base64
import hashlib
import io
import json
import re
import zipfile
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pandas as pd
import pytest

from accpinn import Parameters, load, render_report
from accpinn.methods.estimate import Outcome
from accpinn.results.figures.training import SIMULATION, driven
from accpinn.results.messages import estimate as on_estimate
from accpinn.results.messages import summary as on_result
from accpinn.results.report import (
    bundle,
    curve_pictures,
    motion_picture,
    platoon_pictures,
    tables_of,
)
from accpinn.results.tables.stability import GAIN
from accpinn.study.result import Result
from accpinn.study.vehicles import assessed_vehicles
from accpinn.study.verification import PROMPT, Verification, verify
from tests.support.html import Reader
from tests.support.snapshots import (
    altered,
    delayed,
    recommended,
    result_for,
    small,
    trained,
    two_windows,
    whole,
)

pytestmark = pytest.mark.usefixtures("cthp_alone")
UNCHECKED = Verification(())

HOSTILE = "</script><script>alert(1)</script>\"'><img src=x onerror=alert(1)>$y$_z_&amp;"


def drawings(page: str) -> list[dict[str, Any]]:
    return json.loads(re.search(r'id="drawings">(.*?)</script>', page, re.DOTALL)[1])


@pytest.fixture(scope="module")
def page() -> str:
    return render_report(whole())


@pytest.fixture(scope="module")
def reader(page: str) -> Reader:
    return Reader(page)


def text_of(page: str) -> str:
    return " ".join(text for inside, text in Reader(page).texts if inside != "script")


def test_the_page_has_its_sections_whatever_is_known(reader: Reader) -> None:
    bare = Reader(render_report(small(), UNCHECKED))
    assert {*reader.within("h2")} - {*bare.within("h2")} == {"Methods compared", "Note"}
    assert len(bare.within("h2")) == 8


def test_a_point_has_no_interval_and_says_so_where_a_posterior_has_them() -> None:
    point, known = (text_of(render_report(r, UNCHECKED)) for r in (trained(), recommended()))
    assert "the paper's estimate: a point" in point
    assert "% interval" not in point
    assert "Probability" not in point
    for part in ("(90 % interval)", "Further window", "Probability", "a point"):
        assert (part in known) == (part != "a point")
    assert recommended().posterior.method in known


def test_every_table_is_one_of_the_one_estimate() -> None:
    assert [*tables_of(trained())][:2] == ["parameters", "errors"]
    assert {"windows_1", "parameters", "errors", "stability"} <= {*tables_of(two_windows())}
    point = result_for(recommended().segments[0])
    beside = tables_of(replace(point, compared=(recommended(), point)))["methods_1"]
    assert [row[0] for row in beside.rows] == ["PiNN (calibrated preset)", "Least squares"]


def lost() -> Result:
    """An estimate that leaves the first follower's τ open."""
    values = trained().parameters.values.copy()
    values[0] = 0.0, 0.2, np.nan
    return altered(trained(), parameters=Parameters.of(values), outcome=Outcome.STOPPED)


@pytest.mark.parametrize("made", [small, trained, recommended, two_windows, lost])
def test_every_table_and_sentence_is_whole_whatever_the_estimate_has(
    made: Callable[[], Result],
) -> None:
    result = made()
    shown = [
        text
        for table in tables_of(result).values()
        for text in (table.to_text(), table.to_csv(), table.to_latex(), table.to_html())
    ]
    cards = [f"{card.lead} {card.trust}" for card in on_estimate.cards(result)]
    cards += [f"{card.lead} {card.trust}" for card in on_estimate.cards(result, together=True)]
    about = [on_estimate.about_estimate(result), on_estimate.assumption(result)]
    checks = [why for check in on_estimate.checks(result) for why in check.why]
    for text in (*shown, *cards, *about, *checks, *on_result.summary(result)):
        assert text
        assert not re.search(r"\bnan\b|\bNone\b|\binf\b", text)
    has_intervals = result.posterior is not None
    assert any("interval" in text for text in cards) == has_intervals


def test_without_curves_no_series_is_in_the_page() -> None:
    """Whoever must not share a recording can share this page."""
    page = render_report(recommended(), UNCHECKED, with_curves=False)
    drawn = drawings(page)
    names = [drawing["name"] for drawing in drawn]
    assert not [name for name in names if name == "motion" or name.startswith("curves")]
    assert {"bode", "course"} <= {*names}
    traces = {str(trace.get("name")) for drawing in drawn for trace in drawing["data"]}
    assert not {"data", "network", SIMULATION, "disturbance"} & traces
    measured = recommended().segments[0].measured.gaps[:, 0].astype(np.float32)
    hidden = base64.b64encode(measured[:300].tobytes()).decode()[:40]
    assert hidden not in page
    places = [int(a["data-place"]) for a in Reader(page).having("data-place")]
    assert places == list(range(len(drawn)))


def test_the_intervals_under_a_better_form_stand_beside_those_of_the_cthp() -> None:
    changed = replace(small(), compared=(small(),))
    changed.__dict__["adequacy"] = delayed()
    text = text_of(render_report(changed, UNCHECKED))
    assert "(0.72–1.08)" in text, "of the delay"
    assert changed.adequacy.better[0].sentence(changed.info) in text


def test_it_loads_nothing_runs_its_own_scripts_alone_and_stays_below_6_mb(
    page: str, reader: Reader
) -> None:
    assert page.count("plotly.js v") == 1
    assert len(page.encode()) < 6_000_000
    assert not reader.having("src")
    allowed = ("data:", "https://creativecommons.org/", "https://doi.org/")
    assert all(attributes["href"].startswith(allowed) for attributes in reader.having("href"))
    (policy,) = (attributes["content"] for attributes in reader.having("http-equiv"))
    assert "default-src 'none'" in policy
    scripts = re.findall(r"<script(?: id=\"plotly\")?>(.*?)</script>", page, re.DOTALL)
    digests = [base64.b64encode(hashlib.sha256(script.encode()).digest()) for script in scripts]
    assert re.findall(r"'sha256-(.*?)'", policy) == [digest.decode() for digest in digests]
    assert len(scripts) == 2


def test_every_drawing_has_a_place_and_few_digits(page: str, reader: Reader) -> None:
    drawn = drawings(page)
    places = [int(attributes["data-place"]) for attributes in reader.having("data-place")]
    assert places == list(range(len(drawn)))
    assert [drawing["name"] for drawing in drawn][:3] == ["bode", "waves", "motion"]
    traces = [trace for drawing in drawn for trace in drawing["data"]]
    packed = [trace[axis] for trace in traces for axis in "xy" if isinstance(trace.get(axis), dict)]
    assert "f4" in {numbers["dtype"] for numbers in packed}


def test_tables_hold_the_snapshots_numbers_and_are_offered_as_files(reader: Reader) -> None:
    cells = tuple(reader.within("td"))
    shown = [
        number for one in whole().parameters for number in (f"{one.alpha:.4f}", f"{one.tau:.3f}")
    ]
    table = tables_of(whole())["stability"]
    at = table.columns.index(GAIN)
    gains = [row[at] for row in table.rows]
    assert gains == [v.linf_gain for v in assessed_vehicles(whole()).report.vehicles]
    shown += map(GAIN.shown, gains)
    assert not [number for number in shown if not any(cell.startswith(number) for cell in cells)]
    files = {a["download"]: a["href"] for a in reader.having("download")}
    assert {"parameters.csv", "parameters.tex", "stability.csv", "methods_1.csv"} <= set(files)
    text = base64.b64decode(files["parameters.csv"].split("base64,")[1]).decode()
    assert str(whole().parameters.alpha[0]) in text


def test_what_was_checked_stands_beside_what_was_found(reader: Reader) -> None:
    checks = verify(whole(), refit_within=PROMPT).checks
    assert checks
    assert {part for c in checks for part in (c.title, c.sentence)} <= set(reader.within("td"))
    forged = altered(whole(), parameters=Parameters.of(whole().parameters.values * 1.1))
    forged = Reader(render_report(forged))
    assert "NO" in forged.within("td")
    for one, count in ((reader, 0), (forged, 1)):
        assert [attributes["class"] for attributes in one.having("class")].count("wrong") == count


def test_the_first_page_says_how_it_was_verified() -> None:
    checked = verify(small())
    page = render_report(small(), checked)
    first = page[: page.index("<main>")]
    assert checked.mark in first
    assert f"accpinn {checked.accpinn}, methods run again" in first
    assert 'class="strip-row"' in first
    assert first.count("data-place") == 2, "Bode magnitude and platoon"
    unchecked = render_report(small(), verify(small(), refit_within=0.0))
    assert "– Not verified: nothing was computed again" in unchecked[: page.index("<main>")]


def test_a_cell_has_its_heading_where_a_table_is_a_list(reader: Reader) -> None:
    titles = {a["data-title"] for a in reader.having("data-title")}
    assert {"Parameters α [1/s²]", "Follower"} <= titles


def test_pictures_show_the_data_the_curves_and_the_simulation() -> None:
    made, segment = motion_picture(whole()), whole().segment
    speed = next(t for t in made.figure.data if t.yaxis == "y2")
    assert np.max(speed.y) == pytest.approx(segment.speeds[:, 0].max())
    names = {trace.name for picture in curve_pictures(whole()) for trace in picture.figure.data}
    assert names == {"data", "network", SIMULATION}


def test_the_platoon_is_that_of_the_study() -> None:
    run, _, pictures, who = platoon_pictures(whole())
    assert who == "The 4 followers in their order"
    assert run.leader.frequency == assessed_vehicles(whole()).report.platoon.peaks[-1].omega
    assert run.trajectories.gaps.shape[1] == 4
    assert [picture.name for picture in pictures] == ["platoon", "amplitude"]


def test_foreign_text_is_shown_as_it_is_and_cannot_end_the_drawings() -> None:
    info = replace(whole().info, names=(HOSTILE,) * 5, source=HOSTILE)
    noted = replace(whole(), name=HOSTILE, note=HOSTILE, facts={"campaign": HOSTILE})
    page = render_report(altered(noted, info=info), UNCHECKED)
    reader = Reader(page)
    for element in ("h1", "blockquote"):
        assert any(HOSTILE in text for text in reader.within(element))
    tags = [tag for tag, _ in reader.tags]
    assert (tags.count("img"), tags.count("script")) == (0, 3)
    assert not any(name.startswith("on") for _, attributes in reader.tags for name in attributes)
    traces = [trace for drawn in drawings(page) for trace in drawn["data"]]
    names = [str(trace.get("name", "")) for trace in traces]
    assert any("&lt;/script&gt;" in name for name in names), "plotly reads a little HTML"
    assert not any("<" in name for name in names if "alert" in name)


def test_a_bundle_holds_report_snapshot_tables_history_and_motion() -> None:
    assert bundle(small()) == bundle(small())
    archive = zipfile.ZipFile(io.BytesIO(bundle(whole())))

    def curves(name: str) -> pd.DataFrame:
        return pd.read_csv(io.BytesIO(archive.read(f"{name}.csv")))

    assert {"report.html", "tables/parameters.csv", "tables/stability.tex",
            "tables/methods_1.csv"} <= {*archive.namelist()}  # fmt: skip
    assert load(archive.read("result.accpinn.zip")).parameters == whole().parameters
    segment, learned = whole().segment, whole().history.parameters
    for name, column, expected in (
        ("motion_measured", "gap_2_m", segment.gaps[:, 0]),
        ("motion_measured", "speed_1_m_per_s", segment.speeds[:, 0]),
        ("motion_simulation", "gap_3_m", driven(whole(), 1).gaps[:, 0]),
        ("motion_pinn", "gap_3_m", whole().curves[0].gaps[:, 1]),
        ("training", "tau_2_s", learned.tau[:, 0]),
        ("training", "alpha_2_per_s2", learned.alpha[:, 0]),
    ):
        np.testing.assert_allclose(curves(name)[column], expected, rtol=1e-7)
