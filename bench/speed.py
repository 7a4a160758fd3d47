"""How long the methods take on real recordings, and how far the fast preset gets.

A user waits for the likelihood with its posterior, the calibrated preset, and the comparison of all
methods. The parameters of the fast preset are compared with the limit of the loss, which splines in
place of the network reach.
"""

import resource
import sys
from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from itertools import count
from pathlib import Path

import numpy as np
import torch  # noqa: F401 (loaded before the first call is timed)

from accpinn.channels import PARAMETERS
from accpinn.inference.intervals import intervals
from accpinn.methods import splines
from accpinn.methods.estimate import Fit
from accpinn.methods.pinn.config import FAST, preset
from accpinn.methods.registry import METHODS
from accpinn.model.cthp import Case
from accpinn.recordings.openacc import read
from accpinn.segment import Segment
from accpinn.segment.cut import cut
from accpinn.study import Analysis
from accpinn.study.comparison import compare
from accpinn.study.result import Result
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
    BenchCase("Casale, all 1,523 s", CASALE, 0, 1523, "II", 2.1),
)


def training(case: BenchCase, folder: Path) -> Iterator[Measurement]:
    """Time the fast preset, and measure its distance from the limit of the loss."""
    segment = case.segment(folder)
    limit = splines.fit(segment, case.case).parameters.values
    fits = deque[Fit](maxlen=1)  # of which memory need not hold more
    once = partial(spent_on, lambda: fits.append(METHODS["pinn"].fit(segment, case.case, FAST)))
    yield timed("first call", once, rounds=1)
    yield timed("fast preset", once, case.fast_limit)
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    in_megabytes = 1e6 if sys.platform == "darwin" else 1e3
    distance = 100 * np.abs(fits[0].parameters.values / limit - 1).max(0)
    for quantity, percent in zip(PARAMETERS, distance, strict=True):
        name = f"{quantity.symbol}, from the limit of the loss"
        yield Measurement(name=name, value=float(percent), unit="%")
    yield Measurement(name="peak memory", value=peak / in_megabytes, unit="MB")


def methods(case: BenchCase, folder: Path) -> Iterator[Measurement]:
    """Time what a user waits for."""
    METHODS["pinn"].fit(case.segment(folder))  # PyTorch is loaded once
    work: dict[str, Callable[[Segment], object]] = {
        "likelihood and posterior": lambda segment: intervals(
            segment, METHODS["maximum-likelihood"].fit(segment, case.case)
        ),
        "calibrated preset": lambda segment: METHODS["pinn"].fit(
            segment, case.case, preset("calibrated")
        ),
        "all methods, with hold-out": partial(_compare_all, case, folder),
    }
    later = count(1)

    def once(call: Callable[[Segment], object]) -> Spent:
        segment = case.segment(folder, SHIFT * next(later))
        return spent_on(lambda: call(segment))

    for (name, call), limit in zip(work.items(), case.method_limits, strict=True):
        yield timed(name, partial(once, call), limit, ROUNDS)


def _compare_all(case: BenchCase, folder: Path, segment: Segment) -> None:
    recording = read(folder / case.file)
    analysis = Analysis.of(recording, [segment.window], segment.vehicles, case=case.case)
    for result in compare(analysis, recording):
        assert not isinstance(result, Result) or result.uncertainty
