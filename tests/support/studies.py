"""Rows of a batch made for a test, and the folder of a study that holds them."""

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from accpinn.inference.coordinates import AT_SPEED
from accpinn.methods.registry import variant_of
from accpinn.recordings import Window
from accpinn.study import Analysis, Source
from accpinn.study.groups import POSTERIOR
from accpinn.study.rows import COLUMNS
from accpinn.study.studies import Computed, Request, written
from accpinn.units import FloatArray

REQUEST = Request(("runs",), ("least-squares",), 300.0)
S0, DELAY = 5.0, 0.5
"""Of every vehicle."""
ERRORS = (0.1, 0.1, 0.03, 0.5, 0.05)
"""Standard deviations of a window's posterior."""


def row(make: str | None, **changes: Any) -> dict[str, Any]:
    """One row; what is not given is unknown."""
    cells: dict[str, Any] = dict.fromkeys(column.name for column in COLUMNS)
    cells |= {"campaign": "X", "name": make, "make": make, "method": "pinn"}
    for name, value in (("alpha", 0.1), ("beta", 0.2), ("tau", 1.0)):
        cells |= {name: value, f"{name}_low": 0.9 * value, f"{name}_high": 1.1 * value}
    cells |= {"sha256": "a", "leader": 1, "vehicle": 2}
    return cells | {"mean_time_gap": 1.2, "p_l2_stable": 0.0, "p_linf_stable": 0.0} | changes


def posterior(cells: dict[str, Any]) -> FloatArray | None:
    """Draws (400, 5) about the row's α, β and τ; None where one is unknown."""
    values = [cells[name] for name in ("alpha", "beta", "tau")]
    if not all(values):
        return None
    alpha, beta, tau = values
    centre = [np.log(alpha), np.log(beta), np.log(tau + S0 / AT_SPEED), S0, DELAY]
    normal = np.random.default_rng(1).standard_normal((400, 5))
    return np.asarray(centre + ERRORS * (normal - normal.mean(axis=0)))


def rows(*given: dict[str, Any]) -> pd.DataFrame:
    """As `read_study` gives them, each of a window of its own."""
    frame = pd.DataFrame(given)
    frame["start"] = [
        60.0 * k if start is None else start for k, start in enumerate(frame["start"])
    ]
    frame[POSTERIOR] = pd.Series([posterior(cells) for cells in given], dtype=object)
    return frame


def analysis(
    start: float = 0.0, file: str = "a.csv", method: str = "least-squares", vehicle: int = 2,
    sha256: str = "",
) -> Analysis:  # fmt: skip
    """A window of 60 s of one follower."""
    source = Source(file, sha256 or f"sha256 of {file}", None, "data")
    asked = Analysis(source, (vehicle - 1, vehicle), (Window(start, start + 60),))
    return asked.with_method(*variant_of(method))


def write_study(folder: Path, *given: dict[str, Any]) -> Path:
    """The folder of a batch with these rows."""
    with written(folder, REQUEST) as study:
        for k, cells in enumerate(given):
            place = {"start": 60.0 * k if cells["start"] is None else cells["start"]}
            own = {name: cells[name] for name in ("sha256", "vehicle")}
            asked = analysis(**place, **own, method=cells["method"] or "least-squares")
            drawn = posterior(cells)
            posteriors = None if drawn is None else drawn[None]
            study.add(cells["file"] or "", Computed(asked, [cells | place], posteriors))
    return folder
