"""Search for the largest evidence of a follower's splines (see `evidence`), round by round.

An ascent by the gradient with a curvature that BFGS corrects, first with coarse knots, then with
fine ones; at its end the curvature is that of second differences.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from accpinn.methods.likelihood import Maximum, corrected_curvature, not_held, scoring_step
from accpinn.methods.pinn.evidence import Evidence
from accpinn.methods.series import Series
from accpinn.units import FloatArray, Mask, Seconds

LEAST_START = 0.05
"""Share of a typical α, ατ, β: from zero a search in logarithms would not move."""
DIFFERENCE = 1e-3
"""Of a coordinate, for its slope: small against its deviation, large against rounding."""
SECOND_DIFFERENCE = 0.02
"""The same for the curvature at the end."""
CLOSE = 1e-4
"""The ascent ends when a full step would gain less than this in log evidence."""
CLOSE_ENOUGH = 1e-2
"""The same for the coarse knots, as the fine ones go on from there."""
ROUNDS = 60
LONGEST_STEP = 1.0
"""In ln of an unknown."""
LEAST_CURVATURE = 0.1
"""Of the criterion in any direction, where it is flat or curved upwards."""
COARSE_KNOTS: Seconds = 1.0
"""At half the cost; the maximum is then within a tenth of a standard error."""


class Ascent:
    """The ascent of one group's criterion, a round at a time.

    BFGS, which begins with the diagonal of the curvature. Where the end need not be exact, slopes
    are one-sided differences at half the cost. Elsewhere these would not do: α and ατ vary almost
    together, and the error of their slopes would move them by a fifth of a standard error.
    """

    def __init__(
        self,
        criterion: "Evidence",
        group: int,
        z: FloatArray,
        moving: Mask | None = None,
        curvature: FloatArray | None = None,
        close: float = CLOSE,
    ) -> None:
        """At coordinates z (P,).

        Args:
            criterion: to be made as large as possible.
            group: of its groups.
            z: (P,)
            moving: (P,) the coordinates that are sought; all by default.
            curvature: (P, P) of the criterion, where it is known from a similar one.
            close: a full step that would gain less ends the ascent.
        """
        self.criterion, self._group = criterion, group
        self._moving = np.ones(len(z), bool) if moving is None else moving
        self.coordinates = np.clip(z, criterion.lower, criterion.upper)
        self.value = self._values(self.coordinates[None])[0]
        self._close = close
        self._gradient = self._slopes()
        self.curvature = self._diagonal() if curvature is None else curvature
        self._damping, self.rounds, self.converged, self.ended = 1e-2, 0, False, False

    def advance(self) -> None:
        """One round; nothing once it has ended."""
        while not self.ended:
            here, gradient = self.coordinates, self._gradient
            step = scoring_step(self.curvature, gradient, self._free(), self._damping, LONGEST_STEP)
            if gradient @ step < self._close and self._damping < 1.0:
                self.converged = self.ended = True
                return
            trial = np.clip(here + step, self.criterion.lower, self.criterion.upper)
            value = self._values(trial[None])[0]
            if not value > self.value - 1e-9:
                self._damping *= 8.0
                self.ended = self._damping > 1e8
                continue
            self.coordinates, self.value = trial, value
            self._gradient = self._slopes()
            fall = gradient - self._gradient
            self.curvature = corrected_curvature(self.curvature, trial - here, fall)
            self._damping = max(self._damping / 8.0, 1e-9)
            self.rounds += 1
            self.ended = self.rounds >= ROUNDS
            return

    def loss(self) -> FloatArray:
        """(2,) half the squared errors and half the squared residuals, whitened, at ŵ."""
        return self.criterion.loss(self.coordinates, self._group)

    def state(self) -> dict[str, FloatArray]:
        """All that the ascent needs to go on."""
        return {
            "coordinates": self.coordinates,
            "curvature": self.curvature,
            "search": np.array(
                [self._damping, self.rounds, self.converged, self.ended, self._close], float
            ),
        }

    @classmethod
    def restored(
        cls, criterion: "Evidence", group: int, state: Mapping[str, NDArray[Any]]
    ) -> "Ascent":
        """The ascent that gave ``state``."""
        z, curvature = (np.array(state[name], float) for name in ("coordinates", "curvature"))
        damping, rounds, converged, ended, close = np.array(state["search"], float).tolist()
        found = cls(criterion, group, z, curvature=curvature, close=close)
        found._damping, found.rounds = float(damping), int(rounds)
        found.converged, found.ended = bool(converged), bool(ended)
        return found

    def finish(self) -> Maximum:
        """Ascend to the end, and take the curvature there from second differences."""
        while not self.ended:
            self.advance()
        z, self.curvature = self.coordinates, self._curvature_here()
        return Maximum(
            "cthp",
            z,
            float(self.value),
            float(self.value - self.criterion.log_prior(z)),
            self.curvature,
            self.converged,
            self.rounds,
        )

    def _free(self) -> Mask:
        free = not_held(self.criterion, self.coordinates, self._gradient)
        return np.asarray(free & self._moving)

    def _values(self, z: FloatArray) -> FloatArray:
        found = self.criterion.log_likelihood(z, np.full(len(z), self._group))
        return np.asarray(found + self.criterion.log_prior(z))

    def _slopes(self) -> FloatArray:
        """(P,) the gradient here; 0 along coordinates that do not move."""
        slopes = np.zeros(len(self.coordinates))
        moves = DIFFERENCE * np.eye(len(slopes))[self._moving]
        above = self._values(self.coordinates + moves)
        if self._close > CLOSE:
            slopes[self._moving] = (above - self.value) / DIFFERENCE
        else:
            below = self._values(self.coordinates - moves)
            slopes[self._moving] = (above - below) / (2 * DIFFERENCE)
        return slopes

    def _diagonal(self) -> FloatArray:
        """(P, P) minus the second derivatives along each coordinate, at least `LEAST_CURVATURE`."""
        moves = SECOND_DIFFERENCE * np.eye(len(self.coordinates))
        both = self._values(self.coordinates + moves) + self._values(self.coordinates - moves)
        second = (both - 2 * self.value) / SECOND_DIFFERENCE**2
        return np.asarray(np.diag(np.maximum(-second, LEAST_CURVATURE)))

    def _curvature_here(self) -> FloatArray:
        """(P, P) minus the second derivatives; 0 where a bound holds a coordinate.

        Directions in which the criterion is not curved downwards get `LEAST_CURVATURE`.
        """
        free = np.flatnonzero(self._free())
        moves = SECOND_DIFFERENCE * np.eye(len(self.coordinates))[free]
        rows, columns = np.triu_indices(len(free))
        pairs = moves[rows] + moves[columns]
        single = np.concatenate([moves, -moves])
        values = self._values(self.coordinates + np.concatenate([pairs, -pairs, single]))
        count = len(rows)
        both = values[:count] + values[count : 2 * count]
        one = values[2 * count :].reshape(2, -1).sum(axis=0)
        second = both - one[rows] - one[columns] + 2 * self.value
        found = np.zeros((len(free), len(free)))
        found[rows, columns] = found[columns, rows] = -second / (2 * SECOND_DIFFERENCE**2)
        sizes, directions = np.linalg.eigh(found)
        curvature = np.zeros((len(self.coordinates),) * 2)
        curvature[np.ix_(free, free)] = (
            directions * np.maximum(sizes, LEAST_CURVATURE)
        ) @ directions.T
        return curvature


def begin(series: Series, theta: FloatArray) -> list[Ascent]:
    """An ascent with coarse knots for each group, from parameters θ (G, 3)."""
    criterion = Evidence(series, COARSE_KNOTS)
    found = []
    for group, start in enumerate(theta):
        z = criterion.start.copy()
        z[:3] = np.log(np.maximum(start, LEAST_START * np.exp(z[:3])))
        found.append(Ascent(criterion, group, z, close=CLOSE_ENOUGH))
    return found


def refine(criterion: "Evidence", coarse: Ascent, group: int) -> Ascent:
    """The ascent that goes on where a coarse one ended."""
    return Ascent(criterion, group, coarse.coordinates, curvature=coarse.curvature)


def maximise_evidence(series: Series, theta: FloatArray) -> tuple[Maximum, ...]:
    """The maximum of each group's evidence, first with coarse knots, then with fine ones.

    Args:
        series: G groups.
        theta: (G, 3) parameters to begin with, such as those of least squares.
    """
    criterion = Evidence(series)
    found = []
    for group, ascent in enumerate(begin(series, theta)):
        while not ascent.ended:
            ascent.advance()
        found.append(refine(criterion, ascent, group).finish())
    return tuple(found)
