"""The batch that fills a study: starting, watching, stopping and continuing it."""

import math
import os
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import streamlit as st

from accpinn.errors import AccpinnError
from accpinn.methods.maximum_likelihood import KEY
from accpinn.methods.registry import METHODS
from accpinn.results.messages.database import estimate_line, progress_line, summary_line
from accpinn.segment.cut import DURATION
from accpinn.study.batch import files_of
from accpinn.study.estimate import BatchEstimate, estimate_batch
from accpinn.study.folders import Request, recall_request
from accpinn.study.process import BatchSettings, run_batch
from accpinn.tasks.batches import StudyTask
from accpinn.tasks.task import Status
from pages.ui.components import frame, show
from pages.ui.components.monitor import POLL, stop_button
from pages.ui.components.show import escape_markdown, format_duration
from pages.ui.components.widgets import bound, select
from pages.ui.database.selection import folder_of, known_studies
from pages.ui.session.choices import DatabaseChoice
from pages.ui.session.recordings import folders, recordings_folder
from pages.ui.session.resources import batch_queue
from pages.ui.session.workspace import Workspace

REDRAWN = 15.0
"""Seconds after which the rows found meanwhile are shown."""
WINDOWS = {60.0: "60 s", 150.0: "150 s", DURATION: f"{DURATION:g} s", 600.0: "600 s",
           math.inf: "whole stretches"}  # fmt: skip
DEFAULT_METHODS = (KEY, "least-squares")
ALL = "all recordings"
DEFAULT_NAME = "OpenACC"


def _task(study: str) -> StudyTask | None:
    task = batch_queue().of(study, "batch")
    return task if isinstance(task, StudyTask) else None


def _start(settings: BatchSettings, study: str) -> None:
    task = _task(study)
    if task is None or not task.is_active:
        batch_queue().submit(StudyTask(study, settings, run_batch))


# Watching


def show_batch(study: str) -> None:
    """The study's batch: how far it is, or how it ended, and what can be done about it."""
    task = _task(study)
    if task is not None and task.is_active:
        bar, button = st.columns((5, 1), vertical_alignment="center")
        with bar:
            _watch(task)
        with button:
            stop_button(task, "Stop", "database_stop")
        return
    request = recall_request(folder_of(study))
    if task is not None and task.status is Status.FAILED:
        show.messages(task.error, "error")
    finished = request is not None and request.finished
    if task is not None and task.summary is not None:
        said = summary_line(task.summary)
    elif request is not None and not finished:
        said = "The batch of this study did not come to its end; what it found is kept."
    else:
        return
    line, button = st.columns((5, 1), vertical_alignment="center")
    icon = "check_circle" if finished else "stop_circle"
    line.markdown(f":material/{icon}: {escape_markdown(said)}")
    settings = _continuable(request, study) if request is not None and not finished else None
    if settings is not None:
        with button:
            st.button(
                "Continue", icon=":material/play_arrow:", type="primary", width="stretch",
                key="database_continue", on_click=_start, args=(settings, study),
                help="Goes on where it was: what is known is not computed again.",
            )  # fmt: skip


def show_refusal(study: str) -> bool:
    """Why the batch of a study that is not there failed, and whether it did."""
    task = _task(study)
    if task is None or task.status is not Status.FAILED:
        return False
    show.messages(task.error, "error")
    return True


def _continuable(request: Request, study: str) -> BatchSettings | None:
    """What goes on; None where the recordings lie outside the server's folder."""
    root, settings = recordings_folder(), request.settings
    if all(Path(source).resolve().is_relative_to(root) for source in settings.sources):
        return replace(settings, study=str(folder_of(study)))
    return None


def _watch(task: StudyTask) -> None:
    """The bar, again and again; now and then the whole page, with the rows found meanwhile."""
    drawn, rows = time.monotonic(), task.latest.rows if task.latest else 0

    def look() -> None:
        now = task.latest
        found = now.rows if now else 0
        if not task.is_active or (found > rows and time.monotonic() - drawn > REDRAWN):
            st.rerun()
        st.progress(task.share, _line_of(task))

    st.fragment(look, run_every=POLL)()


def _line_of(task: StudyTask) -> str:
    if task.status is Status.QUEUED:
        return "Waiting: another batch is running."
    if task.latest is None:
        return "Getting ready …"
    parts = ["Stopping …"] if task.is_stopping else []
    parts.append(progress_line(task.latest))
    if task.time_left:
        parts.append(f"about {format_duration(task.time_left)} left")
    return " · ".join(parts)


# Starting


@st.cache_data(max_entries=64, show_spinner="Estimating the time …")
def _estimate(source: str, window: float, _files: int, changed: int) -> BatchEstimate:
    """Kept until a file changes or there is another."""
    return estimate_batch(Path(source), window)


def show_form(workspace: Workspace, choice: DatabaseChoice) -> None:
    """What a new batch is to do, how long that takes, and the button that starts it."""
    root = recordings_folder()
    below = folders(root)
    if not below:
        show.messages(
            "The server's folder of recordings is empty. Download published runs on page Data, or"
            " put files there; ACCPINN_RECORDINGS names the folder."
        )
        frame.link(frame.DATA, "Go to Data", workspace)
        return
    form = _Form(choice)
    sources = {one: ALL if one == "." else one for one in below}
    source_column, name_column = st.columns((1.4, 1), vertical_alignment="bottom")
    source = form.get("source", below[0], sources)
    select(
        "Recordings", sources, source, "database_source", form.setter("source"),
        place=source_column, help="A folder on the server; all CSV files in it and below.",
    )  # fmt: skip
    name = name_column.text_input(
        "Name of the study", max_chars=60,
        **bound("database_name", form.get("name", _free_name()), form.setter("name")),
        help="A study of the same name is continued: what is known there is not computed again.",
    )  # fmt: skip
    methods = [key for key in form.get("methods", DEFAULT_METHODS) if key in METHODS]
    st.multiselect(
        "Methods", list(METHODS), format_func=lambda key: METHODS[key].title,
        **bound("database_methods", methods, form.setter("methods"), default=""),
        help="Maximum likelihood takes part in the table of pooled vehicles.",
    )  # fmt: skip
    columns = st.columns((1.2, 1, 1), vertical_alignment="bottom")
    window = form.get("window", DURATION, WINDOWS)
    select(
        "Windows", WINDOWS, window, "database_window", form.setter("window"), place=columns[0],
        help="Longest window; complete stretches in car-following under ACC are cut into these.",
    )  # fmt: skip
    case = form.get("case", "II", ("I", "II"))
    select(
        "Case", {"II": "Case II", "I": "Case I"}, case, "database_case", form.setter("case"),
        place=columns[1],
        help="I: one parameter set for all followers of a window; II: one for each.",
    )  # fmt: skip
    most = os.cpu_count() or 1
    workers = columns[2].number_input(
        "Workers", min_value=1, max_value=most, step=1,
        **bound("database_workers", min(form.get("workers", most), most), form.setter("workers")),
        help=f"Processes at a time; this server has {most} processors.",
    )  # fmt: skip
    path = root if source == "." else root / source
    found = show.attempt(lambda: _estimated(path, window))
    if found and methods:
        duration = format_duration(found.seconds(methods, int(workers)))
        st.caption(f"{estimate_line(found)}; about {duration} in all.")
    ready = bool(found and methods and name and _is_allowed(name))
    st.button(
        "Start the batch", type="primary", icon=":material/play_arrow:", key="database_start",
        disabled=not ready, on_click=_start_from,
        args=(choice, str(path), name, tuple(methods), window, case, int(workers)),
    )  # fmt: skip


class _Form:
    """The choices in the form, as far as they differ from the defaults."""

    def __init__(self, choice: DatabaseChoice) -> None:
        self._kept = choice.form

    def get(self, name: str, default: Any, allowed: Any = None) -> Any:
        """The present choice; the default where it is none of those allowed."""
        value = self._kept.get(name, default)
        return value if allowed is None or value in allowed else default

    def setter(self, name: str) -> Any:
        """What keeps a choice of that name."""
        return lambda value: self._kept.update({name: value})


def _free_name() -> str:
    known = known_studies()
    names = (DEFAULT_NAME, *(f"{DEFAULT_NAME} {k}" for k in range(2, len(known) + 3)))
    return next(name for name in names if name not in known)


def _is_allowed(name: str) -> bool:
    """Whether a study may have that name; if not, why."""
    try:
        folder_of(name)
    except AccpinnError as fault:
        show.messages(str(fault), "error")
        return False
    return True


def _estimated(path: Path, window: float) -> BatchEstimate:
    stats = [one.stat() for one in files_of(path)]
    return _estimate(str(path), window, len(stats), sum(one.st_mtime_ns for one in stats))


def _start_from(
    choice: DatabaseChoice, source: str, name: str, methods: tuple[str, ...], window: float,
    case: Any, workers: int,
) -> None:  # fmt: skip
    settings = BatchSettings(
        sources=(source,),
        study=str(folder_of(name)),
        window=None if math.isinf(window) else window,
        methods=methods,
        case=case,
        workers=workers,
    )
    _start(settings, name)
    choice.set(study=name, filters={}, method="", row=None, form={})
    st.session_state["database_new"] = False
