"""The steady motion of a platoon behind a sinusoid, once the transient is over, in closed form.

    v_0(t) - v = A sin ωt,   v_k(t) - v = A |H_1 .. H_k| sin(ωt + φ_1 + .. + φ_k)

with H_i = H_i(jω) and φ_i = arg H_i. The speed v is that of the equilibrium. A vehicle whose own
motion does not decay never gets there, and neither do those behind it.
"""

import numpy as np

from accpinn.model.cthp import Parameters
from accpinn.stability.criteria import response, slowest_rate
from accpinn.units import FloatArray, MetresPerSecond, RadiansPerSecond


def steady_deviations(
    parameters: Parameters,
    omega: RadiansPerSecond,
    time: FloatArray,
    amplitude: MetresPerSecond = 1.0,
) -> FloatArray:
    """(N, M+1) deviations of speed in m/s from the equilibrium, leader first, at (N,) instants.

    Args:
        parameters: one entry a follower, M of them, in their order.
        omega: frequency of the leader's speed in rad/s.
        time: instants in s; the leader's sine starts at 0.
        amplitude: that of the leader's speed in m/s.

    Returns:
        The deviations; nan from the first vehicle on that never settles.
    """
    parameters = parameters.flat
    single = response(parameters, np.array([omega]))[:, 0]
    rates = {vehicle: slowest_rate(vehicle) for vehicle in {*parameters}}
    endless = [rates[vehicle] <= 0 and vehicle.alpha > 0 for vehicle in parameters]
    single = np.where(np.isfinite(single) & ~np.array(endless), single, np.nan)
    chain = np.cumprod(np.concatenate([[1.0], single]))
    return np.asarray((amplitude * chain * np.exp(1j * omega * time)[:, None]).imag)
