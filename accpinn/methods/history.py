"""The progress of an iterative method, and its history, of bounded length however long it runs."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from accpinn.model.cthp import Parameters
from accpinn.units import FloatArray, Seconds

Checkpoint = dict[str, NDArray[np.generic]]
"""The state of a training by name, as plain arrays: all that it needs to continue."""

KEPT = 2000
"""When so many moments are stored, every second one is dropped and the spacing doubles."""

_SCALARS = ("iteration", "seconds", "total", "data", "physics", "initial")


@dataclass(frozen=True, eq=False)
class Progress:
    """One moment of a running estimation, handed to whoever watches."""

    phase: str
    """What runs: "start", "Adam", "L-BFGS", ..."""
    iteration: int
    iterations: int
    """How many are planned at most."""
    seconds: Seconds
    total: float
    data: float
    physics: float
    initial: float
    parameters: Parameters
    """(P,): P = 1 in Case I, M in Case II."""


@dataclass(frozen=True, eq=False)
class History:
    """How loss and parameters moved; K kept entries, oldest first."""

    iteration: FloatArray
    """(K,)"""
    seconds: FloatArray
    """(K,) since training began, without pauses."""
    total: FloatArray
    """(K,) Ψ, the weighted sum of the terms below."""
    data: FloatArray
    """(K,) Ψ_D."""
    physics: FloatArray
    """(K,) Ψ_F."""
    initial: FloatArray
    """(K,) Ψ_R, zero where the term is not used."""
    parameters: Parameters
    """(K, P): P = 1 in Case I, M in Case II."""


class Recorder:
    """Collects `Progress` into a `History`; the first and the latest moment are always in it."""

    def __init__(self) -> None:
        """Empty."""
        self._rows: list[tuple[float, ...]] = []
        self._tables: list[FloatArray] = []
        self._spacing, self._skipped = 1, 0
        self._latest_is_extra = False

    def add(self, progress: Progress) -> None:
        """Store a moment."""
        if self._latest_is_extra:
            self._rows.pop()
            self._tables.pop()
        self._rows.append(tuple(float(getattr(progress, name)) for name in _SCALARS))
        self._tables.append(progress.parameters.values)
        self._skipped += 1
        self._latest_is_extra = self._skipped < self._spacing and len(self._rows) > 1
        if not self._latest_is_extra:
            self._skipped = 0
        if len(self._rows) > KEPT:
            self._rows, self._tables = self._rows[::2], self._tables[::2]
            self._spacing *= 2

    def history(self) -> History:
        """The history so far."""
        columns = np.array(self._rows).reshape(-1, len(_SCALARS)).T
        parameters = Parameters.of(np.array(self._tables).reshape(len(self._tables), -1, 3))
        return History(**dict(zip(_SCALARS, columns, strict=True)), parameters=parameters)

    def state(self) -> Checkpoint:
        """For a checkpoint."""
        return {
            "history.rows": np.array(self._rows).reshape(-1, len(_SCALARS)),
            "history.tables": np.array(self._tables),
            "history.spacing": np.array([self._spacing, self._skipped, self._latest_is_extra]),
        }

    def restore(self, state: Checkpoint) -> None:
        """From a checkpoint."""
        self._rows = [tuple(float(v) for v in row) for row in state["history.rows"]]
        self._tables = [np.array(table, float) for table in state["history.tables"]]
        spacing, skipped, extra = (int(v) for v in state["history.spacing"])
        self._spacing, self._skipped, self._latest_is_extra = spacing, skipped, bool(extra)
