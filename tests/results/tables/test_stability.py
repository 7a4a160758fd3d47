"""Tables of string stability and of amplitudes."""

import csv
import io

import numpy as np
import pytest

from accpinn.inference.intervals import intervals
from accpinn.methods import splines
from accpinn.model.published import ASTAZERO, ParameterSet
from accpinn.platoon.leader import Sinusoid, SpeedStep
from accpinn.platoon.simulation import simulate_platoon
from accpinn.results.tables.stability import (
    WORDS,
    amplitude_table,
    criteria_part,
    measured_gain_table,
    stability_table,
    verdict_table,
)
from accpinn.stability.measured_gain import measured_gain
from accpinn.stability.report import assessment, stability_report
from accpinn.units import Estimate
from tests.support.samples import PLATOON, sample
from tests.support.vehicles import CALM, NO_GAP_CONTROL, row

L2, LINF = "L₂ string stability", "L∞ string stability"


def test_the_papers_verdicts_and_the_exact_gain_beside() -> None:
    table = stability_table(ASTAZERO, stability_report(ASTAZERO.parameters))
    heads = [(column.group, column.title) for column in table.columns]
    tesla = dict(zip(heads, table.rows[3], strict=True))
    assert tesla["", "Vehicle"] == "Tesla Model 3"
    assert tesla[L2, "Stable"] == "NO"
    assert tesla[LINF, "Paper's criterion"] == "YES"
    assert tesla[LINF, "Exact criterion"] == "NO"
    assert tesla[LINF, "‖h‖₁"] == pytest.approx(1.0954, abs=5e-5)
    assert tesla[L2, "Peak"] == pytest.approx(0.3395, abs=5e-5)
    assert tesla["Smallest stable τ", "L₂"] == pytest.approx(2.0534, abs=5e-5)
    assert table.to_latex().isascii(), "every letter has its command"


def test_what_has_no_meaning_is_empty() -> None:
    pair = ParameterSet("Mine", ("calm", "stuck"), row(CALM, NO_GAP_CONTROL))
    table = stability_table(pair, stability_report(pair.parameters))
    head, *rows = csv.reader(io.StringIO(table.to_csv()))
    calm, stuck = (dict(zip(head, cells, strict=True)) for cells in rows)
    assert calm["l2_string_stability_amplified_below_rad_per_s"] == ""
    assert calm["l2_string_stability_at_omega_rad_per_s"] == ""
    assert calm["l2_string_stability_stable"] == "YES"
    assert stuck["tau"] == stuck["smallest_stable_tau_l2_s"] == ""
    assert stuck["l2_string_stability_stable"] == "YES, marginal"


def test_intervals_and_probabilities() -> None:
    segment = sample(PLATOON).segment
    fit = splines.fit(segment)
    uncertainty = intervals(segment, fit)
    learned = ParameterSet("Learned", segment.names[1:], fit.parameters)
    report, peak = stability_report(learned.parameters), uncertainty.peak_gain
    decibels = 20 * np.log10([peak.lower[0], peak.upper[0]])
    table = stability_table(learned, report, uncertainty)
    cells = dict(zip([(c.group, c.title) for c in table.columns], table.rows[0], strict=True))
    assert cells[LINF, "Probability"] == pytest.approx(100 * uncertainty.probability_linf[0])
    below, ends = cells[L2, "Amplified below"], uncertainty.crossover
    assert (below.lower, below.upper) == (ends.lower[0], ends.upper[0])
    verdicts = verdict_table(learned, report, uncertainty)
    cells = dict(zip([(c.group, c.title) for c in verdicts.columns], verdicts.rows[0], strict=True))
    assert cells[L2, "Probability"] == pytest.approx(100 * uncertainty.probability_l2[0])
    assert cells[L2, "Verdict"] == WORDS[assessment(uncertainty.probability_l2[0])]
    assert (cells[L2, "Peak"].lower, cells[L2, "Peak"].upper) == tuple(decibels)
    gain = uncertainty.linf_gain
    norm = cells[LINF, "‖h‖₁"]
    assert (norm.lower, norm.upper) == (gain.lower[0], gain.upper[0])


def test_given_parameters_have_verdicts_by_the_criteria() -> None:
    pair = ParameterSet("Mine", ("tesla", "calm"), row(ASTAZERO.parameters[3], CALM))
    table = verdict_table(pair, stability_report(pair.parameters))
    heads = [(column.group, column.title) for column in table.columns]
    tesla, calm = (dict(zip(heads, cells, strict=True)) for cells in table.rows)
    assert (L2, "Probability") not in heads
    verdicts = ((L2, "Stable"), (LINF, "Exact criterion"))
    assert [tesla[head] for head in verdicts] == ["NO", "NO"]
    assert [calm[head] for head in verdicts] == ["YES", "YES"]
    assert tesla[L2, "Peak"] == pytest.approx(0.3395, abs=5e-5)
    short = criteria_part(stability_table(pair, stability_report(pair.parameters)))
    assert "α" not in [column.title for column in short.columns]


def test_the_measured_gain_as_a_table() -> None:
    segment = sample(PLATOON).segment
    found = measured_gain(segment, 0)
    table = measured_gain_table(segment.labels[1], found)
    assert len(table.rows) == len(found.omega)
    assert table.rows[3][1] == Estimate(found.gain[3], found.lower[3], found.upper[3])
    assert table.to_latex().isascii()


def test_amplitudes_and_smallest_gaps() -> None:
    run = simulate_platoon(ASTAZERO.parameters, Sinusoid(0.25))
    table = amplitude_table(run)
    assert [cells[0] for cells in table.rows][:2] == ["Leader", "Follower 1"]
    assert [cells[1] for cells in table.rows] == run.amplitudes.measured.tolist()
    assert [cells[3] for cells in table.rows] == [None, *run.minimum_gap.tolist()]
    crash = simulate_platoon(ASTAZERO.parameters[[0] * 8], Sinusoid(0.214))
    rows = amplitude_table(crash).rows
    assert 1 < crash.survivors < len(rows)
    for column in (1, 3):
        assert np.isnan([cells[column] for cells in rows[crash.survivors :]]).all()
        assert np.isfinite([cells[column] for cells in rows[1 : crash.survivors]]).all()
    step = simulate_platoon(ASTAZERO.parameters, SpeedStep())
    table = amplitude_table(step, ("Leader", *ASTAZERO.labels))
    assert [cells[0] for cells in table.rows] == ["Leader", *ASTAZERO.labels]
    assert [cells[1] for cells in table.rows] == step.largest_deviation.tolist()
