"""`info`, `verify` and `report`: what they print, where they write, and what they refuse."""

from dataclasses import replace
from pathlib import Path

import pytest

from accpinn.cli import main
from accpinn.model.cthp import Parameters
from accpinn.stability.measured_gain import measured_gain
from accpinn.study.result import Parts, Result
from accpinn.study.snapshot import load, named, save
from tests.support.command import PLATOON, SHORT, STUDY, Capture, document, refused
from tests.support.openacc_files import pair, platoon, table
from tests.support.snapshots import small, whole


def forged(*factors: float) -> Result:
    """The small snapshot with other parameters than the method finds."""
    fit = replace(small().fit, parameters=Parameters.of(small().parameters.values * factors))
    return replace(small(), fits=(fit,))


@pytest.fixture
def file(tmp_path: Path) -> Path:
    return save(small(), tmp_path / "small.accpinn.zip")


def test_writes_beside_the_snapshot_or_where_asked(
    file: Path, tmp_path: Path, capsys: Capture
) -> None:
    assert main(["report", str(file)]) == 0
    written = file.with_name("small.html")
    assert capsys.readouterr().out.strip() == str(written)
    assert load(file).id in written.read_text(encoding="utf-8")
    assert main(["report", str(file), "-o", str(tmp_path / "r.html")]) == 0
    assert (tmp_path / "r.html").stat().st_size > 4_000_000


def test_a_recording_supplies_the_data(tmp_path: Path) -> None:
    file = save(replace(whole(), segments=()), tmp_path / "no_data.accpinn.zip")
    assert main(["report", str(file), "--recording", str(PLATOON)]) == 0
    text = (tmp_path / "no_data.html").read_text(encoding="utf-8")
    assert "Measured space-gaps and speeds" in text


def test_a_snapshot_with_data_has_the_measured_gain(tmp_path: Path, capsys: Capture) -> None:
    path = save(whole(), tmp_path / "whole.accpinn.zip")
    vehicles = document(capsys, "stability", "--snapshot", path)["vehicles"]
    segment = whole().segment
    for k, vehicle in enumerate(vehicles):
        assert vehicle["measured"]["gain"] == measured_gain(segment, k).gain.tolist()
        assert len(vehicle["measured"]["coherent"]) == len(vehicle["measured"]["omega"])


def test_verify_says_yes(file: Path, capsys: Capture) -> None:
    printed = document(capsys, "verify", file)
    assert printed["ok"] is True
    states = {check["part"]: check["state"] for check in printed["checks"]}
    assert (states["fit"], states["uncertainty"]) == ("reproduced", "recomputed")
    quick = document(capsys, "verify", file, "--quick")
    assert {check["part"]: check["state"] for check in quick["checks"]}["fit"] == "not checked"
    assert "--refit" in [check["cure"] for check in quick["not_checked"]]
    assert main(["verify", str(file), "--quick"]) == 0
    assert capsys.readouterr().out.rstrip().endswith("More is checked with --refit.")
    assert main(["verify", str(file), "--refit"]) == 0
    printed = capsys.readouterr()
    assert "reproduced" in printed.out
    assert printed.err == "", "no progress where nobody watches"


def test_forged_parameters_are_named_before_anything_is_made_of_them(
    tmp_path: Path, capsys: Capture
) -> None:
    shorter = named(replace(forged(1, 1, 0.6), parts=Parts()), with_data=True)
    file = save(shorter, tmp_path / "forged.accpinn.zip")
    assert main(["verify", str(file)]) == 1
    printed = capsys.readouterr()
    assert "stored" in printed.out
    assert printed.err.splitlines()[-1].startswith(f"error: {file}: ")
    assert main(["report", str(file)]) == 1
    printed = capsys.readouterr()
    assert Path(printed.out.strip()).exists()
    assert printed.err.startswith("error: what the snapshot says does not follow")


def test_fit_keeps_a_snapshot_that_others_read(tmp_path: Path, capsys: Capture) -> None:
    path = tmp_path / "a.accpinn.zip"
    options = ("--method", "splines", "--name", "mine", "--note", "a note", "--out", path)
    fitted = document(capsys, "fit", STUDY, *SHORT, *options)["answer"][0]["parameters"]
    vehicle = document(capsys, "stability", "--snapshot", path)["vehicles"][0]
    assert {name: vehicle[name] for name in fitted} == fitted
    assert document(capsys, "stability", path)["vehicles"][0] == vehicle
    assert vehicle["measured"] is None, "a snapshot without data"
    assert 0.0 <= vehicle["probability_l2"] <= 1.0
    low, high = vehicle["intervals"]["peak_gain"]
    assert low <= vehicle["peak"]["gain"] <= high
    assert main(["stability", str(path)]) == 0
    assert vehicle["label"] in capsys.readouterr().out
    run = document(capsys, "simulate", "--snapshot", path, "--duration", 60)
    assert len(run["minimum_gap"]) == 8
    assert document(capsys, "verify", path, "--recording", STUDY)["name"] == "mine"
    assert load(path).facts["samples"] == 3001


def test_a_snapshot_of_one_trajectory_is_verified_with_its_table(
    tmp_path: Path, capsys: Capture
) -> None:
    one, other = (pair(platoon(2, 400) + k, 1, name) for k, name in enumerate("ab"))
    recording, kept = tmp_path / "pairs.csv", tmp_path / "b.accpinn.zip"
    recording.write_bytes(table(one, other))
    chosen = ("--trajectory", "b")
    window = ("--duration", 30, "--method", "least-squares")
    document(capsys, "fit", recording, *chosen, *window, "--out", kept)
    assert "choose a trajectory" in refused(capsys, 1, "verify", kept, "--recording", recording)
    found = document(capsys, "verify", kept, "--recording", recording, *chosen)
    assert found["ok"] is True
    assert "--recording" not in {one["cure"] for one in found["not_checked"]}


def test_no_command_replaces_what_it_reads(file: Path, tmp_path: Path, capsys: Capture) -> None:
    recording = tmp_path / "a.csv"
    recording.write_bytes(STUDY.read_bytes())
    before = file.read_bytes()
    assert "is not overwritten" in refused(capsys, 1, "report", file, "-o", file)
    assert "is not overwritten" in refused(capsys, 1, "fit", recording, "--out", recording)
    assert [file.read_bytes(), recording.read_bytes()] == [before, STUDY.read_bytes()]


@pytest.mark.parametrize(
    "options", [("--out", "missing/a"), ("--out", "x" * 300), ("--out", "a", "--name", "x" * 300)]
)
def test_what_cannot_be_kept_is_said_before_any_work(
    capsys: Capture, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, options: tuple[str, ...]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert "not even read" not in refused(capsys, 1, "fit", "not even read.csv", *options)


def test_info_has_the_document_of_the_contract(capsys: Capture) -> None:
    found = document(capsys, "info", PLATOON)
    assert found.keys() >= {
        "campaign", "date", "acc_flag", "distance_setting", "samples", "duration", "sample_time",
        "vehicles", "warnings",
    }  # fmt: skip
    assert (found["samples"], found["duration"], found["sample_time"]) == (4001, 400.0, 0.1)
    assert [vehicle["index"] for vehicle in found["vehicles"]] == [1, 2, 3, 4, 5]
    for vehicle in found["vehicles"]:
        assert vehicle.keys() >= {"index", "name", "present", "missing", "modes"}
    leader, follower = found["vehicles"][:2]
    assert leader["modes"] is None
    assert follower["modes"]["ACC"] == 4001
    assert main(["info", str(STUDY)]) == 0
    text = capsys.readouterr().out
    assert "300 s in 3001 samples of 0.1 s" in text
    assert "2 Synthetic (ACC)" in text


def test_exports_for_sumo_and_as_a_card(file: Path, tmp_path: Path, capsys: Capture) -> None:
    place = tmp_path / "types.xml"
    card = document(capsys, "export", file, "--sumo", place)
    assert card["provenance"]["snapshot"] == load(file).id
    assert 'carFollowModel="ACC"' in place.read_text()
    assert main(["export", str(file), "--sumo", str(place), "--samples", "0"]) == 0
    assert "vTypeDistribution" not in place.read_text()
    assert capsys.readouterr().out.strip() == str(place)
    other = tmp_path / "mine.xml"
    other.write_text("<routes/>")
    assert "not overwritten" in refused(capsys, 1, "export", file, "--sumo", other)
    assert "--sumo" in refused(capsys, 2, "export", file)
    assert "samples" in refused(capsys, 2, "export", file, "--sumo", place, "--samples", -1)
