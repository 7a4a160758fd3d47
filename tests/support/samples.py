"""The recordings of `sample_data` as segments, with the parameters they were made from."""

from dataclasses import dataclass
from functools import cache
from pathlib import Path

import pandas as pd

from accpinn import Segment, cut
from accpinn.recordings.openacc import read
from accpinn.recordings.synthetic import load_truth, truth_path
from accpinn.units import FloatArray

FOLDER = Path(__file__).parents[2] / "sample_data"
NOISE_FREE = "synthetic_paper_study_noise_free"
NOISY = "synthetic_paper_study"
PLATOON, VICOLUNGO = "synthetic_astazero_like", "synthetic_vicolungo_like"


@dataclass(frozen=True, eq=False)
class Sample:
    segment: Segment
    truth: FloatArray
    """(M, 3) α, β, τ."""


@cache
def sample(name: str, duration: float = 300.0) -> Sample:
    """The first of it, so many seconds."""
    path = FOLDER / f"{name}.csv"
    return Sample(cut(read(path), 0, duration), load_truth(truth_path(path)).parameters.values)


def frame(samples: int = 620, first: int = 0) -> pd.DataFrame:
    """Samples of the noisy study as columns of a file, on which a method is soon done."""
    return pd.read_csv(FOLDER / f"{NOISY}.csv", skiprows=5).iloc[first : first + samples]
