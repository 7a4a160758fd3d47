"""Rows of a batch made for a test, and the folder of a study that holds them."""

from pathlib import Path
from typing import Any

import pandas as pd

from accpinn.study.journal import Journal
from accpinn.study.rows import COLUMNS


def row(make: str | None, **changes: Any) -> dict[str, Any]:
    """One row; what is not given is unknown."""
    found: dict[str, Any] = dict.fromkeys(column.name for column in COLUMNS)
    found |= {"campaign": "X", "name": make, "make": make, "method": "maximum-likelihood"}
    for name, value in (("alpha", 0.1), ("beta", 0.2), ("tau", 1.0)):
        found |= {name: value, f"{name}_low": 0.9 * value, f"{name}_high": 1.1 * value}
        found[f"{name}_error"] = 0.05
    return found | {"mean_time_gap": 1.2, "p_l2_stable": 0.0, "p_linf_stable": 0.0} | changes


def rows(*given: dict[str, Any]) -> pd.DataFrame:
    """As `read_study` gives them."""
    return pd.DataFrame(given)


def write_study(folder: Path, *given: dict[str, Any]) -> Path:
    """The folder of a batch with these rows."""
    with Journal(folder, {"window": 300.0, "case": "II"}) as journal:
        for k, one in enumerate(given):
            journal.add("result", str(k), rows=[one])
    return folder
