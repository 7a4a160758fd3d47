"""The package as a whole: what importing it offers and loads, and what its files hold."""

import json
import re
import subprocess
import threading
from collections.abc import Iterator
from http.server import BaseHTTPRequestHandler, HTTPServer
from importlib.metadata import version
from pathlib import Path

import pytest
from packaging.requirements import Requirement

import accpinn
from bench import audit, lock
from tests.support.command import loaded_after

ROOT = Path(__file__).parent.parent
PACKAGE = ROOT / "accpinn"


def test_importing_the_package_loads_nothing_slow() -> None:
    slow = ("numpy", "torch", "pandas", "scipy", "streamlit")
    assert not loaded_after("import accpinn.cli; dir(accpinn)", *slow)


SAMPLE = "sample_data/synthetic_paper_study.csv"
FIT = f"fit {SAMPLE} --duration 30 --no-cache"


@pytest.mark.parametrize(
    ("command", "slow"),
    [
        (f"info {SAMPLE}", "torch pandas scipy jinja2 pyarrow"),
        (FIT, "torch pandas scipy.signal streamlit control matplotlib"),
        (f"{FIT} --preset fast --iterations 5", "torch._dynamo pandas scipy.optimize scipy.signal"),
    ],
)
def test_a_command_waits_for_nothing_that_it_does_not_need(command: str, slow: str) -> None:
    few = (
        "from accpinn.inference import posterior; posterior.STAGES, posterior.FURTHER = (60, 60), 0"
    )
    code = f"from accpinn.cli import main; main({command.split()!r})"
    code = f"{few}\n{code}" if command.startswith("fit") else code
    assert not loaded_after(code, *slow.split())


def test_public_names_exist_and_are_documented() -> None:
    stub = (PACKAGE / "__init__.pyi").read_text(encoding="utf-8")
    assert sorted(accpinn.__all__) == sorted(re.findall(r"import \w+ as (\w+)", stub))
    for name in accpinn.__all__:
        assert getattr(accpinn, name) is not None
        assert re.search(rf"\b{name}\b", accpinn.__doc__), name


def project_files() -> list[str]:
    """All files of the project, relative to its root; new ones too."""
    listed = subprocess.run(
        ["git", "ls-files", "--cached", "--others", "--exclude-standard", "-z"],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )
    if listed.returncode:
        pytest.skip("not a git checkout, so there is no list of the project's files")
    return [name for name in listed.stdout.split("\0") if name and (ROOT / name).is_file()]


def test_no_file_names_a_place_on_one_machine() -> None:
    folders = "|".join(("work", "tmp", "home", "root", "Users", "opt"))
    hosts = "|".join(("pypi", "pythonhosted", "npmjs"))
    forbidden = re.compile(rf"(?<![\w.\-/*])/({folders})/\w|\b({hosts})\.(org|com)\b")
    found = [
        f"{name}:{number}: {line.strip()[:80]}"
        for name in project_files()
        if not name.startswith("sample_data/")
        for number, line in enumerate(
            (ROOT / name).read_text(encoding="utf-8", errors="replace").splitlines(), 1
        )
        if forbidden.search(line)
    ]
    assert found == []


def test_the_container_gets_all_that_the_app_needs() -> None:
    lines = (ROOT / "Containerfile").read_text(encoding="utf-8").splitlines()
    copied = [name for line in lines if line.startswith("COPY ") for name in line.split()[1:-1]]
    tracked = project_files()
    for name in copied:
        assert any(file == name or file.startswith(f"{name}/") for file in tracked), name
    scripts = [ROOT / "app.py", *(ROOT / "pages").rglob("*.py"), *PACKAGE.rglob("*.py")]
    code = "\n".join(path.read_text(encoding="utf-8") for path in scripts)
    imported = set(re.findall(r"^ *(?:from|import) (\w+)", code, re.MULTILINE))
    own = {path.name for path in ROOT.iterdir() if path.is_dir()}
    assert {"accpinn", "pages"} <= imported & own <= set(copied)
    assert {"app.py", "sample_data", "requirements.txt", ".streamlit/config.toml"} <= set(copied)


class TestLock:
    """What is installed, here and by users, is what the lock files say."""

    def test_every_requirement_is_locked_as_allowed_and_with_the_hashes_of_its_files(self) -> None:
        versions = dict(audit.locked(only_here=True))
        for path in (lock.APP, lock.DEV):
            for line in lock.requirements(path):
                requirement = Requirement(line)
                locked = versions[lock.name_of(line)]
                assert requirement.specifier.contains(locked, prereleases=True), (line, locked)
            for entry in self.entries(path):
                assert "--hash=sha256:" in entry, entry.splitlines()[0]
        [torch] = [line for line in lock.requirements(lock.APP) if line.startswith("torch")]
        assert re.fullmatch(r"torch==[\d.]+", torch)

    def test_both_files_agree_and_name_no_place(self) -> None:
        app, dev = ({entry.split()[0] for entry in self.entries(path)}
                    for path in (lock.APP, lock.DEV))  # fmt: skip
        assert app <= dev, "the tests run what the app runs"
        assert any(entry.startswith("authlib==") for entry in app), "signing in"
        for path in (lock.APP, lock.DEV):
            text = lock.lock_of(path).read_text()
            assert not re.search(r"index-url|find-links|://| @ |^-[^-]|torch|nvidia", text, re.M)

    def test_what_is_tested_is_what_is_locked(self) -> None:
        here = dict(audit.locked(only_here=True))
        assert {name: version(name).partition("+")[0] for name in here} == here

    def entries(self, path: Path) -> list[str]:
        lines = lock.lock_of(path).read_text().split("\n")
        text = "\n".join(line for line in lines if not line.startswith("#"))
        return [entry for entry in re.split(r"\n(?=\S)", text.strip()) if entry]


class TestAudit:
    @pytest.fixture
    def database(self, monkeypatch: pytest.MonkeyPatch) -> Iterator[list[bytes]]:
        """One that knows of an advisory on msgspec, and what it was asked."""
        asked: list[bytes] = []

        class Handler(BaseHTTPRequestHandler):
            def do_POST(self) -> None:
                asked.append(self.rfile.read(int(self.headers["Content-Length"])))
                names = [query["package"]["name"] for query in json.loads(asked[0])["queries"]]
                known = [{"vulns": [{"id": "X-1"}]} if name == "msgspec" else {} for name in names]
                self.send_response(200)
                self.end_headers()
                self.wfile.write(json.dumps({"results": known}).encode())

            def log_message(self, *_: object) -> None:
                pass

        with HTTPServer(("127.0.0.1", 0), Handler) as server:
            thread = threading.Thread(target=server.serve_forever, args=(0.01,))
            thread.start()
            monkeypatch.setenv(audit.MIRROR_VARIABLE, f"http://127.0.0.1:{server.server_port}")
            yield asked
            server.shutdown()
            thread.join()

    def test_an_advisory_is_a_line_and_all_packages_are_asked_for(
        self, database: list[bytes], capsys: pytest.CaptureFixture[str]
    ) -> None:
        assert audit.main() == 1
        assert "msgspec" in capsys.readouterr().out
        queries = json.loads(database[0])["queries"]
        asked = [(query["package"]["name"], query["version"]) for query in queries]
        assert asked == audit.locked()
        assert {"torch", "streamlit", "pytest"} <= {name for name, _ in asked}

    def test_without_a_network_nothing_is_said_to_be_sound(
        self, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
    ) -> None:
        monkeypatch.setenv(audit.MIRROR_VARIABLE, "http://127.0.0.1:9")
        assert audit.main() == 2
        printed = capsys.readouterr()
        assert not printed.out
        assert len(printed.err.splitlines()) == 1
