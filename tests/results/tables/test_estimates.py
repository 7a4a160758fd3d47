"""Tables of estimates, stability and amplitudes: the right numbers under the right headings."""

import csv
import io
from dataclasses import astuple, replace
from functools import cache
from typing import Any

import numpy as np
import pytest

from accpinn.methods.estimate import Outcome
from accpinn.methods.findings import Undetermined
from accpinn.methods.pinn.config import FAST, PAPER
from accpinn.model.cthp import Parameters
from accpinn.model.published import ASTAZERO, ParameterSet
from accpinn.model.spec import ModelSpec
from accpinn.platoon import simulate_platoon
from accpinn.platoon.leader import Recorded, Sinusoid, SpeedStep
from accpinn.recordings import Window
from accpinn.results.cast import Cast
from accpinn.results.figures.platoon import growth_by_vehicle
from accpinn.results.naming import name_of
from accpinn.results.recording import quality_table
from accpinn.results.tables import FIXED, Marked, Range, Table
from accpinn.results.tables.estimates import (
    ALL_WINDOWS,
    EVERY_FOLLOWER,
    UNDETERMINED,
    earlier_table,
    earlier_title,
    errors_table,
    methods_table,
    outside_interval,
    parameter_table,
    windows_table,
)
from accpinn.results.tables.stability import (
    amplitude_table,
    assessment_table,
    criteria_part,
    measured_gain_table,
    stability_table,
    verdict_table,
)
from accpinn.segment.cut import cut
from accpinn.stability import assessment, stability_report
from accpinn.stability.measured_gain import measured_gain
from accpinn.study import Analysis
from accpinn.study.comparison import compare
from accpinn.study.result import Result
from accpinn.study.run import run
from accpinn.study.vehicles import AssessedVehicles, assessed_vehicles
from accpinn.units import Quantity
from tests.support.openacc_files import recording
from tests.support.samples import PLATOON, sample
from tests.support.snapshots import (
    altered,
    platoon,
    recommended,
    result_for,
    trained,
    two_windows,
    whole,
)
from tests.support.vehicles import CALM, NO_GAP_CONTROL, row

OWN, SIMULATED = "Surrogate fit, MAE", "Closed-loop simulation, MAE"
L2, LINF = "L₂ string stability", "L∞ string stability"
GAPS, VALUES = "Time gap", "Parameters"
KNOWN = " (90 % interval)"
SEGMENT = cut(recording(names=("Audi(A8)", "BMW", "Tesla")), 5.0, 30.0)
RESULT = result_for(SEGMENT, "splines")
POINT, INFO, QUALITY = RESULT.estimate, RESULT.info, RESULT.quality
LEARNED = POINT.parameters


def column(table: Table, title: str, group: str = "") -> list[Any]:
    """The cells of the one column of that title and group; a value with its interval as a tuple."""
    (k,) = (k for k, c in enumerate(table.columns) if (c.title, c.group) == (title, group))
    cells = [row[k] for row in table.rows]
    return [astuple(cell) if isinstance(cell, Quantity) else cell for cell in cells]


@cache
def nonlinear() -> Result:
    """The IDM of one follower by simulation, with its posterior."""
    asked = Analysis.of(platoon(), (Window(0.0, 60.0),), "1-2", model="idm")
    return run(asked, platoon())


def test_a_point_has_values_without_intervals() -> None:
    table = parameter_table(RESULT)
    assert column(table, "Follower") == ["2 BMW", "3 Tesla"]
    assert column(table, "α", VALUES) == LEARNED.alpha.tolist()
    assert column(table, "at median speed", GAPS) == LEARNED.tau.tolist()
    assert {c.group for c in table.columns} == {"", GAPS, VALUES}, "no further window"
    assert not any(isinstance(cell, Quantity | Range) for row in table.rows for cell in row)
    header, first, _ = csv.reader(io.StringIO(table.to_csv()))
    assert header[-3:] == ["alpha", "beta", "tau"]
    assert first[-3:] == [str(value) for value in LEARNED.values[0]]


@pytest.mark.parametrize("made", [recommended, two_windows, nonlinear])
def test_an_estimate_with_a_posterior_has_intervals_and_a_further_window(made: Any) -> None:
    result = made()
    estimate, table = result.estimate, parameter_table(result)
    assert estimate.spec.in_words in table.caption
    unknown = {s for f in estimate.findings if isinstance(f, Undetermined) for s in f.symbols}
    for parameter in estimate.following.parameters:
        cell = column(table, parameter.symbol, VALUES + KNOWN)[0]
        span = estimate.span(parameter.name, 0)
        if parameter.symbol in unknown:
            assert cell == UNDETERMINED, "it is no value"
        else:
            cell = astuple(cell.cell) if isinstance(cell, Marked) else cell
            assert cell == astuple(span)
    at_median = column(table, "at median speed", GAPS + KNOWN)[0]
    assert at_median == astuple(estimate.time_gap(float(estimate.speeds[0]), 0))
    further = estimate.time_gap(estimate.stated_speed, 0)
    assert table.rows[0][-1] == Range(further.further_lower, further.further_upper)
    for text in (table.to_text(), table.to_csv(), table.to_latex(), table.to_html()):
        assert "nan" not in text


def test_a_speed_that_no_window_holds_is_marked_and_a_fixed_value_is_named() -> None:
    cell = column(parameter_table(whole()), "at 50 km/h", GAPS)[0]
    assert not whole().estimate.is_driven(50 / 3.6, 0)
    assert isinstance(cell, Marked)
    assert cell.cell == whole().estimate.time_gap(50 / 3.6, 0).value
    fixed = Parameters.of([[0.1, 0.2, 1.0, 4.0]] * 2)
    spec = ModelSpec("cthp-s0", (("s0", 4.0),))
    table = parameter_table(altered(RESULT, parameters=fixed, spec=spec))
    assert column(table, "s₀", VALUES) == [(4.0, 4.0, 4.0)] * 2
    assert f"4.0 ({FIXED})" in table.to_text()


def test_followers_that_share_their_parameters_have_one_row_for_them() -> None:
    same = Parameters.stack([LEARNED[0]] * 2)
    shared = altered(RESULT, case="I", parameters=same)
    table = parameter_table(shared)
    assert column(table, "Follower") == [EVERY_FOLLOWER]
    assert column(table, "τ", VALUES) == [LEARNED.tau[0]]
    assert column(errors_table(shared), "Vehicle") == ["1 Audi (A8)", "2 BMW", "3 Tesla"]


def test_errors_of_both_kinds() -> None:
    evaluation, table = RESULT.evaluation, errors_table(RESULT)
    own, simulated = evaluation.surrogate, evaluation.closed_loop
    assert column(table, "Vehicle") == ["1 Audi (A8)", "2 BMW", "3 Tesla"]
    assert column(table, "Mean time gap") == [None, *QUALITY.mean_time_gap]
    assert column(table, "p", OWN) == [None, *own.gap_mae]
    assert column(table, "v", OWN) == [*own.speed_mae]
    assert column(table, "p", SIMULATED) == [None, *simulated.gap_mae]
    moved = [None, *simulated.speed_mae[1:]]
    assert column(table, "v", SIMULATED) == moved, "the leader's speed is given"
    lost = Parameters.of([[0.0, 0.2, np.nan], LEARNED.values[1]])
    table = errors_table(altered(RESULT, parameters=lost, curves=()))
    assert all(row[2:] == (None,) * 4 for row in table.rows), "empty, not zero"


def test_each_window_alone_stands_above_all_of_them() -> None:
    result = two_windows()
    estimate, known = result.estimate, result.posterior
    table = windows_table(result, 0)
    assert column(table, "Window") == [*(str(i.window) for i in result.infos), ALL_WINDOWS]
    alphas = column(table, "α", VALUES + KNOWN)
    ends = (estimate.windows, known.windows_lower, known.windows_upper)
    assert alphas[0][:3] == tuple(part.alpha[0, 0] for part in ends)
    assert alphas[-1] == astuple(estimate.span("alpha", 0))
    point = replace(result, estimate=replace(estimate, posterior=None))
    assert column(windows_table(point, 0), "α", VALUES) == [
        *estimate.windows.alpha[:, 0], estimate.parameters.alpha[0],
    ]  # fmt: skip


def test_preview_of_the_window() -> None:
    table = quality_table(INFO, QUALITY, POINT)
    shares = np.multiply(100, QUALITY.car_following)
    np.testing.assert_allclose(column(table, "Car-following"), shares)
    assert column(table, "α", "Least-squares estimate") == LEARNED.alpha.tolist()
    np.testing.assert_array_equal(column(table, "Condition number"), QUALITY.condition)


def test_a_row_a_method_and_an_earlier_estimate_beside_the_present_one() -> None:
    source = platoon()
    asked = Analysis.of(source, (Window(0.0, 60.0),), "1-3", method="least-squares")
    outcomes = compare(asked, source, ("least-squares", "splines"))
    rows = [row for row in outcomes if isinstance(row, Result)]
    then, gaps = rows[0], "MAE of the space-gap"
    table = methods_table(rows, 1)
    assert column(table, "Method") == ["Least squares", "Splines"]
    assert column(table, "β") == [row.parameters.beta[1] for row in rows]
    assert column(table, "Surrogate fit", gaps)[0] is None
    assert column(table, "Hold-out", gaps)[0] == then.evaluation.holdout.gap_mae[1]

    first = recommended()
    table = methods_table((*rows, first), 1, first)
    assert column(table, "Method")[1:] == ["Least squares", "Splines"], "it is there once, on top"
    assert column(table, "β")[0] == astuple(first.estimate.gain("beta", 1))[:3]
    assert column(table, "β")[1:] == [row.parameters.beta[1] for row in rows]
    away = [outside_interval(first.estimate, row.estimate, 1) for row in rows]
    inside = column(table, "Inside the interval")
    assert [said == "yes" for said in inside] == [False, *(not symbols for symbols in away)]

    now = run(replace(asked, case="I"), source)
    table = earlier_table([then], {"least-squares": now}, vehicle=3)
    assert column(table, "Earlier estimate") == [earlier_title(then)]
    assert column(table, "α") == [then.parameters.alpha[1]]
    change = now.parameters[1].values - then.parameters[1].values
    np.testing.assert_allclose(table.rows[0][5:8], change)
    assert "case: II → I" in column(table, "Differs now in")[0]
    other = earlier_table([then], {"splines": now}, vehicle=3).rows[0]
    assert [value is None or np.isnan(value) for value in other[5:]] == [True] * 4
    assert len(earlier_table([then], {}, vehicle=3).columns) == 5, "nothing to compare with"


def test_a_point_outside_an_interval_is_named_by_its_symbols() -> None:
    first = recommended().estimate
    assert outside_interval(first, first, 0) == ()
    off = Parameters.of(first.parameters.complete * [100.0, 1.0, 1.0, 1.0, 1.0, 1.0])
    assert outside_interval(first, replace(first, parameters=off), 0) == ("α",)
    nothing = replace(first, posterior=None)
    assert outside_interval(nothing, replace(first, parameters=off), 0) == ()


def test_a_method_is_called_by_what_it_was_trained_with() -> None:
    fast, retired = (
        replace(POINT, method="pinn", settings=FAST.to_json()),
        replace(POINT, method="gone"),
    )
    seeded = replace(fast, settings=fast.settings | {"seed": 3})
    stopped = replace(fast, settings=PAPER.to_json(), outcome=Outcome.STOPPED)
    assert [name_of(one) for one in (fast, seeded, stopped, POINT, retired)] == [
        "PiNN (fast preset)", "PiNN (fast preset, own options)", "PiNN (paper preset, stopped)",
        "Splines", "gone",
    ]  # fmt: skip


def test_the_papers_verdicts_and_the_exact_gain_beside() -> None:
    report = stability_report(ASTAZERO.parameters)
    table, short = stability_table(ASTAZERO, report), verdict_table(AssessedVehicles(ASTAZERO))
    assert column(table, "Vehicle")[3] == "Tesla Model 3"
    for title, group, tesla in (
        ("Criterion", L2, "unstable"),
        ("Paper's criterion", LINF, "stable"),
        ("Exact criterion", LINF, "unstable"),
        ("‖h‖₁", LINF, pytest.approx(1.0954, abs=5e-5)),
        ("Peak", L2, pytest.approx(0.3395, abs=5e-5)),
        ("L₂", "Smallest stable τ", pytest.approx(2.0534, abs=5e-5)),
    ):
        cells = column(table, title, group)
        assert cells[3] == tesla
        if title in ("Criterion", "Exact criterion", "Peak"):
            assert column(short, title, group) == cells
    assert "α" not in [one.title for one in criteria_part(table).columns]


def test_what_has_no_meaning_is_empty() -> None:
    pair = ParameterSet("Mine", ("calm", "stuck"), row(CALM, NO_GAP_CONTROL))
    text = stability_table(pair, stability_report(pair.parameters)).to_csv()
    calm, stuck = csv.DictReader(io.StringIO(text))
    assert calm["l2_string_stability_amplified_below_rad_per_s"] == ""
    assert calm["l2_string_stability_at_omega_rad_per_s"] == ""
    assert calm["l2_string_stability_criterion"] == "stable"
    assert stuck["tau"] == stuck["smallest_stable_tau_l2_s"] == ""
    assert stuck["l2_string_stability_criterion"] == "stable (marginal)"


def test_verdicts_have_intervals_and_probabilities_with_a_posterior_alone() -> None:
    subject = assessed_vehicles(recommended())
    known = subject.uncertainty
    peak, gain, stable = known.peak_gain, known.linf_gain, known.probability_l2
    table, verdicts = assessment_table(subject), verdict_table(subject)
    assert column(table, "Amplified below", L2)[0][1:] == (
        known.crossover.lower[0], known.crossover.upper[0],
    )  # fmt: skip
    assert column(table, "Probability", LINF)[0] == pytest.approx(100 * known.probability_linf[0])
    assert column(verdicts, "Probability", L2) == pytest.approx(100 * stable)
    words = [cell.cell if isinstance(cell, Marked) else cell
             for cell in column(verdicts, "Verdict", L2)]  # fmt: skip
    assert words == [assessment(share) for share in stable]
    decibels = 20 * np.log10([peak.lower[0], peak.upper[0]])
    assert column(verdicts, "Peak", L2)[0][1:] == tuple(decibels)
    assert column(verdicts, "‖h‖₁", LINF)[0][1:] == (gain.lower[0], gain.upper[0])
    point = assessed_vehicles(trained())
    titles = {c.title for c in assessment_table(point).columns}
    assert not {"Probability", "Verdict"} & titles
    peaks = [vehicle.peak.db for vehicle in point.report.vehicles]
    assert column(verdict_table(point), "Peak", L2) == peaks


def test_the_measured_gain_as_a_table() -> None:
    segment = sample(PLATOON).segment
    found = measured_gain(segment, 0)
    table = measured_gain_table(segment.labels[1], found)
    assert len(table.rows) == len(found.omega)
    assert table.rows[3][1] == Quantity(found.gain[3], found.lower[3], found.upper[3])
    assert table.to_latex().isascii()


def test_behind_a_recorded_leader_what_the_vehicles_did_stands_beside() -> None:
    leader = Recorded(SEGMENT.time, SEGMENT.speeds[:, 0])
    run = simulate_platoon(LEARNED, leader)
    table, moved = amplitude_table(run, SEGMENT.labels, SEGMENT), "Largest deviation"
    assert column(table, "Simulated", moved) == run.largest_deviation.tolist()
    away = np.abs(SEGMENT.speeds - SEGMENT.speeds[0, 0]).max(axis=0)
    np.testing.assert_allclose(column(table, "Recorded", moved), away)
    assert column(table, "Recorded", "Smallest gap") == [None, *SEGMENT.gaps.min(axis=0)]
    drawn = growth_by_vehicle(run, Cast(ASTAZERO, (0, 1)), SEGMENT)
    (beside,) = (trace for trace in drawn.data if trace.name == "Recorded")
    np.testing.assert_allclose(beside.y, away / run.largest_deviation[0])


def test_amplitudes_and_smallest_gaps() -> None:
    wave = simulate_platoon(ASTAZERO.parameters, Sinusoid(0.25))
    table = amplitude_table(wave, Cast(ASTAZERO, (0, 1, 2, 3)).labels)
    assert column(table, "Vehicle")[:2] == ["Leader", "Audi A6"]
    assert column(table, "Amplitude") == wave.amplitudes.measured.tolist()
    assert column(table, "Smallest gap") == [None, *wave.minimum_gap.tolist()]
    crash = simulate_platoon(ASTAZERO.parameters[[0] * 8], Sinusoid(0.214))
    table = amplitude_table(crash, Cast(ASTAZERO, (0,) * 8).labels)
    assert 1 < crash.survivors < len(table.rows)
    amplitudes, gaps = column(table, "Amplitude"), column(table, "Smallest gap")
    assert np.isnan(amplitudes[crash.survivors :]).all()
    assert np.isfinite([*amplitudes[: crash.survivors], *gaps[1 : crash.survivors]]).all()
    lost = {hit.follower: f"collides at {hit.time:.0f} s" for hit in crash.collisions}
    assert gaps[crash.survivors :] == [lost.get(k) for k in range(crash.survivors, len(gaps))]
    step = simulate_platoon(ASTAZERO.parameters, SpeedStep())
    table = amplitude_table(step, ("Leader", *ASTAZERO.labels))
    assert column(table, "Vehicle") == ["Leader", *ASTAZERO.labels]
    assert column(table, "Largest deviation") == step.largest_deviation.tolist()
