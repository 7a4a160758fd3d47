"""A result has one time gap, growth, verdict and margin, wherever they are shown."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import astuple, replace
from math import nan
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from accpinn import save
from accpinn.model.cthp import Parameters
from accpinn.recordings import Window
from accpinn.results.documents import answer_document, describe_fit, parameter_card
from accpinn.results.messages.estimate import cards, time_gap_in_words
from accpinn.results.report import tables_of
from accpinn.results.strip import strip_of
from accpinn.results.tables.stability import margin_table
from accpinn.stability import assessment
from accpinn.study import Analysis
from accpinn.study.result import Result
from accpinn.study.rows import rows_of
from accpinn.study.run import run
from accpinn.study.store import Entry
from accpinn.study.vehicles import assessed_vehicles
from tests.support.command import Capture, document
from tests.support.snapshots import platoon, recommended

RECORDING = ("campaign", "file", "trajectory", "sha256", "date", "distance_setting")
ENDS = ("", "_low", "_high")


def shared_point() -> Result:
    """A point, without intervals, for followers that share their parameters."""
    windows = [Window(0.0, 60.0)]
    asked = Analysis.of(platoon(), windows, "1-3", case="I", method="splines")
    return run(asked, platoon())


def cells(row: Mapping[str, Any], name: str) -> list[float]:
    """A value with the ends of its interval, nan where there are none."""
    values = (row.get(f"{name}{end}") for end in ENDS)
    return [nan if value is None else float(value) for value in values]


def assert_same(places: Mapping[str, Sequence[float]]) -> None:
    """Whether all places have the numbers of the first."""
    first, *others = places
    for place in others:
        np.testing.assert_allclose(
            places[place], places[first], rtol=1e-9, err_msg=f"{place} and {first}"
        )


@pytest.mark.parametrize("make", [recommended, shared_point])
def test_a_result_has_the_same_numbers_wherever_they_are_shown(
    make: Callable[[], Result], tmp_path: Path, capsys: Capture
) -> None:
    result = make()
    estimate, drawn, subject = result.estimate, result.uncertainty, assessed_vehicles(result)
    speed = estimate.stated_speed
    gap_at = f"time_gap_at_{3.6 * speed:.0f}_kmh_s"
    entry, strip, tables = Entry.of("a", result), strip_of(subject).rows, tables_of(result)
    rows = rows_of(result, dict.fromkeys(RECORDING, ""), ("", ""))
    path = save(result, tmp_path / "a.accpinn.zip")
    by_command = document(capsys, "stability", path)["vehicles"]
    card, fitted = parameter_card(result)["vehicles"], describe_fit(result)
    report, stability, python, margins = (
        table.to_frame().to_dict("records")
        for table in (tables["parameters"], tables["stability"], result, margin_table(subject))
    )
    attributes = result.margin().to_frame().to_dict("records")

    for k, vehicle in enumerate(result.stability.vehicles):
        at = min(k, len(strip) - 1)  # one row for followers that share their parameters
        gap = estimate.time_gap(speed, k)
        gaps = {
            "Python": [gap.value, gap.lower, gap.upper],
            "strip": [*astuple(strip[at].time_gap.quantity)[:3]],
            "list": [*astuple(entry.time_gaps[at])],
            "report": cells(report[at], gap_at),
            "frame": cells(python[k], gap_at),
        }
        if result.posterior:
            answer = answer_document(result)[k]
            key = f"{3.6 * speed:.0f}"
            gaps["document"] = [answer["time_gap"][key], *answer["time_gap_intervals"][key]]
        assert_same(gaps)
        assert time_gap_in_words(gap, speed, estimate.level) in cards(result)[at].lead

        peak, ends = vehicle.peak.gain, [nan, nan]
        if drawn:
            ends = [float(drawn.peak_gain.lower[k]), float(drawn.peak_gain.upper[k])]
        decibels = cells(stability[k], "l2_string_stability_peak_db")
        command = [
            by_command[k]["peak"]["gain"],
            *by_command[k].get("intervals", {}).get("peak_gain", ends),
        ]
        growths = {
            "Python": [peak, *ends],
            "table": [10 ** (value / 20) for value in decibels],
            "command": command,
        }
        if drawn:
            growths["document"] = [peak, *fitted["intervals"][k]["peak_gain"]]
        assert_same(growths)
        growth = by_command[k]["growth"]
        assert_same(
            {
                "Python": [*astuple(subject.growths[k].gain)],
                "strip": [*astuple(strip[at].growth.quantity)],
                "list": [*astuple(entry.growths[at])],
                "command": [growth["gain"], *(growth["interval"] or (nan, nan))],
            }
        )

        share = float(drawn.probability_l2[k] if drawn else vehicle.l2.stable)
        shares = {"Python": share, "batch": float(rows[k]["l2_stable"])}
        if drawn:
            shares = {
                "Python": share,
                "batch": rows[k]["p_l2_stable"],
                "command": by_command[k]["probability_l2"],
                "card": card[k]["probability_l2_stable"],
                "table": stability[k]["l2_string_stability_probability_percent"] / 100,
            }
        assert_same({place: [value] for place, value in shares.items()})
        assert strip[at].l2.assessment == assessment(share)

        assert_same(
            {
                "Python": cells(attributes[k], "margin_l2"),
                "batch": cells(rows[k], "margin_l2"),
                "table": cells(margins[k], "l2_string_stability_margin_s"),
                "report": cells(stability[k], "margin_l2"),
                "command": [
                    by_command[k]["margin"]["l2"]["margin"],
                    *by_command[k]["margin"]["l2"].get("interval", (nan, nan)),
                ],
            }
        )


def test_a_delay_at_its_least_value_is_an_end_of_its_interval_everywhere() -> None:
    result = recommended()
    least = result.parameters.everything.copy()
    least[:, 5] = 0.01  # below all draws of the delay
    at_least = replace(result, estimate=replace(result.estimate, parameters=Parameters.of(least)))
    span, drawn = at_least.estimate.span("delay", 0), at_least.uncertainty
    assert drawn is not None
    assert (span.value, span.lower, drawn.lower.delay[0]) == (0.01, 0.01, 0.01)
    document = answer_document(at_least)[0]["intervals"]["delay"]
    assert document == [span.lower, float(drawn.upper.delay[0])]
