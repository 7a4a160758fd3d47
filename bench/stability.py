"""How long a stability report and a platoon simulation take; `python -m bench.stability` alone.

It needs no recording: the vehicles are those of Table III of the paper, AstaZero's four and
Vicolungo's three, the first three of them twice.
"""

import statistics
import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from accpinn.model.cthp import Parameters
from accpinn.platoon.leader import Brake, Sinusoid
from accpinn.platoon.simulation import simulate_platoon
from accpinn.stability.maps import gains_over_beta
from accpinn.stability.report import stability_report

MOST_MS = 50.0
"""What each may take, first call aside."""
CALLS = 30

VEHICLES = (
    Parameters(0.0612, 0.1200, 1.19),
    Parameters(0.1000, 0.1470, 1.17),
    Parameters(0.0766, 0.2220, 1.16),
    Parameters(0.0409, 0.4450, 1.16),
    Parameters(0.0766, 0.1660, 1.01),
    Parameters(0.1760, 0.3921, 1.00),
    Parameters(0.0705, 0.1930, 1.13),
)
TEN = (*VEHICLES, *VEHICLES[:3])


@dataclass(frozen=True)
class Timing:
    """One thing that was timed, in milliseconds."""

    name: str
    first_ms: float
    median_ms: float
    worst_ms: float
    most_ms: float = MOST_MS

    @property
    def fast_enough(self) -> bool:
        """Whether the median keeps the limit."""
        return self.median_ms <= self.most_ms


def measure() -> tuple[Timing, ...]:
    """Time everything, in this process."""
    beta, tau = np.linspace(0.0, 1.0, 200), np.linspace(0.2, 6.0, 150)
    return (
        _timed("stability report of ten vehicles", lambda: stability_report(TEN)),
        _timed(
            "eight vehicles behind a sinusoid, 500 s",
            lambda: simulate_platoon(TEN[:8], Sinusoid(0.25)),
        ),
        _timed(
            "the same at 0.3 rad/s, all alike",
            lambda: simulate_platoon(VEHICLES[2:3] * 8, Sinusoid(0.3)),
        ),
        _timed("eight vehicles behind a brake, 300 s", lambda: simulate_platoon(TEN[:8], Brake())),
        _timed("gains on a map of 200 by 150", lambda: gains_over_beta(0.07, beta, tau)),
    )


def text(timings: tuple[Timing, ...]) -> str:
    """A line each."""
    return "\n".join(
        f"  {row.name:42s} {row.median_ms:6.1f} ms (first {row.first_ms:.1f},"
        f" worst of {CALLS} {row.worst_ms:.1f}; at most {row.most_ms:.0f})"
        for row in timings
    )


def _timed(name: str, work: Callable[[], object]) -> Timing:
    first, *others = (_milliseconds(work) for _ in range(CALLS + 1))
    return Timing(name, first, statistics.median(others), max(others))


def _milliseconds(work: Callable[[], object]) -> float:
    start = time.perf_counter()
    work()
    return (time.perf_counter() - start) * 1e3


if __name__ == "__main__":
    found = measure()
    print(text(found))
    raise SystemExit(int(not all(row.fast_enough for row in found)))
