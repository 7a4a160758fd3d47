"""Opening a recording: a sample, an upload, a published run, or a file in the server's folder."""

import os
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import streamlit as st
from streamlit import config

from accpinn.errors import AccpinnError, RecordingError
from accpinn.recordings import files
from accpinn.recordings.download import Transfer
from accpinn.recordings.files import File
from accpinn.recordings.mapping import write_mapping
from accpinn.recordings.openacc import PUBLISHED_AT, Run, catalogue
from accpinn.recordings.synthetic import load_truth, truth_path
from accpinn.storage import variable
from accpinn.tasks import Status
from accpinn.tasks.batches import download_task
from pages.ui.components import show
from pages.ui.components.frame import TURN
from pages.ui.components.monitor import monitor, stop_button
from pages.ui.components.show import escape_markdown
from pages.ui.data.mapping import ask_for_columns
from pages.ui.session import resources
from pages.ui.session.workspace import Workspace

OPENING = "data_opening"
"""The entry in Streamlit's session state that shows the ways to open another recording."""
ASK = "data_ask_columns"
"""The entry that asks for columns that are remembered, too."""
MIRROR_VARIABLE = "ACCPINN_MIRROR"
"""Environment variable with the address of a mirror of the publisher's files."""


def find_run(workspace: Workspace, campaign: str, file: str) -> Callable[[], None] | None:
    """What opens a campaign's recording: opened before, or in the server's folder."""
    for known in workspace.opened.values():
        if known.source == file and known.campaign in (None, campaign):
            return lambda: workspace.open(known)
    others = {run.campaign for run in catalogue() if run.file == file} - {campaign}
    named = [path for path in resources.listed() if path.name == file]
    paths = [path for path in named if others.isdisjoint(path.parts)]
    path = min(paths, key=lambda path: campaign not in path.parts, default=None)
    return (lambda: open_file(workspace, path)) if path else None


def open_file(workspace: Workspace, source: bytes | Path, name: str | None = None) -> None:
    """Open a file, or keep it pending with what it asks for. A path has a name of its own.

    Raises:
        RecordingError: where it is refused; what was open before then stays.
    """
    show.forget_flash()
    workspace.pending = None
    try:
        file = files.opened(source, name)
        if st.session_state.get(ASK) and file.mapping:
            workspace.pending = replace(file, mapping=None)
        else:
            _read(workspace, file)
    except AccpinnError as fault:
        kept = " The recording opened before is kept." if workspace.recording else ""
        raise RecordingError(f"{fault}{kept}") from fault


def _read(workspace: Workspace, file: File, trajectory: str | None = None) -> None:
    try:
        workspace.open(file.read(trajectory))
        workspace.pending, st.session_state[OPENING] = None, False
    except AccpinnError:
        if not (file.is_unknown or (not trajectory and _has_runs(file))):
            raise
        workspace.pending = file


def _has_runs(file: File) -> bool:
    with suppress(AccpinnError):
        return bool(file.trajectories)
    return False


def choose_source(workspace: Workspace) -> None:
    """A field for a file; beside each other the samples, and the runs and files on the server."""
    if workspace.pending:
        _ask(workspace, workspace.pending)
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
        root = resources.recordings_folder()
        _choose_published(workspace, root)
        _choose_file(workspace, root)


def _ask(workspace: Workspace, file: File) -> None:
    """What the pending file asks, its trajectory or its columns, and the button that opens it."""
    name, chosen, fault = file.content.name, None, ""
    if runs := file.trajectories:
        vehicles = dict(runs)
        st.markdown(f"**{escape_markdown(name)}** holds {len(runs)} runs. Choose one of them.")
        chosen = st.selectbox(
            "Trajectory", list(vehicles), key="data_trajectory",
            format_func=lambda name: f"{name} · {vehicles[name]} vehicles",
            help="Pairs whose leader is another pair's follower at the same time are one run.",
        )  # fmt: skip
    elif file.layout and (mapping := ask_for_columns(name, file.layout)):
        file = replace(file, mapping=mapping, is_remembered=False)
        try:
            runs = file.trajectories
            recording = file.read(runs[0][0] if runs else None, is_kept=False)
            several = f"; {len(runs)} runs" if runs else ""
            st.caption(
                f":material/check_circle: {len(recording.present)} vehicles,"
                f" {recording.duration:,.0f} s at {1 / recording.sample_time:.3g} Hz{several}."
            )
        except RecordingError as error:
            fault = str(error)
        show.messages(fault, "error")

    def cancel() -> None:
        workspace.pending = None
        show.forget_flash()

    with st.container(horizontal=True):
        if chosen or file.mapping:
            st.button(
                "Open this trajectory" if chosen else "Open with these columns", type="primary",
                key="data_open_trajectory" if chosen else "data_open_mapped", disabled=bool(fault),
                on_click=_read, args=(workspace, file, chosen),
            )  # fmt: skip
        if file.mapping and not chosen:
            st.download_button(
                "Mapping as JSON", write_mapping(file.mapping), "mapping.json", "application/json",
                on_click="ignore", icon=":material/download:", key="data_mapping_json",
                help="For the command line's option --mapping, or for another server.",
            )  # fmt: skip
        st.button("Cancel", on_click=cancel, key="data_cancel")
    show.flashed()


def drop_zone(workspace: Workspace, then: str = "") -> None:
    """The field for a file of the user's own, and why the last attempt to open one failed.

    Once a file has been opened, the app turns to the page ``then``.
    """
    limit = int(config.get_option("server.maxUploadSize"))

    def took(name: str, raw: bytes) -> None:
        open_file(workspace, raw, name)
        st.session_state[TURN] = then
        st.session_state[OPENING] = st.session_state.get(OPENING) or bool(workspace.pending)

    show.upload(
        f"Drop a recording here: a CSV file of up to {limit} MB, from OpenACC or with columns of"
        " speeds and gaps of your own.",
        "data_upload",
        took,
        help="OpenACC: columns Time, Speed1, Speed2, .. in m/s and IVS1, .. in m, below five rows"
        " of metadata. Tables of leader-follower pairs (ULTra-AV) are read as they are; of any"
        " other table you say which columns hold what. A recording is kept in memory alone.",
    )
    show.flashed()


def _choose_sample(workspace: Workspace) -> None:
    paths = resources.samples()
    if not paths:
        st.info("There are no samples here; copy the folder sample_data of the project.")
        return
    path = st.selectbox(
        "Sample: synthetic, true parameters known",
        paths,
        format_func=resources.sample_title,
        key="data_sample",
        help="Made from known parameters, most of them the paper's.",
    )
    about = show.attempt(lambda: load_truth(truth_path(path)).description)
    st.caption(escape_markdown(about or ""))
    st.button(
        "Open this sample", type="secondary" if workspace.recording else "primary",
        on_click=open_file, args=(workspace, path),
    )  # fmt: skip


def _choose_file(workspace: Workspace, root: Path) -> None:
    """The files in the server's folder that are no published runs."""
    published = {run.path(root) for run in catalogue()}
    paths = [path for path in resources.listed() if path not in published]
    if not paths:
        st.caption(
            "Other files in the server's folder of recordings are listed here;"
            f" `{variable('recordings')}` names that folder."
        )
        return
    path = st.selectbox(
        "Recording in the server's folder", paths, index=None, key="data_file",
        format_func=lambda path: str(path.relative_to(root)), placeholder="Search by name",
        help=f"The folder that `{variable('recordings')}` names, with its subfolders.",
    )  # fmt: skip
    if path:
        st.button("Open this recording", on_click=open_file, args=(workspace, path))


def _choose_published(workspace: Workspace, root: Path) -> None:
    """The list of runs; the one that is chosen is offered to be opened, or downloaded first."""
    runs = catalogue()
    present = {run for run in runs if run.path(root).is_file()}
    states = {run: "here" if run in present else "to be downloaded" for run in runs}
    run = st.selectbox(
        f"Published OpenACC run ({len(present)} of {len(runs)} are here)", runs, index=None,
        format_func=lambda run: f"{run.key} · {states[run]}", key="data_run",
        placeholder="Search by campaign or file",
        help="All runs that the Joint Research Centre publishes. Those that are not here"
        " yet are downloaded into the folder of recordings.",
    )  # fmt: skip
    task = resources.download_queue().of(workspace.id, "download")
    if task and task.is_active:
        monitor(task, told=_told)
        stop_button(task, "Stop the download", "data_download_stop")
    elif run is not None and run in present:
        st.button("Open this run", on_click=open_file, args=(workspace, run.path(root)))
    elif run is not None:
        latest = task.status if task and task.names == (run.key,) else None
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
    task = download_task(workspace.id, run, root, base)
    resources.download_queue().submit(task, workspace.owner or workspace.key)


def _told(now: Transfer) -> str:
    size = f" of {now.size / 1e6:.1f}" if now.size else ""
    return f"{now.run.file}: {now.received / 1e6:.1f}{size} MB"
