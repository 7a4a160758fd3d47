"""The app on a clock that can be advanced: `python -m bench.advanced run app.py ...`.

By how many seconds stands in the file that ADVANCE names, which is read upon SIGUSR1. Whatever
asks for the time afterwards, the app and Streamlit alike, finds that so much of it has passed;
nothing waits. Waiting itself (locks, queues) goes by the system's clock.

Upon SIGUSR2 the C library hands free memory back to the system, as far as it can, and a file beside
the other says how many objects of some types there are: what users held is given back when they are
gone, whatever memory the process has.
"""

import ctypes
import gc
import json
import os
import runpy
import signal
import sys
import time
from collections.abc import Callable
from pathlib import Path

from accpinn.units import Seconds

ADVANCE = "ADVANCE"
CLOCKS = ("time", "monotonic")
COUNTED = {
    "AppSession": "connections",
    "Workspace": "sessions",
    "Recording": "recordings",
}
"""Types of objects, and what they are for users."""


class Clock:
    """The system's clocks, all advanced alike."""

    def __init__(self) -> None:
        """Not advanced yet."""
        self.advance: Seconds = 0.0

    def take_over(self) -> None:
        """In place of the system's from now on, for all that is imported later."""
        for name in CLOCKS:
            setattr(time, name, self.later(getattr(time, name)))

    def later(self, clock: Callable[[], Seconds]) -> Callable[[], Seconds]:
        """A clock that shows so much more."""
        return lambda: clock() + self.advance

    def read(self, *_: object) -> None:
        """By how much from now on."""
        self.advance = float(Path(os.environ[ADVANCE]).read_text())


def tell(*_: object) -> None:
    """Hand free memory back, where the C library can, and count what is held."""
    if release := getattr(ctypes.CDLL(None), "malloc_trim", None):
        release(0)
    names = [type(one).__name__ for one in gc.get_objects()]
    unfinished = held_file().with_suffix(".part")
    unfinished.write_text(json.dumps({name: names.count(name) for name in COUNTED}))
    unfinished.replace(held_file())


def held_file() -> Path:
    """What is held."""
    return Path(os.environ[ADVANCE]).with_suffix(".held")


if __name__ == "__main__":
    clock = Clock()
    clock.take_over()
    signal.signal(signal.SIGUSR1, clock.read)
    signal.signal(signal.SIGUSR2, tell)
    sys.argv[0] = "streamlit"
    runpy.run_module("streamlit", run_name="__main__", alter_sys=True)
