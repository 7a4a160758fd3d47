"""The benchmarks print what they measure."""

import json
import shutil
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from accpinn.inference.intervals import Interval
from accpinn.methods.likelihood import Maximum
from accpinn.methods.pinn.config import PRESETS
from accpinn.methods.pinn.loss import loss_terms, output_columns
from accpinn.methods.state_space import COMMON, Form
from accpinn.model.cthp import Parameters, regressors
from accpinn.recordings.openacc import read
from accpinn.recordings.recording import Recording
from accpinn.recordings.synthetic import LeaderProfile
from accpinn.segment.cut import cut
from accpinn.segment.segment import Segment
from accpinn.units import FloatArray
from bench import __main__ as command_line
from bench import advanced, coverage, departures, disturbances, load, replication, start, widths
from bench import batch as batches
from bench.disturbed import MOTORWAY, Disturbance, disturbed
from bench.measurement import Figures, Measurement, Part, table
from bench.paper_protocol import PaperProtocol
from tests.support.command import Capture
from tests.support.samples import FOLDER, NOISY, PLATOON, sample

FEW = 2


@pytest.fixture(scope="module")
def study() -> coverage.CoverageStudy:
    return coverage.measure(FEW, duration=100.0)


class TestCoverage:
    def test_counts_shares_of_recordings(self, study: coverage.CoverageStudy) -> None:
        assert study.rows[0].method == coverage.OURS
        assert "naive" in {row.method for row in study.rows}
        for row in study.rows:
            assert row.recordings == FEW
            assert all((share * FEW).is_integer() for share in row.covered)
        assert all(width > 0 for width in study.rows[0].width)

    def test_standard_errors_shrink_with_the_root_of_the_number_of_recordings(self) -> None:
        rng = np.random.default_rng(1)
        truth = np.ones((1600, 3))
        ends = [Interval(1 - half, 1 + half) for half in rng.gamma(9.0, 1.0, truth.shape)]
        few, many = (coverage._coverage("", 0.9, ends[:n], truth[:n]) for n in (100, 1600))
        # Of normal widths the median's error is 1.25 deviations over the root of their number.
        deviation = np.std([end.upper - end.lower for end in ends])
        assert np.mean(few.width_error) == pytest.approx(1.25 * deviation / 10, rel=0.3)
        assert np.mean(few.width_error) / np.mean(many.width_error) == pytest.approx(4, rel=0.3)
        assert few.error_of(0.5) == 0.05

    def test_naive_intervals_are_far_narrower(self, study: coverage.CoverageStudy) -> None:
        width = {row.method: np.array(row.width) for row in study.rows}
        assert (width["naive"] < 0.5 * width[coverage.OURS]).all()
        assert f"{FEW} recordings of 100 s" in coverage.text(study)

    def test_exit_status_is_1_where_the_coverage_is_not_nominal(
        self,
        study: coverage.CoverageStudy,
        capsys: pytest.CaptureFixture[str],
        monkeypatch: pytest.MonkeyPatch,
    ) -> None:
        nominal = replace(study.rows[0], covered=(0.9, 0.9, 0.9), jointly=0.75)
        for row, expected in ((nominal, 0), (replace(nominal, jointly=0.5), 1)):
            found = replace(study, rows=(row,), bias={coverage.LIKELIHOOD: (0.0, 0.0, 0.0)})
            monkeypatch.setattr(coverage, "measure", lambda *_, found=found, **__: found)
            assert coverage.main(["--recordings", "2", "--json"]) == expected
            [ours] = json.loads(capsys.readouterr().out)["rows"]
            assert ours["jointly"] == row.jointly


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


class TestDepartures:
    @pytest.mark.parametrize(
        ("form", "covered", "noticed", "kept"),
        [
            ("cthp", 4, 0, True),
            ("lag", 3, 5, False),
            ("lag", 4, 0, True),
            (None, 0, 4, True),
            (None, 5, 3, False),
        ],
    )
    def test_limits_are_of_the_recommended_form_or_of_the_findings(
        self, form: Form | None, covered: int, noticed: int, kept: bool
    ) -> None:
        """Five recordings of one follower."""
        found = []
        for k in range(5):
            inside: dict[Form, np.ndarray] = {"cthp": np.zeros((1, 3), bool)}
            inside[form or "cthp"] = told = np.full((1, 3), k < covered)
            found.append(departures.Noticed(inside, told, better=False, inadequate=k < noticed))
        line = departures.Line.of(departures.Departure("", form=form), found)
        assert (line.better, line.inadequate, line.noticed) == (0.0, noticed / 5, noticed / 5)
        assert line.covered[form or "cthp"] == pytest.approx(4 * [covered / 5])
        assert line.is_as_promised == kept

    def test_prints_a_row_a_departure(
        self, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
    ) -> None:
        departure = departures.Departure(
            "slope", Disturbance(0.05, slope=-0.4), "offset", (coverage.SETS[[0]],)
        )
        other = replace(departure, name="other")
        monkeypatch.setattr(departures, "DEPARTURES", (departure, other))
        monkeypatch.setattr(departures, "disturbed", partial(disturbed, duration=60.0))
        departures.main(["--recordings", "1", "--only", "^slope"])
        heads, _, row = capsys.readouterr().out.splitlines()
        assert row.startswith("| slope |")
        assert row.count("|") == heads.count("|")


class TestWidths:
    def test_counts_followers_whose_interval_is_wide(self) -> None:
        segment = sample(NOISY).segment
        recording = read(FOLDER / f"{NOISY}.csv")
        (window,) = widths.windows(recording)
        np.testing.assert_array_equal(window.gaps, segment.gaps)
        found = widths.widths([cut(recording, 0.0, 100.0)])
        assert (found.sets, found.wide) == (1, (0.0, 0.0, 0.0))
        assert 0.0 < found.median[2] < found.median[0] < 1.0
        assert "| run | 1 | 0 %, 0 %, 0 % |" in widths.text({"run": found})


class TestDisturbances:
    def test_a_prior_is_taken_out(self) -> None:
        rng = np.random.default_rng(1)
        size = len(COMMON)
        centre = np.array([one.centre for one in COMMON])
        precision = np.diag([0.0 if one.spread is None else one.spread**-2 for one in COMMON])
        root = rng.normal(size=(size, size))
        own, best = root @ root.T + np.eye(size), rng.normal(size=size)
        both = own + precision
        mode = np.linalg.solve(both, own @ best + precision @ centre)
        values, errors = disturbances.without_prior(_maximum(mode, both))
        np.testing.assert_allclose(values, best)
        np.testing.assert_allclose(errors, np.sqrt(np.diag(np.linalg.inv(own))))
        values, errors = disturbances.without_prior(_maximum(mode, precision + 1e-3))
        assert np.isnan([*values, *errors]).all()

    def test_every_unknown_with_a_prior_is_measured(self, astazero: Recording) -> None:
        found = disturbances.measure([cut(astazero, 320.0, 300.0)])
        assert [one.name for one in found] == [one.name for one in COMMON if one.spread is not None]
        assert all(one.found.windows == 4 for one in found[:3])
        assert str(found[0]).startswith("| disturbance | 4 | ")


def _maximum(z: FloatArray, curvature: FloatArray) -> Maximum:
    return Maximum("cthp", z, 0.0, 0.0, curvature, True, 1)


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

    def test_the_command_is_limited(self) -> None:
        acceleration = motion(Disturbance(1e-9, limits=(-0.2, 0.3)))[0]
        assert acceleration.min() == pytest.approx(-0.2, abs=0.01)
        assert acceleration.max() == pytest.approx(0.3, abs=0.01)

    def test_the_command_comes_late(self) -> None:
        acceleration, command = motion(Disturbance(1e-9, delay=0.5))
        np.testing.assert_allclose(acceleration[100:-5], command[95:-10], atol=0.01)

    def test_disturbances_grow_with_the_speed(self) -> None:
        left = []
        for speed in (20.0, 30.0):
            calm = LeaderProfile(speed, 10.0, 40.0, (500.0, 600.0), (0.4, 1.2), 0.0)
            acceleration, command = motion(Disturbance(1e-3, growth=2.0), calm)
            left.append(acceleration[5:-5] - command[5:-5])
        np.testing.assert_allclose(left[1], left[0] * 1.5**2, atol=2e-5)

    def test_gaps_are_multiples_of_their_resolution(self) -> None:
        segment = disturbed(coverage.SETS[[0]], 1, Disturbance(), duration=20.0, resolution=0.5)
        np.testing.assert_array_equal(2 * segment.gaps, np.round(2 * segment.gaps))

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


def motion(
    disturbance: Disturbance, driving: LeaderProfile = MOTORWAY
) -> tuple[FloatArray, FloatArray]:
    """Acceleration and command, without noise; (N,) each."""
    segment = disturbed(coverage.SETS[[3]], 3, disturbance, driving, 100.0, noise=None)
    acceleration = np.gradient(segment.speeds[:, 1], segment.time)
    return acceleration, regressors(segment.speeds, segment.gaps)[0] @ coverage.SETS[[3]].theta[0]


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


def test_copies_of_recordings_can_be_read_and_have_contents_of_their_own(tmp_path: Path) -> None:
    few = len(batches.originals()) + 1
    batches.copies(tmp_path / "runs", few)
    paths = sorted((tmp_path / "runs").iterdir())
    assert len({path.read_bytes() for path in paths}) == len(paths) == few
    first, again = read(paths[0]), read(paths[-1])
    assert again.samples == first.samples - batches.SHIFT
    np.testing.assert_array_equal(again.speed, first.speed[batches.SHIFT :])


def test_cost_over_the_length_of_the_window(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(batches, "LENGTH_METHODS", ("splines",))
    found = batches.lengths(FOLDER / "synthetic_paper_study.csv", (70.0, 140.0))
    assert [(one.method, one.duration) for one in found] == [("splines", 70), ("splines", 140)]
    assert all(one.seconds > 0 for one in found)


def test_how_long_a_command_takes_is_held_against_its_limit() -> None:
    counting = ("-c", "sum(range(5_000_000))")  # less than a tick of the clock counts as nothing
    quick, slow = (start.command("count", counting, limit, rounds=1) for limit in (60.0, 0.0))
    assert quick.within
    assert not slow.within
    assert slow.processor > 0


def test_an_advanced_clock_shows_later(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "advance").write_text("3600.0")
    monkeypatch.setenv(advanced.ADVANCE, str(tmp_path / "advance"))
    clock = advanced.Clock()
    later = clock.later(lambda: 5.0)
    assert later() == 5.0
    clock.read()
    assert later() == 3605.0


def test_what_a_server_keeps_of_its_users_is_a_fault() -> None:
    before = load.State(500.0, 6, 10, 1.0, 0, {"sessions": 1})
    assert not load.State(515.0, 6, 12, 9.0, 0, {"sessions": 1}).kept_since(before, 2)
    assert len(load.State(560.0, 16, 20, 9.0, 4, {"sessions": 2}).kept_since(before, 2)) == 5
    assert not load.State(1100.0, 6, 10, 9.0, 0, {"sessions": 1}).kept_since(before, load.KEPT)
    assert load.State(1200.0, 6, 10, 9.0, 0, {"sessions": 1}).kept_since(before, 9 * load.KEPT)


class TestReleasedFigures:
    def figures(self, seconds: float, fixed: float) -> Figures:
        """One time and one ratio, measured while the fixed calculation took so long."""
        time = Measurement("page", seconds, limit=2.0, processor=0.5)
        ratio = Measurement("ratio", 350.0, "times", limit=300.0, at_least=True)
        return Figures.now("a machine", [Part("app", fixed, [time, ratio])])

    def test_limits_are_the_least_or_the_largest_value(self) -> None:
        assert self.figures(1.9, 0.1).within
        assert not self.figures(2.1, 0.1).within
        assert not Measurement("ratio", 299.0, "times", limit=300.0, at_least=True).within

    def test_are_kept_without_limits_which_the_code_has(self, tmp_path: Path) -> None:
        assert Figures.released(tmp_path / "none.json") is None
        self.figures(1.0, 0.1).release(tmp_path / "released.json")
        found = Figures.released(tmp_path / "released.json")
        [page, ratio] = found.parts[0].measurements
        assert (page.value, page.processor, ratio.value) == (1.0, 0.5, 350.0)
        assert page.limit is ratio.limit is None

    def test_stand_beside_the_new_ones(self) -> None:
        *_, page, ratio, note = table(self.figures(2.5, 0.1), self.figures(2.0, 0.1)).splitlines()
        assert "1.25  beyond" in page
        assert ratio.endswith("1.00")
        assert "as fast" in note

    def test_a_slower_machine_is_noticed(self) -> None:
        assert "Busy or slow machine during app" in table(
            self.figures(2.5, 0.13), self.figures(2.0, 0.1)
        )


@pytest.mark.parametrize(
    ("program", "arguments", "said"),
    [
        (coverage, ["--recordings", "0"], "at least 1"),
        (replication, [], "OPENACC_DIR"),
        (command_line, ["--release", "--only", "start"], "all parts"),
    ],
    ids=["no recordings", "no folder", "a release of some parts"],
)
def test_what_cannot_be_measured_is_refused(
    program: Any, arguments: list[str], said: str, capsys: Capture, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("OPENACC_DIR", raising=False)
    with pytest.raises(SystemExit) as ended:
        program.main(arguments)
    assert ended.value.code == 2
    assert said in capsys.readouterr().err
