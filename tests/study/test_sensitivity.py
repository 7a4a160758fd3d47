"""Sensitivity of the estimates to instants outside car-following."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from accpinn.model.cthp import Parameters
from accpinn.recordings.recording import Recording
from accpinn.results.tables.recording import regimes_table, sensitivity_table
from accpinn.segment.cut import cut
from accpinn.segment.quality import label_regimes
from accpinn.study.sensitivity import CHOICES, COMPARED, SensitivityResult, sensitivity
from tests.support.command import Capture, document, refused
from tests.support.driving import LAW, driven


def of(rows: tuple[SensitivityResult, ...], choice: str, method: str) -> SensitivityResult:
    return next(row for row in rows if (row.choice, row.method) == (choice, method))


def estimate(rows: tuple[SensitivityResult, ...], choice: str, method: str) -> Parameters:
    """Of the first follower."""
    parameters = of(rows, choice, method).parameters
    return parameters[0]


def test_every_choice_is_made_by_every_method() -> None:
    rows = sensitivity(driven())
    assert [(row.choice, row.method) for row in rows] == [(c, m) for c in CHOICES for m in COMPARED]


def test_where_all_is_car_following_nothing_depends_on_the_choice() -> None:
    rows = sensitivity(driven())
    assert {row.share for row in rows} == {(0.0,)}
    for method in COMPARED:
        found = {row.parameters for row in rows if row.method == method}
        assert len(found) == 1
    found = estimate(rows, "car-following only", "splines")
    assert found.values == pytest.approx(np.array(LAW), rel=2e-3)


def test_the_share_excluded_is_that_of_the_regime() -> None:
    segment = driven()
    moved = segment.gaps + np.where(segment.time < 15.0, 30.0, 0.0)[:, None]
    rows = sensitivity(replace(segment, gaps=moved))
    assert of(rows, "without catching up", "splines").share == pytest.approx((150 / 601,))
    before = estimate(rows, "all instants", "least-squares")
    after = estimate(rows, "without catching up", "least-squares")
    assert abs(before.alpha - LAW[0]) > 5 * abs(after.alpha - LAW[0])


def test_the_segments_own_mask_has_no_effect() -> None:
    segment = driven()
    masked = replace(segment, mask=segment.time[:, None] <= 30.0)
    assert sensitivity(masked) == sensitivity(segment)


def test_too_little_left_is_said_in_its_row() -> None:
    segment = driven()
    rows = sensitivity(replace(segment, gaps=segment.gaps + 40.0))
    row = of(rows, "car-following only", "splines")
    assert row.parameters is None
    assert "0.0 s" in str(row.fault)
    assert of(rows, "all instants", "splines").parameters
    table = sensitivity_table(segment.info, rows, 0)
    share, *cells = table.rows[-1][1:]
    assert share == 100.0
    assert np.isnan(np.array(cells, float)).all()


def test_casale_without_catching_up(casale: Recording) -> None:
    """The method notes say about .028, .093, 1.36; what is seen is .0288, .0890, 1.352."""
    segment = cut(casale, 0, 300)
    rows = sensitivity(segment, casale)
    row = of(rows, "without catching up", "least-squares")
    assert row.share == pytest.approx((0.21,), abs=0.01)
    found = estimate(rows, "without catching up", "least-squares")
    assert found.alpha == pytest.approx(0.028, rel=0.05)
    assert found.beta == pytest.approx(0.093, rel=0.06)
    assert found.tau == pytest.approx(1.36, rel=0.01)
    assert estimate(rows, "all instants", "splines").tau == pytest.approx(1.522, rel=0.01)
    table = sensitivity_table(segment.info, rows, 0)
    assert [row[0] for row in table.rows] == [choice.capitalize() for choice in CHOICES]
    shares = regimes_table(segment.info, label_regimes(segment, casale)).rows[0][1:]
    assert shares == pytest.approx((78.8, 21.2, 0.0, 0.0), abs=0.1)


def test_the_command_excludes_what_is_asked_alone(openacc_dir: Path, capsys: Capture) -> None:
    words = ("fit", openacc_dir / "Casale" / "part7.csv", "--method", "least-squares")
    found = document(capsys, *words, "--leave-out", "catching-up,standstill")
    assert found["segment"]["left_out"]["regimes"] == ["catching up", "standstill"]
    assert found["segment"]["left_out"]["share"] == pytest.approx([0.212], abs=0.001)
    assert found["parameters"][0]["alpha"] == pytest.approx(0.0288, abs=0.0002)
    assert document(capsys, *words)["segment"]["left_out"] == {"regimes": [], "share": []}
    said = refused(capsys, 2, *words, "--leave-out", "car-following")
    assert "choose from catching-up, manual, standstill" in said
