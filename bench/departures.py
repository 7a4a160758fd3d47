"""`python -m bench.departures`: the coverage of the intervals where the model is incomplete.

Each line is the study of `bench.coverage` with one change: disturbances of another size or
duration, an actuator lag, a standstill distance or a slope, which the model lacks; or parameters
that are string stable, as none of the published sets is.
"""

import argparse
import sys
from dataclasses import dataclass

from accpinn.model.cthp import Parameters
from bench.coverage import SETS, SYMBOLS, CoverageStudy, measure
from bench.disturbed import Disturbance

STABLE = Parameters([0.15, 0.15, 0.05, 0.02], [0.6, 0.6, 0.6, 0.3], [1.5, 2.2, 2.5, 3.0])


@dataclass(frozen=True)
class Departure:
    """One line of the table."""

    name: str
    disturbance: Disturbance
    sets: Parameters = SETS


DEPARTURES = (
    Departure("as in bench.coverage", Disturbance()),
    Departure("disturbances last 1 s", Disturbance(memory=1.0)),
    Departure("disturbances last 20 s", Disturbance(memory=20.0)),
    Departure("disturbances of 0.1 m/s²", Disturbance(deviation=0.1)),
    Departure("disturbances of 0.5 m/s²", Disturbance(deviation=0.5)),
    Departure("string stable parameters", Disturbance(), STABLE),
    Departure("actuator lag of 0.5 s", Disturbance(lag=0.5)),
    Departure("actuator lag of 1 s", Disturbance(lag=1.0)),
    Departure("standstill distance of 4 m", Disturbance(standstill=4.0)),
    Departure("1 % uphill throughout", Disturbance(slope=-0.1)),
)


def table(recordings: int) -> str:
    """One study a line, as Markdown."""
    lines = [
        f"| 90 % intervals, {recordings} recordings each | {' | '.join(SYMBOLS)} | all three |",
        f"|---|{'---|' * (len(SYMBOLS) + 1)}",
    ]
    for departure in DEPARTURES:
        study = measure(recordings, departure.disturbance, others=False, sets=departure.sets)
        lines.append(f"| {departure.name} | {_shares(study)} |")
    return "\n".join(lines)


def _shares(study: CoverageStudy) -> str:
    ours = study.rows[0]
    return " | ".join(f"{100 * share:.0f} %" for share in (*ours.covered, ours.jointly))


def main(arguments: list[str] | None = None) -> int:
    """Measure and print."""
    parser = argparse.ArgumentParser(prog="python -m bench.departures", description=__doc__)
    parser.add_argument("--recordings", type=int, default=200, help="for each line (200)")
    options = parser.parse_args(arguments)
    if options.recordings < 1:
        parser.error("--recordings: give at least 1")
    print(table(options.recordings))
    return 0


if __name__ == "__main__":
    sys.exit(main())
