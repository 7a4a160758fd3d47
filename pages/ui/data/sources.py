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

OPENING, ARRIVED = "data_opening", "data_arrived"
"""Entries in Streamlit's session state: whether the ways to open another recording are shown, and
whether an upload has just been opened."""

Load = Callable[[], tuple[Recording, Truth | None]]


def from_bytes(raw: bytes, name: str) -> Recording:
    """An upload's recording; nothing but the session keeps it, so it leaves memory with that."""
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


def samples() -> list[Path]:
    """The samples' files, the first of them first."""
    return sorted(SAMPLES.glob("*.csv"), key=lambda path: path != FIRST_SAMPLE)


def title_of(path: Path) -> str:
    """What a sample is called."""
    return TITLES.get(path.stem, path.stem)


def about(path: Path) -> str:
    """A sample's description, or why there is none."""
    try:
        return load_truth(truth_path(path)).description
    except AccpinnError as fault:
        return str(fault)


def find_sample(name: str, sha256: str) -> tuple[Recording, Truth] | None:
    """The sample of that file name and content, with its true parameters; None for none."""
    path = next((path for path in SAMPLES.glob("*.csv") if path.name == name), None)
    found = sample(path) if path else None
    return found if found and found[0].sha256 == sha256 else None


def find_run(workspace: Workspace, file: str) -> Load | None:
    """What opens the recording of that file name: opened before, or in the server's folder."""
    for known in workspace.opened.values():
        if known[0].source == file:
            return lambda: known
    path = next((path for path in _listed() if path.name == file), None)
    return (lambda: (from_file(path), None)) if path else None


def open_with(workspace: Workspace, load: Load) -> None:
    """Open what ``load`` gives; if that fails, keep what was open and say why."""
    try:
        workspace.open(*load())
    except AccpinnError as fault:
        workspace.refusal = str(fault)
    else:
        st.session_state[OPENING] = False


def ask_for_upload() -> None:
    """Let the page Data begin with the field for a file of the user's own."""
    st.session_state[OPENING] = True


def choose_source(workspace: Workspace) -> None:
    """A field for a file, and beside each other the samples and the server's folder."""
    drop_zone(workspace)
    left, right = st.columns(2, gap="large")
    with left:
        _choose_sample(workspace)
    with right:
        _choose_file(workspace)


def drop_zone(workspace: Workspace, announce: bool = False) -> bool:
    """The field for a file of the user's own, and why the last attempt to open one failed.

    Args:
        workspace: the session that the recording is opened in.
        announce: whether to return that a file was opened; else nothing is remembered of it.

    Returns:
        Whether a file has just been opened.
    """
    limit = int(config.get_option("server.maxUploadSize"))

    def uploaded() -> None:
        upload = st.session_state["data_upload"]
        if upload is not None:
            open_with(workspace, lambda: (from_bytes(upload.getvalue(), upload.name), None))
            st.session_state[ARRIVED] = announce and not workspace.refusal

    st.file_uploader(
        f"Drop an OpenACC recording here: one CSV file of up to {limit} MB. It is not stored on"
        " disk.",
        key="data_upload",
        on_change=uploaded,
        help="Columns Time, Speed1, Speed2, .. in m/s and IVS1, .. in m, below the five rows of"
        " metadata, as the OpenACC database has them.",
    )
    if workspace.refusal:
        kept = " The recording opened before is kept." if workspace.recording else ""
        show.messages(workspace.refusal + kept, "error")
    return bool(st.session_state.pop(ARRIVED, False))


def _choose_sample(workspace: Workspace) -> None:
    paths = samples()
    if not paths:
        st.info("There are no samples here; write them with `make samples`.")
        return
    path = st.selectbox(
        "Sample: synthetic, true parameters known",
        paths,
        format_func=title_of,
        key="data_sample",
        help="Made from the parameters that the paper reports, with noise as receivers have it.",
    )
    st.caption(escape_markdown(about(path)))
    _open_button("Open this sample", workspace, lambda: sample(path))


def _open_button(label: str, workspace: Workspace, load: Load) -> None:
    """The primary button as long as nothing is open."""
    kind: Literal["primary", "secondary"] = "secondary" if workspace.recording else "primary"
    st.button(label, type=kind, on_click=open_with, args=(workspace, load))


def _choose_file(workspace: Workspace) -> None:
    named = os.environ.get(FOLDER_VARIABLE, "")
    if not named:
        st.caption(
            f"Folder on the server: none is set. Start the app with the environment variable"
            f" `{FOLDER_VARIABLE}` naming one, and the recordings in it and its subfolders are"
            " listed here."
        )
        return
    paths = _listed()
    if not paths:
        st.info(f"`{FOLDER_VARIABLE}` names a folder without CSV files.")
        return
    root = Path(named).resolve()
    path = st.selectbox(
        "Recording in the server's folder",
        paths,
        format_func=lambda path: str(path.relative_to(root)),
        key="data_file",
        help=f"The folder that `{FOLDER_VARIABLE}` names, with its subfolders.",
    )
    if path:
        _open_button("Open this recording", workspace, lambda: (from_file(path), None))


def _listed() -> list[Path]:
    """The CSV files in the server's folder; none where none is set."""
    named = os.environ.get(FOLDER_VARIABLE, "")
    if not named:
        return []
    root = Path(named).resolve()
    found = (path for path in sorted(root.rglob("*.[cC][sS][vV]")) if path.is_file())
    # A link that leads out of the folder is left out.
    inside = (path for path in found if path.resolve().is_relative_to(root))
    return list(islice(inside, LISTED))
