"""The fast preset against the paper's training protocol, and how long the methods take.

`python -m bench.speed` times what a user waits for: the likelihood with its posterior, the
calibrated preset, and the comparison of all methods, against what each may take on two processors.

`measure` compares the protocols on real segments, in one process, in turn. The paper's is timed per
iteration, by the median, and multiplied by the 20,000 iterations its authors need; the fast preset
runs to its end, from the first call in the process. Peak memory is that of the whole process.

Recordings are found through OPENACC_DIR.
"""

import os
import resource
import statistics
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from accpinn.evaluation.closed_loop import surrogate_errors
from accpinn.inference.intervals import intervals
from accpinn.methods import splines
from accpinn.methods.fit import Fit
from accpinn.methods.pinn.config import FAST, preset
from accpinn.methods.registry import METHODS
from accpinn.model.cthp import Case
from accpinn.recordings.openacc import read
from accpinn.segment.cut import cut
from accpinn.segment.segment import Segment
from accpinn.study.comparison import compare
from bench.paper_protocol import seconds_per_iteration

PAPER_ITERATIONS = 20_000
"""The paper: parameter convergence is achieved in around 20,000 iterations for all tests."""
ROUNDS = 3
SHIFT = 0.5
"""Seconds from window to window, as what was computed for one is remembered."""


@dataclass(frozen=True)
class BenchCase:
    """A segment to train on."""

    name: str
    file: str
    start: float
    duration: float
    case: Case
    least_ratio: float | None
    """How many times faster than the paper's protocol the fast preset must be."""

    def segment(self, later: float = 0.0) -> Segment:
        """The data; or those of as long a window that begins some seconds later."""
        return cut(read(folder() / self.file), self.start + later, self.duration)


CASES = (
    BenchCase("Casale 0-300 s, M = 1", "Casale/part7.csv", 0, 300, "II", 300),
    BenchCase(
        "AstaZero 320-620 s, M = 4, Case II",
        "AstaZero/ASta_040719_platoon5.csv",
        320,
        300,
        "II",
        400,
    ),
    BenchCase(
        "AstaZero 320-620 s, M = 4, Case I", "AstaZero/ASta_040719_platoon5.csv", 320, 300, "I", 400
    ),
    BenchCase("Casale whole, M = 1", "Casale/part7.csv", 0, 1523, "II", None),
)


def folder() -> Path:
    """The folder of the recordings."""
    named = os.environ.get("OPENACC_DIR")
    if not named:
        raise SystemExit(
            "error: OPENACC_DIR is not set; name the folder of OpenACC recordings, which has"
            " Casale/part7.csv and AstaZero/ASta_040719_platoon5.csv."
        )
    return Path(named)


@dataclass(frozen=True)
class Timing:
    """What was measured, as plain numbers ready for JSON."""

    name: str
    case: str
    paper_iteration_ms: float
    paper_seconds: float
    fast_seconds: list[float]
    """Each round; the first is the process's first training."""
    fast_iterations: int
    outcome: str
    ratio: float
    """By the median of the rounds."""
    ratio_first: float
    """By the first round."""
    least_ratio: float | None
    parameters: list[list[float]]
    limit: list[list[float]]
    distance_percent: list[float]
    """Largest distance from the limit over the followers: α, β, τ."""
    loss: float
    loss_start: float
    loss_limit: float
    gap_mae: list[float]
    peak_memory_mb: float


def measure(case: BenchCase, paper_iterations: int) -> Timing:
    """Alternate the two protocols, and compare the result with the limit of the loss."""
    segment = case.segment()
    limit = splines.fit(segment, case.case)
    fits: list[Fit] = []
    for _ in range(ROUNDS):
        fits.append(METHODS["pinn"].fit(segment, case.case, FAST))
    peak = _peak_memory_mb()
    paper: list[float] = []
    for _ in range(ROUNDS):
        paper += seconds_per_iteration(segment, paper_iterations)
        fits.append(METHODS["pinn"].fit(segment, case.case, FAST))
    iteration, fast = statistics.median(paper), [fit.seconds for fit in fits]
    table, best = fits[0].parameters.values, limit.parameters.values
    errors = surrogate_errors(segment, fits[0])
    assert errors is not None
    return Timing(
        name=case.name,
        case=case.case,
        paper_iteration_ms=1e3 * iteration,
        paper_seconds=PAPER_ITERATIONS * iteration,
        fast_seconds=fast,
        fast_iterations=fits[0].iterations,
        outcome=fits[0].outcome.name.lower(),
        ratio=PAPER_ITERATIONS * iteration / statistics.median(fast),
        ratio_first=PAPER_ITERATIONS * iteration / fast[0],
        least_ratio=case.least_ratio,
        parameters=table.tolist(),
        limit=best.tolist(),
        distance_percent=(100 * np.abs(table / best - 1).max(0)).tolist(),
        loss=fits[0].loss["total"],
        loss_start=fits[0].loss["start"],
        loss_limit=limit.loss["total"],
        gap_mae=errors.gap_mae.tolist(),
        peak_memory_mb=peak,
    )


def _peak_memory_mb() -> float:
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak / 1e6 if sys.platform == "darwin" else peak / 1e3


def _likelihood(segment: Segment, case: BenchCase) -> None:
    intervals(segment, METHODS["maximum-likelihood"].fit(segment, case.case))


def _calibrated(segment: Segment, case: BenchCase) -> None:
    METHODS["pinn"].fit(segment, case.case, preset("calibrated"))


def _comparison(segment: Segment, case: BenchCase) -> None:
    list(compare(segment, case.case, recording=read(folder() / case.file)))


GOALS: tuple[tuple[str, Callable[[Segment, BenchCase], None], tuple[float, float]], ...] = (
    ("likelihood and posterior", _likelihood, (0.5, 2.0)),
    ("calibrated preset", _calibrated, (1.5, 5.0)),
    ("all methods, with hold-out", _comparison, (5.0, 9.0)),
)
"""What is timed, and the seconds it may take for each of the first two cases."""


def main() -> int:
    """Print the median of several rounds; exit status 1 where one takes longer than it may."""
    slow = False
    METHODS["pinn"].fit(CASES[0].segment())  # PyTorch is loaded once
    for index, case in enumerate(CASES[:2]):
        print(case.name)
        later = 0.0
        for name, work, goals in GOALS:
            walls, own = [], []
            for _ in range(ROUNDS):
                later += SHIFT
                segment = case.segment(later)
                began, spent = time.perf_counter(), time.process_time()
                work(segment, case)
                walls.append(time.perf_counter() - began)
                own.append(time.process_time() - spent)
            wall, goal = statistics.median(walls), goals[index]
            slow |= wall > goal
            times = f"{wall:5.2f} s (at most {goal:g})"
            print(f"  {name:28}{times}; processor {statistics.median(own):.2f} s", flush=True)
    return int(slow)


if __name__ == "__main__":
    sys.exit(main())
