"""The surrogate's curves from a fit's stored weights alone, in numpy, for whoever checks them."""

import numpy as np

from accpinn.errors import ConfigError
from accpinn.methods.fit import Fit
from accpinn.methods.pinn.config import PinnConfig
from accpinn.methods.pinn.features import FourierFeatures
from accpinn.methods.pinn.output_layout import output_columns
from accpinn.model.cthp import Trajectories
from accpinn.units import FloatArray, Seconds

MOST_FEATURES = 20_000
"""More are not computed; a day's window has fewer."""


def curve(fit: Fit, time: FloatArray, duration: Seconds) -> Trajectories:
    """What the network of a fit says of the motion.

    Args:
        fit: a PiNN's.
        time: (N,) in s from the window's start; any instants of it.
        duration: of the window, in s.

    Raises:
        ConfigError: when the weights are missing, or another network's.
    """
    settings = {name: value for name, value in fit.config.items() if name != "started_from"}
    config = PinnConfig.from_json(settings)
    try:
        outputs = (
            _fast(fit, time, duration, config) if config.preset == "fast" else _paper(fit, time)
        )
        speeds, gaps = output_columns(len(fit.parameters))
        return Trajectories(time, outputs[:, speeds], outputs[:, gaps])
    except (KeyError, ValueError, IndexError):
        raise ConfigError(
            "The network's weights are missing, or another network's; train again."
        ) from None


def _fast(fit: Fit, time: FloatArray, duration: Seconds, config: PinnConfig) -> FloatArray:
    """[φ, h(φ)] W; see `pinn.fast`."""
    if 2 * duration * config.highest_frequency > MOST_FEATURES:
        raise ValueError(duration)
    features = FourierFeatures(duration, config.highest_frequency)(time)
    active = _hidden(fit, features[:, 1:], "hidden.layers")
    return np.asarray(np.hstack([features, active]) @ fit.arrays["output.weight"])


def _paper(fit: Fit, time: FloatArray) -> FloatArray:
    """See `pinn.network.PaperNetwork`."""
    active = _hidden(fit, time[:, None], "network.hidden.layers")
    return _linear(fit, active, "network.output")


def _hidden(fit: Fit, values: FloatArray, prefix: str) -> FloatArray:
    count = sum(name.startswith(prefix) and name.endswith("weight") for name in fit.arrays)
    for k in range(count):
        values = np.tanh(_linear(fit, values, f"{prefix}.{k}"))
    return values


def _linear(fit: Fit, values: FloatArray, name: str) -> FloatArray:
    weight, bias = (np.asarray(fit.arrays[f"{name}.{part}"], float) for part in ("weight", "bias"))
    return np.asarray(values @ weight.T + bias)
