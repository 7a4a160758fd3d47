"""Opening a recording: a sample, an upload, or a file in the server's folder of recordings."""

from collections.abc import Callable
from itertools import islice
from pathlib import Path
from typing import Literal

import streamlit as st
from streamlit import config

from accpinn.errors import AccpinnError, RecordingError
from accpinn.recordings import files
from accpinn.recordings.catalogue import FOLDER_VARIABLE, catalogue, default_folder
from accpinn.recordings.recording import Recording
from accpinn.recordings.synthetic import Truth, load_truth, truth_path
from pages.ui.components import show
from pages.ui.components.show import escape_markdown
from pages.ui.data.mapping import ASK, ask_for_columns, pending_of, show_pending
from pages.ui.data.published import choose_published
from pages.ui.session.workspace import Workspace

SAMPLES = Path(__file__).parents[3] / "sample_data"
FIRST_SAMPLE = SAMPLES / "synthetic_astazero_like.csv"
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
    return files.read(raw, name)


@st.cache_resource(max_entries=16, show_spinner="Reading the recording …")
def _parse_file(path: str, size: int, changed: int, trajectory: str | None) -> Recording:
    return files.read(path, trajectory=trajectory)


def from_file(path: Path, trajectory: str | None = None) -> Recording:
    """A file's recording; read again once the file has changed."""
    try:
        status = path.stat()
    except OSError:
        return files.read(path)  # which says what is wrong
    return _parse_file(str(path), status.st_size, status.st_mtime_ns, trajectory)


def find_recording(
    file: str, sha256: str, trajectory: str | None, campaign: str | None
) -> Recording:
    """The recording with that content, from the server's folder or the samples.

    Args:
        file: its name.
        sha256: of the recording.
        trajectory: of a table with several.
        campaign: where to look first; several have files of the same name.

    Raises:
        RecordingError: where none is there.
    """
    root = recordings_folder()
    found = [path for path in (*root.rglob("*"), *SAMPLES.glob("*.csv")) if path.name == file]
    for path in sorted(found, key=lambda path: campaign not in path.parts):
        inside = path.is_file() and any(path.resolve().is_relative_to(p.resolve())
                                        for p in (root, SAMPLES))  # fmt: skip
        if not inside:
            continue
        try:
            recording = from_file(path, trajectory)
        except RecordingError:  # another file of that name
            continue
        if recording.sha256 == sha256:
            return recording
    raise RecordingError(
        f"{file}: this recording is not in the server's folder; download it on page Data, or put it"
        f" there ({FOLDER_VARIABLE})."
    )


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


def find_run(workspace: Workspace, campaign: str, file: str) -> Load | None:
    """What opens a campaign's recording: opened before, or in the server's folder."""
    for known in workspace.opened.values():
        if known[0].source == file and known[0].campaign in (None, campaign):
            return lambda: known
    others = {run.campaign for run in catalogue() if run.file == file} - {campaign}
    paths = [path for path in _listed() if path.name == file and others.isdisjoint(path.parts)]
    path = min(paths, key=lambda path: campaign not in path.parts, default=None)
    return (lambda: (from_file(path), None)) if path else None


def recordings_folder() -> Path:
    """The server's folder of recordings, which need not exist."""
    return default_folder().resolve()


def folders(root: Path) -> tuple[str, ...]:
    """The folders of recordings below one, itself first as "."; none where there is no file."""
    below = {path.parent.relative_to(root) for path in _listed()}
    every = {Path("."), *below, *(p for one in below for p in one.parents)} if below else set()
    return tuple(str(path) for path in sorted(every))


def open_with(
    workspace: Workspace, load: Load, source: bytes | Path | None = None, name: str = ""
) -> None:
    """Open what ``load`` gives; if that fails, keep what was open and say why.

    Args:
        workspace: the session.
        load: gives the recording.
        source: the file itself, of which columns or a trajectory may be asked.
        name: of the file.
    """
    workspace.pending = None
    try:
        if source is not None and ask_for_columns():
            workspace.pending = pending_of(source, name, known=True)
            if workspace.pending:
                return
        workspace.open(*load())
    except AccpinnError as fault:
        if source is not None:
            workspace.pending = pending_of(source, name)
        workspace.refusal = "" if workspace.pending else str(fault)
    else:
        st.session_state[OPENING] = False


def ask_for_upload() -> None:
    """Let the page Data begin with the field for a file of the user's own."""
    st.session_state[OPENING] = True


def choose_source(workspace: Workspace) -> None:
    """A field for a file; beside each other the samples, and the runs and files on the server."""
    if workspace.pending:
        show_pending(workspace, _close)
        return
    drop_zone(workspace)
    st.checkbox(
        "Ask for columns and units", key=ASK,
        help="Of a table of your own whose columns were named before: to name them anew.",
    )  # fmt: skip
    left, right = st.columns(2, gap="large")
    with left:
        _choose_sample(workspace)
    with right:
        root = recordings_folder()
        choose_published(workspace, root, lambda path: _open_file(workspace, path, "Open this run"))
        _choose_file(workspace)


def _close() -> None:
    """After a file that asked for something was opened."""
    _parse_file.clear()  # what is remembered of columns may have changed
    st.session_state[OPENING] = False


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
            raw, name = upload.getvalue(), upload.name
            open_with(workspace, lambda: (from_bytes(raw, name), None), raw, name)
            st.session_state[ARRIVED] = announce and not workspace.refusal
            st.session_state[OPENING] = st.session_state.get(OPENING) or bool(workspace.pending)

    st.file_uploader(
        f"Drop a recording here: one CSV file of up to {limit} MB, as OpenACC has them or any"
        " other table. It is not stored on disk.",
        key="data_upload",
        on_change=uploaded,
        help="OpenACC: columns Time, Speed1, Speed2, .. in m/s and IVS1, .. in m, below five rows"
        " of metadata. Tables of leader-follower pairs (ULTra-AV) are read as they are; of any"
        " other table you say which columns hold what.",
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


def _open_button(label: str, workspace: Workspace, load: Load, *source: Path | str) -> None:
    """The primary button as long as nothing is open; ``source`` as in `open_with`."""
    kind: Literal["primary", "secondary"] = "secondary" if workspace.recording else "primary"
    st.button(label, type=kind, on_click=open_with, args=(workspace, load, *source))


def _open_file(workspace: Workspace, path: Path, label: str) -> None:
    _open_button(label, workspace, lambda: (from_file(path), None), path, path.name)


def _choose_file(workspace: Workspace) -> None:
    """The files in the server's folder that are no published runs."""
    root = recordings_folder()
    published = {run.path(root) for run in catalogue()}
    paths = [path for path in _listed() if path not in published]
    if not paths:
        st.caption(
            f"Other files in the server's folder of recordings are listed here; `{FOLDER_VARIABLE}`"
            " names that folder."
        )
        return
    path = st.selectbox(
        "Recording in the server's folder",
        paths,
        format_func=lambda path: str(path.relative_to(root)),
        key="data_file",
        help=f"The folder that `{FOLDER_VARIABLE}` names, with its subfolders.",
    )
    if path:
        _open_file(workspace, path, "Open this recording")


def _listed() -> list[Path]:
    """The CSV files in the server's folder; none where there is no folder."""
    root = recordings_folder()
    found = (path for path in sorted(root.rglob("*.[cC][sS][vV]")) if path.is_file())
    # A link that leads out of the folder is left out.
    inside = (path for path in found if path.resolve().is_relative_to(root))
    return list(islice(inside, LISTED))
