"""Stretches of consecutive samples for which something holds."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike


@dataclass(frozen=True)
class Run:
    """Samples ``first`` to ``last``, both included."""

    first: int
    last: int

    def __len__(self) -> int:
        """How many samples it has."""
        return self.last - self.first + 1


def runs(mask: ArrayLike) -> tuple[Run, ...]:
    """The maximal stretches of true values in a boolean vector, in order."""
    padded = np.concatenate(([False], np.asarray(mask, bool), [False]))
    edges = np.flatnonzero(padded[1:] != padded[:-1])
    pairs = zip(edges[::2], edges[1::2], strict=True)
    return tuple(Run(int(first), int(after) - 1) for first, after in pairs)
