"""Recordings that are no OpenACC runs: `--trajectory` and `--mapping`."""

from pathlib import Path

import pytest

from tests.recordings.test_mapping import MAPPING, foreign
from tests.support.command import Capture, document, refused
from tests.support.openacc_files import pair, platoon, table


def test_a_trajectory_of_a_table_of_pairs(capsys: Capture, tmp_path: Path) -> None:
    path, three = tmp_path / "pairs.csv", platoon(3, 400)
    other = platoon(2, 300).assign(Speed2=lambda frame: frame["Speed2"] + 1)
    path.write_bytes(table(pair(three, 1, "7"), pair(three, 2, "8"), pair(other, 1, "9")))
    found = document(capsys, "info", path, "--trajectory", 8)
    assert len(found["vehicles"]) == 3
    fitted = document(capsys, "fit", path, "--trajectory", 9, "--method", "least-squares")
    assert fitted["segment"]["vehicles"] == [1, 2]
    assert "choose a trajectory (--trajectory): 7, 9" in refused(capsys, 1, "info", path)


def test_a_mapping_serves_every_command_and_is_remembered(
    capsys: Capture, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("ACCPINN_MAPPINGS", str(tmp_path / "mappings"))
    path, mapping = tmp_path / "mine.csv", tmp_path / "mapping.json"
    foreign(platoon(2, 400)).to_csv(path, index=False)
    mapping.write_text(MAPPING)
    method = ("--method", "least-squares")
    first = document(capsys, "fit", path, "--mapping", mapping, *method)
    assert document(capsys, "fit", path, *method)["parameters"] == first["parameters"]
    mapping.write_text("{}")
    assert "mapping.json: this is no mapping" in refused(
        capsys, 1, "info", path, "--mapping", mapping
    )
