"""The PiNN's surrogate in numpy: its input features, the order of its outputs, and its curves.

The `fast` preset sees time t in a window of duration T through Fourier features,

    φ(t) = (1, s, sin ω_1 t, cos ω_1 t, ..., sin ω_n t, cos ω_n t),   s = 2t/T - 1 in [-1, 1],
    ω_j = π j / T: from half a cycle per window up to the highest frequency, evenly spaced.

The derivative is linear in the features themselves, dφ/dt = φ S, so their Gram matrices with the
derivative need no further sums over the data.
"""

import numpy as np

from accpinn.errors import ConfigError
from accpinn.methods.fit import Fit
from accpinn.methods.pinn.config import PinnConfig
from accpinn.model.cthp import Trajectories
from accpinn.units import FloatArray, Seconds

MOST_FEATURES = 20_000
"""`redraw` refuses more; a window of a day has fewer."""


class FourierFeatures:
    """The features of a window of ``duration`` seconds up to ``highest_frequency`` hertz."""

    def __init__(self, duration: Seconds, highest_frequency: float) -> None:
        """At least four frequencies, however short the window."""
        count = max(4, round(2 * duration * highest_frequency))
        self.duration = duration
        self.angular: FloatArray = np.arange(1, count + 1, dtype=np.float64) * (np.pi / duration)
        """(n,) in rad/s."""
        self.size = 2 + 2 * count

    def __call__(self, time: FloatArray) -> FloatArray:
        """(N,) seconds to (N, size) features."""
        phase = np.outer(time, self.angular)
        features = np.empty((len(time), self.size))
        features[:, 0] = 1.0
        features[:, 1] = 2 * time / self.duration - 1
        features[:, 2::2] = np.sin(phase)
        features[:, 3::2] = np.cos(phase)
        return features

    def derivative(self) -> FloatArray:
        """(size, size) matrix S with dφ/dt = φ S."""
        matrix = np.zeros((self.size, self.size))
        matrix[0, 1] = 2 / self.duration
        sine, cosine = np.arange(2, self.size, 2), np.arange(3, self.size, 2)
        matrix[cosine, sine] = self.angular
        matrix[sine, cosine] = -self.angular
        return matrix


def output_columns(followers: int) -> tuple[list[int], list[int]]:
    """Where speeds (M+1) and space-gaps (M) stand among the outputs v_0, v_1, p_1, v_2, p_2, ..."""
    return [0, *range(1, 2 * followers, 2)], list(range(2, 2 * followers + 1, 2))


def stack_outputs(speeds: FloatArray, gaps: FloatArray) -> FloatArray:
    """(N, M+1) speeds and (N, M) gaps as (N, 2M+1) in the order of `output_columns`."""
    followers = gaps.shape[1]
    stacked = np.empty((len(gaps), 2 * followers + 1))
    speed_columns, gap_columns = output_columns(followers)
    stacked[:, speed_columns], stacked[:, gap_columns] = speeds, gaps
    return stacked


def redraw(fit: Fit, time: FloatArray, duration: Seconds) -> Trajectories:
    """The surrogate of a fit from its stored weights alone.

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
