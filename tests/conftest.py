"""Fixtures that several test modules share."""

import gc
import os
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import get_args

import pytest
from hypothesis import settings

from accpinn.recordings import Recording
from accpinn.recordings.openacc import read
from accpinn.storage import FolderName, variable
from accpinn.study.store import Store
from tests.support import draws
from tests.support.registries import restored

# The same examples on every run, and no time limit an example: machines and their load differ.
settings.register_profile("house", derandomize=True, deadline=None)
settings.load_profile("house")


# Intervals from few draws, but in the tests of inference: elsewhere their place hardly counts, and
# they are ready in a tenth of the time. A process of its own takes all of them, but for the app
# that browsers look at.
draws.take_few()


def pytest_collection() -> None:
    """What is imported lives until the end: no collection need look through it again and again."""
    gc.disable()


def pytest_collection_finish() -> None:
    gc.freeze()
    gc.enable()


@pytest.fixture(scope="session")
def openacc_dir() -> Path:
    """Folder of the real OpenACC recordings; they are never part of the project."""
    folder = os.environ.get("OPENACC_DIR", "")
    if not folder or not Path(folder).is_dir():
        pytest.skip("OPENACC_DIR does not name a folder with the OpenACC recordings")
    return Path(folder)


@pytest.fixture(scope="session")
def casale(openacc_dir: Path) -> Recording:
    """Table I's run: one follower, which catches up for a fifth of the time."""
    return read(openacc_dir / "Casale" / "part7.csv")


@pytest.fixture(scope="session")
def astazero(openacc_dir: Path) -> Recording:
    """The run of Tables II and III: four followers, from 320 s on."""
    return read(openacc_dir / "AstaZero" / "ASta_040719_platoon5.csv")


@pytest.fixture(autouse=True)
def folders_of_its_own(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """No test sees or changes what whoever runs it keeps."""
    for name in get_args(FolderName):
        monkeypatch.setenv(variable(name), str(tmp_path / name))


@pytest.fixture
def store(tmp_path: Path) -> Store:
    """An empty one."""
    return Store(tmp_path / "cache")


@pytest.fixture
def fresh_server(monkeypatch: pytest.MonkeyPatch, folders_of_its_own: None) -> Iterator[None]:
    """A server of its own for a page's test: no sessions, no tasks, an empty store."""
    # Streamlit takes a second, which most tests need not wait.
    from pages.ui.session import resources as server
    from pages.ui.session import sessions, users

    # A page's test has no connection; it stands for the person at this computer.
    monkeypatch.setattr(users, "connection_headers", lambda: {"Host": "localhost:8501"})
    # A page takes the place of the main module, which new processes would run.
    monkeypatch.setitem(sys.modules, "__main__", sys.modules["__main__"])
    monkeypatch.chdir(Path(__file__).parent.parent)
    # Every page opened would search all installed packages for components; the app has none.
    scan = "streamlit.components.v2.manifest_scanner.scan_component_manifests"
    monkeypatch.setattr(scan, list)
    # The session's objects; what pages make of a file alone is as good in the next test.
    named = {**vars(server), **vars(sessions)}.values()
    state = [value for value in named if isinstance(value, type(server.store))]
    for part in state:
        part.clear()
    yield
    for queue in (server.task_queue, server.batch_queue, server.download_queue):
        queue().close()
    for part in state:
        part.clear()


@pytest.fixture
def cthp_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of the forms of the model only the CTHP, where the others take time and are not looked at."""
    from accpinn.inference import model_adequacy

    monkeypatch.setattr(model_adequacy, "FORMS", ("cthp",))


@pytest.fixture(scope="module")
def all_draws() -> Iterator[None]:
    """As many as users have; the tests of a module share what they are of."""
    with draws.as_users_have():
        yield


@pytest.fixture
def registries() -> Iterator[None]:
    """What a test registers, models and methods, is forgotten behind it."""
    with restored():
        yield
