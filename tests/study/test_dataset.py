"""The data set of many recordings: what its tables hold, and that the same call goes on."""

import json
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pandas as pd
import pytest
from pyarrow import parquet

from accpinn.methods.registry import METHODS
from accpinn.recordings.files import read
from accpinn.results.datasheet import columns_of, write_dataset
from accpinn.results.export import SUMO_IDM
from accpinn.segment.cut import cut
from accpinn.stability.measured_gain import measured_gain
from accpinn.study.dataset import MODELS, Dataset, gain_peak, make_dataset
from tests.support.command import Capture, document, refused
from tests.support.openacc_files import csv, metadata, platoon
from tests.support.samples import FOLDER

NAMES = ("Lead", "Audi(A8)")


@pytest.fixture(scope="module")
def recordings(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A car in a recording that is no run of OpenACC's, and a file that is no recording."""
    place = tmp_path_factory.mktemp("runs")
    rows = platoon(2, 1000)
    rows += 0.02 * np.random.default_rng(1).normal(size=rows.shape) * (rows.columns != "Time")
    (place / "run.csv").write_bytes(csv(rows, metadata(NAMES, distance="S")))
    (place / "broken.csv").write_bytes(b"Date,1,1,2020\n\0\0\0")
    return place


@pytest.fixture(scope="module")
def made(recordings: Path, cluster: str, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of their data set."""
    folder = tmp_path_factory.mktemp("set")
    dataset = make_dataset(recordings, folder, scheduler=cluster, command="accpinn dataset runs")
    assert isinstance(dataset, Dataset)
    write_dataset(dataset, folder)
    return folder


def test_each_model_has_a_row_of_one_consistent_set_with_what_was_measured(
    recordings: Path, made: Path
) -> None:
    table = pd.read_csv(made / "parameters.csv").set_index("following_model")
    assert {*table.index} == {*MODELS}
    best, idm = (table.loc[model] for model in MODELS)
    assert (best.make, best.model, best.distance_setting) == ("Audi", "A8", "S")
    assert (table[["windows", "vehicles", "recordings"]] == 1).all(axis=None)
    assert (table.point == "joint").all()
    recording = read(recordings / "run.csv")
    rows = pd.read_parquet(made / "windows.parquet")
    start, duration = rows.iloc[0][["start", "duration"]]
    segment = cut(recording, start, duration, (1, 2))
    (car,) = METHODS["pinn"].fit(segment).parameters
    assert [best.alpha, best.tau, best.s0, best.delay] == pytest.approx(car.complete[[0, 2, 3, 5]])
    for low, name, high in (("alpha_low", "alpha", "alpha_high"), ("T_low", "T", "T_high")):
        row = best if name == "alpha" else idm
        assert 0 < row[low] < row[high]
        assert row[name] > 0
    assert np.isnan(best["T"])
    assert np.isnan(idm["tau"])
    gap = best.tau + best.s0 / best.median_speed
    assert best.time_gap_at_median_speed == pytest.approx(gap)
    assert best.margin_l2 == pytest.approx(gap - best.smallest_time_gap_l2)

    held_out = pd.read_csv(made / "held_out.csv").query("model == 'pinn'")
    errors = np.log(held_out.gap_rmse)
    assert best.held_out_gap_rmse == pytest.approx(np.exp(errors.mean()))
    assert best.held_out_windows == len(held_out)


def test_the_measured_peak_is_that_of_all_drives_together() -> None:
    recording = read(FOLDER / "synthetic_motorway.csv")
    drives = [cut(recording, start, 290, (1, 2)) for start in (0, 300)]
    found, measured = gain_peak(drives), measured_gain(drives, 0)
    at = np.argmin(np.abs(measured.omega - found.omega))
    assert found.peak.value == pytest.approx(20 * np.log10(measured.gain[at]))
    assert found.peak.lower < found.peak.value < found.peak.upper
    assert np.isnan(gain_peak([cut(recording, 0, 30, (1, 2))]).peak.value)


def test_every_column_is_described_and_both_formats_hold_the_same(made: Path) -> None:
    table = pd.read_csv(made / "parameters.csv")
    described = columns_of(table)
    assert [part.name for part in described] == list(table.columns)
    assert all(part.meaning for part in described)
    stored = parquet.read_table(made / "parameters.parquet")
    assert stored.schema.field("beta").metadata[b"unit"] == b"1/s"
    same = (frame.drop(columns="campaigns") for frame in (stored.to_pandas(), table))
    pd.testing.assert_frame_equal(*same, check_dtype=False)
    sheet = (made / "README.md").read_text()
    assert all(
        part.meaning[:40] in sheet for part in described if part.name in ("tau", "margin_l2")
    )


def test_the_sheet_names_whose_recordings_they_are_and_what_failed(made: Path) -> None:
    sheet = (made / "README.md").read_text()
    assert "none of the published runs of OpenACC (run.csv)" in sheet
    assert "CC BY 4.0" not in sheet  # of recordings that are not OpenACC's nothing is known
    assert "accpinn dataset runs" in sheet
    assert pd.read_csv(made / "failures.csv").file.unique().tolist() == ["broken.csv"]
    (recording,) = json.loads((made / "made_with.json").read_text())["recordings"]
    assert recording["sha256"] == pd.read_csv(made / "recordings.csv").sha256[0]


def test_vehicle_types_have_the_numbers_of_the_table(made: Path) -> None:
    table = pd.read_csv(made / "parameters.csv").set_index("following_model")
    (idm,) = ElementTree.parse(made / "sumo_idm.add.xml").getroot().findall("vType")
    for name, attribute in SUMO_IDM.items():
        assert float(idm.attrib[attribute]) == pytest.approx(table.loc["idm"][name])
    (acc,) = ElementTree.parse(made / f"sumo_{MODELS[0]}.add.xml").getroot().findall("vType")
    assert acc.attrib["id"] == "F1_Audi_A8_S"
    assert float(acc.attrib["gapControlGainSpace"]) == pytest.approx(table.loc[MODELS[0]].alpha)


def test_the_command_goes_on_from_the_folder(recordings: Path, made: Path, capsys: Capture) -> None:
    before = (made / "parameters.csv").read_text()
    kept = {path: path.stat().st_mtime_ns for path in made.glob("[ps]*s/*.json")}
    assert len(kept) == 4
    found = document(capsys, "dataset", recordings, "--out", made, "--workers", 1)
    assert found["groups"] == dict.fromkeys(MODELS, 1)
    assert found["windows"] == 1
    assert {*found["files"]} <= {path.name for path in made.iterdir()}
    assert (made / "parameters.csv").read_text() == before
    assert {path: path.stat().st_mtime_ns for path in made.glob("[ps]*s/*.json")} == kept


def test_what_holds_no_recording_ends_in_one_sentence(
    recordings: Path, tmp_path: Path, capsys: Capture
) -> None:
    out = tmp_path / "set"
    broken = recordings / "broken.csv"
    assert "broken.csv" in refused(capsys, 1, "dataset", broken, "--out", out, "--workers", 1)
    assert "no such file" in refused(capsys, 1, "dataset", tmp_path / "none", "--out", out)
    assert "level" in refused(capsys, 2, "dataset", broken, "--out", out, "--level", 2)
