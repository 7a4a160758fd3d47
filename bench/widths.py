"""`python -m bench.widths`: how wide are the 90 % intervals on real recordings?

Two runs of OpenACC (`OPENACC_DIR` names the folder) are cut into windows of 300 s, one every 60 s,
and each is also taken as a whole. Of all followers and windows are printed the share whose interval
spans more than a factor of five, and the median width as a share of the estimate. The exit status
says whether β is so wide for at most 10 % of the followers in windows, and α and τ in whole runs.
"""

import argparse
import sys
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from tqdm import tqdm

from accpinn.inference.identifiability import WIDE
from accpinn.inference.intervals import intervals
from accpinn.methods.registry import METHODS
from accpinn.recordings.openacc import read
from accpinn.recordings.recording import Recording
from accpinn.segment.cut import DURATION, cut
from accpinn.segment.segment import Segment
from bench.coverage import LIKELIHOOD
from bench.run import SYMBOLS, openacc

RUNS = ("AstaZero/ASta_040719_platoon5.csv", "Casale/part7.csv")
EVERY = 60.0
"""From the start of a window to the next one's, in s."""
MOST = 0.1
"""Share of followers that may be wide, where there is a limit."""


@dataclass(frozen=True)
class Widths:
    """Of several sets of intervals; one entry for each of α, β, τ."""

    sets: int
    """Followers and windows."""
    wide: tuple[float, ...]
    """Share that spans more than a factor of `WIDE`."""
    median: tuple[float, ...]
    """Width as a share of the estimate."""


def windows(recording: Recording) -> Iterator[Segment]:
    """All windows of `DURATION` that start a multiple of `EVERY` after the first sample."""
    for start in np.arange(0.0, recording.duration - DURATION + 1e-6, EVERY):
        yield cut(recording, float(start))


def widths(segments: list[Segment]) -> Widths:
    """Of the intervals of all followers of the segments."""
    ends = []
    for segment in tqdm(segments, unit="window", file=sys.stderr):
        found = intervals(segment, METHODS[LIKELIHOOD].fit(segment, "II"))
        ends.append([one.values for one in (found.lower, found.upper, found.centre)])
    lower, upper, centre = np.concatenate(ends, axis=1)
    return Widths(
        len(lower),
        tuple((upper > WIDE * lower).mean(axis=0).tolist()),
        tuple(np.median((upper - lower) / centre, axis=0).tolist()),
    )


def text(rows: dict[str, Widths]) -> str:
    """A Markdown table."""
    symbols = ", ".join(SYMBOLS)
    lines = [
        f"| 90 % intervals | sets | factor above {WIDE:g}: {symbols} | median width: {symbols} |",
        "|---|---|---|---|",
    ]
    for name, one in rows.items():
        cells = (", ".join(f"{100 * x:.0f} %" for x in values) for values in (one.wide, one.median))
        lines.append(f"| {name} | {one.sets} | {' | '.join(cells)} |")
    return "\n".join(lines)


def main(arguments: list[str] | None = None) -> int:
    """Measure and print; see above for the exit status."""
    parser = argparse.ArgumentParser(prog="python -m bench.widths", description=__doc__)
    parser.parse_args(arguments)
    folder = openacc(parser)
    recordings = [read(folder / run) for run in RUNS]
    short = widths([segment for recording in recordings for segment in windows(recording)])
    long = widths([cut(run, duration=run.duration) for run in recordings])
    print(text({f"windows of {DURATION:g} s": short, "whole runs": long}))
    return int(not (short.wide[1] <= MOST and long.wide[0] <= MOST and long.wide[2] <= MOST))


if __name__ == "__main__":
    sys.exit(main())
