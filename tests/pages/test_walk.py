"""A random walk over every control of every page: no page may end in an exception."""

import random
from collections.abc import Iterator
from typing import Any

import pytest
from streamlit.proto.WidgetStates_pb2 import WidgetState

from accpinn.methods.registry import METHODS
from accpinn.units import Seconds
from pages.ui.session.resources import task_queue
from pages.ui.session.workspace import Workspace
from tests.support.apptest import PAGES, Page, open_page, with_sample

SEED = 26
PAGES_MORE = 8
"""Pages that are opened again after all of them."""
PATIENCE: Seconds = 3.0
"""A task that takes longer is stopped."""
STAY = 7
"""Mean number of steps on a page."""
QUICK = ("maximum-likelihood", "least-squares", "splines")
LEFT_OUT = ("data_download", "database_start", "database_form_start")
"""Buttons that reach the publisher, or run a batch."""
TEXTS = ("", "1-2", "4, 1-2", "3 3 3", "alpha", "<b>*x*</b>", "π ≈ 3,14", "-1e9", "a" * 50)
TABS = {
    "app.py": "home_tabs", "pages/1_Data.py": "data_tabs", "pages/2_Train.py": "train_tabs",
    "pages/3_Stability.py": "stability", "pages/4_Platoon.py": "platoon",
    "pages/5_Compare.py": "compare_tabs", "pages/6_Snapshots.py": "snapshots_tabs",
    "pages/7_Database.py": "database_tabs",
}  # fmt: skip
KINDS = (
    "button", "button_group", "selectbox", "multiselect", "number_input", "text_input", "toggle",
    "checkbox", "slider",
)  # fmt: skip


def choose(state: WidgetState, kind: str, widget: Any, dice: random.Random) -> object:
    """Set a state, as a browser sends it, to a value that the widget allows; what was chosen."""
    if kind == "button":
        state.trigger_value = True
        return "pressed"
    if kind in ("toggle", "checkbox"):
        state.bool_value = dice.random() < 0.5
        return state.bool_value
    if kind == "text_input":
        state.string_value = dice.choice(TEXTS)
        return state.string_value
    if kind in ("selectbox", "button_group"):
        chosen = dice.choice(widget.options)
        if kind == "selectbox":
            state.string_value = chosen
        else:
            state.string_array_value.data[:] = [chosen]
        return chosen
    if kind == "multiselect":
        most = widget.proto.max_selections or len(widget.options)
        several = dice.sample(widget.options, dice.randint(0, min(most, len(widget.options))))
        state.string_array_value.data[:] = several
        return several
    if kind == "slider":
        low, high = widget.min, widget.max
        ends = sorted(round(dice.uniform(low, high), 1) for _ in widget.value)
        state.double_array_value.data[:] = ends
        return ends
    number = chosen_number(widget, dice)
    if widget.proto.data_type == widget.proto.INT:
        number = int(number)
        state.int_value = number
    else:
        state.double_value = number
    return number


def chosen_number(widget: Any, dice: random.Random) -> float:
    """A neighbour of a number input's value, an end of its range, or a number between."""
    proto = widget.proto
    low = proto.min if proto.has_min else -100.0
    high = proto.max if proto.has_max else 1000.0
    now, step = float(widget.value or 0), float(proto.step or 1)
    number = dice.choice([now + step, now - step, low, high, dice.uniform(low, high)])
    return round(min(max(number, low), high), 3)


def controls(page: Page) -> Iterator[tuple[str, Any]]:
    """All that a person can press or set."""
    for kind in KINDS:
        for widget in page.get(kind):
            is_dead = widget.proto.disabled or (widget.key or "").startswith(LEFT_OUT)
            if not is_dead and (kind not in ("selectbox", "button_group") or widget.options):
                yield kind, widget


def settle(session: Workspace) -> None:
    """Wait for the session's tasks a while, then stop them."""
    for task in session.tasks:
        if not task.wait(PATIENCE):
            task.stop()
            task.wait()


@pytest.mark.usefixtures("fresh_server")
def test_no_control_of_any_page_ends_in_an_exception(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("accpinn.tasks.task.METHODS", {key: METHODS[key] for key in QUICK})
    dice, session, trail = random.Random(SEED), with_sample(), list[str]()
    for path in (*PAGES, *dice.choices(PAGES, k=PAGES_MORE)):
        page = open_page(path, session)
        trail.append(path)
        for _ in range(dice.randint(1, 2 * STAY)):
            # What is pressed next may train: with little work.
            session.preset, session.settings["fast"] = "fast", {"iterations": 20}
            if page.tabs and dice.random() < 0.2:
                title = dice.choice([tab.label for tab in page.tabs])
                session.choices[TABS[path]] = title
                trail.append(f"tab {title}")
                page.run()
            elif known := [*controls(page)]:
                kind, widget = dice.choice(known)
                states = page._tree.get_widget_states()
                state = next((one for one in states.widgets if one.id == widget.id), None)
                state = state or states.widgets.add(id=widget.id)
                chosen = choose(state, kind, widget, dice)
                trail.append(f"{kind} {widget.key or widget.label} = {chosen}")
                page._run(states)
            assert not page.exception, f"seed {SEED}: {trail}\n{page.exception}"
            session = page.workspace()
            settle(session)
    task_queue().close()
    print(len(trail), "steps")
