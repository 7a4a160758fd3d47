"""The paper's items: what is printed against what follows from it, and the runs they take."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from accpinn.model.cthp import Parameters
from accpinn.model.published import ASTAZERO, VICOLUNGO
from accpinn.recordings.openacc import read
from accpinn.results.reproduction import (
    DEVIATION,
    ITEMS,
    PANELS,
    TICK,
    TOLERANCE,
    PrintedVerdicts,
    beside_printed,
    compared_panels,
    compared_peaks,
    deviations,
    inconsistencies,
    learned_line,
    reproduction_table,
)
from accpinn.segment.cut import cut
from accpinn.study.run import run
from tests.support.samples import FOLDER

PRINTED = [one for item in ITEMS for one in item.verdicts]
(TABLE_III,) = (item.verdicts[0] for item in ITEMS if item.title == "Table III")


def test_all_printed_verdicts_follow_from_the_papers_own_criteria() -> None:
    assert [one.agreeing for one in PRINTED] == [2 * len(one.vehicles) for one in PRINTED]
    assert [name for one in PRINTED for name in one.refuted] == ["Tesla Model 3"]


def test_a_verdict_that_does_not_follow_is_counted() -> None:
    wrong = PrintedVerdicts(VICOLUNGO, (False, True, False), (False,) * 3)
    assert wrong.agreeing == 5
    (item,) = (item for item in ITEMS if item.title == "Table III")
    assert replace(item, verdicts=(wrong,)).compared(None).recomputed.startswith("5 of 6 ")


def test_peaks_stand_beside_the_printed_verdicts() -> None:
    """Peaks of Table III's parameters, by an independent computation."""
    peaks = [row[-2:] for row in reproduction_table(TABLE_III).rows]
    assert [peak[0] for peak in peaks] == pytest.approx([3.56, 2.99, 1.80, 0.34], abs=0.006)
    assert peaks[0][1] == pytest.approx(0.214, abs=0.001)


def test_a_tick_stands_only_where_every_parameter_agrees() -> None:
    factors = np.ones((4, 3))
    factors[1], factors[3, 1] = 1 + 0.99 * TOLERANCE, 1 - 1.01 * TOLERANCE
    learned = Parameters.of(ASTAZERO.parameters.values * factors)
    table = reproduction_table(TABLE_III, learned)
    assert [row[-1] for row in table.rows] == [TICK, TICK, TICK, None]
    groups = [column.group for column in table.columns]
    off = [row[groups.index(DEVIATION) :][:3] for row in table.rows]
    np.testing.assert_allclose(off, 100 * (factors - 1), atol=1e-9)
    assert f"{100 * TOLERANCE:.0f} %" in table.caption
    said = learned_line(TABLE_III, learned)
    assert not said.startswith(TICK)
    assert "α 15 %, β 15 % and τ 15 %" in said
    assert learned_line(TABLE_III, ASTAZERO.parameters).startswith(TICK)
    one = deviations(TABLE_III, ASTAZERO.parameters[:1])
    assert one.shape == (4, 3), "one set may stand for all rows"


def test_the_papers_contradictions_are_computed_from_its_own_table() -> None:
    """Independently: |H|² = (β²ω² + α²) / ((α - ω²)² + (ατ + β)²ω²)."""
    omega = np.linspace(0.01, 1.0, 100_000)

    def decibels(vehicle: Parameters, at: object) -> np.ndarray:
        alpha, beta, tau = vehicle.values
        square = np.asarray(at) ** 2
        below = (alpha - square) ** 2 + (alpha * tau + beta) ** 2 * square
        return np.asarray(10 * np.log10((beta**2 * square + alpha**2) / below))

    text, caption, verdict = inconsistencies()
    assert ASTAZERO.labels[3] in verdict
    audi, tesla = ASTAZERO.parameters[0], ASTAZERO.parameters[3]
    gain = decibels(audi, omega)
    assert "1.2 dB at 0.25 rad/s" in text
    assert f"{gain.max():.2f} dB at {omega[gain.argmax()]:.3f} rad/s for AstaZero" in text
    assert f"{decibels(tesla, 0.25):.2f} dB" in caption
    assert ("3.56 dB at 0.214 rad/s" in text, "-0.46 dB" in caption) == (True, True)


def test_the_figures_stand_beside_what_was_learned() -> None:
    """Independently: |H|² as above, to the power of eight followers."""
    learned = Parameters.of(ASTAZERO.parameters.values * [1.1, 1.0, 1.0])
    for panel in PANELS:
        alpha, beta, tau = ASTAZERO.parameters[panel.vehicle].values
        square = panel.frequency**2
        ratio = (beta**2 * square + alpha**2) / (
            (alpha - square) ** 2 + (alpha * tau + beta) ** 2 * square
        )
        assert panel.gain(ASTAZERO.parameters) == pytest.approx(ratio**4, rel=1e-9)
        assert f"{panel.letter} {ratio**4:.2f}" in compared_panels(None).recomputed
        off = 100 * (panel.gain(learned) / ratio**4 - 1)
        assert f"{panel.letter} {off:+.0f}".replace("-", "−") in compared_panels(learned).deviation
    unstable = {panel.letter for panel in PANELS if panel.printed == "unstable"}
    assert unstable == {p.letter for p in PANELS if p.gain(ASTAZERO.parameters) > 1}
    assert (compared_panels(None).learned, compared_peaks(None).deviation) == ("", "")
    assert "1.2 dB at 0.25 rad/s" in compared_peaks(None).printed
    assert compared_peaks(ASTAZERO.parameters).deviation.startswith("+0.00 dB")
    assert not compared_peaks(learned).deviation.startswith("+0.00 dB")


def test_runs_and_samples_exist(openacc_dir: Path) -> None:
    for item in ITEMS:
        assert not item.sample or (FOLDER / f"{item.sample}.csv").exists()
        if asked := item.run:
            assert asked.file in str(asked)
            recording = read(openacc_dir / asked.campaign / asked.file)
            for window in asked.windows:
                segment = cut(recording, window.start, window.duration, asked.vehicles)
                assert segment.window == window


@pytest.mark.parametrize("title", ["Table I", "Table II", "Table III"])
def test_the_preset_fast_learns_what_the_paper_prints(title: str, openacc_dir: Path) -> None:
    (item,) = (item for item in ITEMS if item.title == title)
    asked = item.run
    assert asked
    recording = read(openacc_dir / asked.campaign / asked.file)
    assert asked.is_of(recording)
    result = run(asked.analysis(recording), recording)
    found, table, line = beside_printed(result)
    assert found is item
    assert {row[-1] for row in table.rows} == {TICK}
    assert line.startswith(TICK)
    assert beside_printed(replace(result, facts={})) is None
