"""Opening a recording: a sample, an upload, or a file in a folder on the server."""

import os
from collections.abc import Callable
from itertools import islice
from pathlib import Path
from typing import Literal

import streamlit as st
from streamlit import config

from accpinn.errors import AccpinnError
from accpinn.recordings import openacc
from accpinn.recordings.recording import Recording
from accpinn.recordings.synthetic import Truth, load_truth, truth_path
from pages.ui.components import show
from pages.ui.components.show import escape_markdown
from pages.ui.session.workspace import Workspace

SAMPLES = Path(__file__).parents[3] / "sample_data"
FIRST_SAMPLE = SAMPLES / "synthetic_astazero_like.csv"
FOLDER_VARIABLE = "ACCPINN_RECORDINGS"
TITLES = {
    "synthetic_astazero_like": "AstaZero-like platoon: four followers on a test track",
    "synthetic_vicolungo_like": "Ispra-Vicolungo-like platoon: three followers on a motorway",
    "synthetic_paper_study": "The paper's synthetic study: one follower, with receiver noise",
    "synthetic_paper_study_noise_free": "The paper's synthetic study: the same without noise",
}
LISTED = 1000
"""Files of a folder that are offered at most."""

SOURCE, ASKED = "data_source", "data_asked"
"""Entries in Streamlit's session state: the kind of source, and whether its controls are opened."""

Load = Callable[[], tuple[Recording, Truth | None]]


@st.cache_resource(max_entries=16, show_spinner="Reading the recording …")
def from_bytes(raw: bytes, name: str) -> Recording:
    """An upload's recording; it is read-only, so all sessions may share one of the same bytes."""
    return openacc.read(raw, name)


@st.cache_resource(max_entries=16, show_spinner="Reading the recording …")
def _parse_file(path: str, size: int, changed: int) -> Recording:
    return openacc.read(path)


def from_file(path: Path) -> Recording:
    """A file's recording; read again once the file has changed."""
    try:
        status = path.stat()
    except OSError:
        return openacc.read(path)  # which says what is wrong
    return _parse_file(str(path), status.st_size, status.st_mtime_ns)


def sample(path: Path) -> tuple[Recording, Truth]:
    """A sample and its true parameters."""
    return from_file(path), load_truth(truth_path(path))


def find_sample(name: str, sha256: str) -> tuple[Recording, Truth] | None:
    """The sample of that file name and content, with its true parameters; None for none."""
    path = next((path for path in SAMPLES.glob("*.csv") if path.name == name), None)
    found = sample(path) if path else None
    return found if found and found[0].sha256 == sha256 else None


def open_with(workspace: Workspace, load: Load) -> None:
    """Open what ``load`` gives; if that fails, keep what was open and say why."""
    try:
        workspace.open(*load())
    except AccpinnError as fault:
        workspace.refusal = str(fault)


def ask_for_upload() -> None:
    """Let the page Data begin with the field for a file of the user's own."""
    st.session_state[SOURCE] = "Upload"
    st.session_state[ASKED] = True


def is_asked() -> bool:
    """Whether the user has just asked for another recording."""
    return bool(st.session_state.pop(ASKED, False))


def choose_source(workspace: Workspace) -> None:
    """One of the three sources, and its controls."""
    kind = st.segmented_control(
        "Source of the recording",
        ("Sample", "Upload", "Folder on the server"),
        key=SOURCE,
        default="Sample",
        required=True,
        label_visibility="collapsed",
    )
    if kind == "Sample":
        _choose_sample(workspace)
    elif kind == "Upload":
        _choose_upload(workspace)
    else:
        _choose_file(workspace)
    if workspace.refusal:
        kept = " The recording opened before is kept." if workspace.recording else ""
        show.messages(workspace.refusal + kept, "error")


def _choose_sample(workspace: Workspace) -> None:
    paths = sorted(SAMPLES.glob("*.csv"), key=lambda path: path != FIRST_SAMPLE)
    if not paths:
        st.info("There are no samples here; write them with `make samples`.")
        return
    path = st.selectbox(
        "Synthetic recording, true parameters known",
        paths,
        format_func=lambda path: TITLES.get(path.stem, path.stem),
        key="data_sample",
    )
    try:
        about = load_truth(truth_path(path)).description
    except AccpinnError as fault:
        about = str(fault)
    st.caption(escape_markdown(about))
    _open_button("Open this sample", workspace, lambda: sample(path))


def _open_button(label: str, workspace: Workspace, load: Load) -> None:
    """The primary button as long as nothing is open."""
    kind: Literal["primary", "secondary"] = "secondary" if workspace.recording else "primary"
    st.button(label, type=kind, on_click=open_with, args=(workspace, load))


def _choose_upload(workspace: Workspace) -> None:
    limit = int(config.get_option("server.maxUploadSize"))

    def opened() -> None:
        upload = st.session_state["data_upload"]
        if upload is not None:
            open_with(workspace, lambda: (from_bytes(upload.getvalue(), upload.name), None))

    st.file_uploader(
        f"An OpenACC recording: one CSV file of up to {limit} MB. It is not stored on disk.",
        key="data_upload",
        on_change=opened,
    )


def _choose_file(workspace: Workspace) -> None:
    named = os.environ.get(FOLDER_VARIABLE, "")
    if not named:
        st.info(
            f"No folder is set. Start the app with the environment variable `{FOLDER_VARIABLE}`"
            " naming one, and the recordings in it and its subfolders are listed here."
        )
        return
    root = Path(named).resolve()
    found = (path for path in sorted(root.rglob("*.[cC][sS][vV]")) if path.is_file())
    # A link that leads out of the folder is left out.
    inside = (path for path in found if path.resolve().is_relative_to(root))
    paths = list(islice(inside, LISTED))
    if not paths:
        st.info(f"`{FOLDER_VARIABLE}` names a folder without CSV files.")
        return
    path = st.selectbox(
        "Recording in the server's folder",
        paths,
        format_func=lambda path: str(path.relative_to(root)),
        key="data_file",
    )
    if path:
        _open_button("Open this recording", workspace, lambda: (from_file(path), None))
