"""The result strip: numbers and marks of its rows, and what its markup shows of them."""

import math
from collections.abc import Callable
from dataclasses import replace
from math import inf, nan

import numpy as np
import pytest

from accpinn.inference.gain_check import GainCheck
from accpinn.inference.intervals import from_draws
from accpinn.model.cthp import Parameters
from accpinn.model.published import ASTAZERO, ParameterSet
from accpinn.results.figures.strip import REACH, axis_around, strip_html
from accpinn.results.figures.style import vehicle_colours
from accpinn.results.marks import EXTRAPOLATED, LEGEND, MEASURED, OUTSIDE
from accpinn.results.strip import Strip, strip_of
from accpinn.results.tables import Column, Marked, Table
from accpinn.study.result import Result
from accpinn.study.vehicles import AssessedVehicles, assessed_vehicles
from accpinn.units import Quantity
from tests.support.html import Reader
from tests.support.snapshots import missing_the_drive, recommended, trained, two_windows

LOUD, CALM = Parameters(0.08, 0.12, 1.5), Parameters(0.05, 0.6, 1.8)


def strip(result: Result) -> Strip:
    return strip_of(assessed_vehicles(result))


@pytest.mark.parametrize("made", [trained, recommended, two_windows])
def test_a_row_holds_what_the_estimate_says(made: Callable[[], Result]) -> None:
    result = made()
    shown, growths = strip(result), assessed_vehicles(result).growths
    assert [row.label for row in shown.rows] == [*result.info.labels[1:]]
    assert shown.speed == result.estimate.stated_speed
    for k, row in enumerate(shown.rows):
        assert row.time_gap.quantity == result.estimate.time_gap(shown.speed, k)
        assert row.growth.quantity == growths[k].gain
        assert row.growth.is_measured == growths[k].is_measured
        assert row.l2.is_point == row.linf.is_point == (result.posterior is None)
        assert math.isnan(row.growth.quantity.lower) == (result.posterior is None)


def of_shares(*shares: float) -> Strip:
    """Vehicles of which shares of the draws are string stable."""
    draws = [[CALM if draw < 100 * share else LOUD for share in shares] for draw in range(100)]
    centre = Parameters.stack([LOUD] * len(shares))
    drawn = Parameters.of(np.array([[one.complete for one in row] for row in draws]))
    names = tuple(f"Car {k}" for k in range(len(shares)))
    known = from_draws(centre, drawn, 0.9)
    return strip_of(AssessedVehicles(ParameterSet("cars", names, centre), known))


def test_a_mark_is_sure_above_95_and_below_5_percent_of_the_draws() -> None:
    rows = of_shares(0.0, 0.04, 0.5, 0.96, 1.0).rows
    said = [row.l2.assessment for row in rows]
    assert said == ["unstable", "unstable", "undecided", "stable", "stable"]
    assert not any(row.l2.is_point for row in rows)
    published = strip_of(AssessedVehicles(ASTAZERO))
    assert [row.l2.assessment for row in published.rows] == 4 * ["unstable"]


def test_the_strip_says_how_much_time_gap_string_stability_lacks() -> None:
    point = strip_of(AssessedVehicles(ASTAZERO))
    margins = [
        -vehicle.l2.distance.value for vehicle in AssessedVehicles(ASTAZERO).margins.vehicles
    ]
    most = int(np.argmax(margins))
    assert point.lacking.startswith(f"{ASTAZERO.labels[most]} needs {max(margins):.2f} s more")
    for row, margin in zip(point.rows, margins, strict=True):
        assert f"{margin:.2f} s more" in row.l2.why
    known = of_shares(0.0, 1.0)
    assert "(" in known.lacking, "with the interval of the draws"
    calm = AssessedVehicles(ParameterSet("calm", ("A",), Parameters.stack([CALM])))
    assert strip_of(calm).lacking == ""
    assert "to spare" in strip_of(calm).rows[0].l2.why
    (margin,), (alone,) = calm.margins.vehicles, calm.l2_margins
    assert alone.distance == margin.l2.distance
    assert alone.state is margin.l2.state


def test_trust_says_why_it_is_missing() -> None:
    result = recommended()
    missing, _ = missing_the_drive(result)
    first, *others = strip(missing).rows
    assert first.trust.is_trusted is False
    assert {*first.trust.brief} >= {*missing.trust[0].reasons}
    assert missing.trust[0].in_words in first.trust.why
    assert [row.trust.brief for row in others] == [
        row.trust.brief for row in strip(result).rows[1:]
    ]
    (untold, *_) = strip_of(AssessedVehicles(ASTAZERO)).rows
    assert untold.trust.is_trusted is None
    against = GainCheck(3, 9, contradiction="damps", highest=-1.0)
    rows = strip_of(AssessedVehicles(ASTAZERO, checks=(against,))).rows
    assert [row.trust.is_trusted for row in rows] == [None, False, None, None]
    two = ParameterSet("two", ("A", "B"), result.parameters[:2])
    mixed = AssessedVehicles(two, cars=((missing, 0), (result, 1)))
    trusts = [row.trust for row in strip_of(mixed).rows]
    assert trusts[0].is_trusted is False
    assert missing.trust[0].in_words in trusts[0].why
    assert trusts[1] == strip(result).rows[1].trust
    by_hand = replace(ASTAZERO, by_hand=(0.0, 0.0, 1.0, 0.0))
    rows = strip_of(AssessedVehicles(by_hand)).rows
    assert [bool(row.trust.brief) for row in rows] == [False, False, True, False]


def test_followers_that_share_their_parameters_have_one_row() -> None:
    result = recommended()
    shared = replace(result, estimate=replace(result.estimate, case="I"))
    shared.__dict__.pop("trust", None)
    (row,) = strip(shared).rows
    assert row.number == 0
    assert shared.info.followers > 1


def test_some_vehicles_alone_keep_their_colours() -> None:
    whole = strip_of(AssessedVehicles(ASTAZERO))
    part = whole.of_places({2})
    assert [row.label for row in part.rows] == [ASTAZERO.labels[2]]
    colours = vehicle_colours(ASTAZERO.vehicles)
    html = strip_html(part)
    assert colours[3] in html
    assert not any(colour in html for colour in (*colours[:3], *colours[4:]))


def test_an_axis_holds_values_and_all_but_far_too_wide_intervals() -> None:
    axis = axis_around([Quantity(1.0, 0.8, 1.3), Quantity(1.2, nan, nan)], 0.2)
    assert axis.low < 0.8 < 1.3 < axis.high
    assert axis.at(0.8) < axis.at(1.0) < axis.at(1.2) < axis.at(1.3) < 100
    wide = axis_around([Quantity(1.0, 0.2, 50.0)], 0.2)
    assert wide.at(1.0) > 30
    assert wide.at(50.0) == 100
    endless = axis_around([Quantity(inf, 1.2, inf), Quantity(1.1, 1.0, 1.2)], 0.2, 1.0)
    assert endless.at(1.0) < endless.at(1.1) < endless.at(inf) == 100
    assert endless.high < 3 * REACH
    for nothing in ([], [Quantity(nan, nan, nan)]):
        assert axis_around(nothing, 0.2).low < axis_around(nothing, 0.2).high


def test_extrapolated_and_outside_an_interval_have_marks_of_their_own() -> None:
    strip = strip_of(AssessedVehicles(ASTAZERO))
    first = strip.rows[0]
    value = first.time_gap.quantity.value
    shapes = []
    for quantity, is_extrapolated in (
        (Quantity(value, value - 0.1, value + 0.1), False),
        (Quantity(value, value - 0.1, value + 0.1), True),
        (Quantity(value, value + 0.1, value + 0.2), False),
    ):
        shown = replace(first.time_gap, quantity=quantity, is_extrapolated=is_extrapolated)
        html = strip_html(replace(strip, rows=(replace(first, time_gap=shown),)))
        shapes.append([word for word in ("ring", "square") if f'<s class="{word}"' in html])
    assert shapes == [[], ["ring"], ["square"]]
    measured = replace(first, growth=replace(first.growth, is_measured=True))
    html = strip_html(replace(strip, rows=(measured, *strip.rows[1:])))
    assert html.count('<s class="cross"') == 1, "only the growth that is measured"
    column = Column("τ", "s", 2)
    cells = Quantity(1.0, 1.1, 1.2), Marked(1.0, "extrapolated", EXTRAPOLATED.glyph)
    table = Table.of("", [(column, cells)])
    assert [column.shown(cell)[4] for cell in cells] == ["□", "○"]
    assert {line[0] for line in table.legend} == {"□", "○"}
    assert {OUTSIDE.glyph, EXTRAPOLATED.glyph, MEASURED.glyph} <= {word for word, _ in LEGEND}


def test_the_markup_has_a_reason_for_every_point_and_mark_and_no_html_of_a_name() -> None:
    named = replace(ASTAZERO, labels=("<b>A</b>", *ASTAZERO.labels[1:]))
    html = strip_html(strip_of(AssessedVehicles(named)))
    reader = Reader(html)
    assert "<b>A</b>" not in html
    assert "<b>A</b>" in " ".join(text for _, text in reader.texts)
    whys = reader.having("data-why")
    assert len(whys) == 5 * 4 + 4, "and what the marks of each column are"
    assert all(of["data-why"] and of["tabindex"] == "0" for of in whys)
    points = strip_html(strip(trained()))
    assert ("<u" in points, "<u" in strip_html(strip(recommended()))) == (False, True)


def test_what_is_not_determined_has_no_point() -> None:
    result = trained()
    values = result.parameters.values.copy()
    values[0] = nan
    lost = replace(result, estimate=replace(result.estimate, parameters=Parameters.of(values)))
    row = strip(lost).rows[0]
    assert math.isnan(row.time_gap.quantity.value)
    assert row.l2.assessment == "not determined"
    assert "nan" not in strip_html(strip(lost))
