"""The catalogue, and downloads from a publisher that breaks off, stalls, refuses or is away."""

import hashlib
import time
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace

import pytest

from accpinn.cli import main
from accpinn.errors import ConfigError, RecordingError
from accpinn.recordings.download import Download, DownloadState, Transfer, download
from accpinn.recordings.openacc import Run, catalogue, find, is_listed_name, make_and_model, read
from tests.support.command import Capture, document, refused
from tests.support.openacc_files import csv, platoon
from tests.support.publisher import Publisher, publisher

CONTENT = csv(platoon(2, 1500))
DIGEST = hashlib.sha256(CONTENT).hexdigest()
KNOWN = Run("JRC low speed", "part 1.csv", DIGEST)
UNKNOWN = Run("Casale", "part2.csv", None)


@pytest.fixture
def server() -> Iterator[Publisher]:
    with publisher({KNOWN.key: CONTENT, UNKNOWN.key: CONTENT}) as state:
        yield state


@pytest.fixture(autouse=True)
def no_pauses(monkeypatch: pytest.MonkeyPatch) -> None:
    impatient = SimpleNamespace(sleep=lambda seconds: None, time=time.time)
    monkeypatch.setattr("pooch.core.time", impatient)


def fetched(server: Publisher, folder: Path, *runs: Run, **options: object) -> list[Download]:
    # Only where the publisher stalls is it given up soon: a busy machine answers late, too.
    stalls = "stall" in str(server.faults)
    downloads = download(runs, folder, server.url, stall=0.1 if stalls else 5.0, **options)
    return sorted(downloads, key=lambda done: runs.index(done.run))


def names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def test_files_arrive_once_and_can_be_read(server: Publisher, tmp_path: Path) -> None:
    first = fetched(server, tmp_path, KNOWN, UNKNOWN)
    assert [ended.state for ended in first] == [DownloadState.DOWNLOADED] * 2
    assert read(first[0].path).samples == 1500
    assert names(first[0].path.parent) == [KNOWN.file]
    requests = len(server.requests)
    again = fetched(server, tmp_path, KNOWN, UNKNOWN)
    assert [ended.state for ended in again] == [DownloadState.PRESENT] * 2
    assert len(server.requests) == requests


@pytest.mark.parametrize("run", [KNOWN, UNKNOWN], ids=["known", "unknown"])
@pytest.mark.parametrize("faults", [["stall"], ["503", "429"], ["503", "break", "503"]])
def test_interruptions_are_survived(
    server: Publisher, tmp_path: Path, run: Run, faults: list[str]
) -> None:
    server.faults[run.key] = [*faults]
    received: list[Transfer] = []
    [done] = fetched(server, tmp_path, run, on_transfer=received.append)
    assert done.state is DownloadState.DOWNLOADED
    assert done.path.read_bytes() == CONTENT
    assert done.path.stat().st_mode & 0o044, "others may read it as the user's umask says"
    assert (received[-1].received, received[-1].size) == (len(CONTENT), len(CONTENT))
    assert len(server.requests) == len(faults) + 1
    assert names(tmp_path / run.campaign) == [run.file]


@pytest.mark.parametrize(
    ("fault", "words"),
    [
        ("break", "breaks off, 5"),
        ("stall", "nothing arrives for 0.1 s, 5"),
        ("503", "status 503, 5"),
    ],
)
def test_after_five_attempts_a_download_fails_and_a_later_call_starts_again(
    server: Publisher, tmp_path: Path, fault: str, words: str
) -> None:
    server.faults[KNOWN.key] = [fault] * 5
    [done] = fetched(server, tmp_path, KNOWN)
    assert done.state is DownloadState.FAILED
    assert words in done.reason
    assert names(tmp_path / KNOWN.campaign) == []
    [done] = fetched(server, tmp_path, KNOWN)
    assert done.path.read_bytes() == CONTENT


@pytest.mark.parametrize(
    ("content", "fault", "words"),
    [
        (None, "404", "it is not there"),
        (None, "403", "it is refused"),
        (b"<!doctype html><p>moved", "", "no OpenACC run"),
        (b"PK\3\4" + bytes(500), "", "no OpenACC run"),
    ],
)
def test_a_file_that_is_no_run_is_deleted(
    server: Publisher, tmp_path: Path, content: bytes | None, fault: str, words: str
) -> None:
    server.files[UNKNOWN.key] = content or CONTENT
    server.faults[UNKNOWN.key] = [fault] * bool(fault)
    wrong, right = fetched(server, tmp_path, UNKNOWN, KNOWN)
    assert words in wrong.reason
    assert wrong.reason.startswith(UNKNOWN.key)
    assert right.state is DownloadState.DOWNLOADED
    assert names(wrong.path.parent) == []


def test_another_file_than_the_published_one_is_not_kept(server: Publisher, tmp_path: Path) -> None:
    server.files[KNOWN.key] = csv(platoon(2, 1400))
    [unlike] = fetched(server, tmp_path, KNOWN)
    assert "SHA-256 differs" in unlike.reason
    assert not unlike.path.exists()
    unlike.path.write_bytes(b"mine")
    [again] = fetched(server, tmp_path, KNOWN)
    assert "move it away" in again.reason
    assert again.path.read_bytes() == b"mine"
    with pytest.raises(RecordingError, match="no folder can be made"):
        fetched(server, again.path / "below", KNOWN)


def test_without_a_network_a_download_fails_at_once_in_one_sentence(
    capsys: Capture, server: Publisher, tmp_path: Path
) -> None:
    closed = "http://127.0.0.1:9"
    assert main(["download", "ZalaZone", "--to", str(tmp_path), "--from", closed]) == 1
    printed = capsys.readouterr()
    assert printed.out == f"{tmp_path}: 73 failed\n"
    [sentence] = [line for line in printed.err.splitlines() if line.startswith("error: ")]
    assert "127.0.0.1:9 cannot be reached; check the network" in sentence


def test_connections_are_limited_and_can_be_stopped(server: Publisher, tmp_path: Path) -> None:
    runs = [Run("Casale", f"part{k}.csv", None) for k in range(20, 40)]
    server.files |= {run.key: CONTENT for run in runs}
    downloads = fetched(server, tmp_path, *runs, connections=3)
    assert all(ended.state is DownloadState.DOWNLOADED for ended in downloads)
    assert server.most_at_once <= 3
    [stopped] = fetched(server, tmp_path / "other", KNOWN, should_stop=lambda: True)
    assert stopped.state is DownloadState.STOPPED


def test_the_catalogue_names_every_published_run() -> None:
    assert len(set(catalogue())) == len(catalogue()) == 139
    assert [run.file for run in find(["casale"])][-1] == "part11.csv"
    assert find(["Casale", "casale/part7.csv"]) == find(["Casale"])
    with pytest.raises(ConfigError, match=r"Casale/part7.csv or JRC low speed/part7.csv"):
        find(["part7.csv"])
    with pytest.raises(ConfigError, match="AstaZero, Casale"):
        find(["nothing"])


def test_command_lists_downloads_and_counts(
    capsys: Capture, server: Publisher, tmp_path: Path
) -> None:
    server.files |= {run.key: CONTENT for run in find(["Cherasco"])}
    options = ("--to", tmp_path, "--from", server.url)
    name = next(run.file for run in find(["Cherasco"]) if run.sha256 is None)
    listed = document(capsys, "download", name, "--list", *options)
    assert [row["downloaded"] for row in listed["runs"]] == [False]
    downloaded = document(capsys, "download", name, *options)
    assert [row["state"] for row in downloaded["runs"]] == ["downloaded"]
    assert main(["download", "--list", "--to", str(tmp_path)]) == 0
    assert capsys.readouterr().out.startswith("139 runs, ")
    assert "not in the catalogue" in refused(capsys, 2, "download", "x", *options)


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("Audi(A8)", ("Audi", "A8")),
        ("AUDI_E_TRON", ("Audi", "e-tron")),
        ("Peugeot (5008 GT Line)", ("Peugeot", "5008 GT Line")),
        ("Mercedes(AClass)", ("Mercedes-Benz", "A-Class")),
        ("VW(GolfE)", ("Volkswagen", "e-Golf")),
        ("Rexton", ("SsangYong", "Rexton")),
        ("vw (Tiguan)", ("Volkswagen", "Tiguan")),
        ("TESLA_ROADSTER_2", ("Tesla", "ROADSTER_2")),
        ("Lada(Niva)", ("Lada", "Niva")),
        (" Unimog ", ("Unimog", "")),
        ("ID 27", ("ID 27", "")),
        ("", ("", "")),
    ],
)
def test_makes_and_models_have_one_spelling(name: str, expected: tuple[str, str]) -> None:
    assert make_and_model(name) == expected
    assert is_listed_name("tesla (model3)")
    assert not is_listed_name("Lada(Niva)")
