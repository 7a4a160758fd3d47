"""The course of a training, kept to a bounded length however long it runs."""

from typing import TYPE_CHECKING

import numpy as np

from accpinn.methods.fit import History, Progress
from accpinn.units import FloatArray

if TYPE_CHECKING:  # whoever only watches a training need not load torch
    from accpinn.methods.pinn.protocol import Checkpoint

KEPT = 2000
"""When so many moments are stored, every second one is dropped and the spacing doubles."""

_SCALARS = ("iteration", "seconds", "total", "data", "physics", "initial")


class Recorder:
    """Collects `Progress` into a `History`; the first and the latest moment are always there."""

    def __init__(self) -> None:
        """Empty."""
        self._rows: list[tuple[float, ...]] = []
        self._tables: list[FloatArray] = []
        self._spacing, self._skipped = 1, 0
        self._latest_is_extra = False

    def add(self, progress: Progress) -> None:
        """Take note of a moment."""
        if self._latest_is_extra:
            self._rows.pop()
            self._tables.pop()
        self._rows.append(tuple(float(getattr(progress, name)) for name in _SCALARS))
        self._tables.append(progress.parameters.copy())
        self._skipped += 1
        self._latest_is_extra = self._skipped < self._spacing and len(self._rows) > 1
        if not self._latest_is_extra:
            self._skipped = 0
        if len(self._rows) > KEPT:
            self._rows, self._tables = self._rows[::2], self._tables[::2]
            self._spacing *= 2

    def history(self) -> History:
        """What was kept so far."""
        columns = np.array(self._rows).reshape(-1, len(_SCALARS)).T
        tables = np.array(self._tables)
        return History(**dict(zip(_SCALARS, columns, strict=True)), parameters=tables)

    def state(self) -> "Checkpoint":
        """For a checkpoint."""
        return {
            "history.rows": np.array(self._rows).reshape(-1, len(_SCALARS)),
            "history.tables": np.array(self._tables),
            "history.spacing": np.array([self._spacing, self._skipped, self._latest_is_extra]),
        }

    def restore(self, state: "Checkpoint") -> None:
        """From a checkpoint."""
        self._rows = [tuple(float(v) for v in row) for row in state["history.rows"]]
        self._tables = [np.array(table, float) for table in state["history.tables"]]
        spacing, skipped, extra = (int(v) for v in state["history.spacing"])
        self._spacing, self._skipped, self._latest_is_extra = spacing, skipped, bool(extra)
