"""From a question to its answer: its key; by the method, from the store, of windows."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import accpinn
from accpinn import METHODS, Parameters, Segment, Store, preset
from accpinn.errors import AccpinnError, SegmentError
from accpinn.evaluation.closed_loop import ClosedLoop
from accpinn.methods.estimate import CacheProblem, ParameterTrack
from accpinn.recordings import Recording, Window
from accpinn.recordings.openacc import read
from accpinn.serial import dump, flatten, restore
from accpinn.study import Analysis, differences
from accpinn.study import result as module
from accpinn.study.result import TRACK_INSTANTS, Result
from accpinn.study.run import estimate, fit_windows, run
from accpinn.study.snapshot import SCHEMA
from bench.disturbed import Disturbance, disturbed
from tests.support.driving import MIXED, driven
from tests.support.samples import FOLDER, NOISY
from tests.support.snapshots import bits, platoon, put, resealed, small, whole

ASKED = Analysis.of(platoon(), [Window(0, 60)], "1-3", excluded=["catching up", "manual"])


def test_equal_questions_have_equal_keys(tmp_path: Path) -> None:
    renamed = tmp_path / "renamed.csv"
    renamed.write_bytes((FOLDER / "synthetic_astazero_like.csv").read_bytes())
    others = (
        Analysis.of(read(renamed), [Window(0, 60)], "1-3", excluded=["catching up", "manual"]),
        Analysis.of(platoon(), [Window(0.0, 60.0)], (1, 2, 3), excluded="manual,catching-up"),
        Analysis.of(platoon(), [Window(0, 60)], np.arange(1, 4), excluded=["manual"] * 2
                    + ["catching up"], settings=preset("fast")),
        Analysis.of(platoon(), [Window(0, 60)], "1-3", excluded=["catching up", "manual"],
                    settings=preset("fast").to_json()),
        restore(Analysis, json.loads(json.dumps(dump(ASKED)[0])), {}),
    )  # fmt: skip
    assert {other.key for other in others} == {ASKED.key}
    assert len(ASKED.key) == 64
    assert others[-1] == ASKED


OTHERS = {"case": "I", "method": "splines"}


def changed(leaf: Any) -> Any:
    if isinstance(leaf, bool):
        return not leaf
    return leaf + 1 if isinstance(leaf, int | float) else f"{leaf}x"


@given(st.data())
def test_whatever_determines_the_answer_changes_the_key(data: st.DataObject) -> None:
    tree = dump(ASKED)[0]
    # Least squares cannot estimate another model than the paper's delay, so none is fitted.
    told = {"source.name", "source.sha256", "source.trajectory", "fitted"}
    places = list(flatten(tree))
    place, leaf = data.draw(st.sampled_from(places))
    put(tree, place.split("."), OTHERS.get(place, changed(leaf)))
    other = restore(Analysis, tree, {})
    assert (other.key == ASKED.key) == (place in told)
    of_answer = place == "model" or place.startswith("held")
    assert (other.fit_key == ASKED.fit_key) == (place in told or of_answer)


def test_a_methods_version_changes_the_key(monkeypatch: pytest.MonkeyPatch) -> None:
    method = replace(METHODS["pinn"], version=METHODS["pinn"].version + 1)
    monkeypatch.setitem(METHODS, "pinn", method)
    assert replace(ASKED).key != ASKED.key


def test_a_longer_training_goes_on_from_a_shorter_ones_checkpoint() -> None:
    short, long, seeded = (
        ASKED.with_method("pinn", preset("paper", **changes))
        for changes in ({"iterations": 10}, {"iterations": 20}, {"seed": 1})
    )
    assert short.checkpoint_key == long.checkpoint_key != seeded.checkpoint_key
    assert short.key != long.key
    assert replace(short, model="cthp").checkpoint_key == short.checkpoint_key
    assert ASKED.checkpoint_key == ASKED.with_method("splines").checkpoint_key == ""


def test_differences_name_what_was_asked_otherwise() -> None:
    assert differences(ASKED, ASKED) == ()
    moved = replace(ASKED, windows=(Window(40.0, 340.0),), case="I", excluded=())
    said = differences(ASKED, moved)
    assert "case: II → I" in said
    assert "window: 0–60 s → 40–340 s" in said
    assert any(one.startswith("excluded") and one.endswith("nothing") for one in said)
    assert differences(ASKED, ASKED.with_method("pinn", preset("fast", seed=3))) == ("seed: 0 → 3",)


@pytest.mark.parametrize(
    ("asked", "words"),
    [
        ({"recording": None}, "recording"),
        ({"case": "III"}, "choose I or II"),
        ({"start": "0"}, "start"),
        ({"duration": True}, "duration"),
        ({"method": "pinn", "seed": "a"}, "seed"),
        ({"seed": 1.5}, "seed"),
        ({"vehicles": (1.0, 2.0)}, "vehicles"),
        ({"exclude": "lunch"}, "catching-up"),
        ({"windows": "0-60,60-120", "method": "pinn", "preset": "fast"}, "takes one window"),
        ({"windows": "0-60,60-120", "method": "splines"}, "choose one of them"),
        ({"model": "gipps"}, "cthp-s0-delay"),
        ({"model": "cthp", "hold": {"s0": 4.0}}, "s0 cannot be held; cthp has no term to hold"),
        (
            {"model": "cthp-s0-lag", "hold": {"delay": 0.5}},
            "delay cannot .* has s0, lag to hold",
        ),
        ({"model": "cthp-s0", "hold": {"alpha": 0.1}}, "alpha cannot be .* has s0 to hold"),
        ({"hold": {"s0": 400.0}}, "-30 to 60"),
        ({"hold": {"s0": np.nan}}, "s0 = nan is not allowed; choose -30 to 60"),
        ({"method": "pinn", "threads": -1}, "threads"),
        ({"method": "pinn", "threads": "2"}, "threads"),
    ],
    ids=str,
)
def test_an_argument_out_of_range_is_named(asked: dict[str, Any], words: str) -> None:
    with pytest.raises(AccpinnError, match=words) as fault:
        accpinn.fit(**{"recording": FOLDER / f"{NOISY}.csv", "method": "splines"} | asked)
    assert str(fault.value).endswith(".")
    assert "\n" not in str(fault.value)


@pytest.fixture(scope="module")
def recording() -> Recording:
    return read(FOLDER / f"{NOISY}.csv")


def asked(recording: Recording, method: str = "splines", **changes: object) -> Analysis:
    return Analysis.of(recording, [Window(0.0, 60.0)], method=method, **changes)


def problems(result: Result) -> list[str]:
    return [one.problem for one in result.fit.findings if isinstance(one, CacheProblem)]


class TestRun:
    def test_the_second_time_it_comes_from_the_store_with_its_parts(
        self, recording: Recording, store: Store, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        first = run(asked(recording), recording, store=store)
        store.keep(first.without_data())
        failing = replace(METHODS["splines"], run=None)
        monkeypatch.setitem(METHODS, "splines", failing)
        monkeypatch.setattr(module, "intervals", None)
        again = run(asked(recording), recording, store=store)
        assert (first.fit.cached, again.fit.cached) == (False, True)
        assert bits(replace(again.fit, cached=False)) == bits(first.fit)
        assert bits(again.uncertainty) == bits(first.uncertainty)
        assert again.quality.leader_deviation == first.quality.leader_deviation
        assert again.recording is recording
        assert problems(again) == []
        other = run(asked(recording, model="idm"), recording, store=store)
        assert (other.fit.cached, other.fit.model, other.parts.answer) == (True, "cthp", None)

    @pytest.mark.parametrize("content", ["damaged", "truncated", "foreign", "newer", "another"])
    def test_a_file_that_cannot_be_used_is_said_once_and_computed_again(
        self, recording: Recording, store: Store, content: str
    ) -> None:
        first = run(asked(recording), recording, store=store)
        path = store.path(first.analysis.fit_key)
        data = path.read_bytes()
        other = run(asked(recording, "least-squares"), recording, store=store)
        path.write_bytes({
            "damaged": data[:500] + bytes([data[500] ^ 255]) + data[501:],
            "truncated": data[:300],
            "foreign": b"Time,Speed1\n",
            "newer": resealed(lambda *_: None, data, SCHEMA + 1),
            "another": store.path(other.analysis.fit_key).read_bytes(),
        }[content])  # fmt: skip
        again = run(asked(recording), recording, store=store)
        (said,) = problems(again)
        assert path.name in said
        assert "\n" not in said
        assert again.parameters == first.parameters
        assert problems(run(asked(recording), recording, store=store)) == []

    def test_several_windows_share_one_likelihood(self, recording: Recording, store: Store) -> None:
        windows = [Window(0.0, 60.0), Window(60.0, 120.0)]
        analysis = Analysis.of(recording, windows, method="maximum-likelihood")
        joint = run(analysis, recording, store=store)
        assert [fit.parameters == joint.parameters for fit in joint.fits] == [True, True]
        again = run(analysis, recording, store=store)
        assert again.fit.cached
        assert [one.start for one in again.segments] == [0.0, 60.0]
        alone = run(replace(analysis, windows=windows[1:]), recording)
        assert again.qualities[1].condition == alone.quality.condition
        pairs = zip(joint.segments, joint.fits, strict=True)
        mean = np.mean([ClosedLoop.of(*pair).errors.gap_mae for pair in pairs], axis=0)
        assert again.evaluation.closed_loop.gap_mae == pytest.approx(mean, rel=1e-3)
        left = recording.duration - 120.0
        assert joint.evaluation.out_of_window_seconds == pytest.approx(left, abs=1.0)
        gaps = [quality.mean_time_gap for quality in joint.qualities]
        assert joint.mean_time_gaps == pytest.approx(np.mean(gaps, axis=0), rel=1e-3)


class TestResult:
    def test_without_the_data_what_is_missing_is_a_sentence(self, recording: Recording) -> None:
        bare = replace(run(asked(recording), recording), segments=(), recording=None)
        for name in ("qualities", "uncertainty", "evaluation", "adequacy"):
            with pytest.raises(SegmentError, match="the data are not at hand"):
                getattr(bare, name)
        assert (bare.segment, bare.simulated) == (None, None)
        whole = bare.with_data(recording)
        assert whole.uncertainty.lower.tau[0] < whole.parameters.tau[0]
        assert bare.found_in(recording).segment is not None

    def test_data_of_another_recording_or_window_are_refused(self, recording: Recording) -> None:
        result = run(asked(recording), recording)
        with pytest.raises(SegmentError, match="not the recording"):
            whole().with_data(recording)
        with pytest.raises(SegmentError, match="the window cut from it differs"):
            result.with_data(replace(recording, gap=recording.gap + 1.0))
        for other in (None, recording):
            assert whole().found_in(other) is whole()

    def test_a_row_has_no_curves_and_a_thinned_track(self) -> None:
        time = np.arange(3000.0)
        track = ParameterTrack(time, Parameters.of(np.ones((3000, 4, 3))), None)
        row = replace(whole(), fits=(replace(whole().fit, track=track),)).as_row()
        assert (row.fit.surrogate, row.fit.history, row.fit.arrays) == (None, None, {})
        assert len(row.fit.track.time) == TRACK_INSTANTS
        assert row.fit.track.time[-1] == 2999.0
        assert (row.segments, row.compared) == ((), ())
        assert row.uncertainty is whole().uncertainty

    def test_what_follows_from_the_parameters_needs_no_data(self) -> None:
        result = replace(small(), segments=())
        (vehicle,) = result.stability.vehicles
        (transfer,) = result.transfer_function()
        assert abs(transfer(1j * vehicle.peak.omega)) == pytest.approx(vehicle.peak.gain)
        lost = replace(result.fit, parameters=Parameters([0.1], [0.1], [np.nan]))
        assert replace(result, fits=(lost,)).stability is None


TRUTH = Parameters([0.08], [0.2], [1.3])


@pytest.fixture(scope="module")
def same() -> Result:
    """Four recordings, so that no two share samples."""
    windows = [disturbed(TRUTH, seed, Disturbance(), duration=150.0) for seed in range(4)]
    return fit_windows(windows)


class TestJointFit:
    @pytest.mark.usefixtures("all_draws")
    def test_windows_together_say_more_than_one_alone(self, same: Result) -> None:
        def off(parameters: Parameters) -> float:
            return float(np.abs(np.log(parameters[0].values / TRUTH[0].values)).mean())

        asked = [replace(same.analysis, windows=(window,)) for window in same.analysis.windows]
        alone = [
            estimate(analysis, (segment,))
            for analysis, segment in zip(asked, same.segments, strict=True)
        ]
        assert off(same.parameters) < 0.7 * np.mean([off(part.parameters) for part in alone])
        ends = [part.uncertainty for part in (same, *alone)]
        widths = [end.upper.values / end.lower.values for end in ends]
        assert (widths[0] < np.min(widths[1:], axis=0)).all()
        assert same.uncertainty.inside.all()
        assert all(fit.parameters == same.parameters for fit in same.fits)
        assert same.answer.findings == ()

    def test_what_bounds_rule_out_is_that_of_all_windows(self) -> None:
        whole = driven(((0.10, -0.04, 1.8),), duration=100.0, noise=0.05)
        windows = whole.part(0, 501), whole.part(501, whole.samples)
        found = fit_windows(windows, model="cthp")
        assert found.parameters.beta[0] == 0.0
        one, other = (fit.unconstrained.values[0] for fit in found.fits)
        np.testing.assert_array_equal(one, other)
        assert one[1] == pytest.approx(-0.04, abs=0.02)


def recorded(start: float, **changes: object) -> Segment:
    """A window of one recording; short, as it is to be refused."""
    return replace(driven(), start=start, sha256="one file", **changes)


@pytest.mark.parametrize(
    ("segments", "words"),
    [
        ([], "at least two"),
        ([recorded(0.0)], "at least two"),
        ([recorded(0.0), recorded(59.0)], "0–60 s and 59–119 s overlap"),
        ([driven(), driven()], "0–60 s and 0–60 s overlap"),
        ([recorded(0.0), driven(MIXED[:2])], "2 followers"),
        ([recorded(0.0), driven(step=0.4)], "0.4 s apart"),
        ([recorded(0.0), driven(duration=15.0)], "too short"),
    ],
)
def test_segments_that_cannot_share_a_likelihood(segments: list[Segment], words: str) -> None:
    with pytest.raises(AccpinnError, match=words):
        fit_windows(segments)
