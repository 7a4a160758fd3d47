"""A random walk over every control of every page: no page may end in an exception."""

import os
import random
from collections.abc import Iterator
from functools import partial
from typing import Any

import pytest
from streamlit.proto.WidgetStates_pb2 import WidgetState, WidgetStates

from accpinn.units import Seconds
from pages.ui.session.resources import task_queue
from pages.ui.session.workspace import Workspace
from tests.support.apptest import PAGES, WIDGETS, Page, open_page, with_sample

SEED = int(os.environ.get("WALK_SEED", "26"))
PAGES_MORE = int(os.environ.get("WALK_PAGES", "2"))
"""Pages that are opened again after all of them; some hundred for a long walk."""
PATIENCE: Seconds = 3.0
"""A task that takes longer is stopped."""
STAY = 7
"""Mean number of steps on a page."""
QUICK = ("pinn-fast", "least-squares", "splines")
LEFT_OUT = ("data_download", "database_start", "database_form_start")
"""Buttons that reach the publisher, or run a batch."""
TEXTS = ("", "1-2", "4, 1-2", "3 3 3", "alpha", "<b>*x*</b>", "π ≈ 3,14", "-1e9", "a" * 50)
TABS = {"Stability": "stability", "Platoon": "platoon"}
KINDS = ("button", *WIDGETS)


def choose(kind: str, widget: Any, dice: random.Random) -> WidgetState:
    """A state that a widget allows, as a browser sends it."""
    state, options = partial(WidgetState, id=widget.id), getattr(widget, "options", ())
    if kind == "button":
        return state(trigger_value=True)
    if kind in ("toggle", "checkbox"):
        return state(bool_value=dice.random() < 0.5)
    if kind == "text_input":
        return state(string_value=dice.choice(TEXTS))
    if kind == "selectbox":
        return state(string_value=dice.choice(options))
    if kind == "button_group":
        return state(string_array_value={"data": [dice.choice(options)]})
    if kind == "multiselect":
        most = min(widget.proto.max_selections or len(options), len(options))
        return state(string_array_value={"data": dice.sample(options, dice.randint(0, most))})
    if kind == "select_slider":
        return state(string_array_value={"data": [dice.choice(options)]})
    if kind == "slider":
        ends = sorted(round(dice.uniform(widget.min, widget.max), 1) for _ in widget.value)
        return state(double_array_value={"data": ends})
    number = chosen_number(widget, dice)
    if widget.proto.data_type == widget.proto.INT:
        return state(int_value=int(number))
    return state(double_value=number)


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
    monkeypatch.setattr("accpinn.tasks.COMPARED", QUICK)
    dice, session, trail = random.Random(SEED), with_sample(), list[str]()
    for title in (*PAGES, *dice.choices([*PAGES], k=PAGES_MORE)):
        page = open_page(title, session)
        trail.append(title)
        for _ in range(dice.randint(1, 2 * STAY)):
            # What is pressed next may train: with little work.
            session.preset, session.settings["fast"] = "fast", {"iterations": 20}
            if page.tabs and dice.random() < 0.2:
                tab = dice.choice([tab.label for tab in page.tabs])
                session.choices[TABS.get(title, f"{title.lower()}_tabs")] = tab
                trail.append(f"tab {tab}")
                page.run()
            elif known := [*controls(page)]:
                kind, widget = dice.choice(known)
                states = page._tree.get_widget_states()
                chosen = choose(kind, widget, dice)
                others = [state for state in states.widgets if state.id != widget.id]
                trail.append(f"{kind} {widget.key or widget.label} = {chosen}")
                page._run(WidgetStates(widgets=[*others, chosen]))
            assert not page.exception, f"seed {SEED}: {trail}\n{page.exception}"
            session = page.workspace()
            settle(session)
    task_queue().close()
    print(len(trail), "steps")
