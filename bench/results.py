"""How long stability, platoons and the report of a result take.

No recording is needed: the vehicles are those of Table III of the paper, AstaZero's four and
Vicolungo's three, the first three of them twice; the report is that of a sample.
"""

from collections.abc import Callable, Iterator
from functools import partial
from itertools import count
from pathlib import Path
from tempfile import TemporaryDirectory

from accpinn.api import fit, report
from accpinn.model.cthp import Parameters
from accpinn.model.published import ASTAZERO, VICOLUNGO
from accpinn.platoon import simulate_platoon
from accpinn.platoon.leader import Brake, Sinusoid
from accpinn.stability.report import stability_report
from accpinn.study.result import Result
from accpinn.units import Seconds
from bench.measurement import Measurement, Spent, spent_on, timed
from bench.start import SAMPLE

LIMIT: Seconds = 0.05
REPORT: Seconds = 1.0
"""Limit of the report."""
CALLS = 30
DURATION: Seconds = 200.0
TEN = Parameters.stack([*ASTAZERO.parameters, *VICOLUNGO.parameters, *ASTAZERO.parameters[:3]])
MERCEDES = 2


def measure() -> Iterator[Measurement]:
    """Time everything in this process."""
    alike = TEN[[MERCEDES] * 8]
    work: dict[str, Callable[[], object]] = {
        "stability report of ten vehicles": lambda: stability_report(TEN),
        "eight vehicles behind a sinusoid, 500 s": lambda: simulate_platoon(TEN[:8], Sinusoid()),
        "the same at 0.3 rad/s, all alike": lambda: simulate_platoon(alike, Sinusoid(0.3)),
        "eight vehicles behind a brake, 300 s": lambda: simulate_platoon(TEN[:8], Brake()),
    }
    for name, call in work.items():
        yield timed(name, partial(spent_on, call), LIMIT, CALLS)
    with TemporaryDirectory() as folder:
        yield report_time(Path(folder))


def report_time(folder: Path) -> Measurement:
    """Time the report of a sample with four followers, in another window each round."""
    starts = count()

    def once() -> Spent:
        result = _result(float(next(starts)))
        return spent_on(lambda: report(result, folder / "report.html"))

    return timed("report of a result written", once, REPORT)


def _result(start: Seconds) -> Result:
    """Fit a window, with everything computed that is known once a result is shown."""
    result = fit(SAMPLE, start, DURATION)
    assert result.uncertainty
    assert result.evaluation
    return result
