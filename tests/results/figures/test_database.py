"""A batch as figures: what the forest plot, the plane and the time gaps draw."""

import numpy as np

from accpinn import Parameters, group
from accpinn.results.figures import database as figures
from accpinn.stability.criteria import l2_criterion
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


def test_the_plane_has_every_point_on_its_side_of_the_line() -> None:
    rng = np.random.default_rng(1)
    alpha, beta, tau = rng.uniform(0.01, 0.5, 50), rng.uniform(0, 1.5, 50), rng.uniform(0.8, 2, 50)
    stable = l2_criterion(Parameters(alpha, beta, tau)) >= 0
    vehicles = zip(alpha, beta, tau, stable, strict=True)
    known = [
        row("A", alpha=a, beta=b, tau=t, l2_stable=bool(s), **PLACE) for a, b, t, s in vehicles
    ]
    given = rows(*known, row("A", alpha=None, beta=None, tau=None))
    figure = figures.plane(given, in_units_of_tau=True)
    line = named(figure, "L₂")
    for name, expected in (("L₂ stable", True), ("L₂ unstable", False)):
        points = named(figure, name)
        assert sorted(points.customdata) == list(np.flatnonzero(stable == expected))
        shown = np.asarray(points.x) < line.x[-1]
        above = np.asarray(points.y) >= np.interp(points.x, line.x, line.y)
        assert (above[shown] == expected).mean() > 0.99, "but for the line's chords"
    plain, at = figures.plane(given), float(np.median(tau))
    line = named(plain, "L₂")
    np.testing.assert_allclose(line.y, np.maximum((2 - line.x * at**2) / (2 * at), 0))
    right, top = plain.layout.xaxis.range[1], plain.layout.yaxis.range[1]
    assert figures.beyond(plain) == int(((alpha > right) | (beta > top)).sum())


def test_time_gaps_are_drawn_by_group_and_few_have_a_colour() -> None:
    labels = [f"M{k}" for k in range(figures.MOST_NAMED + 2) for _ in range(1 + (k < 10))]
    given = rows(*(row(one, mean_speed=float(k), **PLACE) for k, one in enumerate(labels)))
    figure = figures.gap_against_speed(given, labels)
    assert set(names(figure)) == {*labels[:20], figures.OTHERS}
    assert sorted(np.concatenate([trace.customdata for trace in figure.data])) == [*range(22)]
    assert list(named(figure, "M3").x) == [6.0, 7.0]
