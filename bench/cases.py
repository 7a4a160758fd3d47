"""The real segments that are timed; recordings are found through OPENACC_DIR."""

import os
from dataclasses import dataclass
from pathlib import Path

from accpinn.model.cthp import Case
from accpinn.recordings.openacc import read
from accpinn.segment.cut import cut
from accpinn.segment.segment import Segment


@dataclass(frozen=True)
class BenchCase:
    """A segment to train on, and how much faster than the paper's recipe it must be."""

    name: str
    file: str
    start: float
    duration: float
    case: Case
    least_ratio: float | None

    def segment(self) -> Segment:
        """Read and cut it."""
        return cut(read(folder() / self.file), self.start, self.duration)


CASES = (
    BenchCase("Casale 0-300 s, M = 1", "Casale/part7.csv", 0, 300, "II", 300),
    BenchCase(
        "AstaZero 320-620 s, M = 4, Case II",
        "AstaZero/ASta_040719_platoon5.csv",
        320,
        300,
        "II",
        400,
    ),
    BenchCase(
        "AstaZero 320-620 s, M = 4, Case I", "AstaZero/ASta_040719_platoon5.csv", 320, 300, "I", 400
    ),
    BenchCase("Casale whole, M = 1", "Casale/part7.csv", 0, 1523, "II", None),
)


def folder() -> Path:
    """Where the recordings are."""
    named = os.environ.get("OPENACC_DIR")
    if not named:
        raise SystemExit(
            "error: OPENACC_DIR is not set; name the folder of OpenACC recordings, which has"
            " Casale/part7.csv and AstaZero/ASta_040719_platoon5.csv."
        )
    return Path(named)
