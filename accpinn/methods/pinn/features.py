"""Input features of the `fast` preset: what the network sees of time, and its derivative.

    φ(t) = (1, s, sin ω_1 t, cos ω_1 t, ..., sin ω_n t, cos ω_n t),   s = 2t/T - 1 in [-1, 1],
    ω_j = π j / T: from half a cycle per window up to the highest frequency, evenly spaced.

The derivative is linear in the features themselves, dφ/dt = φ S, so their Gram matrices with the
derivative come without touching the data again.
"""

import numpy as np

from accpinn.units import FloatArray, Seconds


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
