"""The benchmarks print what they measure."""

import json
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from accpinn.methods.pinn.config import PRESETS
from accpinn.methods.pinn.loss import loss_terms
from accpinn.methods.pinn.method import output_columns
from accpinn.model.cthp import Parameters, regressors
from accpinn.recordings.synthetic import LeaderProfile
from accpinn.segment.segment import Segment
from bench import coverage, departures, replication
from bench.disturbed import Disturbance, disturbed
from bench.paper_protocol import PaperProtocol
from tests.support.samples import FOLDER, NOISY, PLATOON, sample

FEW = 4


@pytest.fixture(scope="module")
def study() -> coverage.CoverageStudy:
    return coverage.measure(FEW, duration=150.0)


class TestCoverage:
    def test_counts_shares_of_recordings(self, study: coverage.CoverageStudy) -> None:
        assert study.rows[0].method == coverage.OURS
        assert "naive" in {row.method for row in study.rows}
        for row in study.rows:
            assert row.recordings == FEW
            assert all((share * FEW).is_integer() for share in row.covered)
        assert all(width > 0 for width in study.rows[0].width)

    def test_naive_intervals_are_far_narrower(self, study: coverage.CoverageStudy) -> None:
        width = {row.method: np.array(row.width) for row in study.rows}
        assert (width["naive"] < 0.5 * width[coverage.OURS]).all()
        assert f"{FEW} recordings of 150 s" in coverage.text(study)

    def test_exit_status_is_1_where_the_coverage_is_not_nominal(
        self, capsys: pytest.CaptureFixture[str]
    ) -> None:
        status = coverage.main(["--recordings", "2", "--duration", "150", "--json"])
        ours = json.loads(capsys.readouterr().out)["rows"][0]
        assert status == int(not all(0.85 <= share <= 0.95 for share in ours["covered"]))

    def test_refuses_no_recordings(self, capsys: pytest.CaptureFixture[str]) -> None:
        with pytest.raises(SystemExit) as ended:
            coverage.main(["--recordings", "0"])
        assert ended.value.code == 2
        assert "at least 1" in capsys.readouterr().err


class TestReplication:
    @pytest.fixture
    def folder(self, tmp_path: Path) -> Path:
        """One recording of a single car, as if it were of a campaign."""
        folder = tmp_path / "openacc"
        folder.mkdir()
        (folder / "Casale").mkdir()
        shutil.copy(FOLDER / f"{NOISY}.csv", folder / "Casale")
        return folder

    def test_windows_of_one_car_are_compared_in_pairs(self, folder: Path) -> None:
        study = replication.measure(folder, 75.0)
        assert (study.windows, study.pairs) == (4, 6)
        for agreement, overlap in zip(study.agreement, study.overlap, strict=True):
            assert (6 * agreement) == pytest.approx(round(6 * agreement))
            assert agreement <= overlap
        [car] = study.cars
        assert (car.windows, car.campaign) == (4, "Casale")
        tau = car.between[2]
        assert tau.typical == pytest.approx(sample(NOISY).truth[0, 2], rel=0.1)
        assert tau.deviation < 0.1
        assert "6 pairs of windows of the same car" in replication.text(study)

    def test_refuses_a_folder_that_is_not_there(
        self, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
    ) -> None:
        monkeypatch.delenv("OPENACC_DIR", raising=False)
        with pytest.raises(SystemExit) as ended:
            replication.main([])
        assert ended.value.code == 2
        assert "OPENACC_DIR" in capsys.readouterr().err


class TestDepartures:
    def test_every_line_is_a_study_of_its_own(self, monkeypatch: pytest.MonkeyPatch) -> None:
        asked = []

        def measured(
            recordings: int, disturbance: Disturbance, **rest: Any
        ) -> coverage.CoverageStudy:
            asked.append((disturbance, rest["sets"]))
            return coverage.measure(1, disturbance, duration=60.0, **rest)

        monkeypatch.setattr(departures, "measure", measured)
        lines = departures.table(1).splitlines()
        assert len(lines) == 2 + len(departures.DEPARTURES)
        assert asked == [(one.disturbance, one.sets) for one in departures.DEPARTURES]
        assert all(line.count(" %") >= 4 for line in lines[2:])


class TestDisturbedRecordings:
    def test_equilibrium_gap_has_standstill_distance_and_slope(self) -> None:
        """At a constant speed ahead the gap is τv + s₀ - w/α."""
        parameters = Parameters([0.2], [0.4], [1.2])
        calm = LeaderProfile(20.0, 10.0, 30.0, (500.0, 600.0), (0.4, 1.2), 0.0)
        for standstill, slope in ((0.0, 0.0), (4.0, 0.0), (0.0, -0.1)):
            what = Disturbance(1e-9, 4.0, standstill=standstill, slope=slope)
            segment = disturbed(parameters, 1, what, calm, 120.0, noise=None)
            gap = 1.2 * 20.0 + standstill - slope / 0.2
            assert segment.gaps[-1, 0] == pytest.approx(gap, abs=1e-6)

    def test_the_disturbance_is_as_strong_as_stated(self) -> None:
        """Without noise the residual of the model is the disturbance."""
        parameters = coverage.SETS[[0]]
        strong, calm = (
            disturbed(parameters, 3, Disturbance(deviation, 4.0, 0.0), duration=300.0)
            for deviation in (0.25, 1e-9)
        )
        left = [residual(segment, parameters) for segment in (strong, calm)]
        added = np.sqrt(max(left[0] ** 2 - left[1] ** 2, 0.0))
        assert added == pytest.approx(0.25, rel=0.35)


def residual(segment: Segment, parameters: Parameters) -> float:
    """RMS of dv/dt minus the model, smoothed over a second."""
    acceleration = np.gradient(segment.speeds[:, 1], segment.time)
    modelled = regressors(segment.speeds, segment.gaps)[0] @ parameters.theta[0]
    second = round(1 / segment.sample_time)
    smooth = np.convolve(acceleration - modelled, np.ones(second) / second, mode="valid")
    return float(np.sqrt((smooth**2).mean()))


def test_the_papers_protocol_has_the_loss_of_the_package() -> None:
    training = PaperProtocol(sample(PLATOON).segment)
    time = training.time.detach()
    surrogate, rates = torch.func.jvp(training.network, (time,), (torch.ones_like(time),))
    measured = torch.cat([training.speeds, training.gaps], dim=1)
    speeds, gaps = output_columns(training.followers)
    order = np.argsort([*speeds, *gaps])
    terms = loss_terms(
        surrogate[:, order],
        rates[:, order],
        measured[:, order],
        torch.tensor(Parameters.of(training.parameters.detach()).theta),
        PRESETS["paper"],
    )
    ours, theirs = terms.total.item(), training.loss().item()
    assert theirs == pytest.approx(ours, rel=1e-12)
