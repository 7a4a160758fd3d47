"""What a comparison waits for, and the way to what of that is one's own."""

import streamlit as st

from accpinn.tasks.job import Job
from accpinn.tasks.series import Series
from accpinn.tasks.task import Task
from pages.ui.components import frame
from pages.ui.components.monitor import waiting_line
from pages.ui.components.text import format_duration
from pages.ui.session.resources import task_queue
from pages.ui.session.workspace import Workspace


def show_waiting(workspace: Workspace, task: Task, what: str) -> None:
    """What runs before a queued task of the session, and for how long; ``what`` names the task."""
    ahead = task_queue().ahead_of(task)
    own = next((one for one in ahead if one.owner == task.owner), None)
    if own is None:
        st.info(waiting_line(task), icon=":material/hourglass_top:")
        return
    kept = "can be continued later" if isinstance(own, Job) else "keeps what has ended"
    st.info(
        f"{own_line(own, task_queue().wait_for(task))} The {what} then starts by itself. To have it"
        f" sooner, stop what comes first; it {kept}.",
        icon=":material/hourglass_top:",
    )
    if isinstance(own, Job):
        frame.link(frame.TRAIN, "Go to Train to stop it", workspace, "arrow_forward")
    else:
        st.button(
            f"Stop the {_named(own)}",
            icon=":material/stop:",
            disabled=own.is_stopping,
            on_click=task_queue().stop,
            args=(own,),
        )


def show_busy(workspace: Workspace) -> None:
    """That a comparison asked for now would have to wait for the session's own training."""
    job = workspace.job
    if job and job.is_active:
        st.caption(f"{own_line(job, job.time_left)} The methods would come after it.")


def own_line(task: Task, seconds: float | None) -> str:
    """What of the user's own is ahead, and how long it takes at most."""
    long = f", for {format_duration(seconds)} at most" if seconds else ""
    return f"Your own {_named(task)} comes first{long}."


def _named(task: Task) -> str:
    if isinstance(task, Job):
        return f"training with the {task.request.config.preset} preset"
    return task.what if isinstance(task, Series) else "task"
