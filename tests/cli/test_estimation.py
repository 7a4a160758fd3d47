"""`fit`: its document, its options, its cache and its notes."""

import re
from dataclasses import replace
from pathlib import Path

import pytest

from accpinn.cli import main
from accpinn.cli.estimation import fit_text
from accpinn.model.cthp import Parameters
from accpinn.recordings.openacc import read
from accpinn.results.documents import describe_fit
from accpinn.study.result import Result
from tests.support.command import PLATOON, SHORT, STUDY, Capture, document, refused, strict
from tests.support.driving import driven
from tests.support.snapshots import result_for

KEYS = {
    "method", "case", "preset", "seed", "segment", "parameters", "mae", "mean_time_gap", "loss",
    "network_weights", "iterations", "seconds", "cached", "outcome",
}  # fmt: skip


LIKELIHOOD = ("--method", "maximum-likelihood")


def test_document_of_the_command_line_contract(capsys: Capture) -> None:
    found = document(capsys, "fit", PLATOON, "--start", 10, *SHORT, "--vehicles", "4,5")
    assert found.keys() >= KEYS
    assert (found["method"], found["case"]) == ("pinn", "II")
    assert (found["preset"], found["seed"], found["model"]) == ("calibrated", 0, "cthp")
    segment = found["segment"]
    assert (segment["start"], segment["duration"], segment["samples"]) == (10, 30, 301)
    assert segment["vehicles"] == [4, 5]
    rows = found["parameters"]
    assert [row["vehicle"] for row in rows] == [5]
    assert rows[0]["name"] == "Tesla(Model3-like)"
    assert all(row["alpha"] > 0 and row["beta"] > 0 and row["tau"] > 0 for row in rows)
    counts = [len(found["mae"]["v"]), len(found["mae"]["p"]), len(found["mean_time_gap"])]
    assert counts == [2, 1, 1]
    loss = found["loss"]
    assert loss["total"] == pytest.approx(loss["data"] + loss["physics"])
    assert found["outcome"] == "converged"
    assert found["cached"] is False


def test_the_same_again_comes_from_the_cache_unless_forbidden(capsys: Capture, cache: Path) -> None:
    assert not document(capsys, "fit", STUDY, *SHORT, "--no-cache")["cached"]
    assert not cache.exists()
    first, again = (document(capsys, "fit", STUDY, *SHORT) for _ in range(2))
    assert (first["cached"], again["cached"]) == (False, True)
    for key in ("parameters", "loss", "seconds", "iterations", "notes"):
        assert again[key] == first[key]
    assert len(list(cache.glob("*.accpinn.zip"))) == 1


def scaled(result: Result, *factors: float) -> Result:
    """With other parameters."""
    parameters = Parameters.of(result.parameters.values * factors)
    return replace(result, fits=(replace(result.fit, parameters=parameters),))


@pytest.mark.parametrize(
    ("options", "expected"),
    [
        (("--method", "least-squares"), False),
        (("--method", "least-squares", "--intervals"), True),
        (("--method", "maximum-likelihood"), True),
    ],
)
def test_likelihood_and_who_asks_get_intervals(
    capsys: Capture, options: tuple[str, ...], expected: bool
) -> None:
    assert main(["fit", str(STUDY), *SHORT, *options]) == 0
    estimates = capsys.readouterr().out.partition("synthetic_paper_study.csv")[2]
    assert bool(re.search(r"\([\d.]+–[\d.]+\)", estimates)) == expected
    found = document(capsys, "fit", STUDY, *SHORT, *options)
    if not expected:
        assert (found["intervals"], found["level"]) == (None, None)
        return
    (ends,), level = found["intervals"], found["level"]
    assert (ends["vehicle"], level) == (2, 0.9)
    assert ends["tau"][0] < ends["tau"][1]
    assert 0.0 <= ends["probability_l2"] <= 1.0


@pytest.mark.parametrize("method", ["splines", "least-squares"])
def test_other_methods_in_case_one(capsys: Capture, method: str) -> None:
    options = (*SHORT, "--method", method, "--vehicles", "3-5", "--case", "I")
    found = document(capsys, "fit", PLATOON, *options)
    assert (found["method"], found["outcome"]) == (method, "solved")
    assert (found["preset"], found["network_weights"]) == (None, 0)
    assert (found["mae"] is None) == (method == "least-squares")
    assert len(found["closed_loop_mae"]["p"]) == 2
    assert found["segment"]["vehicles"] == [3, 4, 5]
    first, second = found["parameters"]
    assert [first["vehicle"], second["vehicle"]] == [4, 5]
    assert first["alpha"] == second["alpha"]


def test_the_paper_preset_with_its_options(capsys: Capture) -> None:
    found = document(
        capsys,
        *("fit", PLATOON, *SHORT, "--preset", "paper", "--iterations", 4, "--lbfgs", 3),
        *("--initial", "0.1,0.2,1.3", "--seed", 7, "--threads", 1, "--vehicles", "4,5"),
    )
    assert found["network_weights"] == 7623
    assert (found["iterations"], found["seed"]) == (7, 7)
    assert found["outcome"] == "finished"
    assert found["loss"].keys() >= {"test_data", "test_physics"}
    for row in found["parameters"]:
        assert (row["alpha"], row["beta"], row["tau"]) != (0.1, 0.2, 1.3)
        assert row["tau"] == pytest.approx(1.3, abs=0.3)


def test_what_is_undetermined_is_null(capsys: Capture, tmp_path: Path) -> None:
    """Vehicles that never move: no headway, no time gap, no closed loop, and no NaN."""
    lines = STUDY.read_text().splitlines()
    still = [f"{0.1 * k:.1f},0.0000,0.0000,5.0000,ACC" for k in range(301)]
    path = tmp_path / "still.csv"
    path.write_text("\n".join([*lines[:6], *still]) + "\n")
    found = document(capsys, "fit", path, *SHORT, "--method", "least-squares")
    (row,) = found["parameters"]
    assert (row["alpha"], row["tau"]) == (0, None)
    assert found["mean_time_gap"] == [None]
    assert found["closed_loop_mae"] is None
    assert found["notes"]


def test_text_has_the_table_and_progress_is_for_terminals(capsys: Capture) -> None:
    assert main(["fit", str(STUDY), *SHORT]) == 0
    printed = capsys.readouterr()
    first, answer, estimates, *_ = printed.out.split("\n\n")
    assert "Known from one window alone." in first
    assert answer.startswith("Answer: CTHP with intercept s₀ and delay d, one window")
    lines = [*estimates.splitlines(), "", *printed.out.split("\n\n")[3].splitlines()]
    assert lines[0] == "PiNN (calibrated preset), synthetic_paper_study.csv, 0–30 s"
    assert "α [1/s²]" in lines[2]
    assert [line[:11] for line in lines[3:5]] == ["1 Synthetic", "2 Synthetic"]
    assert lines[6].startswith("Converged:")
    assert printed.err == ""


def test_a_collision_stands_beside_the_closed_loop_errors() -> None:
    segment = driven(duration=100.0, step=0.5)
    swaying = scaled(result_for(segment), 0.6, 0.0, 0.7)
    (event,) = describe_fit(swaying, False)["incidents"]
    assert "collides with the vehicle ahead at" in event
    assert event in fit_text(swaying, False)
    assert not describe_fit(result_for(segment), False)["incidents"]


def test_options_without_effect_are_named(capsys: Capture) -> None:
    options = ["--method", "least-squares", "--seed", "0", "--preset", "fast", "--json"]
    assert main(["fit", str(STUDY), *SHORT, *options]) == 0
    printed = capsys.readouterr()
    assert strict(printed.out)["method"] == "least-squares"
    assert "--preset, --seed has no effect" in printed.err


def test_several_windows_have_the_keys_of_fit_and_each_window(capsys: Capture) -> None:
    options = (*LIKELIHOOD, "--windows", "10-40,100-130", "--vehicles", "1-3")
    found = document(capsys, "fit", PLATOON, *options)
    assert found.keys() >= KEYS | {"windows", "intervals", "level"}
    segment = found["segment"]
    assert (segment["start"], segment["duration"], segment["samples"]) == (10, 60, 602)
    assert segment["vehicles"] == [1, 2, 3]
    assert [row["vehicle"] for row in found["parameters"]] == [2, 3]
    windows = found["windows"]
    assert [(one["start"], one["duration"]) for one in windows] == [(10, 30), (100, 30)]
    assert len(found["mae"]["v"]) == 3
    assert len(found["mae"]["p"]) == len(found["mean_time_gap"]) == 2
    for k, row in enumerate(found["parameters"]):
        for name in ("alpha", "beta", "tau"):
            low, high = found["intervals"][k][name]
            assert low < row[name] < high


def test_all_complete_stretches_in_pieces(capsys: Capture) -> None:
    options = (*LIKELIHOOD, "--windows", "all", "--duration", "140")
    assert main(["fit", str(STUDY), *options]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert "Its gains are known within" in lines[0]
    assert any(line.endswith("study.csv, 2 windows, 280 s together") for line in lines)
    starts = [line.split("  ")[0] for line in lines]
    assert starts.count("0–140 s") == starts.count("140–280 s") == 1


class TestMissingSamples:
    @pytest.fixture
    def holes(self, tmp_path: Path) -> Path:
        """The study's recording without the follower for 20 of its first 60 s."""
        lines = STUDY.read_text().splitlines()
        first = next(k for k, line in enumerate(lines) if line.startswith("Time"))
        names = lines[first].split(",")
        gone = [names.index(name) for name in ("Speed2", "IVS1")]
        for row in range(first + 201, first + 401):
            cells = lines[row].split(",")
            lines[row] = ",".join("" if k in gone else cell for k, cell in enumerate(cells))
        path = tmp_path / "holes.csv"
        path.write_text("\n".join(lines) + "\n")
        return path

    def test_other_methods_refuse_and_name_the_cure(self, capsys: Capture, holes: Path) -> None:
        for options in (("fit", holes, "--method", "splines"), ("fit", holes), ("starts", holes)):
            said = refused(capsys, 1, *options)
            assert "holes.csv: Speed2 is missing at 20–39.9 s" in said
            assert "or choose maximum-likelihood, which allows missing samples." in said

    def test_compare_refuses_unless_all_methods_allow_them(
        self, capsys: Capture, holes: Path
    ) -> None:
        some = ("--methods", "maximum-likelihood,splines")
        assert "or choose maximum-likelihood alone" in refused(capsys, 1, "compare", holes, *some)
        window = ("--methods", "maximum-likelihood", "--duration", 60)
        (row,) = document(capsys, "compare", holes, *window)["rows"]
        assert len(row["blocks_mae"]) == 2

    def test_a_real_recording_is_fitted_whole(self, capsys: Capture, openacc_dir: Path) -> None:
        recording = openacc_dir / "JRC low speed" / "part12.csv"
        whole = ("fit", recording, "--vehicles", "1,2", "--duration", 1000)
        found = document(capsys, *whole, "--method", "maximum-likelihood")
        assert found["segment"]["samples"] == read(recording).samples
        (row,) = found["parameters"]
        assert 0 <= row["alpha"] < 1
        assert 0 <= row["beta"] < 2
        assert 0.5 < row["tau"] < 8
        assert refused(capsys, 1, *whole, "--method", "splines")
