"""What the estimates owe to instants outside car-following."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from accpinn.cli import main
from accpinn.recordings.openacc import read
from accpinn.results.tables.estimates import regimes_table, sensitivity_table
from accpinn.segment.cut import cut
from accpinn.segment.regimes import label_regimes
from accpinn.study.sensitivity import CHOICES, SensitivityResult, sensitivity
from accpinn.study.sensitivity import COMPARED as METHODS
from tests.support.driving import LAW, driven

STUDY = Path(__file__).parent.parent / "sample_data" / "synthetic_paper_study.csv"


def of(rows: tuple[SensitivityResult, ...], choice: str, method: str) -> SensitivityResult:
    return next(row for row in rows if (row.choice, row.method) == (choice, method))


def test_every_choice_is_made_by_every_method() -> None:
    rows = sensitivity(driven())
    assert [(row.choice, row.method) for row in rows] == [(c, m) for c in CHOICES for m in METHODS]


def test_where_all_is_car_following_nothing_depends_on_the_choice() -> None:
    rows = sensitivity(driven())
    assert {row.share for row in rows} == {(0.0,)}
    for method in METHODS:
        found = {row.parameters for row in rows if row.method == method}
        assert len(found) == 1
    law = of(rows, "car-following only", "splines").parameters[0]
    assert (law.alpha, law.beta, law.tau) == pytest.approx(LAW, rel=2e-3)


def test_the_share_left_out_is_that_of_the_regime() -> None:
    segment = driven()
    moved = segment.gaps + np.where(segment.time < 15.0, 30.0, 0.0)[:, None]
    rows = sensitivity(replace(segment, gaps=moved))
    assert of(rows, "without catching up", "splines").share == pytest.approx((150 / 601,))
    before = of(rows, "all instants", "least-squares").parameters[0]
    after = of(rows, "without catching up", "least-squares").parameters[0]
    assert abs(before.alpha - LAW[0]) > 5 * abs(after.alpha - LAW[0])


def test_what_the_segment_leaves_out_itself_plays_no_part() -> None:
    segment = driven()
    masked = replace(segment, left_out=segment.time[:, None] > 30.0)
    assert sensitivity(masked) == sensitivity(segment)


def test_too_little_left_is_said_in_its_row() -> None:
    segment = driven()
    rows = sensitivity(replace(segment, gaps=segment.gaps + 40.0))
    row = of(rows, "car-following only", "splines")
    assert row.parameters == ()
    assert "0.0 s are left" in row.refusal
    assert of(rows, "all instants", "splines").parameters
    table = sensitivity_table(segment, rows, 0)
    assert table.rows[-1][1:] == (100.0, *[None] * 6)


def test_casale_without_catching_up(openacc_dir: Path) -> None:
    """The method notes say about .028, .093, 1.36; what is seen is .0288, .0890, 1.352."""
    recording = read(openacc_dir / "Casale" / "part7.csv")
    segment = cut(recording, 0, 300)
    rows = sensitivity(segment, recording)
    row = of(rows, "without catching up", "least-squares")
    assert row.share == pytest.approx((0.21,), abs=0.01)
    law = row.parameters[0]
    assert law.alpha == pytest.approx(0.028, rel=0.05)
    assert law.beta == pytest.approx(0.093, rel=0.06)
    assert law.tau == pytest.approx(1.36, rel=0.01)
    everything = of(rows, "all instants", "splines").parameters[0]
    assert everything.tau == pytest.approx(1.522, rel=0.01)
    table = sensitivity_table(segment, rows, 0)
    assert [row[0] for row in table.rows] == [choice.capitalize() for choice in CHOICES]
    shares = regimes_table(segment, label_regimes(segment, recording)).rows[0][1:]
    assert shares == pytest.approx((78.8, 21.2, 0.0, 0.0), abs=0.1)


class TestCommandLine:
    def test_leaves_out_what_is_asked_and_says_it(
        self, openacc_dir: Path, capsys: pytest.CaptureFixture[str]
    ) -> None:
        arguments = ["fit", str(openacc_dir / "Casale" / "part7.csv"), "--method", "least-squares"]
        arguments += ["--leave-out", "catching-up,standstill"]
        assert main([*arguments, "--json"]) == 0
        document = json.loads(capsys.readouterr().out)
        assert document["segment"]["left_out"]["regimes"] == ["catching up", "standstill"]
        assert document["segment"]["left_out"]["share"] == pytest.approx([0.212], abs=0.001)
        assert document["parameters"][0]["alpha"] == pytest.approx(0.0288, abs=0.0002)
        assert main(arguments) == 0
        assert "Left out of the law's equations: catching up and standstill" in (
            capsys.readouterr().out
        )

    def test_leaves_nothing_out_unasked(self, capsys: pytest.CaptureFixture[str]) -> None:
        assert main(["fit", str(STUDY), "--method", "least-squares", "--json"]) == 0
        document = json.loads(capsys.readouterr().out)
        assert document["segment"]["left_out"] == {"regimes": [], "share": []}

    def test_refuses_what_is_no_regime(self, capsys: pytest.CaptureFixture[str]) -> None:
        with pytest.raises(SystemExit) as ended:
            main(["fit", str(STUDY), "--leave-out", "car-following"])
        assert ended.value.code == 2
        assert "choose from catching-up, manual, standstill" in capsys.readouterr().err
