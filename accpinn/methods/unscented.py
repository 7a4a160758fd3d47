"""The scaled unscented transform: mean and covariance carried through any function by a few points.

For a normal x of n components with covariance L Lᵀ the 2n+1 points are the mean and the mean plus
or minus sqrt(n + λ) times each column of L, λ = spread² n - n. All but the first weigh
1 / (2(n + λ)); the first weighs λ / (n + λ) in means, and 1 - spread² + kurtosis more in
covariances. A linear function gets its exact mean and covariance.

Source: Julier, Proceedings of the American Control Conference 2002, 4555-4559.
"""

from dataclasses import dataclass

import numpy as np

from accpinn.units import FloatArray

SPREAD = 1.0
"""With 1 the points lie sqrt(n) deviations out and no weight is negative."""
KURTOSIS = 2.0
"""The value for normal distributions."""


@dataclass(frozen=True, eq=False)
class Moments:
    """Of a function's values."""

    mean: FloatArray
    """(.., m)"""
    deviations: FloatArray
    """(.., 2n+1, m) the values at the points less the mean."""
    weighted: FloatArray
    """(.., m, 2n+1) the same times the covariance's weights, transposed."""

    @property
    def covariance(self) -> FloatArray:
        """(.., m, m)."""
        return np.asarray(self.weighted @ self.deviations)


class Unscented:
    """The transform for n components, for a stack of distributions at once."""

    def __init__(self, size: int) -> None:
        """The transform of n = ``size`` components."""
        total = SPREAD**2 * size
        self._reach = np.sqrt(total)
        self._means = np.full(2 * size + 1, 0.5 / total)
        self._means[0] = 1 - size / total
        self._squares = self._means.copy()
        self._squares[0] += 1 - SPREAD**2 + KURTOSIS

    def points(self, mean: FloatArray, covariance: FloatArray) -> FloatArray:
        """(.., 2n+1, n) for mean (.., n) and covariance (.., n, n)."""
        centre = mean[..., None, :]
        columns = self._reach * np.linalg.cholesky(covariance).swapaxes(-1, -2)
        return np.concatenate([centre, centre + columns, centre - columns], axis=-2)

    def moments(self, values: FloatArray) -> Moments:
        """Of the values (.., 2n+1, m) at the points."""
        mean = self._means @ values
        deviations = values - mean[..., None, :]
        return Moments(mean, deviations, deviations.swapaxes(-1, -2) * self._squares)


def symmetric(matrix: FloatArray) -> FloatArray:
    """What rounding has made unequal, made equal again."""
    return np.asarray((matrix + matrix.swapaxes(-1, -2)) / 2)
