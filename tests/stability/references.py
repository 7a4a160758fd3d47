"""Reference systems for string stability, with numbers from methods of their own.

Where the parameters come from: Apostolakis and Ampountolas, IEEE TVT 2024; the rows of Table III
with its YES/NO columns, and experiment 1 of Table I (Ispra-Casale).

Where the numbers come from: none of the closed forms of `accpinn.stability` is used.

- peak: |G(jω)| of a `control.TransferFunction`, its maximum on a grid of 4000 frequencies, then by
  `scipy.optimize.minimize_scalar` between the neighbours (xatol 1e-12);
- crossover: `scipy.optimize.brentq` on |G(jω)| - 1 above the peak (xtol 1e-14);
- ‖h‖₁: h(t) = C exp(At) B by `scipy.linalg.expm`, its changes of sign by brentq, |h| integrated
  between them by `scipy.integrate.quad` (epsabs 1e-13) until exp(At) has fallen to 1e-15.

``python -m tests.stability.references`` computes the table again and prints it; a test compares.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.integrate import quad
from scipy.linalg import expm
from scipy.optimize import brentq, minimize_scalar

from accpinn.model.cthp import Parameters


@dataclass(frozen=True)
class Reference:
    """One vehicle, what the paper says of it, and what independent methods find."""

    name: str
    vehicle: Parameters
    paper_l2: bool
    paper_linf: bool
    gain: float
    db: float
    omega: float
    crossover: float
    linf_gain: float


_TABLE = """
AstaZero 1, Audi A6        0.0612 0.1200 1.19 NO  NO  1.506802 3.561124 0.213962 0.315622 1.824512
AstaZero 2, BMW X5         0.1000 0.1470 1.17 NO  NO  1.411510 2.993677 0.265659 0.389760 1.702492
AstaZero 3, Mercedes       0.0766 0.2220 1.16 NO  NO  1.229709 1.796044 0.211140 0.325350 1.421033
AstaZero 4, Tesla          0.0409 0.4450 1.16 NO  YES 1.039864 0.339532 0.105906 0.193194 1.095430
AstaZero, average          0.0700 0.2340 1.17 NO  NO  1.204053 1.612909 0.197455 0.308161 1.378697
Vicolungo 1, Ford S-Max    0.0766 0.1660 1.01 NO  NO  1.408249 2.973587 0.232237 0.348610 1.680197
Vicolungo 2, Peugeot 5008  0.1760 0.3921 1.00 NO  NO  1.111555 0.918620 0.277213 0.427791 1.247848
Vicolungo 3, Kia Niro      0.0705 0.1930 1.13 NO  NO  1.289745 2.210079 0.211005 0.322340 1.508879
Vicolungo, average         0.1077 0.2504 1.05 NO  NO  1.227402 1.779737 0.249898 0.382072 1.422038
Casale, experiment 1       0.0104 0.0718 1.52 NO  NO  1.492357 3.477451 0.087862 0.135204 1.776276
"""
"""Vehicle; α, β, τ; the paper's L₂ and L∞; peak gain, dB and ω; crossover ω; ‖h‖₁."""


def _references() -> Iterator[Reference]:
    for line in _TABLE.strip().splitlines():
        *name, alpha, beta, tau, l2, linf, gain, db, omega, edge, area = line.split()
        vehicle = Parameters(float(alpha), float(beta), float(tau))
        numbers = map(float, (gain, db, omega, edge, area))
        yield Reference(" ".join(name), vehicle, l2 == "YES", linf == "YES", *numbers)


TABLE = tuple(_references())


def transfer_function(vehicle: Parameters) -> Callable[[Any], Any]:
    """G(s), by python-control."""
    from control import TransferFunction

    total = vehicle.alpha * vehicle.tau + vehicle.beta
    return TransferFunction([vehicle.beta, vehicle.alpha], [1.0, total, vehicle.alpha])


def peak(vehicle: Parameters) -> tuple[float, float]:
    """Gain and frequency [rad/s] of the largest |G(jω)|."""
    system, grid = transfer_function(vehicle), np.geomspace(1e-3, 10.0, 4000)
    best = int(np.argmax(abs(system(1j * grid))))
    found = minimize_scalar(
        lambda omega: -abs(system(1j * omega)),
        bounds=(grid[max(best - 1, 0)], grid[best + 1]),
        method="bounded",
        options={"xatol": 1e-12},
    )
    return float(-found.fun), float(found.x)


def crossover(vehicle: Parameters, above: float) -> float:
    """The frequency [rad/s] above the peak's at which |G(jω)| = 1."""
    system = transfer_function(vehicle)
    return float(brentq(lambda omega: abs(system(1j * omega)) - 1.0, above, 100.0, xtol=1e-14))


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


def row_of(vehicle: Parameters) -> tuple[float, float, float, float, float]:
    """Peak gain, dB, ω, crossover and ‖h‖₁."""
    gain, omega = peak(vehicle)
    edge, area = crossover(vehicle, omega), integral_of_magnitude(vehicle)
    return gain, 20 * np.log10(gain), omega, edge, area


if __name__ == "__main__":
    for reference in TABLE:
        print(reference.name, *(f"{value:.6f}" for value in row_of(reference.vehicle)))
