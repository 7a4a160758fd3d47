"""What all browsers share: the store of results, the library of snapshots, queues of tasks."""

from collections.abc import Callable
from functools import lru_cache
from typing import Any

import streamlit as st

from accpinn.recordings.recording import Recording
from accpinn.stability.report import stability_report
from accpinn.study.result import Result
from accpinn.study.store import Library, Store
from accpinn.tasks.queue import TaskQueue

KEPT = 64
"""Entries of each cache of what pages show: one for each of many users at a time. With fewer they
would take turns to drive out each other's, and every view would be computed anew."""
BY_CONTENT: dict[str | type, Callable[[Any], str]] = {Recording: lambda recording: recording.digest}
"""How a cache knows a recording: not by its file, which another mapping reads otherwise."""


report_of = lru_cache(maxsize=KEPT)(stability_report)
"""The stability report on (M,) parameters."""


@st.cache_resource(show_spinner=False)
def store() -> Store:
    """The server's one store of results, checkpoints and sessions."""
    return Store()


@st.cache_resource(show_spinner=False)
def library() -> Library:
    """The server's one library of snapshots."""
    return Library()


@st.cache_resource(max_entries=KEPT, show_spinner=False)
def opened(name: str) -> Result:
    """A snapshot of the library; its name is its content, so it never changes.

    Raises:
        SnapshotError: for an unknown name, or a file that is damaged or another's.
    """
    return library().read(name)


@st.cache_resource(show_spinner=False)
def task_queue() -> TaskQueue:
    """The server's queue of trainings and comparisons."""
    return TaskQueue(store=store())


@st.cache_resource(show_spinner=False)
def batch_queue() -> TaskQueue:
    """The queue of batches; they may take hours, which no training should wait for."""
    return TaskQueue(prepare=lambda: None)


@st.cache_resource(show_spinner=False)
def download_queue() -> TaskQueue:
    """The queue of downloads."""
    return TaskQueue(prepare=lambda: None)
