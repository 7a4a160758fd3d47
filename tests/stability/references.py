"""Reference systems for string stability, and an integral of their impulse responses.

Where the parameters come from: Apostolakis and Ampountolas, IEEE TVT 2024; the rows of Table III
with its YES/NO columns, two of Table II (NO twice), and experiment 1 of Table I (Ispra-Casale).

‖h‖₁ is computed without the closed form: h(t) = C exp(At) B by `scipy.linalg.expm`, its changes of
sign by brentq, |h| integrated between them by `scipy.integrate.quad` (epsabs 1e-13) until exp(At)
has fallen to 1e-15.
"""

from functools import partial
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.integrate import quad
from scipy.linalg import expm
from scipy.optimize import brentq

from accpinn.model.cthp import Parameters


class Reference(NamedTuple):
    """One vehicle, and the paper's verdicts."""

    name: str
    vehicle: Parameters
    l2: bool = False
    linf: bool = False


TABLE = (
    Reference("AstaZero 1, Audi A6", Parameters(0.0612, 0.1200, 1.19)),
    Reference("AstaZero 2, BMW X5", Parameters(0.1000, 0.1470, 1.17)),
    Reference("AstaZero 3, Mercedes", Parameters(0.0766, 0.2220, 1.16)),
    Reference("AstaZero 4, Tesla", Parameters(0.0409, 0.4450, 1.16), linf=True),
    Reference("AstaZero, average", Parameters(0.0700, 0.2340, 1.17)),
    Reference("Vicolungo 1, Ford S-Max", Parameters(0.0766, 0.1660, 1.01)),
    Reference("Vicolungo 2, Peugeot 5008", Parameters(0.1760, 0.3921, 1.00)),
    Reference("Vicolungo 3, Kia Niro", Parameters(0.0705, 0.1930, 1.13)),
    Reference("Vicolungo, average", Parameters(0.1077, 0.2504, 1.05)),
    Reference("Table II, first", Parameters(0.0627, 0.2630, 1.17)),
    Reference("Table II, second", Parameters(0.0581, 0.3010, 1.04)),
    Reference("Casale, experiment 1", Parameters(0.0104, 0.0718, 1.52)),
)


def impulse(vehicle: Parameters, time: ArrayLike) -> Any:
    """h(t) = C exp(At) B in the controllable canonical form."""
    a = np.array([[0.0, 1.0], [-vehicle.alpha, -vehicle.alpha * vehicle.tau - vehicle.beta]])
    return expm(a * np.asarray(time)[..., None, None])[..., 1] @ [vehicle.alpha, vehicle.beta]


def integral_of_magnitude(vehicle: Parameters) -> float:
    """∫|h| dt by quadrature between the changes of sign."""
    a = np.array([[0.0, 1.0], [-vehicle.alpha, -vehicle.alpha * vehicle.tau - vehicle.beta]])
    end = 1.0
    while np.abs(expm(a * end)).max() > 1e-15:
        end *= 2.0
    time = np.concatenate([[0.0], np.geomspace(end * 1e-6, end, 200), np.linspace(0, end, 1500)])
    time = np.unique(time)
    values = impulse(vehicle, time)
    changes = np.flatnonzero((values[:-1] * values[1:] < 0) & (np.abs(values[:-1]) > 1e-15))
    roots = [brentq(partial(impulse, vehicle), *time[k : k + 2], xtol=1e-14) for k in changes]
    # More cuts, so that every piece is smooth on its own scale.
    cuts = np.unique(np.concatenate([roots, [0.0], np.geomspace(end * 1e-5, end, 40)]))
    pieces = [
        quad(partial(impulse, vehicle), low, high, epsabs=1e-13, epsrel=1e-12)[0]
        for low, high in pairwise(cuts)
    ]
    return float(np.abs(pieces).sum())
