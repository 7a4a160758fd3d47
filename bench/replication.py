"""`python -m bench.replication`: do two windows of the same car say the same?

The recordings of two campaigns (`OPENACC_DIR` names their folder) are cut into disjoint windows,
and each window's parameters are estimated by itself. Windows belong to the same car where campaign,
name and distance setting are the same. Of all pairs of windows of the same car are counted

    overlap     the share whose two 90 % intervals overlap
    agreement   the share in which the difference of ln α (ln β, ln τ) may be zero: its 90 %
                interval, from posterior draws of both windows, holds zero. If a car's parameters
                were constant and the model complete, this would be 90 %

and of the windows the median width of the intervals, as a share of the estimate, and the share of
intervals that span more than a factor of five. For each car the between-window deviation of ln α,
ln β and ln τ beyond sampling error is estimated (`accpinn.study.windows`).
"""

import argparse
import json
import sys
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from itertools import combinations
from pathlib import Path

import numpy as np
from tqdm import tqdm

from accpinn.inference.identifiability import WIDE
from accpinn.inference.intervals import LEVEL, interval_ends
from accpinn.recordings.openacc import read
from accpinn.segment.cut import DURATION, cut, disjoint_windows
from accpinn.segment.segment import Segment
from accpinn.study.windows import RandomEffects, estimate, random_effects
from accpinn.units import FloatArray
from bench.run import SYMBOLS, openacc

CAMPAIGNS = ("AstaZero", "Casale")


@dataclass(frozen=True, eq=False)
class WindowOfCar:
    """What one window says about one car."""

    logs: FloatArray
    """(3,) ln of the estimates of α, β, τ; not finite where there is none."""
    errors: FloatArray
    """(3,) their standard errors."""
    ends: FloatArray
    """(2, 3) of the intervals of α, β, τ."""
    draws: FloatArray
    """(n, 3) from the posterior of ln α, ln β, ln τ, in random order."""


@dataclass(frozen=True)
class Car:
    """How far one car's parameters vary; one entry for each of α, β, τ."""

    campaign: str
    name: str
    distance_setting: str | None
    windows: int
    between: tuple[RandomEffects, ...]


@dataclass(frozen=True)
class ReplicationStudy:
    """All cars together; one entry for each of α, β, τ."""

    level: float
    duration: float
    """Of each window, in s."""
    windows: int
    """Followers and windows: how many sets of intervals there are."""
    pairs: int
    overlap: tuple[float, ...]
    agreement: tuple[float, ...]
    width: tuple[float, ...]
    wide: tuple[float, ...]
    cars: tuple[Car, ...]


Key = tuple[str, str, str | None]


def measure(folder: Path, duration: float = DURATION, level: float = LEVEL) -> ReplicationStudy:
    """Estimate from every window and compare those of the same car.

    Args:
        folder: holds a folder of recordings for each campaign.
        duration: of each window, in s.
        level: of the intervals.
    """
    cars: dict[Key, list[WindowOfCar]] = defaultdict(list)
    rng = np.random.default_rng(0)
    segments = list(_segments(folder, duration))
    for campaign, setting, segment in tqdm(segments, unit="window", file=sys.stderr):
        found = estimate(segment, level=level)
        for k, name in enumerate(segment.names[1:]):
            bounds = found.uncertainty.lower[k], found.uncertainty.upper[k]
            with np.errstate(divide="ignore"):
                logs = np.log(found.fit.parameters.values[k])
            cars[campaign, name, setting].append(
                WindowOfCar(
                    logs,
                    found.errors[k],
                    np.array([one.values for one in bounds]),
                    rng.permutation(np.log(found.uncertainty.draws.values[:, k])),
                )
            )
    return _study(cars, duration, level)


def _segments(folder: Path, duration: float) -> Iterator[tuple[str, str | None, Segment]]:
    """Campaign, distance setting and data of every complete window."""
    for campaign in CAMPAIGNS:
        for path in sorted((folder / campaign).glob("*.csv")):
            recording = read(path)
            for window in disjoint_windows(recording, duration):
                segment = cut(recording, window.start, window.duration)
                yield campaign, recording.distance_setting, segment


def _study(cars: dict[Key, list[WindowOfCar]], duration: float, level: float) -> ReplicationStudy:
    every = [window for windows in cars.values() for window in windows]
    pairs = [pair for windows in cars.values() for pair in combinations(windows, 2)]
    lower, upper = np.moveaxis(np.array([one.ends for one in every]), 1, 0)
    estimates = np.exp([one.logs for one in every])
    return ReplicationStudy(
        level,
        duration,
        len(every),
        len(pairs),
        _shares([_overlap(*pair) for pair in pairs]),
        _shares([_agree(*pair, level) for pair in pairs]),
        tuple(np.nanmedian((upper - lower) / estimates, axis=0).tolist()),
        tuple((upper / lower > WIDE).mean(axis=0).tolist()),
        tuple(
            Car(*key, len(windows), _between(windows, level))
            for key, windows in cars.items()
            if len(windows) > 1
        ),
    )


def _shares(yes: list[FloatArray]) -> tuple[float, ...]:
    return tuple(np.mean(yes, axis=0).tolist())


def _overlap(one: WindowOfCar, other: WindowOfCar) -> FloatArray:
    """(3,) whether the intervals overlap."""
    return np.asarray((one.ends[0] <= other.ends[1]) & (other.ends[0] <= one.ends[1]))


def _agree(one: WindowOfCar, other: WindowOfCar, level: float) -> FloatArray:
    """(3,) whether the interval of the difference holds zero."""
    low, high = interval_ends(one.draws - other.draws, level)
    return np.asarray((low <= 0.0) & (high >= 0.0))


def _between(windows: list[WindowOfCar], level: float) -> tuple[RandomEffects, ...]:
    logs, errors = (np.array([getattr(w, name) for w in windows]) for name in ("logs", "errors"))
    return tuple(random_effects(x, s, level) for x, s in zip(logs.T, errors.T, strict=True))


def text(study: ReplicationStudy) -> str:
    """A table for reading."""
    percent = f"{100 * study.level:.0f} %"
    lines = [
        f"{study.windows} sets of {percent} intervals from windows of {study.duration:g} s;"
        f" {study.pairs} pairs of windows of the same car",
        "",
        f"{'':52}" + "".join(f"{symbol:>8}" for symbol in SYMBOLS),
        *(
            f"{name:52}" + "".join(f"{100 * share:7.0f}%" for share in shares)
            for name, shares in (
                ("pairs whose intervals overlap", study.overlap),
                (f"pairs that agree ({percent} if parameters were constant)", study.agreement),
                ("median width, share of the estimate", study.width),
                (f"intervals that span more than a factor of {WIDE:g}", study.wide),
            )
        ),
        "",
        f"Deviation between windows beyond sampling error, of the logarithm, in %; its {percent}"
        " interval",
        f"{'':52}" + "".join(f"{symbol:>18}" for symbol in SYMBOLS),
    ]
    for car in study.cars:
        name = f"{car.campaign}, {car.name}, setting {car.distance_setting or 'unknown'}"
        cells = [
            f"{100 * one.deviation:.0f} ({100 * one.lower:.0f} to {100 * one.upper:.0f})"
            for one in car.between
        ]
        row = f"{name} ({car.windows} windows)"
        lines.append(f"{row:52}" + "".join(f"{cell:>18}" for cell in cells))
    middle = np.nanmedian([[one.deviation for one in car.between] for car in study.cars], axis=0)
    lines.append(f"{'median of the cars':52}" + "".join(f"{100 * one:>18.0f}" for one in middle))
    return "\n".join(lines)


def main(arguments: list[str] | None = None) -> int:
    """Measure and print."""
    parser = argparse.ArgumentParser(prog="python -m bench.replication", description=__doc__)
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.add_argument(
        "--duration", type=float, default=DURATION, help=f"of each window in s ({DURATION:g})"
    )
    parser.add_argument("--json", action="store_true", help="one JSON document")
    options = parser.parse_args(arguments)
    folder = openacc(parser)
    if not 20.0 <= options.duration <= 600.0:
        parser.error("--duration: give 20 to 600 s")
    study = measure(folder, options.duration)
    print(json.dumps(asdict(study), indent=2) if options.json else text(study))
    return 0


if __name__ == "__main__":
    sys.exit(main())
