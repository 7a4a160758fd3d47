"""The steady motion of a platoon behind a sinusoid, once the transient is over, in closed form.

    v_0(t) - v = A sin ωt,   v_k(t) - v = A |H_1 .. H_k| sin(ωt + φ_1 + .. + φ_k)

with H_i = H_i(jω) and φ_i = arg H_i. The speed v is that of the equilibrium. A vehicle whose own
motion does not decay never gets there, and neither do those behind it.
"""

import numpy as np
from numpy.typing import NDArray

from accpinn.model.cthp import Parameters
from accpinn.stability.criteria import response, slowest_rate
from accpinn.units import FloatArray


def steady_gains(parameters: Parameters, omega: FloatArray) -> NDArray[np.complex128]:
    """(M, K) H_i(jω) of M vehicles at (K,) frequencies in rad/s; nan for one that never settles."""
    parameters = parameters.flat
    single = response(parameters, omega)
    endless = np.array([slowest_rate(vehicle) <= 0 < vehicle.alpha for vehicle in parameters])
    return np.where(np.isfinite(single) & ~endless[:, None], single, np.nan)
