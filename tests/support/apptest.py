"""Pages run without a browser: opening them, and what is written on them."""

import base64
import json
import re
import time
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from streamlit.testing.v1 import AppTest, local_script_runner

from accpinn import Case, Result, Table
from accpinn.recordings import Recording, Window, facts_of, files
from accpinn.study.run import run
from accpinn.tasks import Task
from pages.ui.session import sessions
from pages.ui.session.resources import store
from pages.ui.session.workspace import Workspace
from tests.support.command import PLATOON, ROOT

# A page's script is waited for as a thread is, without a look every millisecond.
local_script_runner.require_widgets_deltas = lambda runner, timeout: runner.join()

PAGES = {"Home": "app.py"} | {
    path.stem[2:]: f"pages/{path.name}" for path in sorted((ROOT / "pages").glob("[0-9]*.py"))
}
"""Their scripts by their titles."""
WIDGETS = (
    "button_group", "selectbox", "multiselect", "number_input", "text_input", "toggle", "checkbox",
    "slider", "select_slider",
)  # fmt: skip
"""What a value is chosen with."""
MINUTE = Window(0.0, 60.0)
WAIT = 120.0
"""Seconds a real training may take on a busy machine; it needs about one."""


def read(written: str) -> str:
    """Text as a person reads it: without the marks that make foreign text literal."""
    return (
        written.replace("\\", "").replace("\N{NO-BREAK SPACE}", " ").replace("\N{WORD JOINER}", "")
    )


class Page(AppTest):
    """A page of the app, and what a person does and reads on it."""

    def widget(self, key: str) -> Any:
        """The widget of that key, whatever kind it is, or the latest that stands in its place."""
        own = re.compile(rf"{re.escape(key)}(_\d+)?")  # see pages.ui.components.show.bound
        (found,) = (w for kind in WIDGETS for w in self.get(kind) if w.key and own.fullmatch(w.key))
        return found

    def choose(self, key: str, value: object) -> "Page":
        """Set the widget of that key, and run."""
        self.widget(key).set_value(value)
        return self.sound()

    def press(self, name: str) -> "Page":
        """Click on the button of that key or label, and run."""
        next(button for button in self.button if name in (button.key, button.label)).click()
        return self.sound()

    def open_tab(self, key: str, title: str) -> "Page":
        """Open a tab of the row with that key, and run."""
        self.workspace().choices[key] = title
        return self.sound()

    def upload(self, name: str, content: bytes) -> "Page":
        """Give a file to the field for recordings, and run."""
        self.file_uploader(key="data_upload").upload(name, content, "text/csv")
        return self.sound()

    def sound(self) -> "Page":
        """Run, without an exception."""
        self.run()
        assert not self.exception, self.exception
        return self

    def workspace(self) -> Workspace:
        """The session that the page's address names."""
        name = self.query_params["session"]
        found = sessions.workspaces().find(name if isinstance(name, str) else name[0])
        assert found is not None
        return found

    def texts(self) -> str:
        """All that is written on it but its tables."""
        kinds = ("title", "subheader", "markdown", "caption", "text")
        boxes = ("info", "warning", "error", "success")
        written = [element.value for kind in (*kinds, *boxes) for element in self.get(kind)]
        return "\n".join([*written, *(element.proto.body for element in self.get("html"))])

    def plain(self) -> str:
        """The same as a person reads it."""
        return read(self.texts())

    @property
    def buttons(self) -> set[str]:
        """The keys of its buttons."""
        return {str(button.key) for button in self.button}

    def boxes(self, kind: str) -> list[str]:
        """The sentences in its boxes of one kind, as "warning"."""
        return [read(box.value) for box in self.get(kind)]

    def everything(self) -> str:
        """All that it shows, tables and figures included."""
        return " ".join(str(element.proto) for element in self.main if hasattr(element, "proto"))

    def shows(self, table: Table, rows: int = 1) -> bool:
        """Whether all cells of a table's first rows are written on it."""
        written = self.texts()
        cells = (pair for row in table.rows[:rows] for pair in zip(table.columns, row, strict=True))
        return all(str(column.html(cell)) in written for column, cell in cells)

    def figures(self) -> list[dict[str, Any]]:
        """The charts as plotly has them."""
        return [json.loads(chart.proto.spec) for chart in self.get("plotly_chart")]


def numbers(values: Any) -> Any:
    """A chart's numbers, which plotly may have packed."""
    if isinstance(values, dict):
        return np.frombuffer(base64.b64decode(values["bdata"]), values["dtype"])
    return values


def open_page(
    title: str, found: Workspace | None = None, user: dict[str, Any] | None = None, **address: str
) -> Page:
    """A page as a direct link opens it: the first page has not run before.

    Args:
        title: of the page.
        found: the session that the address names.
        user: who is signed in, on a server that asks who one is.
        address: what else the address says.
    """
    page = Page(ROOT / PAGES["Home"], default_timeout=60)
    if user:
        page.user = user
    if title != "Home":
        page.switch_page(PAGES[title])
    if found:
        address["session"] = found.id
    for name, value in address.items():
        page.query_params[name] = value
    return page.sound()


def until(holds: Callable[[], object]) -> None:
    """Wait for it."""
    end = time.monotonic() + WAIT
    while not holds():
        assert time.monotonic() < end
        time.sleep(0.01)


def stop_tasks(session: Workspace) -> None:
    """As their buttons do, and wait for them."""
    for task in session.tasks:
        task.stop()
    assert all(task.wait(WAIT) for task in session.tasks)


@cache
def sample_recording(path: Path = PLATOON) -> Recording:
    """A sample, by default the first, read once for all tests."""
    return files.read(path)


def with_sample() -> Workspace:
    """A session with the first sample open."""
    session = sessions.workspaces().new()
    session.open(sample_recording())
    return session


def with_pair() -> Workspace:
    """A session with a minute of its first two vehicles, on which a training is soon done."""
    found = with_sample()
    found.choose(window=MINUTE, vehicles=(1, 2))
    return found


def with_example() -> Workspace:
    """A session that shows a published example."""
    found = sessions.workspaces().new()
    found.choose_source("published")
    return found


def fitted(window: Window = MINUTE, **changes: Any) -> Workspace:
    """A session whose training is done; see `train_at_once`."""
    session = with_sample()
    session.choose(window=window, vehicles=(2, 3, 4, 5))
    train_at_once(session, **changes)
    return session


_results = dict[str, Result]()
"""By the keys of their analyses, with what has been derived from them."""


def train_at_once(session: Workspace, case: Case = "II", **changes: Any) -> Result:
    """Give a session the finished training that it asks for.

    Args:
        session: with a window.
        case: "I" or "II".
        changes: of the estimate.
    """
    session.selection = replace(session.selection, case=case)
    asked = session.analysis()
    assert asked
    if asked.key not in _results:
        result = run(asked, session.recording, segments=session.segments)
        _results[asked.key] = replace(result, facts=facts_of(session.recording))
    result = _results[asked.key]
    if result.recording is not session.recording:
        result = result.on(session.segments, session.recording)
        result = replace(result, facts=facts_of(session.recording))
    if changes:
        result = replace(result, estimate=replace(result.estimate, **changes))
    task = Task(session.id, "training", lambda _: iter(()), analysis=asked)
    task.finish(result)
    session.restored, session.training = None, task
    if result.is_finished:
        for owner in {session.key, session.owner or session.key}:
            store().record_shown(owner, result)
    return result
