"""A training as it runs: one fragment looks at the job twice a second, and draws."""

import streamlit as st

from accpinn.model.cthp import Parameters
from accpinn.results.figures import training
from accpinn.tasks.job import Job
from accpinn.tasks.task import Status, Task
from pages.ui.components.charts import show_chart
from pages.ui.components.frame import vehicle_key
from pages.ui.components.text import escape_markdown, format_duration
from pages.ui.session.resources import task_queue

POLL = 0.5
"""Seconds between two looks."""
FIRST_DRAWING = 1.0
"""Seconds of training before the first curves: a short one would be slowed by drawing it."""


def watch(job: Job, truth: Parameters | None) -> None:
    """Show the job; while it is active, again and again, and once it has ended, the whole page."""
    active = job.is_active

    def look() -> None:
        if active and not job.is_active:
            st.rerun()
        show_status(job)
        if not active or _long_enough(job):
            show_course(job, truth)

    st.fragment(look, run_every=POLL if active else None)()


def _long_enough(job: Job) -> bool:
    history = job.history()
    return history is not None and history.seconds[-1] > FIRST_DRAWING


def show_status(job: Job) -> None:
    """One line, and a bar: where it stands, how fast, how long still."""
    status, now = job.status, job.progress
    if status is Status.QUEUED:
        st.info(waiting_line(job), icon=":material/hourglass_top:")
    elif status is Status.RUNNING and now is None:
        st.progress(0.0, "Getting ready …")
    elif status is Status.RUNNING and now:
        share = min(1.0, now.iteration / max(1, now.iterations))
        parts = [f"{now.phase}: iteration {now.iteration:,} of {now.iterations:,}"]
        parts += [f"{job.rate:,.0f} iterations/s"] if job.rate else []
        parts += [f"{format_duration(job.time_left)} left at most"] if job.time_left else []
        stopping = "Stopping … " if job.is_stopping else ""
        st.progress(share, stopping + " · ".join(parts))
    elif status is Status.FAILED:
        st.error(escape_markdown(job.error), icon=":material/error:")
    elif status is Status.STOPPED and job.fit is None:
        st.info("Stopped before it began.", icon=":material/stop_circle:")


def waiting_line(job: Task) -> str:
    """Who is ahead, and for how long."""
    ahead, seconds = task_queue().ahead_of(job), task_queue().wait_for(job)
    if len(ahead) <= 1:
        who = "Another estimation runs; yours is next"
    else:
        who = f"{len(ahead)} estimations are ahead of yours"
    when = f"starts in about {format_duration(seconds)}" if seconds else "starts by itself"
    return f"{who} and {when}."


def show_course(job: Job, truth: Parameters | None) -> None:
    """Loss terms and parameters over iterations."""
    history, segment = job.history(), job.request.segment
    if history is None:
        return
    vehicle_key(segment.info, with_truth=bool(truth))
    loss, *parameters = st.columns(4)
    with loss:
        show_chart(training.loss_history(history), "train_loss")
    for which, column in enumerate(parameters):
        with column:
            figure = training.parameter_history(history, which, segment.info, truth)
            show_chart(figure, f"train_parameter_{which}")
    st.caption(
        "Training lowers the loss Ψ, the sum of its terms: Ψ_D, how far the network's curves are"
        " from the data, and Ψ_F, how far they are from obeying the law."
    )
