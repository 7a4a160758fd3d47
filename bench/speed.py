"""How long the methods take on real recordings.

A user waits for the likelihood with its posterior, the calibrated preset, and the comparison of all
methods.

The fast preset runs to its end. Its parameters are compared with the limit of the loss, which
splines in place of the network reach. Its limits are shares of the time of the paper's protocol: a
300th to a 1000th of what that took on two cores (see docs/validation.md).
"""

import resource
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from itertools import count
from pathlib import Path

import numpy as np

from accpinn.channels import PARAMETERS
from accpinn.inference.intervals import intervals
from accpinn.methods import splines
from accpinn.methods.fit import Fit
from accpinn.methods.pinn.config import FAST, preset
from accpinn.methods.registry import METHODS
from accpinn.model.cthp import Case
from accpinn.recordings.openacc import read
from accpinn.segment.cut import cut
from accpinn.segment.segment import Segment
from accpinn.study.analysis import Analysis
from accpinn.study.comparison import compare, results_among
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
    """Limit of the fast preset."""
    method_limits: tuple[Seconds, ...] = ()
    """Limits of `METHODS_TIMED`; empty if they are not timed on this segment."""

    def segment(self, folder: Path, later: Seconds = 0.0) -> Segment:
        """Return the data of the window, or of one as long that begins some seconds later."""
        return cut(read(folder / self.file), self.start + later, self.duration)


CASALE, ASTAZERO = "Casale/part7.csv", "AstaZero/ASta_040719_platoon5.csv"
CASES = (
    BenchCase("Casale, one follower", CASALE, 0, 300, "II", 1.2, (0.5, 1.5, 5.0)),
    BenchCase("AstaZero, four followers", ASTAZERO, 320, 300, "II", 2.8, (2.0, 5.0, 9.0)),
    BenchCase("AstaZero, Case I", ASTAZERO, 320, 300, "I", 2.9),
    BenchCase("Casale, all 1,523 s", CASALE, 0, 1523, "II", 2.1),
)


def training(case: BenchCase, folder: Path) -> Iterator[Measurement]:
    """Time the fast preset, and compare its parameters with the limit of the loss."""
    segment = case.segment(folder)
    limit = splines.fit(segment, case.case).parameters.values
    fits: list[Fit] = []
    spent: list[Spent] = []

    def fast() -> Spent:
        spent.append(spent_on(lambda: fits.append(METHODS["pinn"].fit(segment, case.case, FAST))))
        return spent[-1]

    yield timed("fast preset", fast, case.fast_limit)
    yield Measurement(name="first call", value=spent[0][0], processor=spent[0][1])
    distance = 100 * np.abs(fits[0].parameters.values / limit - 1).max(0)
    for quantity, percent in zip(PARAMETERS, distance, strict=True):
        name = f"{quantity.symbol}, from the limit of the loss"
        yield Measurement(name=name, value=float(percent), unit="%")
    yield Measurement(name="peak memory", value=_peak_memory(), unit="MB")


def _peak_memory() -> float:
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak / 1e6 if sys.platform == "darwin" else peak / 1e3


def _likelihood(segment: Segment, case: BenchCase, _: Path) -> None:
    intervals(segment, METHODS["maximum-likelihood"].fit(segment, case.case))


def _calibrated(segment: Segment, case: BenchCase, _: Path) -> None:
    METHODS["pinn"].fit(segment, case.case, preset("calibrated"))


def _comparison(segment: Segment, case: BenchCase, folder: Path) -> None:
    recording = read(folder / case.file)
    analysis = Analysis.of(recording, [segment.window], segment.vehicles, case=case.case)
    for result in results_among(compare(analysis, recording)):
        assert result.uncertainty


Work = Callable[[Segment, BenchCase, Path], None]
METHODS_TIMED: dict[str, Work] = {
    "likelihood and posterior": _likelihood,
    "calibrated preset": _calibrated,
    "all methods, with hold-out": _comparison,
}


def methods(case: BenchCase, folder: Path) -> Iterator[Measurement]:
    """Time what a user waits for."""
    METHODS["pinn"].fit(case.segment(folder))  # PyTorch is loaded once
    later = count(1)

    def once(work: Work) -> Spent:
        segment = case.segment(folder, SHIFT * next(later))
        return spent_on(lambda: work(segment, case, folder))

    for (name, work), limit in zip(METHODS_TIMED.items(), case.method_limits, strict=True):
        yield timed(name, partial(once, work), limit, ROUNDS)
