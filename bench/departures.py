"""`python -m bench.departures`: what the intervals are worth where the law lacks more than noise.

Each line is the study of `bench.coverage` with one thing changed that a real car may have and the
law does not: disturbances of other sizes and lengths, an actuator's lag, a distance kept at
standstill, a slope; or with laws that are string stable, as none of the published ones is.
"""

import argparse
import sys
from dataclasses import dataclass

from accpinn.channels import PARAMETERS
from accpinn.model.cthp import Parameters
from bench.coverage import LAWS, Study, measure
from bench.disturbed import Disturbance

STABLE = (
    Parameters(0.15, 0.6, 1.5),
    Parameters(0.15, 0.6, 2.2),
    Parameters(0.05, 0.6, 2.5),
    Parameters(0.02, 0.3, 3.0),
)


@dataclass(frozen=True)
class Departure:
    """One line of the table."""

    name: str
    disturbance: Disturbance
    laws: Parameters = LAWS


DEPARTURES = (
    Departure("as in bench.coverage", Disturbance()),
    Departure("disturbances last 1 s", Disturbance(memory=1.0)),
    Departure("disturbances last 20 s", Disturbance(memory=20.0)),
    Departure("disturbances of 0.1 m/s²", Disturbance(deviation=0.1)),
    Departure("disturbances of 0.5 m/s²", Disturbance(deviation=0.5)),
    Departure("string stable laws", Disturbance(), STABLE),
    Departure("actuator lag 0.5 s", Disturbance(lag=0.5)),
    Departure("actuator lag 1 s", Disturbance(lag=1.0)),
    Departure("4 m kept at standstill", Disturbance(standstill=4.0)),
    Departure("1 % uphill throughout", Disturbance(slope=-0.1)),
)


def table(recordings: int) -> str:
    """The studies one below the other, as Markdown."""
    symbols = " | ".join(one.symbol for one in PARAMETERS)
    lines = [
        f"| 90 % intervals, {recordings} recordings each | {symbols} | all three |",
        f"|---|{'---|' * (len(PARAMETERS) + 1)}",
    ]
    for departure in DEPARTURES:
        study = measure(recordings, departure.disturbance, rivals=False, laws=departure.laws)
        lines.append(f"| {departure.name} | {_shares(study)} |")
    return "\n".join(lines)


def _shares(study: Study) -> str:
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
