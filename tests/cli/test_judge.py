"""`judge`: a model of the user's own beside others, as one document, tables and refusals."""

from pathlib import Path

import pandas as pd
import pytest

from accpinn.cli import main
from accpinn.recordings.files import read
from accpinn.study.judging import Judgements, judge_recordings
from tests.support.command import ROOT, STUDY, Capture, document, refused

GIPPS = ROOT / "docs" / "gipps.py"


@pytest.fixture
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("ACCPINN_CACHE", str(tmp_path / "cache"))
    return tmp_path


@pytest.mark.usefixtures("cache", "registries")
def test_a_users_model_stands_beside_others_in_one_command(tmp_path: Path, capsys: Capture) -> None:
    """The scores that the command keeps are those of Python, and the next call knows them."""
    asked = ["judge", STUDY, "--model", GIPPS, "--models", "cthp"]
    found = document(capsys, *asked, "--reference", "gipps", "--out", tmp_path / "out")
    assert [row["key"] for row in found["models"]] == ["cthp", "gipps"]
    best = found["models"][0]
    assert found["reference"] == "gipps"
    assert best["difference"] < 0
    (follower,) = found["followers"]
    assert (follower["file"], len(follower["models"])) == (STUDY.name, 2)
    (recording,) = found["made_with"]["recordings"]
    assert recording["sha256"] == read(STUDY).sha256
    assert found["made_with"]["scripts"][0]["name"] == GIPPS.name
    assert found["made_with"]["command"].startswith(f"accpinn judge {STUDY.name} --model gipps.py")
    (pair,) = found["pairs"]
    assert pair["difference"] == pytest.approx(-best["difference"])

    alone: Judgements = judge_recordings([read(STUDY)], ["cthp"])
    assert best["rmse"] == pytest.approx(alone.summary()[0].rmse, rel=1e-9)
    assert main([*map(str, asked), "--format", "csv"]) == 0
    printed = capsys.readouterr().out
    (tmp_path / "printed.csv").write_text(printed)
    table = pd.read_csv(tmp_path / "printed.csv").set_index("key")
    assert table.gap_rmse_m["cthp"] == pytest.approx(best["rmse"])
    written = pd.read_csv(tmp_path / "out" / "models.csv").set_index("key")
    assert written.beside_reference_percent.isna().to_dict() == {"cthp": False, "gipps": True}


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("def acceleration(:", "fails with SyntaxError"),
        ("raise ValueError('mine')", "fails with ValueError: mine"),
        ("raise SystemExit(3)", "fails with SystemExit"),
        ("x = 1", "registers neither model nor method"),
    ],
)
def test_a_broken_script_ends_in_one_sentence(
    text: str, reason: str, tmp_path: Path, capsys: Capture
) -> None:
    script = tmp_path / "mine.py"
    script.write_text(text)
    assert reason in refused(capsys, 2, "judge", STUDY, "--model", script)


def test_what_cannot_be_judged_ends_in_one_sentence(tmp_path: Path, capsys: Capture) -> None:
    broken = tmp_path / "broken.csv"
    broken.write_bytes(b"Date,1,1,2020\n\0\0\0")
    assert "broken.csv" in refused(capsys, 1, "judge", broken, "--no-cache")
    for arguments, reason in (
        (("--models", "nothing"), "nothing is not known"),
        (("--reference", "nothing"), "nothing is not judged"),
        (("--workers", "0"), "0 is not allowed"),
        (("--json", "--format", "csv"), "leave --format out"),
        (("--model", "no/such.py"), "cannot be read"),
    ):
        assert reason in refused(capsys, 2, "judge", STUDY, *arguments)
    assert "no such file" in refused(capsys, 1, "judge", tmp_path / "none.csv", "--no-cache")
