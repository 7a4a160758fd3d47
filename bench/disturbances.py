"""`python -m bench.disturbances`: how do real followers' disturbances differ?

The likelihood has weak priors on disturbance and noise. What they stand for is measured on the
whole runs of OpenACC (`OPENACC_DIR` names the folder): the unknowns of each follower, from its
likelihood without those priors, and how much their logarithms differ between followers beyond
sampling error (random effects, 90 % interval). Beside it stands the prior. The exit status says
whether the priors of the disturbance, s, T and T₂, are as wide as followers may differ: none is
below the lower end of the interval.

A follower counts whose likelihood has a maximum there: without priors, H - W is its curvature and
(H - W)⁻¹ (Hz - Wc) the place, where H and z are those with priors of precision W and centre c.
"""

import argparse
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from tqdm import tqdm

from accpinn.errors import RecordingError
from accpinn.methods.likelihood import Maximum
from accpinn.methods.maximum_likelihood import DISTURBANCE, maxima_of
from accpinn.methods.state_space import COMMON
from accpinn.recordings.openacc import read
from accpinn.segment.cut import cut
from accpinn.segment.segment import Segment
from accpinn.study.windows import RandomEffects, random_effects
from accpinn.units import FloatArray
from bench.run import openacc

UNITS = ("m/s²", "s", "s", "m", "m/s", "m/s²")
"""Of the unknowns after α, ατ, β."""


@dataclass(frozen=True)
class Unknown:
    """How one unknown differs between followers, and its prior."""

    name: str
    unit: str
    found: RandomEffects
    """Of its logarithm."""
    centre: float
    spread: float

    def __str__(self) -> str:
        """A row of the table."""
        found = self.found
        return (
            f"| {self.name} | {found.windows} | {np.exp(found.mean):.2g} {self.unit}"
            f" | {found.deviation:.2f} ({found.lower:.2f}–{found.upper:.2f})"
            f" | {self.centre:g} {self.unit} | {self.spread:g} |"
        )


def whole_runs(folder: Path) -> Iterator[Segment]:
    """Every run that can be read, from its first sample to its last."""
    for file in sorted(folder.glob("*/*.csv")):
        try:
            recording = read(file)
        except RecordingError:
            continue
        yield cut(recording, duration=recording.duration, allow_missing=True)


def without_prior(maximum: Maximum) -> tuple[FloatArray, FloatArray]:
    """The unknowns' coordinates (P,) and their standard errors; nan where only the prior says it.

    An unknown at a bound, where rows and columns of the curvature are zero, counts as known.
    """
    precision = np.array([0.0 if one.spread is None else one.spread**-2 for one in COMMON])
    centre = np.array([one.centre for one in COMMON])
    free = np.diag(maximum.curvature) > 0
    z, curvature = maximum.coordinates[free], maximum.curvature[np.ix_(free, free)]
    bare = curvature - np.diag(precision[free])
    values, errors = np.full((2, len(free)), np.nan)
    if np.linalg.eigvalsh(bare).min() > 0:
        values[free] = np.linalg.solve(bare, curvature @ z - precision[free] * centre[free])
        errors[free] = np.sqrt(np.diag(np.linalg.inv(bare)))
    return values, errors


def measure(segments: list[Segment]) -> tuple[Unknown, ...]:
    """All unknowns but α, ατ and β, over all followers."""
    maxima = [
        one
        for segment in tqdm(segments, unit="run", file=sys.stderr)
        for one in maxima_of(segment, "II")
    ]
    values, errors = np.moveaxis(np.array([without_prior(one) for one in maxima]), 1, 0)
    return tuple(
        Unknown(one.name, unit, random_effects(values[:, k], errors[:, k]), one.start, one.spread)
        for k, (one, unit) in enumerate(zip(COMMON[3:], UNITS, strict=True), start=3)
        if one.spread is not None
    )


def main(arguments: list[str] | None = None) -> int:
    """Measure and print; see above for the exit status."""
    parser = argparse.ArgumentParser(prog="python -m bench.disturbances", description=__doc__)
    parser.parse_args(arguments)
    found = measure(list(whole_runs(openacc(parser))))
    print(
        "| unknown | followers | mean | deviation of its logarithm | prior's centre | deviation |"
    )
    print(6 * "|---" + "|")
    for one in found:
        print(one)
    disturbance = found[: DISTURBANCE.stop - DISTURBANCE.start]
    return int(not all(one.found.lower <= one.spread for one in disturbance))


if __name__ == "__main__":
    sys.exit(main())
