"""Commands on files and given numbers: what they print, where they write, what they refuse."""

import html
import json
from pathlib import Path

import pytest

from accpinn import Sinusoid, load, measured_gain, simulate_platoon, stability_report
from accpinn.cli import main
from accpinn.model.published import ASTAZERO
from accpinn.recordings.mapping import load_mapping
from accpinn.results.export import ABOUT_ACC, ABOUT_IDM
from accpinn.results.report import render_report
from accpinn.stability.head_to_tail import head_to_tail_peaks
from accpinn.study.snapshot import save
from tests.recordings.test_mapping import MAPPING, foreign
from tests.support.command import PLATOON, SHORT, STUDY, Capture, document, refused
from tests.support.openacc_files import pair, platoon, table
from tests.support.samples import frame
from tests.support.snapshots import missing_the_drive, small, whole, with_parameters

METHOD = ("--method", "least-squares")


@pytest.fixture
def file(tmp_path: Path) -> Path:
    return save(small(), tmp_path / "small.accpinn.zip")


# Snapshots


@pytest.mark.usefixtures("cthp_alone")
def test_a_report_is_beside_the_snapshot_or_where_asked(
    file: Path, tmp_path: Path, capsys: Capture
) -> None:
    assert main(["report", str(file)]) == 0
    written = file.with_name("small.html")
    assert capsys.readouterr().out.strip() == str(written)
    assert load(file).id in written.read_text(encoding="utf-8")
    snapshot, place = save(whole(), tmp_path / "whole.accpinn.zip"), tmp_path / "r.html"
    assert main(["report", str(snapshot), "--recording", str(PLATOON), "-o", str(place)]) == 0
    page = place.read_text(encoding="utf-8")
    assert "Outside the window" in page
    elsewhere = PLATOON.with_name("synthetic_paper_study.csv")
    capsys.readouterr()
    sentence = refused(capsys, 1, "report", snapshot, "--recording", elsewhere, "-o", place)
    assert PLATOON.name in sentence


def test_a_report_without_curves_shows_no_series(
    file: Path, tmp_path: Path, capsys: Capture
) -> None:
    place = tmp_path / "r.html"
    for options, shows in ((["--no-curves"], False), ([], True)):
        assert main(["report", str(file), "-o", str(place), *options]) == 0
        assert ("Measured space-gaps and speeds" in place.read_text(encoding="utf-8")) is shows
    capsys.readouterr()


def test_verify_reproduces_a_sound_snapshot(file: Path, capsys: Capture) -> None:
    printed = document(capsys, "verify", file)
    assert printed["ok"] is True
    states = {check["part"]: check["state"] for check in printed["checks"]}
    assert states["estimate"] == "reproduced"
    quick = document(capsys, "verify", file, "--quick")
    assert {check["part"]: check["state"] for check in quick["checks"]}["estimate"] == "not checked"
    assert "--refit" in [check["cure"] for check in quick["not_checked"]]
    assert main(["verify", str(file), "--refit"]) == 0
    assert "reproduced" in capsys.readouterr().out


def test_forged_parameters_are_named_before_anything_is_made_of_them(
    tmp_path: Path, capsys: Capture
) -> None:
    file = save(with_parameters(small(), (1, 1, 0.6)), tmp_path / "forged.accpinn.zip")
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
    options = ("--model", "cthp", "--name", "mine", "--note", "a note", "--out", path)
    document(capsys, "fit", STUDY, *SHORT, *options)
    (vehicle,) = document(capsys, "stability", "--snapshot", path)["vehicles"]
    assert document(capsys, "stability", path)["vehicles"] == [vehicle]
    assert 0.0 <= vehicle["probability_l2"] <= 1.0
    low, high = vehicle["intervals"]["peak_gain"]
    assert low <= vehicle["peak"]["gain"] <= high
    assert main(["stability", str(path)]) == 0
    assert vehicle["label"] in capsys.readouterr().out
    run = document(capsys, "simulate", "--snapshot", path, "--duration", 60)
    assert len(run["minimum_gap"]) == 8
    low, high = run["growth_interval"]
    assert low < run["predicted_amplitude"][-1] < high
    assert document(capsys, "verify", path, "--recording", STUDY)["name"] == "mine"
    assert load(path).facts["samples"] == 3001


def test_a_point_has_verdicts_and_a_measured_gain_but_no_probability(
    tmp_path: Path, capsys: Capture
) -> None:
    path = save(whole(), tmp_path / "a.accpinn.zip")
    for k, vehicle in enumerate(document(capsys, "stability", path)["vehicles"]):
        gain = measured_gain(whole().segments, k, reference=whole().parameters[[k]]).gain
        assert vehicle["measured"]["gain"] == gain.tolist()
        assert len(vehicle["measured"]["coherent"]) == len(vehicle["measured"]["omega"])
        assert vehicle["l2"]["stable"] in (True, False)
        assert vehicle.keys().isdisjoint({"probability_l2", "intervals", "level"})
    assert main(["stability", str(path)]) == 0
    printed = capsys.readouterr().out
    assert "vehicles amplify disturbances" in printed
    assert "robability" not in printed


def test_evidence_against_an_estimate_is_printed_beside_its_conclusions(
    tmp_path: Path, capsys: Capture
) -> None:
    missing, against = missing_the_drive(whole())
    path = save(missing, tmp_path / "a.accpinn.zip")
    for command in ("stability", "simulate"):
        assert main([command, str(path)]) == 0
        assert capsys.readouterr().out.count(against) == 1
    assert against in document(capsys, "simulate", path)["warnings"][-1]
    page = html.unescape(render_report(missing))
    assert page.count(against) >= 2, "with the estimate, and with the verdict"
    assert main(["stability", str(save(whole(), path))]) == 0
    assert against not in capsys.readouterr().out


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
def test_a_snapshot_that_cannot_be_saved_is_refused_before_any_work(
    capsys: Capture, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, options: tuple[str, ...]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert "not even read" not in refused(capsys, 1, "fit", "not even read.csv", *options)


def test_exports_for_sumo_and_as_a_card(file: Path, tmp_path: Path, capsys: Capture) -> None:
    place = tmp_path / "types.xml"
    card = document(capsys, "export", file, "--sumo", place)
    assert card["provenance"]["snapshot"] == load(file).id
    assert 'carFollowModel="ACC"' in place.read_text()
    assert main(["export", str(file), "--sumo", str(place), "--samples", "0"]) == 0
    assert "vTypeDistribution" not in place.read_text()
    for about in (ABOUT_ACC, ABOUT_IDM):
        place.write_text(f"<!--{about}--><additional/>")
        assert main(["export", str(file), "--sumo", str(place)]) == 0, "its own is replaced"
    assert capsys.readouterr().out.split() == [str(place)] * 3
    other = tmp_path / "mine.xml"
    other.write_text("<routes/>")
    assert "not overwritten" in refused(capsys, 1, "export", file, "--sumo", other)
    assert "--sumo" in refused(capsys, 2, "export", file)
    assert "samples" in refused(capsys, 2, "export", file, "--sumo", place, "--samples", -1)
    assert "one snapshot" in refused(capsys, 2, "stability", file, "--snapshot", file)


# Recordings


def test_info_has_the_document_of_the_contract(capsys: Capture) -> None:
    output = document(capsys, "info", PLATOON)
    assert output.keys() >= {
        "campaign", "date", "acc_flag", "distance_setting", "samples", "duration", "sample_time",
        "vehicles", "warnings",
    }  # fmt: skip
    assert (output["samples"], output["duration"], output["sample_time"]) == (4001, 400.0, 0.1)
    assert [vehicle["index"] for vehicle in output["vehicles"]] == [1, 2, 3, 4, 5]
    for vehicle in output["vehicles"]:
        assert vehicle.keys() >= {"index", "name", "present", "missing", "modes"}
    leader, follower = output["vehicles"][:2]
    assert leader["modes"] is None
    assert follower["modes"]["ACC"] == 4001
    assert main(["info", str(STUDY)]) == 0
    assert "2 Synthetic (ACC)" in capsys.readouterr().out


def test_a_trajectory_of_a_table_of_pairs(capsys: Capture, tmp_path: Path) -> None:
    path, snapshot, three = tmp_path / "pairs.csv", tmp_path / "b.accpinn.zip", platoon(3, 400)
    other = frame(400)
    path.write_bytes(table(pair(three, 1, "7"), pair(three, 2, "8"), pair(other, 1, "9")))
    assert len(document(capsys, "info", path, "--trajectory", 8)["vehicles"]) == 3
    chosen = ("--trajectory", 9)
    fitted = document(capsys, "fit", path, *chosen, *METHOD, "--duration", 30, "--out", snapshot)
    assert fitted["segment"]["vehicles"] == [1, 2]
    assert "choose a trajectory (--trajectory): 7, 9" in refused(capsys, 1, "info", path)
    output = document(capsys, "verify", snapshot, "--recording", path)  # the snapshot names it
    assert output["ok"] is True
    assert "--recording" not in {check["cure"] for check in output["not_checked"]}


def test_a_mapping_serves_every_command_and_is_kept_in_the_snapshot(
    capsys: Capture, tmp_path: Path
) -> None:
    path, mapping = tmp_path / "mine.csv", tmp_path / "mapping.json"
    snapshot = tmp_path / "mine.accpinn.zip"
    foreign(frame(401)).to_csv(path, index=False)
    assert "--mapping" in refused(capsys, 1, "info", path)
    mapping.write_text(MAPPING)
    document(capsys, "fit", path, "--mapping", mapping, *METHOD, "--out", snapshot)
    assert "--mapping" in refused(capsys, 1, "info", path)  # nothing is remembered
    assert load(snapshot).analysis.source.mapping == load_mapping(mapping)
    verified = document(capsys, "verify", snapshot, "--recording", path)
    assert verified["ok"] is True
    assert "--recording" not in [check["cure"] for check in verified["not_checked"]]


def test_a_proposed_mapping_is_printed_and_can_be_given(capsys: Capture, tmp_path: Path) -> None:
    path, mapping = tmp_path / "mine.csv", tmp_path / "mapping.json"
    made = platoon(2, 400)
    named = {"Time": "t [s]", "Speed1": "v lead [km/h]", "Speed2": "v ego [km/h]", "IVS1": "gap"}
    made[["Speed1", "Speed2"]] *= 3.6
    made.rename(columns=named).to_csv(path, index=False)
    assert main(["info", str(path), "--propose"]) == 0
    printed = capsys.readouterr()
    assert [speed["unit"] for speed in json.loads(printed.out)["speeds"]] == ["km/h", "km/h"]
    mapping.write_text(printed.out)
    by_hand = document(capsys, "fit", path, "--mapping", mapping, *METHOD)
    assert document(capsys, "fit", path, *METHOD)["parameters"] == by_hand["parameters"]


def test_an_empty_mapping_is_refused(capsys: Capture, tmp_path: Path) -> None:
    path, mapping = tmp_path / "mine.csv", tmp_path / "mapping.json"
    foreign(frame(401)).to_csv(path, index=False)
    mapping.write_text("{}")
    sentence = refused(capsys, 1, "info", path, "--mapping", mapping)
    assert "mapping.json: this is no mapping" in sentence


# Given parameters

TESLA = ASTAZERO.parameters[3]
GIVEN = ("--alpha", TESLA.alpha, "--beta", TESLA.beta, "--tau", TESLA.tau)
TWO = ("--alpha", 0.1, 0.2, "--beta", 0.2, 0.3, "--tau", 1, 1)


def test_stability_has_the_document_of_the_contract(capsys: Capture) -> None:
    (found,) = document(capsys, "stability", *GIVEN)["vehicles"]
    (expected,) = stability_report(ASTAZERO.parameters[3:]).vehicles
    assert [found[name] for name in ("alpha", "beta", "tau")] == [float(v) for v in TESLA.values]
    assert found["l2"]["criterion"] == expected.l2.value
    assert (found["l2"]["stable"], found["linf_paper"]["stable"]) == (False, True)
    assert found["linf_exact"]["gain"] == expected.linf_gain
    assert found["peak"] == vars(expected.peak)
    assert found["crossover"] == expected.crossover
    assert found["smallest_tau"] == vars(expected.smallest_tau)
    assert all(found[name]["reason"] for name in ("l2", "linf_paper", "linf_exact"))
    needed = TESLA.tau - expected.smallest_tau.l2
    assert found["margin"]["l2"]["margin"] == pytest.approx(needed)
    assert found["margin"]["l2"]["state"] == "too_short"
    late = document(capsys, "stability", *GIVEN, "--delay", 3)["vehicles"][0]["margin"]["l2"]
    assert (late["margin"], late["state"]) == (None, "never")
    bare = document(capsys, "stability", "--alpha", 0, "--beta", 0.3, "--tau", 1)["vehicles"][0]
    assert (bare["crossover"], bare["smallest_tau"]) == (None, None), "without gap control"
    assert main(["stability", *map(str, TWO)]) == 0
    assert "Platoon, Weak L∞ string stability: unstable." in capsys.readouterr().out


def test_simulate_has_the_document_of_the_contract(capsys: Capture) -> None:
    options = ("--vehicles", 3, "--frequency", 0.2, "--amplitude", 0.5, "--speed", 22)
    times = ("--settle", 10, "--duration", 400)
    output = document(capsys, "simulate", *GIVEN, *options, *times)
    run = simulate_platoon(ASTAZERO.parameters[[3] * 3], Sinusoid(0.2, 0.5, 22.0, 10.0, 400.0))
    assert output["amplitude"] == run.amplitudes.measured.tolist()
    assert output["predicted_amplitude"] == run.amplitudes.predicted.tolist()
    assert output["minimum_gap"] == run.minimum_gap.tolist()
    assert (output["collisions"], output["growth_interval"]) == ([], None)
    assert main([str(part) for part in ("simulate", *GIVEN, *options, *times)]) == 0
    peak = head_to_tail_peaks(ASTAZERO.parameters[[3] * 3]).omega[-1]
    assert f" {peak:.3g} rad/s" in capsys.readouterr().out, "what is amplified most"
    assert len(document(capsys, "simulate", *TWO)["minimum_gap"]) == 2


def test_simulate_names_a_collision(capsys: Capture) -> None:
    options = [str(v) for v in ("--alpha", 0.05, "--beta", 0, "--tau", 1, "--amplitude", 5)]
    output = document(capsys, "simulate", *options)
    assert output["collisions"][0]["follower"] >= 1
    assert output["warnings"]
    assert main(["simulate", *options]) == 0
    assert f"Note: {output['warnings'][0]}" in capsys.readouterr().out
