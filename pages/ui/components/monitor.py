"""A running task: one fragment polls it, shows its progress, and draws interim results."""

from collections.abc import Callable
from typing import Any

import streamlit as st

from accpinn.findings import capital
from accpinn.methods.forecast import INTERVALS, SETTLED, VARIATION
from accpinn.tasks import Status, Task
from pages.ui.components import show
from pages.ui.session.resources import queue_of
from pages.ui.session.users import sees_all

UNITS = {INTERVALS: "window", VARIATION: "follower"}
"""Units counted in phases that do not count iterations."""
SOON = 0.3
"""Seconds until the first look at a task that is about to start."""
POLL = 1.0
"""Seconds between two looks; each draws the live charts anew, which keeps a slow computer busy."""


def monitor(
    task: Task[Any],
    draw: Callable[[bool], object] = lambda polled: None,
    describe: Callable[[Any], str] | None = None,
    is_stale: Callable[[], bool] = lambda: False,
) -> None:
    """Show a task's progress and below it interim results, repeatedly while it is active.

    When it begins and ends, and when the page ``is_stale``, the whole page is drawn anew. The
    argument of ``draw`` is whether the task is polled: fragments that poll must not be nested, so
    it then calls no other. ``describe`` says how far a task is that tells it in its own terms.
    """
    began = task.status  # read first: a task that ends in between is drawn once more
    active = task.is_active

    def look() -> None:
        if active and (task.status is not began or is_stale()):  # the rest of the page says so, too
            st.rerun()
        show_status(task, describe)
        draw(active)

    if active:
        is_next = began is Status.QUEUED and not queue_of(task).ahead_of(task)
        st.fragment(look, run_every=SOON if is_next else POLL)()
    else:
        look()


def stop_button(task: Task[Any], label: str, key: str) -> None:
    """A button that stops a task; its results so far are kept."""
    st.button(
        label, icon=":material/stop:", key=key, disabled=task.is_stopping,
        on_click=task.stop,
    )  # fmt: skip


def show_status(task: Task[Any], describe: Callable[[Any], str] | None = None) -> None:
    """One line, and a bar while it runs; see `monitor`."""
    status, done, planned = task.status, len(task.results), len(task.names)
    stopping = "Stopping … " if task.is_stopping else ""
    if status is Status.QUEUED and describe:
        st.progress(0.0, stopping + waiting_line(task))
    elif status is Status.QUEUED:
        show_waiting(task)
    elif status is Status.RUNNING:
        progress = (
            describe(task.latest) if describe and task.latest else " · ".join(progress_parts(task))
        )
        st.progress(task.share, stopping + progress)
    elif status is Status.FAILED:
        show.messages(task.error, "error")
    elif status is Status.STOPPED and task.error and (done or describe):
        show.messages(task.error, "warning", "stop_circle")
    elif status is Status.STOPPED and planned > 1:
        outcome = f"{done} of {planned} results are kept" if done else "no result is there yet"
        show.messages(f"Stopped: {outcome}.", icon="stop_circle")
    elif status is Status.STOPPED and not done:
        show.messages(task.error or "Stopped before it began.", icon="stop_circle")


def progress_parts(task: Task[Any]) -> list[str]:
    """Name and progress of the present phase, and the time left."""
    now, left = task.progress, task.time_left
    duration = show.format_duration(left) if left else ""
    if len(task.names) > 1:
        parts = [f"{task.current} …", f"{len(task.results)} of {len(task.names)} done"]
        return parts + ([f"about {duration} left"] if duration else [])
    if now is None:
        return ["Getting ready …"]
    parts = [capital(now.phase)]
    if now.phase in UNITS:
        at = min(now.iteration + 1, now.iterations)
        parts.append(f"{UNITS[now.phase]} {at} of {now.iterations}")
    elif now.phase not in SETTLED:
        parts.append(f"iteration {now.iteration:,}")
    return parts + ([f"about {duration} left"] if duration else [])


def show_waiting(task: Task[Any]) -> None:
    """Which tasks are ahead of a queued one, for how long, and how to stop one's own."""
    ahead = queue_of(task).ahead_of(task)
    if not ahead:
        show.messages("Starting …", icon="hourglass_top")
        return
    earlier = next((other for other in ahead if other.owner == task.owner), None)
    show.messages(waiting_line(task), icon="hourglass_top")
    if earlier:
        stop_button(earlier, f"Stop the {earlier.kind}", f"monitor_stop_{earlier.kind}")


def waiting_line(task: Task[Any]) -> str:
    """Which tasks are ahead of a queued one, the user's own and others, and when it starts."""
    queue = queue_of(task)
    ahead, seconds = queue.ahead_of(task), queue.wait_for(task)
    earlier_of_user = [other for other in ahead if other.owner == task.owner]
    count = len(ahead) - len(earlier_of_user)
    when = f"in about {show.format_duration(seconds)}" if seconds else "by itself"
    whose = "of your other sessions" if sees_all() else "of other users"
    if not earlier_of_user:
        many = f"{count} tasks {whose} come first." if count > 1 else f"1 task {whose} comes first."
        return f"Waiting: {many} Yours then starts {when}."
    (earlier, *_), others = earlier_of_user, f" So do {count} tasks {whose}." if count > 1 else ""
    others = f" So does 1 task {whose}." if count == 1 else others
    outcome = "can be continued later" if earlier.analysis else "keeps its results so far"
    return (
        f"{own_task_line(earlier, None if count else seconds)}{others} The {task.kind} then starts"
        f" {'by itself' if not count else when}. To have it sooner, stop the {earlier.kind}; it"
        f" {outcome}."
    )


def own_task_line(earlier: Task[Any], seconds: float | None) -> str:
    """Which of the user's own tasks comes first, and about how long it takes."""
    takes = f", for about {show.format_duration(seconds)}" if seconds else ""
    return f"Your own {earlier.kind} comes first{takes}."
