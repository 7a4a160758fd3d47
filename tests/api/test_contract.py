"""Promises to scripts: one default, frames, responses, platoons, own models and methods."""

from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import accpinn
from accpinn import AccpinnError, Parameters, Result
from accpinn.methods.registry import METHODS
from accpinn.model.registry import FOLLOWING, fingerprint
from accpinn.results.marks import EXTRAPOLATED
from accpinn.study.batch import batch
from tests.support.command import Capture, document
from tests.support.samples import FOLDER, NOISY
from tests.support.snapshots import recommended, trained, two_windows

SHORT = {"start": 0, "duration": 60, "vehicles": "1-2"}


@cache
def point() -> Result:
    return accpinn.fit(accpinn.sample("motorway"), vehicles="1-3", method="splines")


@cache
def nonlinear() -> Result:
    """The IDM of one follower, with its posterior."""
    return accpinn.fit(accpinn.sample("astazero_like"), 0, 60, "1-2", model="idm")


class TestDefaults:
    @pytest.mark.parametrize(
        ("options", "preset", "iterations"),
        [
            ({}, "calibrated", 300),
            ({"settings": {"iterations": 7}}, "calibrated", 7),
            ({"preset": "fast", "settings": {"width": 20}}, "fast", 600),
            ({"settings": {"preset": "paper"}}, "paper", 20_000),
            ({"settings": {"preset": "fast"}, "seed": np.int64(3)}, "fast", 600),
        ],
    )
    def test_settings_start_from_the_preset_that_is_named(
        self, options: dict[str, Any], preset: str, iterations: int
    ) -> None:
        settings = accpinn.analyse(accpinn.sample("motorway"), **options).settings
        assert (settings["preset"], settings["iterations"]) == (preset, iterations)
        assert settings["seed"] == options.get("seed", 0)

    def test_an_analysis_has_the_default_of_fit_and_of_the_command_line(
        self, capsys: Capture
    ) -> None:
        recording = accpinn.sample("paper_study")
        analysis = accpinn.Analysis.of(recording)
        assert analysis == accpinn.analyse(recording)
        output = document(capsys, "fit", accpinn.sample_path("paper_study"), "--duration", 30,
                        "--no-cache")  # fmt: skip
        kind = (analysis.method, analysis.spec.model, analysis.settings["preset"])
        assert (output["method"], output["model"], output["preset"]) == kind

    @pytest.mark.parametrize(
        ("options", "words"),
        [
            ({"method": "splines", "seed": 0}, "seed: the method splines has none"),
            ({"method": "splines", "settings": {"seed": 0}}, "settings: the method splines"),
            ({"preset": "fast", "settings": {"preset": "paper"}}, "preset: fast contradicts"),
            ({"settings": {"width": "wide"}}, "width = 'wide' is not allowed"),
            ({"hold": {"s0": 4}}, "hold: fit has no such argument; choose fixed"),
            ({"fixed": {"s0": "4"}}, "fixed: {'s0': '4'} is not allowed; choose numbers"),
            ({"vehicles": 2}, "vehicles: 2 is not allowed; choose consecutive"),
            ({"windows": (0, 100)}, "windows: .0, 100. is not allowed; choose pairs"),
            ({"store": "folder"}, "store: 'folder' is not allowed; choose an accpinn.Store"),
            ({"threads": 0}, "threads: 0 is not allowed"),
            ({"case": "III"}, "choose I or II"),
        ],
    )
    def test_arguments_without_effect_and_wrong_ones_are_named(
        self, options: dict[str, Any], words: str
    ) -> None:
        with pytest.raises(AccpinnError, match=words):
            accpinn.fit(accpinn.sample("motorway"), **options)

    def test_settings_on_the_command_line(self, capsys: Capture) -> None:
        given = ("--preset", "fast", "--settings", "width=20", "--settings", "iterations=5")
        path = accpinn.sample_path("paper_study")
        output = document(capsys, "fit", path, "--duration", 30, "--no-cache", *given)
        assert (output["preset"], output["iterations"]) == ("fast", 5)
        usual = document(
            capsys, "fit", path, "--duration", 30, "--no-cache", *given[:2], *given[4:]
        )
        assert output["network_weights"] < usual["network_weights"]


class TestFrames:
    def test_an_estimate_without_a_posterior_has_nan_for_ends(self) -> None:
        frame, estimate = point().to_frame(), point().estimate
        assert frame.vehicle.tolist() == [2, 3]
        assert set(frame.method) == {"splines"}
        np.testing.assert_array_equal(frame.alpha, estimate.parameters.alpha)
        assert frame[["alpha_low", "tau_high"]].isna().all(axis=None)

    def test_intervals_have_the_level_that_is_asked_for(self) -> None:
        result = two_windows()
        usual, narrow = result.to_frame(), result.to_frame(level=0.5)
        for name in result.estimate.names:
            span = result.estimate.span(name, 0)
            assert usual[f"{name}_low"][0] == span.lower
            assert usual[f"{name}_low"][0] < narrow[f"{name}_low"][0]
            assert narrow[f"{name}_high"][0] < usual[f"{name}_high"][0]
        with pytest.raises(AccpinnError, match="level: 2 is not allowed"):
            result.to_frame(level=2)

    def test_a_value_at_a_speed_that_no_window_holds_is_marked(self) -> None:
        result = two_windows()
        frame = result.to_frame()
        table = accpinn.parameter_table(result)
        for speed in (50, 100):
            is_driven = result.estimate.is_driven(speed / 3.6, 0)
            key = f"time_gap_at_{speed}_kmh_s"
            assert frame[f"{key}_extrapolated"][0] != is_driven
            notes = table.to_frame().get(f"{key}_note", [""])
            assert bool(notes[0]) != is_driven
            assert (f"{key}_note" in table.to_csv()) != is_driven
        assert any(
            line.startswith(f"{EXTRAPOLATED.glyph}: ") for line in table.to_text().splitlines()
        )

    @pytest.mark.parametrize("made", [two_windows, nonlinear])
    def test_draws_have_the_names_of_the_model(self, made: Any) -> None:
        result = made()
        frame, posterior = result.posterior.to_frame(), result.posterior
        assert set(frame.columns) == {"kind", "vehicle", "draw", *result.estimate.names}
        typical = frame[frame.kind == "typical"]
        for name in result.estimate.names:
            expected = result.estimate.values(posterior.typical, name)[:, 0]
            np.testing.assert_array_equal(typical[name], expected)

    def test_the_course_of_a_training(self) -> None:
        history = trained().history
        frame = history.to_frame()
        np.testing.assert_array_equal(frame.total, history.total)
        last = frame.iloc[-1]
        names = [name for name in frame if name.startswith("alpha")]
        assert len(names) == history.parameters.alpha.shape[1]
        assert last[names[0]] == history.parameters.alpha[-1, 0]


class TestWhatFollows:
    def test_the_response_is_that_of_the_transfer_functions(self) -> None:
        omega = np.geomspace(0.01, 2.0, 20)
        response = point().frequency_response(omega)
        assert response.shape == (20, 2)
        for k, system in enumerate(point().transfer_functions()):
            np.testing.assert_allclose(system(1j * omega), response[:, k], rtol=1e-9)

    @pytest.mark.parametrize("omega", [-1.0, [np.nan], [[1.0]], "fast", [-1.0]])
    def test_invalid_frequencies_are_refused(self, omega: Any) -> None:
        with pytest.raises(AccpinnError, match="omega"):
            point().frequency_response(omega)

    def test_the_approximant_of_a_delay_is_as_close_as_documented(self) -> None:
        omega = np.linspace(0.001, 2.0, 2000)
        s = 1j * omega
        for delay, most in ((0.5, 3e-4), (1.0, 8e-3)):
            car = Parameters(0.08, 0.3, 1.2, delay=delay)
            late = np.exp(-delay * s)
            loop = (0.3 + 0.08 * 1.2) * s + 0.08
            exact = (0.3 * s + 0.08) * late / (s**2 + loop * late)
            approximate = accpinn.transfer_function(car)(s)
            assert most / 2 < np.abs(approximate - exact).max() < most
            assert np.abs(approximate).max() == pytest.approx(np.abs(exact).max(), rel=1e-5)

    def test_a_platoon_of_one_car_and_of_a_result(self) -> None:
        leader = accpinn.Sinusoid(0.25, duration=100)
        car = point().parameters[0]
        eight = accpinn.simulate_platoon(car, leader, followers=8)
        same = accpinn.simulate_platoon(Parameters.stack([car] * 8), leader)
        np.testing.assert_array_equal(eight.trajectories.speeds, same.trajectories.speeds)
        pair = accpinn.simulate_platoon(point(), leader)
        assert pair.trajectories.gaps.shape[1] == 2
        with pytest.raises(AccpinnError, match="2 parameter sets make 2 followers"):
            accpinn.simulate_platoon(point(), leader, followers=8)
        with pytest.raises(AccpinnError, match="name it, or give the result"):
            accpinn.simulate_platoon(nonlinear().parameters, leader)
        with pytest.raises(AccpinnError, match="not those of cthp"):
            accpinn.simulate_platoon(nonlinear().parameters, leader, model="cthp")
        assert accpinn.simulate_platoon(nonlinear(), leader).trajectories.gaps.shape[1] == 1

    def test_a_leader_of_ones_own(self) -> None:
        time = np.arange(0, 60, 0.1)
        speed = 20 + np.sin(0.3 * time)
        even = accpinn.Recorded(time, speed)
        sampled = np.random.default_rng(0).random(len(time)) < 0.8
        sampled[[0, -1]] = True
        uneven = accpinn.Recorded(time[sampled], speed[sampled])
        np.testing.assert_allclose(np.diff(uneven.time), 0.1, rtol=1e-3)
        np.testing.assert_allclose(np.interp(time, uneven.time, uneven.speeds), speed, atol=2e-2)
        car = Parameters(0.08, 0.3, 1.2)
        runs = [accpinn.simulate_platoon(car, leader) for leader in (even, uneven)]
        ends = [run.trajectories.speeds[-1, 1] for run in runs]
        assert ends[0] == pytest.approx(ends[1], abs=1e-2)

    @pytest.mark.parametrize(
        ("time", "speeds"),
        [
            ([0, 1, 2], [20, np.nan, 20]),
            ([0, 1, 1], [20, 20, 20]),
            ([0, 1], [20, 20, 20]),
            ([0], [20]),
            ("time", "speeds"),
            ([[0, 1]], [[20, 20]]),
        ],
    )
    def test_an_invalid_leader_is_refused(self, time: Any, speeds: Any) -> None:
        with pytest.raises(AccpinnError, match="Leader: "):
            accpinn.Recorded(time, speeds)

    def test_a_criterion_is_its_verdict_or_an_error(self) -> None:
        (car,) = accpinn.stability_report(Parameters(0.08, 0.3, 1.2)).vehicles
        assert (bool(car.l2), bool(car.linf_paper)) == (car.l2.stable, car.linf_paper.stable)
        with pytest.raises(AccpinnError, match="ask a verdict"):
            bool(car.l2.criterion)


MODEL = """
import accpinn

def acceleration(p, v, u, theta, xp):
    return theta[0] * (p - theta[1] - theta[2] * v) + theta[3] * (u - v)

accpinn.register_model(accpinn.FollowingModel("linear", "Linear", (
    accpinn.Parameter("k", "k", "1/s²", 1e-3, 5.0, 0.1, 1.0),
    accpinn.Parameter("d", "d", "m", 0.1, 50.0, 4.0, 0.7),
    accpinn.Parameter("T", "T", "s", 0.1, 5.0, 1.2, 0.4),
    accpinn.Parameter("c", "c", "1/s", 1e-3, 5.0, 0.2, 1.0),
), acceleration))
"""


@pytest.mark.usefixtures("registries")
class TestOwnModels:
    def test_a_model_from_a_script_is_estimated_kept_and_unknown_elsewhere(
        self, tmp_path: Path
    ) -> None:
        exec(MODEL, {})
        result = accpinn.fit(accpinn.sample("paper_study"), 0, 60, model="linear")
        assert result.estimate.names == ("k", "d", "T", "c")
        assert result.to_frame()["T"][0] == pytest.approx(1.0, abs=0.5)
        path = accpinn.save(result, tmp_path / "own.accpinn.zip")
        assert accpinn.load(path).estimate.model == "linear"
        for key in ("linear", "linear-lag", "linear-delay"):
            del FOLLOWING[key]
        with pytest.raises(AccpinnError, match='"linear" is not known here; register it first'):
            accpinn.load(path)

    def test_another_acceleration_under_the_same_key_is_another_question(self) -> None:
        recording = accpinn.sample("paper_study")
        exec(MODEL, {})
        before = accpinn.analyse(recording, model="linear").key, fingerprint("linear")
        exec(MODEL, {})
        assert before == (accpinn.analyse(recording, model="linear").key, fingerprint("linear"))
        exec(MODEL.replace("(u - v)", "(u - v) * 1.01"), {})
        after = accpinn.analyse(recording, model="linear").key, fingerprint("linear")
        assert before[0] != after[0]
        assert before[1] != after[1]

    @pytest.mark.parametrize(
        ("changes", "words"),
        [
            ({"key": "idm"}, "the package's own"),
            ({"key": "My model"}, "not lower case"),
            ({"parameters": ()}, "no parameters"),
            ({"acceleration": lambda p, v: p}, "fails at ordinary motions"),
            ({"acceleration": lambda p, v, u, theta, xp: xp.abs(p)[:2]}, "fails at ordinary"),
        ],
    )
    def test_an_invalid_model_is_refused(self, changes: dict[str, Any], words: str) -> None:
        exec(MODEL, {})
        with pytest.raises(AccpinnError, match=words):
            accpinn.register_model(replace(FOLLOWING["linear"], **changes))

    def test_a_method_is_known_by_its_key(self, capsys: Capture) -> None:
        accpinn.register_method(replace(METHODS["splines"], key="mine", title="Mine"))
        path = FOLDER / f"{NOISY}.csv"
        (row,) = accpinn.compare(path, 0, 60, methods=("mine",))
        assert row.estimate.method == "splines"  # what the function itself says
        output = document(capsys, "fit", path, "--method", "mine", "--duration", 60, "--no-cache")
        assert output["parameters"][0]["alpha"] == row.parameters.alpha[0]
        with pytest.raises(AccpinnError, match="package's own"):
            accpinn.register_method(METHODS["splines"])

    @pytest.mark.parametrize("text", ["1/0", "import accpinn", "syntax error", "\0"])
    def test_a_script_that_registers_nothing(self, text: str, tmp_path: Path) -> None:
        script = tmp_path / "own.py"
        script.write_text(text)
        with pytest.raises(AccpinnError, match=r"own\.py: it "):
            batch(tmp_path, tmp_path / "study", model=script)


def test_models_judged_as_a_frame() -> None:
    judgements = accpinn.judge(accpinn.sample("motorway"), ("cthp", "cthp-s0"), vehicles="1-2")
    frame = judgements.to_frame()
    assert frame.model.tolist() == [score.key for score in judgements[0].ranked]
    assert frame.gap_rmse.is_monotonic_increasing
    assert frame.best_in.sum() == frame.windows[0] == len(judgements[0].windows)
    assert frame.parameters[0].keys() == {*judgements[0].ranked[0].model.names}
    assert "More: .to_frame()" in str(judgements)


def test_progress_is_a_bar_or_calls_a_function(capsys: Capture) -> None:
    steps: list[accpinn.Progress] = []
    options = SHORT | {"preset": "fast", "settings": {"iterations": 30}}
    accpinn.fit(accpinn.sample("motorway"), **options, progress=steps.append)
    assert steps
    assert capsys.readouterr().err == ""
    accpinn.fit(accpinn.sample("motorway"), **options, progress=True)
    assert "loss" in capsys.readouterr().err


def test_a_segment_of_a_recording_is_a_source() -> None:
    recording = accpinn.sample("motorway")
    segment = accpinn.cut(recording, 0, 60, (1, 2))
    result = accpinn.fit(segment, method="splines")
    expected = accpinn.fit(recording, **SHORT, method="splines")
    assert result.parameters == expected.parameters


def test_an_unknown_sample_is_refused_with_the_choices() -> None:
    with pytest.raises(AccpinnError, match="choose astazero_like, motorway"):
        accpinn.sample("autobahn")


def test_the_recommended_estimate_has_intervals() -> None:
    result = recommended()
    assert result.to_frame().notna()[["alpha_low", "tau_high"]].all(axis=None)
