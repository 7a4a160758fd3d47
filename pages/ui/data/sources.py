"""Opening a recording: a sample, an upload, a published run, or a file in the server's folder."""

import os
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import streamlit as st

from accpinn.errors import AccpinnError, RecordingError
from accpinn.recordings import Recording, files
from accpinn.recordings.download import Transfer
from accpinn.recordings.files import File
from accpinn.recordings.mapping import CsvMapping
from accpinn.recordings.openacc import PUBLISHED_AT, Run, catalogue
from accpinn.recordings.source import excerpt
from accpinn.recordings.synthetic import load_truth, truth_path
from accpinn.storage import variable
from accpinn.tasks import Status
from accpinn.tasks.batches import download_task
from pages.ui.components import show
from pages.ui.components.frame import TURN
from pages.ui.components.monitor import monitor, stop_button
from pages.ui.components.show import escape_markdown
from pages.ui.data.mapping import show_form
from pages.ui.session import resources
from pages.ui.session.pending import Pending
from pages.ui.session.workspace import Workspace

OPENING = "data_opening"
"""The entry in Streamlit's session state that shows the ways to open another recording."""
RUN = "data_run"
"""The entry with the published run that is chosen there."""
MIRROR_VARIABLE = "ACCPINN_MIRROR"
"""Environment variable with the address of a mirror of the publisher's files."""


def find_run(workspace: Workspace, campaign: str, file: str) -> Callable[[], None] | None:
    """A function that opens a campaign's recording, opened before or in the server's folder."""
    place = place_of_run(workspace, campaign, file)
    if place is None:
        return None
    if isinstance(place, Recording):
        return lambda: workspace.open(place)
    return lambda: open_file(workspace, place)


def place_of_run(workspace: Workspace, campaign: str, file: str) -> Recording | Path | None:
    """A campaign's recording that was opened before, or its file in the server's folder."""
    for recording in workspace.opened.values():
        if recording.source == file and recording.campaign in (None, campaign):
            return recording
    others = {run.campaign for run in catalogue() if run.file == file} - {campaign}
    named = [path for path in resources.listed() if path.name == file]
    paths = [path for path in named if others.isdisjoint(path.parts)]
    return min(paths, key=lambda path: campaign not in path.parts, default=None)


def open_file(workspace: Workspace, source: bytes | Path, name: str | None = None) -> None:
    """Open a file, or keep it pending with what it asks for. A path has a name of its own.

    A table of one's own is always shown first as it was understood.

    Raises:
        RecordingError: where it is refused; what was open before then stays.
    """
    show.forget_flash()
    workspace.pending = None
    try:
        file = files.opened(source, name)
        if file.is_unknown or file.trajectories:
            workspace.pending = Pending.of(file, workspace.mappings.get(file.names))
        else:
            workspace.open(file.read())
        st.session_state[OPENING] = False
    except AccpinnError as fault:
        remark = " The recording opened before is kept." if workspace.recording else ""
        raise RecordingError(f"{fault}{remark}") from fault


def ask(workspace: Workspace, pending: Pending, then: str = "") -> None:
    """The questions on a pending table; once it is opened, the app turns to the page ``then``."""

    def opened(trajectory: str | None) -> None:
        now = workspace.pending or pending
        open_table(workspace, now.file, now.mapping, now.reading(trajectory))
        workspace.pending, st.session_state[TURN] = None, then

    with st.container(border=True, key="data_form"):
        show_form(workspace, pending, opened)


def open_table(
    workspace: Workspace, file: File, mapping: CsvMapping | None, reading: Recording | AccpinnError
) -> None:
    """Open the recording of a table, and keep its mapping where no data contradict it.

    Raises:
        AccpinnError: in place of a recording.
    """
    if not isinstance(reading, Recording):
        raise reading
    workspace.open(reading)
    workspace.table = file if mapping else workspace.table
    if mapping and not files.contradictions(reading):
        workspace.mappings[file.names] = mapping


def read_anew(workspace: Workspace, file: File, mapping: CsvMapping) -> None:
    """Open the recording that is open by another mapping of its table.

    Raises:
        AccpinnError: where the mapping does not serve; the recording then stays.
    """
    run = workspace.recording.trajectory if workspace.recording else None
    open_table(workspace, file, mapping, Pending(file, mapping).reading(run))


def choose_source(workspace: Workspace) -> None:
    """A field for a file; beside each other the samples, and the runs and files on the server."""
    _choose_opened(workspace)
    drop_zone(workspace)
    left, right = st.columns(2, gap="large")
    with left:
        _choose_sample(workspace)
    with right:
        root = resources.recordings_folder()
        _choose_published(workspace, root)
        _choose_file(workspace, root)


def drop_zone(workspace: Workspace, then: str = "") -> None:
    """The field for a file of the user's own, and why the last attempt to open one failed.

    Once a file has been opened, the app turns to the page ``then``; a table that asks for something
    does so where it was dropped.
    """

    def took(given: list[tuple[str, bytes]]) -> None:
        (name, raw), *others = given
        open_file(workspace, raw, name)
        st.session_state[TURN] = "" if workspace.pending else then
        if others:
            _open_beside(workspace, others)

    show.upload_several(
        "Drop recordings here: speeds and gaps, from OpenACC or your own.",
        "data_upload",
        took,
        help="CSV, Excel, Parquet or SUMO XML, also as .gz. OpenACC: columns Time, Speed1, Speed2,"
        " .. in m/s and IVS1, .. in m, below five rows of metadata. Tables of leader-follower pairs"
        " (ULTra-AV) are read as they are; of any other table you see first how its columns are"
        " understood. A recording is kept in memory alone.",
    )
    show.flashed()


def _open_beside(workspace: Workspace, others: list[tuple[str, bytes]]) -> None:
    """Open further files of one drop, as far as they ask nothing; the first one stays shown.

    Raises:
        RecordingError: where some cannot be opened beside it; the others are open.
    """
    left = []
    for name, raw in others:
        try:
            file = files.opened(raw, name)
            mapping = workspace.mappings.get(file.names) if file.is_unknown else None
            if file.trajectories or (file.is_unknown and mapping is None):
                left.append(f"{name} has to be opened by itself, as its columns are asked for")
                continue
            remembered = replace(file, mapping=mapping) if mapping else file
            workspace.remember_beside(remembered.read())
        except AccpinnError as fault:
            left.append(str(fault).rstrip("."))
    beside = f"{len(others) - len(left)} of {len(others)} further recordings are open"
    where = "page Data, Open another recording, lists them; page Database estimates all together"
    if left:
        raise RecordingError(f"{beside} ({where}). {'; '.join(left)}.")
    show.flash("success", f"{beside}: {where}.")


def _choose_opened(workspace: Workspace) -> None:
    """The other recordings that are open in this session, each with a button to show it."""
    now = workspace.recording
    others = [recording for recording in workspace.opened.values() if recording is not now]
    if not others:
        return
    with st.container(horizontal=True, vertical_alignment="center"):
        st.caption("Also open", width="content")
        for recording in others:

            def turn(recording: Recording = recording) -> None:
                workspace.open(recording)
                st.session_state[OPENING] = False

            st.button(
                escape_markdown(recording.source), key=f"data_opened_{recording.sha256[:12]}",
                type="tertiary",
                icon=":material/timeline:", on_click=turn,
            )  # fmt: skip


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
    if odd := resources.misnamed():
        names = excerpt(", ".join(odd), 150)
        show.messages(f"Left out, as their names are no UTF-8 text: {names}.", "warning")
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
        format_func=lambda run: f"{run.key} · {states[run]}", key=RUN,
        placeholder="Search by campaign or file",
        help="All runs that the Joint Research Centre publishes. Those that are not here"
        " yet are downloaded into the folder of recordings.",
    )  # fmt: skip
    task = resources.download_queue().of(workspace.id, "download")
    if task and task.is_active:
        monitor(task, describe=_describe)
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


def _describe(now: Transfer) -> str:
    size = f" of {now.size / 1e6:.1f}" if now.size else ""
    return f"{now.run.file}: {now.received / 1e6:.1f}{size} MB"
