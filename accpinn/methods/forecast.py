"""Time left of an estimation in several phases, and the pace at which its curves are drawn.

A phase that is under way goes on as it did. Phases that follow take their typical time, which is
that of a reference computer, times how much slower the phases so far were than on that.
"""

import time
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import NamedTuple

from accpinn.methods.estimate import Progress
from accpinn.model.cthp import Trajectories
from accpinn.units import Seconds

PARAMETERS, CURVES, INTERVALS, VARIATION, CHECKS = (
    "parameters", "curves", "intervals", "variation between drives", "checks",
)  # fmt: skip
"""Names of phases: search, curves of what was found, posterior of each window, how the windows of a
car differ, and what a page shows beside."""
SETTLED = (CURVES, INTERVALS, VARIATION, CHECKS)
"""Phases in which the parameters no longer move."""
CURVE_EVERY: Seconds = 0.5
"""Least time between two drawings of the curves."""
DRAWING_SHARE = 0.1
"""Most of the time that drawing takes."""
PRIOR = 0.05
"""Share of a phase that its typical time counts for beside the time that it takes."""
BEGINNING: Seconds = 0.05
"""Time that the typical speed counts for beside the speed of this computer."""
LAST, LEAST = 0.4, 2.0
"""Share of the present phase, and the least time in s, from which its rate is taken: the computer
may have become busy, or quiet."""


class Phase(NamedTuple):
    """A part of an estimation."""

    iterations: int
    """Usual number of its iterations."""
    seconds: Seconds
    """Time of one on a reference computer."""


class Forecast:
    """The time left of an estimation, moment by moment."""

    def __init__(self, phases: Mapping[str, Phase]) -> None:
        """Begin before the first of the phases, which are given by name in their order."""
        self._phases = dict(phases)
        self._name, self._first = "", (0.0, 0)
        """Name of the present phase, and seconds and iteration of its first moment."""
        self._recent = deque[tuple[Seconds, int]]()
        """Seconds and iteration of its latest moments."""
        self._spent = self._typical = BEGINNING
        """Time of the phases that are over, and their typical time."""

    def of(self, now: Progress) -> Progress:
        """The same moment with the time left; moments come in their order."""
        if now.phase != self._name:
            if ended := self._phases.get(self._name):  # of an unknown phase nothing is learned
                began, first = self._first
                self._spent += now.seconds - began
                self._typical += max(1, self._recent[-1][1] - first) * ended.seconds
            self._recent.clear()
            self._name, self._first = now.phase, (now.seconds, now.iteration)
        self._recent.append((now.seconds, now.iteration))
        length = max(LEAST, LAST * (now.seconds - self._first[0]))
        while self._recent[0][0] < now.seconds - length:
            self._recent.popleft()
        return replace(now, left=self._left(now))

    def _left(self, now: Progress) -> Seconds | None:
        """The time left in s, by the phase's latest rate and by how slow past phases were."""
        names, phase = [*self._phases], self._phases.get(now.phase)
        later = names[names.index(now.phase) + 1 :] if phase else names
        (began, first), (since, start) = self._first, self._recent[0]
        done = now.iteration - first
        if phase is None and not done:
            return None
        spent, typical, weight = self._spent, self._typical, 0.0
        if phase and done:
            spent, typical = spent + now.seconds - began, typical + done * phase.seconds
        slowness, usual = spent / typical, 0.0
        if phase:
            weight, usual = max(PRIOR * (now.iterations - first), 0.5), slowness * phase.seconds
        each = (now.seconds - since + weight * usual) / (now.iteration - start + weight)
        following = sum(self._phases[n].iterations * self._phases[n].seconds for n in later)
        return max(now.iterations - now.iteration, 0) * each + slowness * following


class Pace:
    """Draws curves now and then, so that drawing takes little of the time."""

    def __init__(self) -> None:
        """Draw the first time at once."""
        self._next = 0.0

    def drawn(self, draw: Callable[[], Trajectories]) -> Trajectories | None:
        """The curves, where it is time to draw them."""
        began = time.perf_counter()
        if began < self._next:
            return None
        curves = draw()
        ended = time.perf_counter()
        self._next = ended + max(CURVE_EVERY, (ended - began) / DRAWING_SHARE)
        return curves
