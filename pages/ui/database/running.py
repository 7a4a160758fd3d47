"""The batch that fills a study: starting, watching, stopping and continuing it."""

import math
import os
import time
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import streamlit as st

from accpinn.errors import ConfigError
from accpinn.methods.registry import VARIANTS, recommended_method
from accpinn.model.cthp import Case
from accpinn.model.registry import BEST, TITLES
from accpinn.recordings.containers import LIMIT_BYTES
from accpinn.results.database import counted, estimate_line, progress_line, summary_line
from accpinn.segment.cut import DURATION
from accpinn.study.batch import BatchProgress
from accpinn.study.dropped import Dropped, take
from accpinn.study.plan import BatchEstimate, estimate_batch, files_of
from accpinn.study.studies import DROPPED, Request, study_path
from accpinn.tasks import Status, Task
from accpinn.tasks.batches import batch_task
from pages.ui.components import frame, show
from pages.ui.components.monitor import monitor, stop_button
from pages.ui.components.show import escape_markdown, format_duration, kept, select
from pages.ui.database import study_folders
from pages.ui.session.resources import (
    batch_queue,
    folders,
    recordings_folder,
    title_of_variant,
)
from pages.ui.session.workspace import Workspace

REDRAWN = 15.0
"""Seconds after which the rows found meanwhile are shown."""
WINDOWS = {60.0: "60 s", 150.0: "150 s", DURATION: f"{DURATION:g} s", 600.0: "600 s",
           math.inf: "whole stretches"}  # fmt: skip
ALL = "all recordings"
KEPT_CHOICES = ("database_by", "database_tabs")
"""Choices among those of this page that hold for another study, too."""
DEFAULT_NAME = "My study"
UPLOAD = "database_upload"
"""The entry in Streamlit's session state with the files that were dropped."""


def _task(workspace: Workspace, study: str) -> Task[BatchProgress] | None:
    if study == study_folders.SUPPLIED:
        return None
    with suppress(ConfigError):  # no name of a study
        return batch_queue().of(
            study_folders.task_owner(study_folders.path_of(workspace.id, study)), "batch"
        )
    return None


def is_active(workspace: Workspace, study: str) -> bool:
    """Whether the batch of a study waits or runs."""
    task = _task(workspace, study)
    return task is not None and task.is_active


def _start(workspace: Workspace, study: str, request: Request) -> None:
    task = _task(workspace, study)
    if study_folders.is_changed_by(study) and (task is None or not task.is_active):
        path = study_folders.path_of(workspace.id, study)
        task = batch_task(study_folders.task_owner(path), path, request)
        batch_queue().submit(task, workspace.owner or workspace.key)


# Watching


def show_batch(workspace: Workspace, study: str, request: Request | None) -> None:
    """The progress or outcome of the study's batch, with buttons to stop or continue it."""
    task, is_own = _task(workspace, study), study_folders.is_changed_by(study)
    if task is not None and task.is_active:
        bar, button = st.columns((5, 1), vertical_alignment="center")
        with bar:
            _watch(task)
        if is_own:
            with button:
                stop_button(task, "Stop", "database_stop")
        return
    show_refusal(workspace, study)
    if task is not None and task.status is not Status.FAILED and task.latest:
        outcome = summary_line(task.latest)
    elif request is not None and not request.is_finished:
        outcome = "The batch of this study did not come to its end; what it found is kept."
    else:
        return
    finished = request is not None and request.is_finished
    line, button = st.columns((5, 1), vertical_alignment="center")
    icon = "check_circle" if finished else "stop_circle"
    line.markdown(f":material/{icon}: {escape_markdown(outcome)}")
    at_hand = request is not None and _is_at_hand(
        request, study_folders.path_of(workspace.id, study)
    )
    if request is not None and not finished and is_own and at_hand:
        button.button(
            "Continue", icon=":material/play_arrow:", type="primary", width="stretch",
            key="database_continue", on_click=_start, args=(workspace, study, request),
            help="Goes on where it was: what is known is not computed again.",
        )  # fmt: skip


def show_refusal(workspace: Workspace, study: str) -> bool:
    """Why the last batch of a study failed, and whether it did."""
    task = _task(workspace, study)
    if task is None or task.status is not Status.FAILED:
        return False
    show.messages(task.error, "error")
    return True


def _is_at_hand(request: Request, study: Path) -> bool:
    """Whether all recordings lie in the server's folder, or were dropped for the study."""
    roots = recordings_folder(), (study / DROPPED).resolve()
    paths = [Path(source).resolve() for source in request.sources]
    return all(path.exists() and any(map(path.is_relative_to, roots)) for path in paths)


def _watch(task: Task[BatchProgress]) -> None:
    """The bar, again and again; now and then the whole page, with the rows found meanwhile."""
    drawn, rows = time.monotonic(), task.latest.rows if task.latest else 0

    def has_more() -> bool:
        latest = task.latest.rows if task.latest else 0
        return latest > rows and time.monotonic() - drawn > REDRAWN

    def describe(now: BatchProgress) -> str:
        left = f" · about {format_duration(now.seconds_left)} left" if now.seconds_left else ""
        return progress_line(now) + left

    monitor(task, describe=describe, is_stale=has_more)


# Starting


@st.cache_data(max_entries=64, show_spinner="Estimating the time …")
def _estimate(source: str, window: float, _files: int, changed: int) -> BatchEstimate:
    """Kept until a file changes or there is another."""
    return estimate_batch(Path(source), window)


def _estimated(path: Path, window: float) -> BatchEstimate:
    stats = [file.stat() for file in files_of(path)]
    changed = sum(status.st_mtime_ns for status in stats)
    return _estimate(str(path), window, len(stats), changed)


def show_form(workspace: Workspace) -> None:
    """The form of a new batch: recordings, methods, expected time, and the start button."""
    _show_drop_zone(workspace)
    root, dropped = recordings_folder(), workspace.dropped.files
    below = folders(root)
    if not (below or dropped):
        st.caption("Or download published runs into the server's folder of recordings.")
        frame.link(frame.DATA, "Go to Data", workspace)
        return
    most = os.cpu_count() or 1
    source_column, name_column = st.columns((1.4, 1), vertical_alignment="bottom")
    if dropped:
        source = ""
        source_column.caption(
            f"{counted(len(dropped), 'file')} dropped, {workspace.dropped.nbytes / 1e6:.1f} MB"
        )
        if below:
            source_column.button(
                "Take the server's folder instead", key="database_undrop", type="tertiary",
                on_click=setattr, args=(workspace, "dropped", Dropped()),
            )  # fmt: skip
    else:
        source = select(
            "Recordings", {name: ALL if name == "." else name for name in below}, below[0],
            "database_source", workspace, place=source_column,
            help="A folder on the server; all CSV files in it and below.",
        )  # fmt: skip
    taken = study_folders.listed_studies(workspace.id)
    defaults = (DEFAULT_NAME, *(f"{DEFAULT_NAME} {k}" for k in range(2, len(taken) + 3)))
    free = next(name for name in defaults if name not in taken)
    name = name_column.text_input(
        "Name of the study", max_chars=60,
        **kept(workspace, "database_name", free),
        help="A study of the same name is continued: what is known there is not computed again.",
    )  # fmt: skip
    methods = st.multiselect(
        "Methods", list(VARIANTS), format_func=title_of_variant,
        **kept(workspace, "database_methods", [recommended_method()], default=""),
    )  # fmt: skip
    columns = st.columns((1.2, 1.6, 1, 1), vertical_alignment="bottom")
    window = select(
        "Windows", WINDOWS, DURATION, "database_window", workspace, place=columns[0],
        help="Longest window; complete stretches in car-following under ACC are cut into these.",
    )  # fmt: skip
    model = select(
        "Model", TITLES, BEST, "database_model_of", workspace, place=columns[1],
        help="Methods estimate it where they can, and else their usual one; the table of groups"
        " has its parameters.",
    )  # fmt: skip
    cases: dict[Case, str] = {"II": "Case II", "I": "Case I"}
    case = select(
        "Case", cases, "II", "database_case", workspace, place=columns[2],
        help="I: one parameter set for all followers of a window; II: one for each.",
    )  # fmt: skip
    workers = columns[3].number_input(
        "Workers", min_value=1, max_value=most, step=1,
        **kept(workspace, "database_workers", most),
        help=f"Processes at a time; this server has {most} processors.",
    )  # fmt: skip
    estimate = None
    if not dropped:
        estimate = show.attempt(lambda: _estimated(root / source, window))
    if estimate and methods:
        duration = format_duration(estimate.seconds(methods, int(workers)))
        st.caption(f"{estimate_line(estimate)}; about {duration} in all.")

    def folder() -> Path:
        study_path(name)  # refuses another user's
        return study_folders.path_of(workspace.id, name)

    is_allowed = bool(name) and show.attempt(folder) is not None
    request = Request(
        sources=() if dropped else (str(root / source),),
        methods=tuple(methods),
        window=None if math.isinf(window) else window,
        case=case,
        model=model,
        workers=int(workers),
    )
    st.button(
        "Start the batch", type="primary", icon=":material/play_arrow:", key="database_start",
        disabled=not ((estimate or dropped) and methods and is_allowed),
        on_click=_start_from, args=(workspace, name, request),
    )  # fmt: skip


def _show_drop_zone(workspace: Workspace) -> None:
    """The field for files of the user's own, and a sentence for each that is refused."""

    def arrived() -> None:
        given = st.session_state[UPLOAD] or ()
        workspace.dropped = take((file.name, file.getvalue()) for file in given)

    st.file_uploader(
        "Drop recordings here, several at once or as a zip archive", key=UPLOAD,
        accept_multiple_files=True, on_change=arrived,
        help=f"Up to {LIMIT_BYTES / 1e6:.0f} MB together. They lie in the study's folder on the"
        " server until its batch has ended, and are then removed; the study keeps figures alone.",
    )  # fmt: skip
    show.messages(workspace.dropped.refused, "warning")


def _start_from(workspace: Workspace, name: str, request: Request) -> None:
    if workspace.dropped.files and not is_active(workspace, name):
        study_folders.make_room(workspace.id, name, workspace.dropped.nbytes)
        paths = workspace.dropped.save(study_folders.path_of(workspace.id, name))
        request, workspace.dropped = replace(request, sources=paths), Dropped()
    _start(workspace, name, request)
    workspace.choices = {
        key: value for key, value in workspace.choices.items()
        if key in KEPT_CHOICES or not key.startswith("database_")
    } | {"database_study": name}  # fmt: skip
    st.session_state["database_new"] = False
