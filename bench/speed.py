"""Durations of the methods on real recordings, and the fast preset's distance from its limit.

A user waits for the recommended estimate, of one window and of all in car-following, first for its
point and then for its intervals, and for the comparison of all methods. The parameters of the fast
preset are compared with the limit of the loss, which splines in place of the network reach.
"""

import resource
import sys
from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from itertools import count
from pathlib import Path
from time import perf_counter

import numpy as np
import torch  # noqa: F401 (loaded before the first call is timed)

from accpinn.channels import PARAMETERS
from accpinn.inference.window_posterior import window_posterior
from accpinn.methods import TaskContext
from accpinn.methods.estimate import Estimate
from accpinn.methods.pinn.config import FAST
from accpinn.methods.registry import METHODS
from accpinn.model.cthp import Case
from accpinn.recordings.openacc import read
from accpinn.segment import Segment
from accpinn.segment.cut import cut
from accpinn.segment.windows import car_following
from accpinn.study import Analysis, Source
from accpinn.study.comparison import compare
from accpinn.study.result import Result
from accpinn.study.run import estimate, run
from accpinn.units import Seconds
from bench.measurement import Measurement, Spent, spent_on, timed

ROUNDS = 3
SHIFT: Seconds = 0.5
"""Time between the starts of two windows; results of the same window are remembered."""


@dataclass(frozen=True)
class BenchCase:
    """A segment to train on."""

    name: str
    file: str
    start: Seconds
    duration: Seconds
    case: Case
    fast_limit: Seconds
    """Limit of the fast preset: a 300th to 1000th of the paper's protocol (docs/validation.md)."""
    method_limits: tuple[Seconds, ...] = ()
    """Limits of what `methods` times; empty if that is not timed on this segment."""

    def segment(self, folder: Path, later: Seconds = 0.0) -> Segment:
        """Return the data of the window, or of one as long that begins some seconds later."""
        return cut(read(folder / self.file), self.start + later, self.duration)


CASALE, ASTAZERO = "Casale/part7.csv", "AstaZero/ASta_040719_platoon5.csv"
CASES = (
    BenchCase("Casale, one follower", CASALE, 0, 300, "II", 1.2, (0.5, 1.5, 5.0)),
    BenchCase("AstaZero, four followers", ASTAZERO, 320, 300, "II", 2.8, (2.0, 5.0, 9.0)),
    BenchCase("AstaZero, Case I", ASTAZERO, 320, 300, "I", 2.8),
    BenchCase("Casale, all 1,523 s", CASALE, 0, 1523, "II", 1.8),
)


def training(case: BenchCase, folder: Path) -> Iterator[Measurement]:
    """Time the fast preset, and measure its distance from the limit of the loss."""
    segment = case.segment(folder)
    limit = METHODS["splines"].fit(segment, case.case).parameters.values
    latest = deque[Estimate](maxlen=1)  # of which memory need not hold more
    once = partial(spent_on, lambda: latest.append(METHODS["pinn"].fit(segment, case.case, FAST)))
    yield timed("first call", once, rounds=1)
    yield timed("fast preset", once, case.fast_limit)
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    in_megabytes = 1e6 if sys.platform == "darwin" else 1e3
    distance = 100 * np.abs(latest[0].parameters.values / limit - 1).max(0)
    for quantity, percent in zip(PARAMETERS, distance, strict=True):
        name = f"{quantity.symbol}, from the limit of the loss"
        yield Measurement(name=name, value=float(percent), unit="%")
    yield Measurement(name="peak memory", value=peak / in_megabytes, unit="MB")


def methods(case: BenchCase, folder: Path) -> Iterator[Measurement]:
    """Time what a user waits for."""
    work: dict[str, Callable[[Segment], object]] = {
        "recommended, the point": lambda segment: METHODS["pinn"].fit(segment, case.case),
        "recommended, with intervals": partial(_estimated, case),
        "all methods, with hold-out": partial(_compare_all, case, folder),
    }
    later = count(1)

    def once(call: Callable[[Segment], object]) -> Spent:
        segment = case.segment(folder, SHIFT * next(later))
        return spent_on(lambda: call(segment))

    for (name, call), limit in zip(work.items(), case.method_limits, strict=True):
        yield timed(name, partial(once, call), limit, ROUNDS)


def several_windows(folder: Path) -> Iterator[Measurement]:
    """Time the recommended estimate of all windows in car-following of four followers."""
    recording = read(folder / ASTAZERO)
    windows, points = car_following(recording), list[Seconds]()

    def once() -> Spent:
        window_posterior.cache_clear()
        started = perf_counter()
        context = TaskContext(on_estimate=lambda _: points.append(perf_counter() - started))
        analysis = Analysis.of(recording, windows)
        return spent_on(lambda: run(analysis, recording, context=context).uncertainty)

    yield timed("recommended, with intervals", once, 7.0, ROUNDS)
    yield Measurement(name="its point", value=min(points), unit="s", at_most=3.0)


def _estimated(case: BenchCase, segment: Segment) -> None:
    analysis = Analysis(Source(segment.source, segment.sha256, None, segment.info.digest),
                     segment.vehicles, (segment.window,), case.case)  # fmt: skip
    assert estimate(analysis, (segment,)).posterior


def _compare_all(case: BenchCase, folder: Path, segment: Segment) -> None:
    recording = read(folder / case.file)
    analysis = Analysis.of(recording, [segment.window], segment.vehicles, case=case.case)
    for result in compare(analysis, recording):
        assert not isinstance(result, Result) or result.evaluation
