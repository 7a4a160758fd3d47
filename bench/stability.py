"""How long a stability report and a platoon simulation take; `python -m bench.stability` alone.

It needs no recording: the vehicles are those of Table III of the paper, AstaZero's four and
Vicolungo's three, the first three of them twice.
"""

import statistics
import time
from collections.abc import Callable
from dataclasses import dataclass

from accpinn.model.cthp import Parameters
from accpinn.model.published import ASTAZERO, VICOLUNGO
from accpinn.platoon.leader import Brake, Sinusoid
from accpinn.platoon.simulation import simulate_platoon
from accpinn.stability.report import stability_report

MOST_MS = 50.0
"""What each may take, first call aside."""
CALLS = 30
TEN = Parameters.stack([*ASTAZERO.parameters, *VICOLUNGO.parameters, *ASTAZERO.parameters[:3]])
MERCEDES = 2


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
    alike = TEN[[MERCEDES] * 8]
    work: dict[str, Callable[[], object]] = {
        "stability report of ten vehicles": lambda: stability_report(TEN),
        "eight vehicles behind a sinusoid, 500 s": lambda: simulate_platoon(TEN[:8], Sinusoid()),
        "the same at 0.3 rad/s, all alike": lambda: simulate_platoon(alike, Sinusoid(0.3)),
        "eight vehicles behind a brake, 300 s": lambda: simulate_platoon(TEN[:8], Brake()),
    }
    return tuple(_timed(name, call) for name, call in work.items())


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
