"""The paper's items: what is printed against what follows from it, and the runs they take."""

from dataclasses import replace
from pathlib import Path

import pytest

from accpinn.model.published import VICOLUNGO
from accpinn.recordings.openacc import read
from accpinn.results.reproduction import ITEMS, PrintedVerdicts, reproduction_table
from accpinn.segment.cut import cut
from tests.support.samples import FOLDER

PRINTED = [one for item in ITEMS for one in item.verdicts]


def test_all_printed_verdicts_follow_from_the_papers_own_criteria() -> None:
    assert [one.agreeing for one in PRINTED] == [2 * len(one.vehicles) for one in PRINTED]
    assert [name for one in PRINTED for name in one.refuted] == ["Tesla Model 3"]


def test_a_verdict_that_does_not_follow_is_counted() -> None:
    wrong = PrintedVerdicts(VICOLUNGO, (False, True, False), (False,) * 3)
    assert wrong.agreeing == 5
    (item,) = (item for item in ITEMS if item.title == "Table III")
    assert replace(item, verdicts=(wrong,)).outcome.startswith("5 of 6 ")


def test_peaks_stand_beside_the_printed_verdicts() -> None:
    """Peaks of Table III's parameters, by an independent computation."""
    (item,) = (item for item in ITEMS if item.title == "Table III")
    peaks = [row[-2:] for row in reproduction_table(item.verdicts[0]).rows]
    assert [peak[0] for peak in peaks] == pytest.approx([3.56, 2.99, 1.80, 0.34], abs=0.006)
    assert peaks[0][1] == pytest.approx(0.214, abs=0.001)


def test_runs_and_samples_exist(openacc_dir: Path) -> None:
    for item in ITEMS:
        assert not item.sample or (FOLDER / f"{item.sample}.csv").exists()
        if run := item.run:
            assert run.file in str(run)
            recording = read(openacc_dir / run.campaign / run.file)
            segment = cut(recording, run.window.start, run.window.duration, run.vehicles)
            assert segment.window == run.window
