"""Tables of estimates, stability and amplitudes: the right numbers under the right headings."""

import csv
import io
from dataclasses import astuple, replace
from typing import Any

import numpy as np
import pytest

from accpinn.inference.intervals import Uncertainty
from accpinn.methods.estimate import Outcome
from accpinn.methods.pinn.config import FAST, PAPER
from accpinn.methods.registry import METHODS
from accpinn.model.cthp import Parameters
from accpinn.model.published import ASTAZERO, ParameterSet
from accpinn.platoon import simulate_platoon
from accpinn.platoon.leader import Recorded, Sinusoid, SpeedStep
from accpinn.recordings import Window
from accpinn.recordings.openacc import read
from accpinn.results.figures.platoon import amplitude_by_vehicle
from accpinn.results.recording import quality_table
from accpinn.results.tables import Table
from accpinn.results.tables.estimates import (
    EVERY_FOLLOWER,
    PROBABILITY,
    TITLES,
    comparison_table,
    earlier_table,
    earlier_title,
    intervals_table,
    methods_table,
    name_of,
    parameter_table,
)
from accpinn.results.tables.stability import (
    amplitude_table,
    criteria_part,
    measured_gain_table,
    stability_table,
    verdict_table,
)
from accpinn.results.vehicles import Cast, KnownVehicles
from accpinn.segment.cut import cut
from accpinn.stability import assessment, stability_report
from accpinn.stability.measured_gain import measured_gain
from accpinn.study import Analysis
from accpinn.study.comparison import compare
from accpinn.study.result import Result
from accpinn.study.run import run
from accpinn.units import Quantity
from tests.support.openacc_files import recording
from tests.support.samples import FOLDER, PLATOON, sample
from tests.support.snapshots import altered, result_for
from tests.support.vehicles import CALM, NO_GAP_CONTROL, row

GROUP, OWN, SIMULATED = (
    "Quantity (90 % interval)", "Surrogate fit, MAE", "Closed-loop simulation, MAE"
)  # fmt: skip
L2, LINF = "L₂ string stability", "L∞ string stability"
SEGMENT = cut(recording(names=("Audi(A8)", "BMW", "Tesla")), 5.0, 30.0)
RESULT = result_for(SEGMENT, "splines")
FIT, INFO, QUALITY = RESULT.fit, RESULT.info, RESULT.quality
LEARNED = FIT.parameters
SHARED = replace(FIT, case="I", parameters=Parameters.stack([LEARNED[0]] * 2))


def column(table: Table, title: str, group: str = "") -> list[Any]:
    """The cells of the one column of that title and group; an estimate as a tuple."""
    (k,) = (k for k, c in enumerate(table.columns) if (c.title, c.group) == (title, group))
    cells = [row[k] for row in table.rows]
    return [astuple(cell) if isinstance(cell, Quantity) else cell for cell in cells]


@pytest.fixture(scope="module")
def uncertainty() -> Uncertainty:
    lower = Parameters.of([[0.0, 0.05, 1.2], [0.01, 0.1, 1.0]])
    upper = Parameters.of([[0.02, 0.09, np.inf], [0.03, 0.2, 1.3]])
    return replace(RESULT.uncertainty, lower=lower, upper=upper)


def test_parameters_and_errors_of_both_kinds() -> None:
    evaluation = RESULT.evaluation
    own, simulated = evaluation.surrogate, evaluation.closed_loop
    table = parameter_table(RESULT, with_intervals=False)
    assert column(table, "Vehicle") == ["1 Audi (A8)", "2 BMW", "3 Tesla"]
    assert column(table, "α") == [None, *LEARNED.alpha]
    assert column(table, "Mean time gap") == [None, *QUALITY.mean_time_gap]
    assert column(table, "p", OWN) == [None, *own.gap_mae]
    assert column(table, "v", OWN) == [*own.speed_mae]
    assert column(table, "p", SIMULATED) == [None, *simulated.gap_mae]
    moved = [None, *simulated.speed_mae[1:]]
    assert column(table, "v", SIMULATED) == moved, "the leader's speed is given"
    lost = replace(FIT, parameters=Parameters.of([[0.0, 0.2, np.nan], LEARNED.values[1]]))
    without = replace(evaluation, surrogate=None, closed_loop=None)
    table = parameter_table(altered(RESULT, fit=lost, evaluation=without), with_intervals=False)
    assert table.to_csv().splitlines()[2].startswith("2 BMW,0.0,0.2,,")
    assert all(row[5:] == (None,) * 4 for row in table.rows), "empty, not zero"


def test_intervals_stand_beside_the_parameters(uncertainty: Uncertainty) -> None:
    known = altered(RESULT, uncertainty=uncertainty)
    table, (tau, other) = parameter_table(known), LEARNED.tau
    assert column(table, "τ", GROUP) == [None, (tau, 1.2, np.inf), (other, 1.0, 1.3)]
    head, leader, first, _ = (line.split(",") for line in table.to_csv().splitlines())
    assert head[1:4] == ["alpha", "alpha_low", "alpha_high"]
    assert (leader[1:4], first[1:4]) == (["", "", ""], [str(LEARNED.alpha[0]), "0.0", "0.02"])
    assert len(set(head)) == len(head) == len(first)
    alone = intervals_table(known)
    likeliest = column(alone, "β", "Maximum likelihood (90 % interval)")
    assert [cell[1:] for cell in likeliest] == [(0.05, 0.09), (0.1, 0.2)]
    shares = np.multiply(100, uncertainty.probability_l2)
    np.testing.assert_allclose(column(alone, "L₂", PROBABILITY), shares)


def test_followers_that_share_their_parameters_have_one_row_for_them(
    uncertainty: Uncertainty,
) -> None:
    shared = altered(RESULT, fit=SHARED, uncertainty=uncertainty)
    table = parameter_table(shared)
    assert column(table, "Vehicle") == ["1 Audi (A8)", EVERY_FOLLOWER, "2 BMW", "3 Tesla"]
    assert [cell is None for cell in column(table, "τ", GROUP)] == [True, False, True, True]
    assert column(table, "p", OWN) == [None, None, *RESULT.evaluation.surrogate.gap_mae]
    assert len(intervals_table(shared).rows) == 1
    termed = Parameters.of([[0.03, 0.2, 1.1, 4.0, 0.0, 0.3]] * 2)
    beside = {"PiNN": (LEARNED, uncertainty), "Answer": (termed, uncertainty)}
    table = comparison_table(shared, beside)
    assert column(table, "Method") == ["PiNN", "Answer"]
    assert [cell and cell[0] for cell in column(table, "s₀")] == [None, 4.0]
    assert [cell[0] for cell in column(table, "β")] == [LEARNED.beta[0], 0.2]


def test_preview_of_the_window() -> None:
    table = quality_table(INFO, QUALITY, FIT)
    shares = np.multiply(100, QUALITY.car_following)
    np.testing.assert_allclose(column(table, "Car-following"), shares)
    assert column(table, "α", "Least-squares estimate") == LEARNED.alpha.tolist()
    np.testing.assert_array_equal(column(table, "Condition number"), QUALITY.condition)


def test_a_row_a_method_and_an_earlier_fit_beside_the_present_one() -> None:
    source = read(FOLDER / f"{PLATOON}.csv")
    asked = Analysis.of(source, (Window(0.0, 60.0),), method="least-squares")
    outcomes = compare(asked, source, ("least-squares", "splines"))
    rows = [row for row in outcomes if isinstance(row, Result)]
    then, gaps = rows[0], "MAE of the space-gap"
    table = methods_table(then.info, rows, 1)
    assert column(table, "Method") == ["Least squares", "Splines"]
    assert column(table, "β") == [row.parameters.beta[1] for row in rows]
    assert column(table, "Surrogate fit", gaps)[0] is None
    assert column(table, "Hold-out", gaps)[0] == then.evaluation.holdout.gap_mae[1]

    table = methods_table(then.info, rows, 1, (Parameters(0.1, 0.2, 0.9, s0=5.0), 0.3))
    assert column(table, "Method")[0] == "Answer"
    assert (column(table, "s₀"), column(table, "Closed loop", gaps)[0]) == ([5.0, None, None], 0.3)

    now = run(replace(asked, case="I"), source)
    table = earlier_table([then], {"least-squares": now}, vehicle=3)
    assert column(table, "Earlier fit") == [earlier_title(then)]
    assert column(table, "α") == [then.parameters.alpha[1]]
    change = now.parameters[1].values - then.parameters[1].values
    np.testing.assert_allclose(table.rows[0][5:8], change)
    assert "case: II → I" in column(table, "Differs now in")[0]
    other = earlier_table([then], {"splines": now}, vehicle=3).rows[0]
    assert [value is None or np.isnan(value) for value in other[5:]] == [True] * 4
    assert len(earlier_table([then], {}, vehicle=3).columns) == 5, "nothing to compare with"


def test_a_method_is_called_by_what_it_was_trained_with() -> None:
    assert set(TITLES) == set(METHODS)
    fast, retired = replace(FIT, method="pinn", config=FAST.to_json()), replace(FIT, method="gone")
    seeded = replace(fast, config=fast.config | {"seed": 3})
    stopped = replace(fast, config=PAPER.to_json(), outcome=Outcome.STOPPED)
    assert [name_of(fit) for fit in (fast, seeded, stopped, FIT, retired)] == [
        "PiNN (fast preset)", "PiNN (fast preset, own options)", "PiNN (paper preset, stopped)",
        "Splines", "gone",
    ]  # fmt: skip


def test_the_papers_verdicts_and_the_exact_gain_beside() -> None:
    report = stability_report(ASTAZERO.parameters)
    table, short = stability_table(ASTAZERO, report), verdict_table(KnownVehicles(ASTAZERO))
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


def test_verdicts_have_intervals_and_probabilities() -> None:
    found = result_for(sample(PLATOON, 60.0).segment, "splines")
    learned, known = (
        ParameterSet("Learned", found.info.names[1:], found.parameters),
        found.uncertainty,
    )
    peak, gain, stable = known.peak_gain, known.linf_gain, known.probability_l2
    table = stability_table(learned, stability_report(learned.parameters), known)
    verdicts = verdict_table(KnownVehicles(learned, known))
    assert column(table, "Amplified below", L2)[0][1:] == (
        known.crossover.lower[0], known.crossover.upper[0],
    )  # fmt: skip
    assert column(table, "Probability", LINF)[0] == pytest.approx(100 * known.probability_linf[0])
    assert column(verdicts, "Probability", L2) == pytest.approx(100 * stable)
    assert column(verdicts, "Verdict", L2) == [assessment(share) for share in stable]
    decibels = 20 * np.log10([peak.lower[0], peak.upper[0]])
    assert column(verdicts, "Peak", L2)[0][1:] == tuple(decibels)
    assert column(verdicts, "‖h‖₁", LINF)[0][1:] == (gain.lower[0], gain.upper[0])


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
    drawn = amplitude_by_vehicle(run, Cast(ASTAZERO, (0, 1)), False, SEGMENT)
    (beside,) = (trace for trace in drawn.data if trace.name == "Recorded")
    np.testing.assert_allclose(beside.y, away)


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
