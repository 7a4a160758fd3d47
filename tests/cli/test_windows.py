"""`fit --windows`: its document, its tables and what it refuses."""

from pathlib import Path

import pytest

from accpinn.cli import main
from tests.cli.test_estimation import KEYS
from tests.support.command import PLATOON, STUDY, Capture, document, refused

METHOD = ("--method", "maximum-likelihood")


def test_document_has_the_keys_of_fit_and_each_window(capsys: Capture) -> None:
    options = (*METHOD, "--windows", "10-40,100-130", "--vehicles", "1-3")
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
    options = (*METHOD, "--windows", "all", "--duration", "140")
    assert main(["fit", str(STUDY), *options]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert any(line.endswith("study.csv, 2 windows, 280 s together") for line in lines)
    starts = [line.split("  ")[0] for line in lines]
    assert starts.count("0–140 s") == starts.count("140–280 s") == 1
    whole = document(capsys, "fit", STUDY, *METHOD, "--windows", "all")
    assert whole["parameters"] == document(capsys, "fit", STUDY, *METHOD)["parameters"]


def test_a_snapshot_of_several_windows_is_verified(capsys: Capture, tmp_path: Path) -> None:
    path = tmp_path / "two.accpinn.zip"
    windows = ("--windows", "0-30,100-130", "--out", path)
    fitted = document(capsys, "fit", STUDY, *METHOD, *windows)["answer"]
    found = document(capsys, "verify", path, "--recording", STUDY)
    assert found["ok"] is True
    (vehicle,) = document(capsys, "stability", "--snapshot", path)["vehicles"]
    assert vehicle["alpha"] == fitted[0]["parameters"]["alpha"]
    assert main(["report", str(path), "--recording", str(STUDY)]) == 0


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--preset", "fast", "--windows", "0-60,60-120"], "the preset fast takes one window"),
        (["--method", "splines", "--windows", "0-60,60-120"], "splines does not"),
        ([*METHOD, "--windows", "0-60,60-120", "--start", "10"], "leave --start out"),
        ([*METHOD, "--windows", "0-60,60-120", "--duration", "60"], "leave --duration out"),
        ([*METHOD, "--windows", "all", "--start", "10"], "leave --start out"),
        ([*METHOD, "--windows", "noon"], "0-300,600-900"),
    ],
)
def test_options_that_contradict_each_other_or_cannot_be_read(
    capsys: Capture, options: list[str], words: str
) -> None:
    assert words in refused(capsys, 2, "fit", STUDY, *options)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--windows", "0-60,30-90"], "0–60 s and 30–90 s overlap"),
        (["--windows", "0-60,5000-5060"], "remain from 5000 s"),
        (["--windows", "0-60,100-115"], "too short"),
        (["--windows", "all", "--duration", "1000"], "finds no window of 1000 s"),
    ],
)
def test_windows_that_the_recording_does_not_have(
    capsys: Capture, options: list[str], words: str
) -> None:
    assert words in refused(capsys, 1, "fit", STUDY, *METHOD, *options)
