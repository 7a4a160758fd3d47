"""A comparison or a series of starts as it runs: one fragment looks at it twice a second."""

from collections.abc import Callable
from typing import Any

import streamlit as st

from accpinn.results.tables.names import TITLES
from accpinn.tasks.series import Series
from accpinn.tasks.task import Status
from pages.ui.compare.waiting import show_waiting
from pages.ui.components.monitor import POLL
from pages.ui.components.text import escape_markdown, format_duration
from pages.ui.session.workspace import Workspace


def watch(workspace: Workspace, series: Series[Any], show: Callable[[], None]) -> None:
    """Its status and what is known so far, again and again; at its end the whole page."""
    if not series.is_active:
        show_status(workspace, series)
        show()
        return

    def look() -> None:
        if not series.is_active:
            st.rerun()
        show_status(workspace, series)
        show()

    st.fragment(look, run_every=POLL)()


def show_status(workspace: Workspace, series: Series[Any]) -> None:
    """One line, and a bar while it runs."""
    done, whole = len(series.results), len(series.names)
    if series.status is Status.QUEUED:
        show_waiting(workspace, series, series.what)
    elif series.status is Status.RUNNING:
        name = TITLES.get(series.current, series.current)
        left = f" · about {format_duration(series.time_left)} left" if series.time_left else ""
        said = "Stopping" if series.is_stopping else name
        st.progress(series.share, f"{said} … · {done} of {whole} done{left}")
    elif series.status is Status.FAILED:
        st.error(escape_markdown(series.error), icon=":material/error:")
    elif series.status is Status.STOPPED:
        kept = f"the {done} of {whole} that had ended are kept" if done else "none had ended yet"
        st.info(f"Stopped: {kept}.", icon=":material/stop_circle:")
