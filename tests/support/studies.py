"""Rows of a batch made for a test, and the folder of a study that holds them."""

from pathlib import Path
from typing import Any

import pandas as pd

from accpinn.recordings.recording import Window
from accpinn.study.analysis import Analysis, Source
from accpinn.study.rows import COLUMNS
from accpinn.study.studies import Request, Study

REQUEST = Request(("runs",), ("least-squares",), 300.0)


def row(make: str | None, **changes: Any) -> dict[str, Any]:
    """One row; what is not given is unknown."""
    cells: dict[str, Any] = dict.fromkeys(column.name for column in COLUMNS)
    cells |= {"campaign": "X", "name": make, "make": make, "method": "maximum-likelihood"}
    for name, value in (("alpha", 0.1), ("beta", 0.2), ("tau", 1.0)):
        cells |= {name: value, f"{name}_low": 0.9 * value, f"{name}_high": 1.1 * value}
        cells[f"{name}_error"] = 0.05
    return cells | {"mean_time_gap": 1.2, "p_l2_stable": 0.0, "p_linf_stable": 0.0} | changes


def rows(*given: dict[str, Any]) -> pd.DataFrame:
    """As `read_study` gives them."""
    return pd.DataFrame(given)


def analysis(start: float = 0.0, file: str = "a.csv", method: str = "least-squares") -> Analysis:
    """A window of 60 s of the first follower."""
    source = Source(file, f"sha256 of {file}", None, "data")
    return Analysis(source, (1, 2), (Window(start, start + 60),), method=method)


def write_study(folder: Path, *given: dict[str, Any]) -> Path:
    """The folder of a batch with these rows."""
    with Study(folder, REQUEST) as study:
        for k, cells in enumerate(given):
            asked = analysis(60.0 * k, method=cells["method"] or "least-squares")
            study.add_rows(asked, cells["file"] or "", [cells])
    return folder
