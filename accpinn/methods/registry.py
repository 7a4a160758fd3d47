"""Every method by its key, in the order in which they are shown."""

from accpinn.errors import ConfigError
from accpinn.methods import (
    dual_ukf,
    least_squares,
    maximum_likelihood,
    particle,
    recursive,
    simulation,
    splines,
)
from accpinn.methods.method import Method
from accpinn.methods.pinn import method as pinn

METHODS: dict[str, Method] = {
    method.key: method
    for method in (
        pinn.METHOD,
        maximum_likelihood.METHOD,
        least_squares.METHOD,
        least_squares.SMOOTHED,
        splines.METHOD,
        simulation.METHOD,
        recursive.METHOD,
        particle.METHOD,
        dual_ukf.METHOD,
    )
}


def method_of(key: str) -> Method:
    """The method of that key.

    Raises:
        ConfigError: for an unknown key.
    """
    if key not in METHODS:
        raise ConfigError(f"method: {key[:40]} is not known; choose {', '.join(METHODS)}.")
    return METHODS[key]
