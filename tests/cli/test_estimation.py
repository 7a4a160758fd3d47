"""`fit`, `compare --models` and `runs`: their documents, options, cache and notes."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from accpinn.cli import main
from accpinn.cli.estimation import fit_text
from accpinn.evaluation.closed_loop import SimulatedCollision
from accpinn.methods.registry import METHODS
from accpinn.results.documents import describe_fit
from accpinn.results.naming import PAPERS_POINT, POINT
from tests.support.command import PLATOON, SHORT, STUDY, Capture, document, refused, strict
from tests.support.openacc_files import csv
from tests.support.samples import frame
from tests.support.snapshots import small

KEYS = {
    "method", "case", "preset", "seed", "segment", "parameters", "mae", "mean_time_gap", "loss",
    "network_weights", "iterations", "seconds", "cached", "outcome",
}  # fmt: skip
FEW_ROUNDS = ("--preset", "paper", "--iterations", 4)


def test_fit_has_the_document_of_the_contract(capsys: Capture) -> None:
    output = document(capsys, "fit", PLATOON, "--start", 10, *SHORT, "--vehicles", "4,5")
    assert output.keys() >= KEYS
    assert (output["method"], output["case"], output["model"]) == ("pinn", "II", "cthp-s0-delay")
    assert (output["preset"], output["seed"], output["outcome"]) == ("calibrated", 0, "converged")
    (answer,) = output["answer"]
    segment = output["segment"]
    assert (segment["start"], segment["duration"], segment["samples"]) == (10, 30, 301)
    assert segment["vehicles"] == [4, 5]
    (row,) = output["parameters"]
    assert (row["vehicle"], row["name"]) == (5, "Tesla(Model3-like)")
    assert min(row["alpha"], row["beta"], row["tau"]) > 0
    assert answer["parameters"] == {name: row[name] for name in answer["parameters"]}
    for name, (low, high) in answer["intervals"].items():
        assert low < answer["parameters"][name] < high, name
    counts = [len(output["mae"]["v"]), len(output["mae"]["p"]), len(output["mean_time_gap"])]
    assert counts == [2, 1, 1]
    loss = output["loss"]
    assert loss["total"] == pytest.approx(loss["data"] + loss["physics"])


def test_a_point_in_case_one_has_no_intervals(capsys: Capture) -> None:
    options = ("--method", "least-squares", "--vehicles", "3-5")
    words = ("fit", str(PLATOON), *SHORT, *options, "--case", "I", "--json")
    assert main([*words, "--threads", "1"]) == 0
    output = strict(capsys.readouterr().out)
    facts = [output[name] for name in ("method", "model", "outcome")]
    assert facts == ["least-squares", "cthp", "solved"]
    assert output["segment"]["left_out"] == {"regimes": [], "share": []}
    assert (output["preset"], output["network_weights"], output["mae"]) == (None, 0, None)
    assert (output["level"], bool(output["intervals"]), "answer" in output) == (None, False, False)
    assert len(output["closed_loop_mae"]["p"]) == 2
    first, second = output["parameters"]
    assert [first["vehicle"], second["vehicle"]] == [4, 5]
    assert first["alpha"] == second["alpha"]


def test_fixed_parameters_keep_their_values_under_both_option_names(capsys: Capture) -> None:
    part = ("fit", PLATOON, *SHORT, "--vehicles", "4,5", "--method", "maximum-likelihood")
    output = document(capsys, *part, "--fixed", "s0=4.5", "--hold", "delay=0.3")
    assert (output["method"], output["preset"]) == ("pinn", "calibrated")
    (row,) = output["parameters"]
    assert (row["s0"], row["delay"]) == (4.5, pytest.approx(0.3, rel=1e-12))


def test_regimes_are_left_out_when_asked(capsys: Capture, tmp_path: Path) -> None:
    far = frame(601)
    far.loc[:199, "IVS1"] += 60
    (tmp_path / "far.csv").write_bytes(csv(far))
    options = ("--method", "least-squares", "--leave-out", "catching-up,standstill")
    left_out = document(capsys, "fit", tmp_path / "far.csv", *options)["segment"]["left_out"]
    assert left_out["regimes"] == ["catching up", "standstill"]
    assert left_out["share"] == pytest.approx([200 / 601])


def test_the_paper_preset_has_its_model_and_takes_its_options(capsys: Capture) -> None:
    output = document(
        capsys,
        *("fit", PLATOON, *SHORT, *FEW_ROUNDS, "--lbfgs", 3, "--vehicles", "4,5"),
        *("--initial", "0.1,0.2,1.3", "--seed", 7, "--threads", 1),
    )
    assert (output["model"], output["network_weights"]) == ("cthp", 7623)
    assert (output["iterations"], output["seed"], output["outcome"]) == (7, 7, "finished")
    assert output["loss"].keys() >= {"test_data", "test_physics"}
    (row,) = output["parameters"]
    assert 1.3 != row["tau"] == pytest.approx(1.3, abs=0.3)
    assert any(PAPERS_POINT in note for note in output["notes"])


def test_undetermined_numbers_are_null(capsys: Capture, tmp_path: Path) -> None:
    """Vehicles that never move: no headway, no time gap, no closed loop, and no NaN."""
    still = frame(301).assign(Speed1=0.0, Speed2=0.0, IVS1=5.0)
    (tmp_path / "still.csv").write_bytes(csv(still))
    method = ("--method", "least-squares")
    output = document(capsys, "fit", tmp_path / "still.csv", *SHORT, *method)
    (row,) = output["parameters"]
    assert (row["alpha"], row["tau"]) == (0, None)
    assert output["mean_time_gap"] == [None]
    assert output["closed_loop_mae"] is None
    assert output["notes"]


def test_a_collision_stands_beside_the_closed_loop_errors() -> None:
    crash = replace(small().evaluation, findings=(SimulatedCollision(2, 12.3, -1.0),))
    swaying = replace(small())
    vars(swaying)["evaluation"] = crash
    (event,) = describe_fit(swaying)["incidents"]
    assert "collides with the vehicle ahead at" in event
    assert event in fit_text(swaying)
    assert not describe_fit(small())["incidents"]


def test_several_windows_have_the_keys_of_fit_and_each_window(capsys: Capture) -> None:
    options = ("--windows", "10-40,100-130", "--vehicles", "1-3")
    output = document(capsys, "fit", PLATOON, *options)
    assert output.keys() >= KEYS | {"windows", "intervals", "level"}
    segment = output["segment"]
    assert (segment["start"], segment["duration"], segment["samples"]) == (10, 60, 602)
    windows = [(window["start"], window["duration"]) for window in output["windows"]]
    assert windows == [(10, 30), (100, 30)]
    for window in output["windows"]:
        for row, intervals in zip(window["parameters"], window["intervals"], strict=True):
            inside = {
                n: intervals[n][0] <= row[n] <= intervals[n][1] for n in ("alpha", "s0", "delay")
            }
            assert all(inside.values()), inside
    assert [row["vehicle"] for row in output["parameters"]] == [2, 3]
    for row, intervals in zip(output["parameters"], output["intervals"], strict=True):
        assert all(intervals[name][0] < row[name] < intervals[name][1] for name in ("alpha", "tau"))
    assert main(["fit", str(PLATOON), *options]) == 0
    printed = capsys.readouterr()
    assert all(part in printed.out for part in ("2 Audi", "α [1/s²]", "cache"))
    assert printed.err == "", "progress is for terminals"
    starts = [line.split("  ")[0] for line in printed.out.splitlines()]
    assert starts.count("10–40 s") == starts.count("100–130 s") == 2


@pytest.mark.parametrize("method", [key for key in METHODS if key != "pinn"])
def test_every_method_takes_several_windows(capsys: Capture, method: str) -> None:
    part = ("--vehicles", "1,2", "--method", method, "--model", "cthp")
    joint = document(capsys, "fit", PLATOON, "--windows", "10-50,100-140", *part)
    alone = document(capsys, "fit", PLATOON, "--start", 10, "--duration", 40, *part)
    assert [window["start"] for window in joint["windows"]] == [10, 100]
    (together,), (first,) = joint["parameters"], alone["parameters"]
    assert together["alpha"] != first["alpha"]


@pytest.mark.usefixtures("cthp_alone")
def test_missing_samples_are_used_by_the_likelihood_alone(capsys: Capture, tmp_path: Path) -> None:
    made, holes = frame(601), tmp_path / "holes.csv"
    made.loc[200:399, ["Speed2", "IVS1"]] = np.nan  # for 20 of its 60 s
    holes.write_bytes(csv(made))
    for options in (("fit", holes, "--method", "splines"), ("fit", holes, "--preset", "fast")):
        sentence = refused(capsys, 1, *options)
        assert "holes.csv: Speed2 is missing at 20–39.9 s" in sentence
        assert "choose the PiNN's preset calibrated, which allows missing samples." in sentence
    some = ("--methods", "pinn,splines")
    assert "preset calibrated alone" in refused(capsys, 1, "compare", holes, *some)
    window = ("--methods", "maximum-likelihood", "--model", "cthp")
    (row,) = document(capsys, "compare", holes, *window)["rows"]
    assert (row["method"], len(row["blocks_mae"])) == ("pinn", 2)


@pytest.mark.usefixtures("cthp_alone")
def test_methods_are_compared_on_all_windows_beside_the_recommended_estimate(
    capsys: Capture,
) -> None:
    part = ("compare", PLATOON, "--windows", "10-50,100-140", "--vehicles", "1,2")
    output = document(capsys, *part, "--methods", "pinn,least-squares")
    assert [window["start"] for window in output["windows"]] == [10, 100]
    best, point = output["rows"]
    assert (best["model"], point["model"]) == ("cthp-s0-delay", "cthp")
    (answer,) = output["answer"]
    assert answer["parameters"].items() <= best["parameters"][0].items()
    assert bool(best["intervals"]) is not bool(point["intervals"])
    for row in output["rows"]:
        assert all(row[name]["p"] for name in ("closed_loop_mae", "holdout_mae"))
    assert main([*map(str, part), "--methods", "splines"]) == 0
    assert POINT in capsys.readouterr().out


def test_a_real_recording_with_holes_is_fitted(capsys: Capture, openacc_dir: Path) -> None:
    """Blocks of more than 4 s are missing in the window."""
    recording = openacc_dir / "JRC low speed" / "part12.csv"
    part = ("--vehicles", "1,2", "--duration", 120, "--model", "cthp")
    output = document(capsys, "fit", recording, *part)
    assert output["segment"]["samples"] == 1201
    assert 0.5 < output["parameters"][0]["tau"] < 8


def test_all_runs_can_be_searched(capsys: Capture) -> None:
    assert document(capsys, "runs") == {"runs": []}
    fitted, again = (document(capsys, "fit", STUDY, *SHORT, "--method", "splines") for _ in "ab")
    assert [fitted["cached"], again["cached"]] == [False, True]
    document(capsys, "fit", PLATOON, *SHORT, "--vehicles", "2-3", "--method", "least-squares")
    document(capsys, "fit", STUDY, *SHORT, "--method", "recursive", "--no-cache")
    assert len(document(capsys, "runs")["runs"]) == 2
    (run,) = document(capsys, "runs", "splines", "paper_STUDY")["runs"]
    assert (run["method"], run["window"]) == ("splines", "0–30 s")
    parameters = fitted["parameters"][0]
    assert run["parameters"] == [{name: parameters[name] for name in ("alpha", "beta", "tau")}]
    for word, count in (("bmw", 1), ("nowhere", 0)):
        assert main(["runs", word]) == 0
        assert capsys.readouterr().out.count("least-squares") == count


def test_the_judgement_has_every_model_and_which_is_best(capsys: Capture) -> None:
    part = ("--start", 0, "--duration", 120, "--vehicles", "1,2")
    output = document(capsys, "compare", PLATOON, *part, "--models", "cthp,cthp-s0")
    (car,) = output["vehicles"]
    assert (car["vehicle"], len(car["windows"])) == (2, 3)
    assert [model["model"] for model in car["models"]] == ["cthp", "cthp-s0"]
    for model in car["models"]:
        assert len(model["gap_rmse"]) == len(model["collided"]) == 3
        assert model["stability"]["speed"] == car["speeds"]["median"]
        for parameter in model["parameters"].values():
            low, high = parameter["interval"]
            assert low < parameter["value"] < high
    errors = {model["model"]: sum(model["gap_rmse"]) for model in car["models"]}
    assert car["best"] == min(errors, key=errors.get)
    assert sum(model["wins"] for model in car["models"]) == 1
    assert car["sentences"]
