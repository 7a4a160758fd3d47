"""From an analysis to its result: by the method, from the store, of one window or of several."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from accpinn import fit
from accpinn.errors import AccpinnError, ParameterError, SegmentError
from accpinn.evaluation.closed_loop import ClosedLoop
from accpinn.methods import TaskContext
from accpinn.methods.estimate import Estimate, Outcome, Progress
from accpinn.methods.findings import CacheProblem
from accpinn.methods.forecast import CURVES, INTERVALS, PARAMETERS, VARIATION
from accpinn.methods.pinn.config import preset
from accpinn.methods.registry import METHODS
from accpinn.model.cthp import Parameters
from accpinn.recordings import Recording, Window
from accpinn.recordings.openacc import read
from accpinn.segment import Segment
from accpinn.study import Analysis
from accpinn.study import run as module
from accpinn.study.result import Result
from accpinn.study.run import run
from accpinn.study.snapshot import SCHEMA
from accpinn.study.store import Store
from bench.disturbed import Disturbance, disturbed
from tests.support.driving import MIXED, driven
from tests.support.estimates import point
from tests.support.samples import FOLDER, NOISY
from tests.support.snapshots import altered, bits, resealed, small, two_windows, whole

TWO = [Window(0.0, 60.0), Window(60.0, 120.0)]


@pytest.fixture(scope="module")
def recording() -> Recording:
    return read(FOLDER / f"{NOISY}.csv")


def make_analysis(recording: Recording, method: str = "splines", **changes: Any) -> Analysis:
    windows = changes.pop("windows", [Window(0.0, 60.0)])
    return Analysis.of(recording, windows, method=method, **changes)


def problems(result: Result) -> list[str]:
    return [
        finding.problem for finding in result.estimate.findings if isinstance(finding, CacheProblem)
    ]


class Watched:
    """An observer of a run that keeps what it is told, in order."""

    def __init__(self, stop: str = "", after: int = 0) -> None:
        """Stop it after so many further moments of a phase."""
        self.seen: list[str | Estimate] = []
        """Phases, and the estimate."""
        self.moments: list[Progress] = []
        self.context = TaskContext(
            on_progress=self._note,
            should_stop=lambda: bool(stop) and self.seen.count(stop) > after,
            on_estimate=self.seen.append,
        )

    def _note(self, moment: Progress) -> None:
        self.seen.append(moment.phase)
        self.moments.append(moment)


class TestStore:
    def test_the_second_time_it_comes_from_the_store(
        self, recording: Recording, store: Store, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        question = make_analysis(recording, "pinn", windows=TWO)
        first = run(question, recording, store=store)
        monkeypatch.setitem(METHODS, "pinn", replace(METHODS["pinn"], run=None))
        monkeypatch.setattr(module, "with_posterior", None)
        again = run(question, recording, store=store)
        assert (first.estimate.cached, again.estimate.cached) == (False, True)
        assert bits(replace(again.estimate, cached=False)) == bits(first.estimate)
        assert bits(again.uncertainty) == bits(first.uncertainty)
        assert (again.created, again.recording is recording) == (first.created, True)
        assert problems(again) == []
        with pytest.raises(TypeError):  # another question
            run(make_analysis(recording, "pinn", model="cthp"), recording, store=store)

    @pytest.mark.parametrize("content", ["damaged", "truncated", "foreign", "newer", "another"])
    def test_a_file_that_cannot_be_used_is_said_once_and_computed_again(
        self, recording: Recording, store: Store, content: str
    ) -> None:
        first = run(make_analysis(recording), recording, store=store)
        path = store.path(first.analysis.key)
        data = path.read_bytes()
        other = run(make_analysis(recording, "least-squares"), recording, store=store)
        path.write_bytes({
            "damaged": data[:500] + bytes([data[500] ^ 255]) + data[501:],
            "truncated": data[:300],
            "foreign": b"Time,Speed1\n",
            "newer": resealed(lambda *_: None, data, SCHEMA + 1),
            "another": store.path(other.analysis.key).read_bytes(),
        }[content])  # fmt: skip
        again = run(make_analysis(recording), recording, store=store)
        (problem,) = problems(again)
        assert path.name in problem
        assert "\n" not in problem
        assert again.parameters == first.parameters
        assert problems(run(make_analysis(recording), recording, store=store)) == []


class TestCourse:
    def test_the_point_is_told_before_its_intervals(self, recording: Recording) -> None:
        watched = Watched()
        result = run(
            make_analysis(recording, "pinn", windows=TWO), recording, context=watched.context
        )
        first, told = [what for what in watched.seen if isinstance(what, Estimate)]
        at = watched.seen.index(told)
        phases = [phase for phase in watched.seen if phase == PARAMETERS]
        assert watched.seen[: at - 2] == phases
        assert watched.seen[at - 2 : at] == [first, CURVES]
        assert watched.seen[at + 1 :] == [*[INTERVALS] * 3, VARIATION], "by window and follower"
        assert (len(first.curves), len(told.curves)) == (0, 2), "at first without its curves"
        for one in (first, told):
            assert (one.posterior, one.windows, one.outcome) == (None, None, Outcome.CONVERGED)
            assert one.parameters == result.parameters
        assert result.estimate.seconds > told.seconds
        intervals = [moment for moment in watched.moments if moment.phase == INTERVALS]
        assert [moment.iteration for moment in intervals] == [0, 1, 2]
        assert {moment.iterations for moment in intervals} == {2}
        assert all(moment.left > 0.0 for moment in watched.moments), "there is always a next phase"
        assert watched.moments[-1].parameters == result.history.parameters[-1]
        assert len(result.history.iteration) == len(phases), "the point's alone"
        assert result.posterior.windows_lower.values.shape == (2, 1, 3)

    def test_a_point_without_posterior_is_told_at_its_end(self, recording: Recording) -> None:
        watched = Watched()
        quick = preset("fast", iterations=20)
        result = run(
            make_analysis(recording, "pinn", settings=quick), recording, context=watched.context
        )
        assert "intervals" not in watched.seen
        last = watched.seen[-1]
        assert isinstance(last, Estimate)
        assert bits(last.parameters) == bits(result.parameters)
        assert (result.posterior, result.uncertainty, result.gap_band) == (None, None, None)
        assert (result.gain_checks, result.weaknesses) == ((), ())
        assert result.trust[0].same is None

    @pytest.mark.parametrize("after", [0, 1])
    def test_stopped_during_intervals_the_point_is_left_and_not_kept(
        self, recording: Recording, store: Store, after: int
    ) -> None:
        question, watched = (
            make_analysis(recording, "pinn", windows=TWO),
            Watched("intervals", after),
        )
        stopped = run(question, recording, store=store, context=watched.context)
        estimate = stopped.estimate
        assert (estimate.outcome, estimate.posterior, estimate.windows) == (
            Outcome.STOPPED,
            None,
            None,
        )
        assert not stopped.is_finished
        assert store.find(question) is None
        whole = run(question, recording, store=store)
        assert whole.parameters == stopped.parameters
        assert whole.posterior is not None
        assert store.find(question) is not None

    def test_stopped_before_there_are_no_intervals(
        self, recording: Recording, store: Store
    ) -> None:
        question, watched = make_analysis(recording, "pinn"), Watched("parameters", 2)
        stopped = run(question, recording, store=store, context=watched.context)
        assert (stopped.estimate.outcome, stopped.posterior) == (Outcome.STOPPED, None)
        assert "intervals" not in watched.seen
        assert store.find(question) is None


class TestWindows:
    def test_several_share_one_estimate(self, recording: Recording, store: Store) -> None:
        question = make_analysis(recording, "pinn", windows=TWO)
        joint = run(question, recording, store=store)
        again = run(question, recording, store=store)
        assert again.estimate.cached
        assert [segment.start for segment in again.segments] == [0.0, 60.0]
        alone = run(replace(question, windows=(TWO[1],)), recording)
        assert again.qualities[1].condition == alone.quality.condition
        np.testing.assert_allclose(joint.estimate.windows.values[1], alone.parameters.values, 1e-3)
        loops = [ClosedLoop.of(segment, joint.estimate) for segment in joint.segments]
        mean = np.mean([loop.errors.gap_mae for loop in loops], axis=0)
        assert again.evaluation.closed_loop.gap_mae == pytest.approx(mean, rel=1e-3)
        left = recording.duration - 120.0
        assert joint.evaluation.out_of_window_seconds == pytest.approx(left, abs=1.0)
        gaps = [quality.mean_time_gap for quality in joint.qualities]
        assert joint.mean_time_gaps == pytest.approx(np.mean(gaps, axis=0), rel=1e-3)
        assert [motion.time[-1] for motion in joint.simulated] == [60.0, 60.0]
        held_out = joint.with_holdout()
        assert [block.window for block in held_out.blocks] == TWO
        assert held_out.evaluation.holdout.gap_mae.shape == (1,)

    def test_what_bounds_rule_out_is_that_of_all_windows(self) -> None:
        whole = driven(((0.10, -0.04, 1.8),), duration=100.0, noise=0.05)
        windows = whole.part(0, 501), whole.part(501, whole.samples)
        estimate = fit(windows, model="cthp").estimate
        assert estimate.parameters.beta[0] == 0.0
        assert estimate.active_bounds == (("β",),)
        assert estimate.unconstrained.beta[0] == pytest.approx(-0.04, abs=0.02)

    def test_together_they_are_nearer_the_truth_than_each_alone(self) -> None:
        """Four recordings, so that no two share samples."""
        truth = Parameters([0.08], [0.2], [1.3])
        windows = [disturbed(truth, seed, Disturbance(), duration=150.0) for seed in range(4)]

        def off(parameters: Parameters) -> float:
            return float(np.abs(np.log(parameters[0].values / truth[0].values)).mean())

        joint = point(windows, model="cthp").parameters
        alone = [point(window, model="cthp").parameters for window in windows]
        assert off(joint) < 0.7 * np.mean([off(result) for result in alone])


def recorded(start: float, **changes: object) -> Segment:
    """A window of one recording; short, as it is to be refused."""
    return replace(driven(), start=start, sha256="one file", **changes)


@pytest.mark.parametrize(
    ("segments", "method", "words"),
    [
        ([], "pinn", "choose a file's path, a recording, or segments"),
        ([recorded(0.0), recorded(59.0)], "pinn", "0–60 s and 59–119 s overlap"),
        ([driven(), driven()], "least-squares", "0–60 s and 0–60 s overlap"),
        ([recorded(0.0), driven(MIXED[:2])], "splines", "2 followers"),
        ([recorded(0.0), driven(step=0.4)], "pinn", "0.4 s apart"),
        ([recorded(0.0), driven(duration=15.0)], "pinn", "too short"),
        ([recorded(0.0), driven(duration=15.0)], "simulation", "too short to be simulated"),
    ],
)
def test_segments_that_cannot_share_an_estimate(
    segments: list[Segment], method: str, words: str
) -> None:
    with pytest.raises(AccpinnError, match=words):
        fit(segments, method=method)


def test_steps_may_differ_where_no_likelihood_is_shared() -> None:
    result = fit([recorded(0.0), driven(step=0.2)], method="least-squares")
    np.testing.assert_allclose(result.parameters.values[0], [0.08, 0.12, 1.5], rtol=5e-3)


class TestResult:
    def test_data_of_another_recording_or_window_are_refused(self, recording: Recording) -> None:
        result = run(make_analysis(recording), recording)
        with pytest.raises(SegmentError, match="not the recording"):
            whole().with_data(recording)
        with pytest.raises(SegmentError, match="the window cut from it differs"):
            result.with_data(replace(recording, gap=recording.gap + 1.0))
        for other in (None, recording):
            assert whole().found_in(other) is whole()
        bare = replace(result, recording=None)
        assert bare.evaluation.out_of_window is None
        assert bare.found_in(recording).recording is recording
        assert bare.with_data(recording).evaluation.out_of_window is not None

    def test_what_follows_is_of_its_estimate(self) -> None:
        result = small()
        (vehicle,) = result.stability.vehicles
        assert vehicle.parameters == result.estimate.parameters[0]
        (transfer,) = result.transfer_functions()
        assert abs(transfer(1j * vehicle.peak.omega)) == pytest.approx(vehicle.peak.gain)
        lost = altered(result, parameters=Parameters([0.1], [0.1], [np.nan]))
        assert lost.stability is None
        with pytest.raises(ParameterError):
            lost.transfer_functions()

    def test_what_is_known_of_it_is_centred_on_its_estimate(self) -> None:
        result = two_windows()
        assert result.uncertainty.centre == result.parameters
        assert result.uncertainty.draws == result.posterior.typical
        assert result.uncertainty.level == result.estimate.level
        band = result.gap_band
        assert band.lower.shape == band.upper.shape == (len(band.time), 1)
        assert [gain_check.vehicle for gain_check in result.gain_checks] == [2]
        assert (result.trust[0].windows, result.trust[0].same in range(3)) == (2, True)
