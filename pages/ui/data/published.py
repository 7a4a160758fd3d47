"""The published runs of the OpenACC database: a list to search, and their download."""

import os
from collections.abc import Callable
from pathlib import Path

import streamlit as st

from accpinn.recordings.catalogue import Run, catalogue
from accpinn.recordings.download import PUBLISHED_AT
from accpinn.tasks.batches import DownloadTask
from accpinn.tasks.task import Status
from pages.ui.components import show
from pages.ui.components.monitor import stop_button
from pages.ui.session.resources import download_queue
from pages.ui.session.workspace import Workspace

MIRROR_VARIABLE = "ACCPINN_MIRROR"
"""Environment variable with the address of a mirror of the publisher's files."""
POLL = 0.5
"""Seconds between two looks at a download."""


def choose_published(workspace: Workspace, root: Path, offer: Callable[[Path], None]) -> None:
    """The list of runs; the one that is chosen is opened, or downloaded first.

    Args:
        workspace: the session.
        root: the server's folder of recordings.
        offer: draws the button that opens a file.
    """
    runs = catalogue()
    present = {run for run in runs if run.path(root).is_file()}
    run = st.selectbox(
        f"Published OpenACC run ({len(present)} of {len(runs)} on this server)", runs, index=None,
        format_func=lambda run: _title(run, run in present), key="data_run",
        placeholder="Search by campaign or file",
        help="All runs that the Joint Research Centre publishes. Those that are not on the server"
        " yet are downloaded into its folder of recordings.",
    )  # fmt: skip
    submitted = download_queue().of(workspace.id, "download")
    task = submitted if isinstance(submitted, DownloadTask) else None
    if task and task.is_active:
        _watch(task)
    elif run is not None and run in present:
        offer(run.path(root))
    elif run is not None:
        latest = task.status if task and task.run == run else None
        if task and latest is Status.FAILED:
            show.messages(task.error, "error", "cloud_off")
        stopped = latest is Status.STOPPED
        st.button(
            "Continue the download" if stopped else "Download this run",
            icon=":material/download:", key="data_download", on_click=_start,
            args=(workspace, run, root), help="From the publisher, with its checksum where known.",
        )  # fmt: skip


def _title(run: Run, is_there: bool) -> str:
    return f"{run.key} · {'on this server' if is_there else 'to be downloaded'}"


def _start(workspace: Workspace, run: Run, root: Path) -> None:
    base = os.environ.get(MIRROR_VARIABLE) or PUBLISHED_AT
    download_queue().submit(DownloadTask(workspace.id, run, root, base))


def _watch(task: DownloadTask) -> None:
    """The bar, again and again, and the button that stops it."""

    def look() -> None:
        if not task.is_active:
            st.rerun()
        now, waits = task.latest, task.status is Status.QUEUED
        if waits or now is None:
            said = "Waiting: another download is running." if waits else "Connecting …"
        else:
            size = f" of {now.size / 1e6:.1f}" if now.size else ""
            said = f"{task.run.file}: {now.received / 1e6:.1f}{size} MB"
        st.progress(task.share, said)

    st.fragment(look, run_every=POLL)()
    stop_button(task, "Stop the download", "data_download_stop")
