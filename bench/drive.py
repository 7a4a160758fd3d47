"""`python -m bench.drive`: do the drives that are proposed keep what they promise?

Cars have published α, β and τ, s₀, a delay, disturbances and the receivers' noise. Each is
estimated from a motorway drive, for which the next drive is proposed; then it drives behind that,
and behind another motorway drive of the same length. Measured are the intervals of its parameters
from each of these two drives alone (the window's posterior): their ratio beside the predicted one,
and how often they cover the truth.

The exit status is 1 if the intervals of α and β behind the drives proposed are not half as wide at
most, in the median, or `MANY` cars or more have a coverage that is not as accpinn promises.
"""

import argparse
import sys
from collections.abc import Iterator
from functools import partial

import numpy as np

from accpinn.errors import ConfigError
from accpinn.inference.coordinates import AT_SPEED
from accpinn.inference.experiment import STEP
from accpinn.inference.intervals import LEVEL
from accpinn.inference.window_posterior import window_posterior
from accpinn.model.cthp import Parameters
from accpinn.model.registry import BEST
from accpinn.model.spec import ModelSpec
from accpinn.recordings.synthetic import SIMULATION_STEP
from accpinn.segment import Segment
from accpinn.study.next_drive import next_drive
from accpinn.units import FloatArray, Seconds, interval_ends
from bench.coverage import EACH, MANY, SETS, covered, simulated
from bench.disturbed import MOTORWAY, Disturbance, disturbed
from bench.measurement import Measurement, measured, show

LENGTH: Seconds = 120.0
USUAL = Disturbance(delay=0.4, standstill=4.0)
NAMES = "ln α", "ln β", "time gap", "s₀", "delay"
KEYS = "alpha", "beta", "time_gap", "s0", "delay"
NAMES_OF_ROWS = (
    "truth", "predicted", "drive lower", "drive upper", "motorway lower", "motorway upper",
)  # fmt: skip
PROMISED = 0.5
"""Largest median ratio of the intervals of α and β."""


def car(seed: int) -> dict[str, FloatArray]:
    """Simulate one car, propose its next drive, and estimate it from that and from another.

    Returns:
        (5,) each, by `KEYS`: the truth, ends of the intervals from both drives, and the ratio of
        their widths that was predicted; nan of a car for which nothing is proposed.
    """
    import accpinn

    true = SETS[seed % len(SETS)]
    first = disturbed([true], 3 * seed, USUAL, duration=LENGTH)
    known = accpinn.fit(first, method="pinn", preset="calibrated")
    try:
        proposed = next_drive(known, duration=LENGTH)
    except ConfigError:  # every drive could come too close
        return {name: np.full(len(KEYS), np.nan) for name in NAMES_OF_ROWS}
    time = SIMULATION_STEP * np.arange(round(LENGTH / SIMULATION_STEP) + 1)
    ahead = np.interp(time, STEP * np.arange(len(proposed.speed)), proposed.speed)
    widths = {row.name: row.relative_width for row in proposed.narrowing}
    row = {
        "truth": _values(Parameters(*true.values, USUAL.standstill, 0.0, USUAL.delay)),
        "predicted": np.array([widths[key] for key in KEYS]),
    }
    for name, driving, k in (("drive", ahead, 1), ("motorway", MOTORWAY, 2)):
        segment = disturbed([true], 3 * seed + k, USUAL, driving, LENGTH)
        row[f"{name} lower"], row[f"{name} upper"] = _interval(segment)
    return row


def _values(parameters: Parameters) -> FloatArray:
    """(.., 5) by `NAMES`."""
    gap = parameters.time_gap(AT_SPEED)
    sizes = np.log(np.maximum(parameters.alpha, 1e-9)), np.log(np.maximum(parameters.beta, 1e-9))
    return np.stack([*sizes, gap, parameters.s0, parameters.delay], axis=-1)


def _interval(segment: Segment) -> tuple[FloatArray, FloatArray]:
    """Both ends (5,) from a window by itself."""
    drawn = window_posterior(segment, "II", ModelSpec(BEST)).drawn[0]
    gap = np.exp(drawn[:, 2])
    values = np.column_stack([drawn[:, :2], gap, drawn[:, 3:]])
    lower, upper = interval_ends(values, LEVEL)
    return lower, upper


def measure(cars: int) -> Iterator[Measurement]:
    """Run the study; the same number gives the same figures."""
    of_all = simulated(partial(car), cars)
    yield from figures(of_all)


def figures(of_all: dict[str, FloatArray]) -> Iterator[Measurement]:
    """The measurements of cars, as `car` returns them."""
    given = np.isfinite(of_all["truth"]).all(axis=1)
    of_all = {name: rows[given] for name, rows in of_all.items()}
    widths = {name: of_all[f"{name} upper"] - of_all[f"{name} lower"]
              for name in ("drive", "motorway")}  # fmt: skip
    ratios = widths["drive"] / widths["motorway"]
    cars = len(ratios)
    for k, name in enumerate(NAMES):
        yield Measurement(
            name=f"width of {name}, ratio", value=float(np.median(ratios[:, k])), unit="",
            at_most=PROMISED if k < 2 and cars >= MANY else None,
        )  # fmt: skip
        yield Measurement(
            name=f"predicted ratio of {name}", value=float(np.median(of_all["predicted"][:, k])),
            unit="",
        )  # fmt: skip
    for drive in widths:
        lower, upper = of_all[f"{drive} lower"], of_all[f"{drive} upper"]
        covers = (lower <= of_all["truth"]) & (of_all["truth"] <= upper)
        for k, name in enumerate(NAMES):
            limits = EACH if cars >= MANY and k < 3 else None
            yield covered(f"{drive}, {name}", covers[:, k], limits)


def main(arguments: list[str] | None = None) -> int:
    """Measure and print; the exit status is described above."""
    parser = argparse.ArgumentParser(prog="python -m bench.drive", description=__doc__)
    parser.add_argument("--cars", type=int, default=200, help="how many (200)")
    given = parser.parse_args(arguments)
    return show({f"{given.cars} cars": measured(partial(measure, given.cars))})


if __name__ == "__main__":
    sys.exit(main())
