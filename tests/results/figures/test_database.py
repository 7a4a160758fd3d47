"""A batch as figures: what the forest plot, the plane and the time gaps draw."""

import numpy as np

from accpinn import Groups, Parameters, group
from accpinn.results import marks
from accpinn.results.database import ranking_table
from accpinn.results.figures import database as figures
from accpinn.results.figures.strip import GLYPHS
from accpinn.results.tables import Marked
from accpinn.stability import assessment, stability_report
from accpinn.stability.criteria import smallest_beta_exact, smallest_beta_l2
from tests.support.figures import named, names
from tests.support.studies import row, rows

PLACE = {"file": "f.csv", "start": 0.0, "duration": 9.0}


def test_the_forest_has_every_value_with_its_interval_sorted_by_time_gap() -> None:
    given = (row("Long", tau=2.0), row("Short", tau=1.0), row("Unknown", tau=None))
    found = group(rows(*given), ("make",))
    figure = figures.forest(found)
    assert list(figure.layout.yaxis.ticktext) == ["Unknown", "Long", "Short"]
    spans = {one.values[0]: one.time_gap(100 / 3.6) for one in found.groups}
    gaps, long = named(figure, "time gap"), spans["Long"]
    np.testing.assert_array_equal(
        gaps.x, [spans[name].value for name in ("Unknown", "Long", "Short")]
    )
    further, typical = (
        bars.x[1] + np.array([-bars.error_x.arrayminus[1], bars.error_x.array[1]])
        for bars in figure.data
        if bars.xaxis == gaps.xaxis and bars.error_x.array is not None
    )
    np.testing.assert_allclose(typical, [long.lower, long.upper])
    assert further[0] <= typical[0] < typical[1] <= further[1]


def test_of_many_groups_those_with_most_windows_are_drawn() -> None:
    given = [row(f"M{k}") for k in range(figures.MOST_GROUPS + 3) for _ in range(1 + (k > 2))]
    shown = figures.forest(group(rows(*given), ("make",))).layout.yaxis.ticktext
    assert len(shown) == figures.MOST_GROUPS
    assert not {"M0", "M1", "M2"} & {*shown}
    assert len(named(figures.forest(group(rows(*given)[:0], ("make",))), "time gap").x) == 0


def measured_and_extrapolated() -> Groups:
    """Groups of which some drive 100 km/h, and shorter gaps of some that do not."""
    fast, slow = ({"lowest_speed": 20.0, "highest_speed": v} for v in (30.0, 22.0))
    return group(
        rows(
            row("Slow long", tau=1.9, **slow), row("Fast long", tau=1.8, **fast),
            row("Slow short", tau=0.6, **slow), row("Fast short", tau=0.9, **fast),
        ),
        ("make",),
    )  # fmt: skip


def test_measured_time_gaps_rank_before_extrapolated_ones_which_are_rings_and_marked() -> None:
    found, ranks = measured_and_extrapolated(), ["Fast short", "Fast long"]
    ranks += ["Slow short", "Slow long"]
    figure = figures.forest(found)
    assert list(figure.layout.yaxis.ticktext) == ranks[::-1]
    symbols = list(named(figure, "time gap").marker.symbol)
    assert symbols == [marks.EXTRAPOLATED.symbol] * 2 + [figures.MEASURED] * 2
    (line,) = [shape for shape in figure.layout.shapes if shape.y0 == shape.y1 == 1.5]
    assert line.type == "line"
    table = ranking_table(found)
    at = [column.title for column in table.columns].index("at 100 km/h")
    assert [row[0] for row in table.rows] == ranks
    assert [isinstance(row[at], Marked) for row in table.rows] == [False, False, True, True]


def test_the_marks_of_stability_are_those_of_the_groups_shares() -> None:
    found = group(rows(row("Stable", alpha=0.5, beta=3.0, tau=2.5), row("Not")), ("make",))
    figure = figures.forest(found)
    shares = {part.values[0]: part.l2_stable.value for part in found.groups}
    for name, glyph in zip(figure.layout.yaxis.ticktext, named(figure, "L₂").text, strict=True):
        assert glyph == GLYPHS[assessment(shares[name])]
    growth = named(figure, "max |H|")
    expected = [{p.values[0]: p.growth.value for p in found.groups}[n]
                for n in figure.layout.yaxis.ticktext]  # fmt: skip
    np.testing.assert_allclose(growth.x, expected)


def test_the_plane_has_every_point_on_its_side_of_both_lines() -> None:
    rng = np.random.default_rng(1)
    count = 300
    alpha, beta, tau = (rng.uniform(*ends, count) for ends in ((0.01, 0.9), (0, 1.5), (0.8, 2)))
    report = stability_report(Parameters(alpha, beta, tau)).vehicles
    known = [
        row("A", alpha=a, beta=b, tau=t, l2_stable=of.l2.stable, linf_stable=of.linf_exact.stable,
            **PLACE)
        for a, b, t, of in zip(alpha, beta, tau, report, strict=True)
    ]  # fmt: skip
    given = rows(*known, row("A", alpha=None, beta=None, tau=None))
    figure = figures.plane(given)
    l2, linf = smallest_beta_l2(alpha * tau**2, 1.0), smallest_beta_exact(alpha * tau**2, 1.0)
    drawn = 0
    for name, (above_l2, above_linf) in zip(
        [look[0] for look in figures.CLASSES[:3]],
        ((False, False), (True, False), (True, True)), strict=True,
    ):  # fmt: skip
        points = named(figure, name)
        places = np.asarray(points.customdata, int)
        drawn += len(places)
        assert len(places) > 20
        np.testing.assert_allclose(points.x, alpha[places] * tau[places] ** 2, atol=1e-5)
        y = beta[places] * tau[places]
        assert ((y >= l2[places]) == above_l2).all()
        assert ((y >= linf[places]) == above_linf).all()
    assert drawn == count
    for name, smallest in (("L₂", smallest_beta_l2), ("L∞, exact", smallest_beta_exact)):
        line = named(figure, name)
        np.testing.assert_allclose(line.y, smallest(np.asarray(line.x), 1.0))
    right, top = figure.layout.xaxis.range[1], figure.layout.yaxis.range[1]
    x, y = alpha * tau**2, beta * tau
    assert figures.beyond(figure) == int(((x > right) | (y > top)).sum())


def test_no_boundary_is_drawn_where_a_vehicle_has_one_of_its_own() -> None:
    given = rows(row("A", **PLACE), row("B", delay=0.4, l2_stable=False, **PLACE))
    figure = figures.plane(given)
    assert not {"L₂", "L∞, exact"} & {*names(figure)}
    assert figure.layout.xaxis.title.text.startswith("α,")


def test_time_gaps_are_drawn_by_group_and_few_have_a_colour() -> None:
    labels = [f"M{k}" for k in range(figures.MOST_NAMED + 2) for _ in range(1 + (k < 10))]
    given = rows(*(row(one, mean_speed=float(k), **PLACE) for k, one in enumerate(labels)))
    figure = figures.gap_against_speed(given, labels)
    assert set(names(figure)) == {*labels[:20], figures.OTHERS}
    assert sorted(np.concatenate([trace.customdata for trace in figure.data])) == [*range(22)]
    assert list(named(figure, "M3").x) == [6.0, 7.0]
