"""The string stability criteria in closed form, and the smallest headway that meets each.

The speed of a vehicle answers that of the one ahead by

    H(s) = (βs + α) / (s² + (ατ+β)s + α),    H(0) = 1

    L2          |H(jω)| < 1 for all ω > 0  ⇔  κ = α²τ² + 2αβτ - 2α ≥ 0   (the paper's form: > 0)
    L∞, paper   D = (ατ+β)² - 4α > 0, that is, real poles
    L∞, exact   ‖h‖₁ = 1  ⇔  h(t) ≥ 0 for all t  ⇔  βτ ≥ 1, or D ≥ 0 and β ≤ ατ

ατ ≥ β puts the zero -α/β beyond the slow pole, once the poles are real. With α and β kept, each
criterion holds from some headway on:

    L2          τ = 2 / (β + √(β² + 2α))
    L∞, paper   τ = (2√α - β) / α, or 0
    L∞, exact   τ = (2√α - β) / α where β² < α, otherwise 1/β

Source: Apostolakis and Ampountolas, IEEE TVT 2024, section III, for L2 and the paper's L∞; the
exact condition is that of a second-order response without a change of sign.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import isnan
from typing import Self

import numpy as np

from accpinn.errors import ParameterError
from accpinn.model.cthp import Parameters
from accpinn.units import FloatArray

MARGINAL = 1e-9
"""A criterion this close to its boundary, relatively, or a gain this little above 1, is marginal.

Far below what any estimate can resolve and far above what rounding does.
"""

LARGEST = 1e50
"""Parameters above this are refused, and those below its inverse are zero; products stay finite."""


@dataclass(frozen=True, eq=False)
class Laws:
    """The parameters of many vehicles as arrays that broadcast against each other."""

    alpha: FloatArray
    """In 1/s²."""
    beta: FloatArray
    """In 1/s."""
    tau: FloatArray
    """In s; any number where α = 0, as it has no effect there."""

    @classmethod
    def of(cls, parameters: Sequence[Parameters]) -> Self:
        """One entry a vehicle; see `checked`."""
        rows = [(law.alpha, law.beta, law.tau) for law in checked(parameters)]
        alpha, beta, tau = np.array(rows, float).T
        return cls(alpha, beta, tau)

    @property
    def spaced(self) -> FloatArray:
        """α where it is positive and 1 elsewhere: what to divide by before masking α = 0."""
        return np.where(self.alpha > 0, self.alpha, 1.0)


def checked(parameters: Sequence[Parameters]) -> tuple[Parameters, ...]:
    """The same with τ = 0 where α = 0, as it has no effect there.

    Raises:
        ParameterError: for values that are missing, negative or beyond all bounds.
    """
    if not parameters:
        raise ParameterError("There is no vehicle; give at least one set of α, β and τ.")
    return tuple(_checked(f"Parameter set {k}", law) for k, law in enumerate(parameters, 1))


def _checked(place: str, law: Parameters) -> Parameters:
    alpha, beta = _value(place, "α", law.alpha), _value(place, "β", law.beta)
    return Parameters(alpha, beta, _value(place, "τ", law.tau) if alpha else 0.0)


def _value(place: str, name: str, value: float) -> float:
    if isnan(value):
        raise ParameterError(f"{place}: {name} is missing; give α, β and τ as numbers.")
    if value < 0:
        raise ParameterError(
            f"{place}: {name} = {value:g} is negative, which the rational driving constraints rule"
            " out; give zero or more."
        )
    if value > LARGEST:
        raise ParameterError(
            f"{place}: {name} = {value:g} is beyond any vehicle; give α in 1/s², β in 1/s, τ in s."
        )
    return float(value) if value * LARGEST >= 1.0 else 0.0


def l2_criterion(laws: Laws) -> FloatArray:
    """κ in 1/s²; the paper calls the vehicle L2 string stable where it is positive."""
    return np.asarray(laws.alpha * l2_margin(laws) * 2.0 + 0.0)  # + 0 turns -0 into 0


def l2_margin(laws: Laws) -> FloatArray:
    """κ / 2α, free of units; where α = 0 its limit."""
    at = laws.alpha * laws.tau
    return np.asarray(laws.tau * (at / 2.0 + laws.beta) - 1.0)


def paper_criterion(laws: Laws) -> FloatArray:
    """D in 1/s²; the paper calls the vehicle L∞ string stable where it is positive."""
    root, total = 2.0 * np.sqrt(laws.alpha), laws.alpha * laws.tau + laws.beta
    return np.asarray((total - root) * (total + root))


def paper_margin(laws: Laws) -> FloatArray:
    """D / 4α, free of units; infinite where α = 0 < β, and 0 where both are."""
    bare = np.where(laws.beta > 0, np.inf, 0.0)
    return np.where(laws.alpha > 0, paper_criterion(laws) / (4.0 * laws.spaced), bare)


def exact_margin(laws: Laws) -> FloatArray:
    """How far τ is beyond the smallest exactly L∞ stable one, relative to that; inf where α = 0."""
    beyond = laws.tau / smallest_headway_exact(laws) - 1.0
    return np.where(laws.alpha > 0, beyond, np.inf)


def smallest_headway_l2(laws: Laws) -> FloatArray:
    """In s; where α = 0 the limit of small α."""
    total = laws.beta + np.hypot(laws.beta, np.sqrt(2.0 * laws.alpha))
    return np.asarray(2.0 / np.where(total > 0, total, np.nan))


def smallest_headway_paper(laws: Laws) -> FloatArray:
    """In s; where α = 0 the limit of small α."""
    return np.where(laws.alpha > 0, np.maximum(_real_poles_from(laws), 0.0), 0.0)


def smallest_headway_exact(laws: Laws) -> FloatArray:
    """In s; where α = 0 the limit of small α."""
    stiff = laws.beta >= np.sqrt(laws.alpha)
    inverse = 1.0 / np.where(stiff & (laws.beta > 0), laws.beta, np.nan)
    return np.where(stiff, inverse, _real_poles_from(laws))


def _real_poles_from(laws: Laws) -> FloatArray:
    """The τ at which D = 0."""
    return np.asarray((2.0 * np.sqrt(laws.alpha) - laws.beta) / laws.spaced)
