"""How long the methods take on real recordings, and the fast preset against the paper's protocol.

A user waits for the likelihood with its posterior, the calibrated preset, and the comparison of all
methods.

Iterations of the paper's protocol are timed in turn with the fast preset; their median is
multiplied by the 20,000 iterations that its authors need. The fast preset runs to its end. Its
parameters are compared with the limit of the loss, which splines in place of the network reach.
"""

import resource
import statistics
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
from bench.paper_protocol import seconds_per_iteration

PAPER_ITERATIONS = 20_000
"""The paper: "parameter convergence is achieved in around 20,000 iterations for all tests"."""
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
    least_ratio: float | None = None
    """Least ratio of the paper's time to that of the fast preset."""
    method_limits: tuple[Seconds, ...] = ()
    """Limits of `METHODS_TIMED`; empty if they are not timed on this segment."""

    def segment(self, folder: Path, later: Seconds = 0.0) -> Segment:
        """Return the data of the window, or of one as long that begins some seconds later."""
        return cut(read(folder / self.file), self.start + later, self.duration)


CASALE, ASTAZERO = "Casale/part7.csv", "AstaZero/ASta_040719_platoon5.csv"
CASES = (
    BenchCase("Casale, one follower", CASALE, 0, 300, "II", 300, (0.5, 1.5, 5.0)),
    BenchCase("AstaZero, four followers", ASTAZERO, 320, 300, "II", 400, (2.0, 5.0, 9.0)),
    BenchCase("AstaZero, Case I", ASTAZERO, 320, 300, "I", 400),
    BenchCase("Casale, all 1,523 s", CASALE, 0, 1523, "II", 1000),
)


def training(case: BenchCase, folder: Path, iterations: int) -> Iterator[Measurement]:
    """Time the fast preset beside that many iterations a round of the paper's protocol."""
    segment = case.segment(folder)
    limit = splines.fit(segment, case.case).parameters.values
    fits: list[Fit] = []
    spent: list[Spent] = []

    def fast() -> None:
        spent.append(spent_on(lambda: fits.append(METHODS["pinn"].fit(segment, case.case, FAST))))

    for _ in range(ROUNDS):
        fast()
    peak = _peak_memory()
    paper: list[Seconds] = []
    for _ in range(ROUNDS):
        paper += seconds_per_iteration(segment, iterations)
        fast()
    seconds, processor = map(statistics.median, zip(*spent, strict=True))
    protocol = PAPER_ITERATIONS * statistics.median(paper)
    distance = 100 * np.abs(fits[0].parameters.values / limit - 1).max(0)
    yield Measurement(name="fast preset", value=seconds, processor=processor)
    yield Measurement(name="first call", value=spent[0][0], processor=spent[0][1])
    yield Measurement(name="paper's 20,000 iterations", value=protocol)
    yield Measurement(
        name="ratio", value=protocol / seconds, unit="times", at_least=case.least_ratio
    )
    for quantity, percent in zip(PARAMETERS, distance, strict=True):
        name = f"{quantity.symbol}, from the limit of the loss"
        yield Measurement(name=name, value=float(percent), unit="%")
    yield Measurement(name="peak memory", value=peak, unit="MB")


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
