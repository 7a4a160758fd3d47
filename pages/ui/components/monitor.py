"""A task as it runs: one fragment polls it, shows where it stands, and draws what is known."""

from collections.abc import Callable
from typing import Any

import streamlit as st

from accpinn.tasks import Status, Task
from pages.ui.components import show
from pages.ui.session.resources import task_queue

INTERVALS = "intervals"
"""The phase in which the point is known and its intervals are computed."""
POLL = 1.0
"""Seconds between two looks; each draws the live charts anew, which keeps a slow computer busy."""


def monitor(
    task: Task[Any],
    draw: Callable[[bool], object] = lambda polled: None,
    told: Callable[[Any], str] | None = None,
    is_stale: Callable[[], bool] = lambda: False,
) -> None:
    """Show where a task stands, and below it what is known, again and again while it is active.

    When it begins and ends, and when the page ``is_stale``, the whole page is drawn anew. The
    argument of ``draw`` is whether the task is polled: fragments that poll must not be nested, so
    it then calls no other. ``told`` says how far a task is that tells it in its own terms.
    """
    began = task.status  # read first: a task that ends in between is drawn once more
    active = task.is_active

    def look() -> None:
        if active and (task.status is not began or is_stale()):  # the rest of the page says so, too
            st.rerun()
        show_status(task, told)
        draw(active)

    if active:
        st.fragment(look, run_every=POLL)()
    else:
        look()


def stop_button(task: Task[Any], label: str, key: str) -> None:
    """The button that stops a task, whose results so far are kept."""
    st.button(
        label, icon=":material/stop:", key=key, disabled=task.is_stopping,
        on_click=task.stop,
    )  # fmt: skip


def show_status(task: Task[Any], told: Callable[[Any], str] | None = None) -> None:
    """One line, and a bar while it runs; see `monitor`."""
    status, done, planned = task.status, len(task.results), len(task.names)
    stopping = "Stopping … " if task.is_stopping else ""
    if status is Status.QUEUED and told:
        st.progress(0.0, f"{stopping}Waiting: another {task.kind} is running.")
    elif status is Status.QUEUED:
        show_waiting(task)
    elif status is Status.RUNNING:
        said = told(task.latest) if told and task.latest else " · ".join(progress_parts(task))
        st.progress(task.share, stopping + said)
    elif status is Status.FAILED:
        show.messages(task.error, "error")
    elif status is Status.STOPPED and planned > 1:
        kept = f"{done} of {planned} results are kept" if done else "no result is there yet"
        show.messages(f"Stopped: {kept}.", icon="stop_circle")
    elif status is Status.STOPPED and not done:
        show.messages(task.error or "Stopped before it began.", icon="stop_circle")


def progress_parts(task: Task[Any]) -> list[str]:
    """What runs, how far its phase is, how fast, and how long that still takes."""
    now, left = task.progress, task.time_left
    duration = show.format_duration(left) if left else ""
    if len(task.names) > 1:
        parts = [f"{task.current} …", f"{len(task.results)} of {len(task.names)} done"]
        return parts + ([f"about {duration} left"] if duration else [])
    if now is None:
        return ["Getting ready …"]
    unit = "window" if now.phase == INTERVALS else "iteration"
    parts = [f"{now.phase}: {unit} {now.iteration:,} of {now.iterations:,}"]
    if task.rate and unit == "iteration":
        parts.append(f"{task.rate:,.0f} iterations/s")
    return parts + ([f"about {duration} left"] if duration else [])


def show_waiting(task: Task[Any]) -> None:
    """Which tasks are ahead of a queued one, for how long, and how to stop one's own."""
    ahead, seconds = task_queue().ahead_of(task), task_queue().wait_for(task)
    if not ahead:
        show.messages("Starting …", icon="hourglass_top")
        return
    earlier = next((other for other in ahead if other.owner == task.owner), None)
    if earlier is None:
        count = len(ahead)
        who = f"{count} tasks of others are ahead of yours" if count > 1 else (
            "Another task is running; yours is next"
        )  # fmt: skip
        when = f"starts in about {show.format_duration(seconds)}" if seconds else "starts by itself"
        show.messages(f"{who} and {when}.", icon="hourglass_top")
        return
    kept = "can be continued later" if earlier.analysis else "keeps its results so far"
    show.messages(
        f"{own_task_line(earlier, seconds)} The {task.kind} then starts by itself. To have it"
        f" sooner, stop the {earlier.kind}; it {kept}.",
        icon="hourglass_top",
    )
    stop_button(earlier, f"Stop the {earlier.kind}", f"monitor_stop_{earlier.kind}")


def own_task_line(earlier: Task[Any], seconds: float | None) -> str:
    """Which of the user's own tasks comes first, and about how long it takes."""
    takes = f", for about {show.format_duration(seconds)}" if seconds else ""
    return f"Your own {earlier.kind} comes first{takes}."
