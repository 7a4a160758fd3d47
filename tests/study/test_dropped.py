"""Several files handed over at once: what is taken, and a sentence for each that is not."""

import io
import zipfile
from pathlib import Path

import pytest

from accpinn.recordings import files
from accpinn.study import dropped
from accpinn.study.dropped import Dropped, take
from tests.support.openacc_files import csv, metadata, platoon

RUN = csv(platoon(2, 400), metadata(("Audi(A8)", "Kia(Niro)")))
OTHER = csv(platoon(3, 400), metadata(("Audi(A8)", "Kia(Niro)", "Tesla(Model3)")))


def packed(**members: bytes) -> bytes:
    content = io.BytesIO()
    with zipfile.ZipFile(content, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, raw in members.items():
            archive.writestr(name, raw)
    return content.getvalue()


def test_archives_are_unpacked_and_notes_left_out(tmp_path: Path) -> None:
    archive = packed(**{"runs/Casale/part3.csv": OTHER, "Casale_notes.txt": b"a note"})
    found = take([("mine.csv", RUN), ("runs.zip", archive)])
    assert found.refused == ()
    assert [str(file.path) for file in found.files] == ["mine.csv", "Casale/part3.csv"]
    paths = found.save(tmp_path)
    assert [Path(path).read_bytes() for path in paths] == [RUN, OTHER]
    assert files.read(paths[1]).campaign == "Casale"
    assert found.nbytes == len(RUN) + len(OTHER)


def test_names_lead_nowhere_else(tmp_path: Path) -> None:
    archive = packed(**{"../../../evil.csv": RUN, "a/..\\..\\b.csv": OTHER})
    for path in take([("../../x.zip", archive)]).save(tmp_path / "study"):
        assert Path(path).resolve().is_relative_to((tmp_path / "study").resolve())
        assert ".." not in Path(path).parts


@pytest.mark.parametrize(
    ("name", "raw", "reason"),
    [
        ("empty.csv", b"", "empty.csv: the file is empty"),
        ("picture.csv", b"\x89PNG....", "picture.csv: this is a PNG image"),
        ("cut.zip", b"PK\x03\x04....", "cut.zip: the zip archive or Excel workbook is damaged"),
        ("notes.zip", packed(**{"notes.txt": b"a note"}), "notes.zip: no table of a recording"),
        ("again.csv", RUN, "again.csv: its contents are those of first.csv"),
        ("table.csv", b"a,b\n1,2\n", "table.csv"),
    ],
)
def test_each_refused_file_has_one_sentence(name: str, raw: bytes, reason: str) -> None:
    found = take([("first.csv", RUN), (name, raw)])
    assert [str(file.path) for file in found.files] == ["first.csv"]
    (sentence,) = found.refused
    assert sentence.startswith(reason)
    assert "\n" not in sentence


def test_no_more_is_taken_than_one_file_may_hold(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(dropped, "MOST_FILES", 1)
    assert "1 files are taken at a time" in take([("a.csv", RUN), ("b.csv", OTHER)]).refused[0]
    monkeypatch.setattr(dropped, "MOST_FILES", 200)
    monkeypatch.setattr(dropped, "LIMIT_BYTES", len(RUN) + 10)
    found = take([("a.csv", RUN), ("b.csv", OTHER), ("c.csv", RUN)])
    assert [len(found.files), len(found.refused)] == [1, 2]
    assert "together the files have more than" in found.refused[0]
    assert Dropped().nbytes == 0
