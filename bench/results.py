"""Durations of stability, platoons and the report of a result.

No recording is needed: the vehicles are those of Table III of the paper, AstaZero's four and
Vicolungo's three, the first three of them twice; the report is that of a sample.
"""

from collections.abc import Callable, Iterator
from functools import partial
from itertools import count
from tempfile import TemporaryDirectory

from threadpoolctl import threadpool_limits

from accpinn.api import fit, report
from accpinn.model.cthp import Parameters
from accpinn.model.published import ASTAZERO, VICOLUNGO
from accpinn.platoon import simulate_platoon
from accpinn.platoon.leader import Brake, Sinusoid
from accpinn.stability import stability_report
from accpinn.stability.head_to_tail import head_to_tail_peaks
from accpinn.stability.lagged import lagged_stability
from accpinn.units import Seconds
from bench.measurement import Measurement, Spent, spent_on, timed
from bench.start import SAMPLE

REPORT: Seconds = 1.0
"""Limit of the report."""
CALLS = 100
"""Calls of what takes milliseconds, of which the best counts."""
DURATION: Seconds = 200.0
TEN = Parameters.stack([*ASTAZERO.parameters, *VICOLUNGO.parameters, *ASTAZERO.parameters[:3]])
DELAYED = Parameters(TEN.alpha, TEN.beta, TEN.tau, delay=0.3)
MERCEDES = 2


def measure() -> Iterator[Measurement]:
    """Time everything in this process, with one thread of linear algebra, as the app has."""
    threadpool_limits(limits=1, user_api="blas")
    alike = TEN[[MERCEDES] * 8]
    work: dict[str, tuple[Seconds, Callable[[], object]]] = {
        "stability report of ten vehicles": (0.008, lambda: _assess(TEN)),
        "the same with a delay": (0.04, lambda: _assess(DELAYED)),
        "eight vehicles behind a sinusoid, 500 s": (
            0.005,
            lambda: simulate_platoon(TEN[:8], Sinusoid()),
        ),
        "the same at 0.3 rad/s, all alike": (
            0.005,
            lambda: simulate_platoon(alike, Sinusoid(0.3)),
        ),
        "eight with a delay behind a sinusoid": (
            0.015,
            lambda: simulate_platoon(DELAYED[:8], Sinusoid()),
        ),
        "eight vehicles behind a brake, 300 s": (
            0.005,
            lambda: simulate_platoon(TEN[:8], Brake()),
        ),
    }
    for name, (limit, call) in work.items():
        yield timed(name, partial(spent_on, call), limit, CALLS, min)
    starts = count()
    yield timed("report of a result written", lambda: _report(float(next(starts))), REPORT)


def _assess(vehicles: Parameters) -> None:
    """Assess the vehicles as if for the first time."""
    for remembered in (stability_report, head_to_tail_peaks, lagged_stability):
        remembered.cache_clear()
    stability_report(vehicles)


def _report(start: Seconds) -> Spent:
    """Time the report of a window of four followers, of which all is known that pages show."""
    result = fit(SAMPLE, start, DURATION)
    assert result.uncertainty
    assert result.evaluation
    assert result.trust
    assert result.gain_checks
    with TemporaryDirectory() as folder:
        return spent_on(lambda: report(result, f"{folder}/report.html"))
