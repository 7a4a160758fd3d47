"""Opening a recording: a sample, an upload, a published run, or a file in the server's folder."""

import os
from collections.abc import Callable
from pathlib import Path
from typing import Literal

import streamlit as st
from streamlit import config

from accpinn.errors import AccpinnError
from accpinn.recordings import files
from accpinn.recordings.catalogue import Run, catalogue
from accpinn.recordings.download import PUBLISHED_AT
from accpinn.recordings.recording import Recording
from accpinn.recordings.synthetic import Truth, load_truth, truth_path
from accpinn.storage import variable
from accpinn.tasks.batches import DownloadTask
from accpinn.tasks.task import Status
from pages.ui.components import show
from pages.ui.components.monitor import stop_button, watch
from pages.ui.components.show import escape_markdown
from pages.ui.data.mapping import ASK, pending_of, show_pending
from pages.ui.session.resources import (
    download_queue,
    listed,
    recordings_folder,
    sample,
    sample_title,
    samples,
)
from pages.ui.session.workspace import Workspace

OPENING, ARRIVED = "data_opening", "data_arrived"
"""Entries in Streamlit's session state: whether the ways to open another recording are shown, and
whether an upload has just been opened."""

MIRROR_VARIABLE = "ACCPINN_MIRROR"
"""Environment variable with the address of a mirror of the publisher's files."""

Load = Callable[[], tuple[Recording, Truth | None]]


def about(path: Path) -> str:
    """A sample's description, or why there is none."""
    try:
        return load_truth(truth_path(path)).description
    except AccpinnError as fault:
        return str(fault)


def find_run(workspace: Workspace, campaign: str, file: str) -> Load | None:
    """What opens a campaign's recording: opened before, or in the server's folder."""
    for known in workspace.opened.values():
        if known[0].source == file and known[0].campaign in (None, campaign):
            return lambda: known
    others = {run.campaign for run in catalogue() if run.file == file} - {campaign}
    paths = [path for path in listed() if path.name == file and others.isdisjoint(path.parts)]
    path = min(paths, key=lambda path: campaign not in path.parts, default=None)
    return (lambda: (files.read(path), None)) if path else None


def open_with(
    workspace: Workspace, load: Load, source: bytes | Path | None = None, name: str = ""
) -> None:
    """Open what ``load`` gives; if that fails, keep what was open and say why.

    ``source`` is the file itself, of which columns or a trajectory may be asked.
    """
    workspace.pending = None
    try:
        if source is not None and st.session_state.get(ASK):
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
        show_pending(workspace, lambda: st.session_state.update({OPENING: False}))
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
        _choose_published(workspace, root)
        _choose_file(workspace, root)


def drop_zone(workspace: Workspace, announce: bool = False) -> bool:
    """The field for a file of the user's own, and why the last attempt to open one failed.

    Returns:
        Whether a file has just been opened, where the page asks to ``announce`` that.
    """
    limit = int(config.get_option("server.maxUploadSize"))

    def uploaded() -> None:
        upload = st.session_state["data_upload"]
        if upload is not None:
            raw, name = upload.getvalue(), upload.name
            open_with(workspace, lambda: (files.read(raw, name), None), raw, name)
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
        format_func=sample_title,
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
    _open_button(label, workspace, lambda: (files.read(path), None), path, path.name)


def _choose_file(workspace: Workspace, root: Path) -> None:
    """The files in the server's folder that are no published runs."""
    published = {run.path(root) for run in catalogue()}
    paths = [path for path in listed() if path not in published]
    if not paths:
        st.caption(
            "Other files in the server's folder of recordings are listed here;"
            f" `{variable('recordings')}` names that folder."
        )
        return
    path = st.selectbox(
        "Recording in the server's folder",
        paths,
        format_func=lambda path: str(path.relative_to(root)),
        key="data_file",
        help=f"The folder that `{variable('recordings')}` names, with its subfolders.",
    )
    _open_file(workspace, path, "Open this recording")


def _choose_published(workspace: Workspace, root: Path) -> None:
    """The list of runs; the one that is chosen is offered to be opened, or downloaded first."""
    runs = catalogue()
    present = {run for run in runs if run.path(root).is_file()}
    states = {run: "on this server" if run in present else "to be downloaded" for run in runs}
    run = st.selectbox(
        f"Published OpenACC run ({len(present)} of {len(runs)} on this server)", runs, index=None,
        format_func=lambda run: f"{run.key} · {states[run]}", key="data_run",
        placeholder="Search by campaign or file",
        help="All runs that the Joint Research Centre publishes. Those that are not on the server"
        " yet are downloaded into its folder of recordings.",
    )  # fmt: skip
    submitted = download_queue().of(workspace.id, "download")
    task = submitted if isinstance(submitted, DownloadTask) else None
    if task and task.is_active:
        watch(task, lambda: _line_of(task))
        stop_button(task, "Stop the download", "data_download_stop")
    elif run is not None and run in present:
        _open_file(workspace, run.path(root), "Open this run")
    elif run is not None:
        latest = task.status if task and task.run == run else None
        if task and latest is Status.FAILED:
            show.messages(task.error, "error", "cloud_off")
        stopped = latest is Status.STOPPED
        st.button(
            "Continue the download" if stopped else "Download this run",
            icon=":material/download:", key="data_download", on_click=_download,
            args=(workspace, run, root), help="From the publisher, with its checksum where known.",
        )  # fmt: skip


def _download(workspace: Workspace, run: Run, root: Path) -> None:
    base = os.environ.get(MIRROR_VARIABLE) or PUBLISHED_AT
    download_queue().submit(DownloadTask(workspace.id, run, root, base))


def _line_of(task: DownloadTask) -> str:
    now, waits = task.latest, task.status is Status.QUEUED
    if waits or now is None:
        return "Waiting: another download is running." if waits else "Connecting …"
    size = f" of {now.size / 1e6:.1f}" if now.size else ""
    return f"{task.run.file}: {now.received / 1e6:.1f}{size} MB"
