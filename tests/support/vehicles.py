"""Vehicles that tests of stability and of platoons share."""

from hypothesis import strategies as st

from accpinn.model.cthp import Parameters
from accpinn.model.published import ASTAZERO

MIXED = ASTAZERO.parameters
AUDI, BMW, MERCEDES, TESLA = MIXED
CALM = Parameters(0.08, 0.60, 3.0)
"""Stable by every criterion."""
NO_GAP_CONTROL = Parameters(0.0, 0.3, float("nan"))
NO_REACTION = Parameters(0.0, 0.0, float("nan"))
UNDAMPED = Parameters(0.25, 0.0, 0.0)

ordinary = st.builds(
    Parameters, alpha=st.floats(1e-4, 4.0), beta=st.floats(0.0, 4.0), tau=st.floats(0.01, 6.0)
)
_power = st.one_of(st.just(0.0), st.floats(-12, 12).map(lambda power: 10.0**power))
extreme = st.builds(Parameters, alpha=_power, beta=_power, tau=_power)


def damping(vehicle: Parameters) -> float:
    """The damping ratio."""
    return (vehicle.alpha * vehicle.tau + vehicle.beta) / (2 * vehicle.alpha**0.5)


def row(*vehicles: Parameters) -> Parameters:
    """Vehicles one behind the other."""
    return Parameters.stack(vehicles)
