"""Vehicles as they might be: with another time gap or delay, or told the acceleration ahead.

Cooperative adaptive cruise control (CACC) receives the acceleration of the car ahead by radio. It
adds a share k of it, θ after it was measured, to what its actuator is given:

    (1 + λs) s V(s) = e^(-ds) [α (U - V)/s - ατ V + β (U - V)] + k e^(-θs) s U(s)

    H(s) = [e^(-ds) (βs + α) + k e^(-θs) s²] q(s) / D(s)

with D(s), and q(s) of the delay's approximant inside the loop, as in `lagged`. The poles are those
of the same vehicle without the feed-forward, so it can neither make a vehicle unstable nor stop it
from being so; H(0) = 1 as before. The browser's frequency laboratory computes the same in
JavaScript, to which a test holds it.

Source: Naus, Vugts, Ploeg, van de Molengraft and Steinbuch, String-stable CACC design and
experimental validation, IEEE Transactions on Vehicular Technology 59 (2010) 4268-4279.
"""

from dataclasses import dataclass, field
from functools import cached_property
from math import isfinite
from typing import TYPE_CHECKING

import numpy as np
from numpy.polynomial.polynomial import polyval
from numpy.typing import NDArray

from accpinn.display import Displayed
from accpinn.errors import ParameterError
from accpinn.model.cthp import Parameters
from accpinn.stability.criteria import Peak, checked, response
from accpinn.stability.lagged import polynomials
from accpinn.stability.margin import is_damped
from accpinn.units import FloatArray, Mask, Seconds

if TYPE_CHECKING:
    from pandas import DataFrame

LIMITS = {
    "time_gap": (-10.0, 10.0), "delay": (-10.0, 10.0), "feedforward": (-2.0, 2.0),
    "latency": (0.0, 10.0),
}  # fmt: skip
"""Least and largest value of each change."""
FREQUENCIES = np.geomspace(1e-3, 10.0, 2000)
"""Frequencies in rad/s at which the largest gain is looked for."""
GROWS = 1e-6
"""Excess of a gain over 1 from which a frequency counts as amplified."""


@dataclass(frozen=True, eq=False)
class WhatIf(Displayed):
    """Vehicles (M,) whose control is changed, and how they would pass on disturbances.

    Raises:
        ParameterError: for a change beyond `LIMITS`, or parameters that no vehicle has.
    """

    given: Parameters
    """(M,) the vehicles as they are."""
    time_gap: Seconds = 0.0
    """Added to the time gap of each, which does not fall below 0."""
    delay: Seconds = 0.0
    """Added to the delay of each, which does not fall below 0."""
    feedforward: float = 0.0
    """k: the share of the acceleration ahead that the actuator is given as well."""
    latency: Seconds = 0.0
    """θ: the age of that acceleration when the actuator is given it."""
    names: tuple[str, ...] = field(default=())
    """(M,) of the vehicles, where they have any."""

    def __post_init__(self) -> None:
        """Refuse changes that mean nothing."""
        for name, (low, high) in LIMITS.items():
            value = getattr(self, name)
            if not (isfinite(value) and low <= value <= high):
                raise ParameterError(
                    f"{name}: {value:g} is not allowed; choose a number from {low:g} to {high:g}."
                )
        checked(self.given.flat)

    def __str__(self) -> str:
        """A line a vehicle."""
        lines = [
            f"What if: time gap {self.time_gap:+.2f} s, delay {self.delay:+.2f} s, feed-forward"
            f" {self.feedforward:g} of the acceleration ahead, {self.latency:.2f} s old"
        ]
        before, after = response_peaks(self.given.flat), self.peaks
        for k, (was, now) in enumerate(zip(before, after, strict=True)):
            name = self.names[k] if self.names else f"Follower {k + 1}"
            lines.append(
                f"  {name}: largest gain {now.gain:.3g}, without the change {was.gain:.3g}"
            )
        return "\n".join([*lines, "More: .to_frame(), .response(omega), .parameters"])

    @cached_property
    def parameters(self) -> Parameters:
        """(M,) the vehicles with the other time gap and delay."""
        changed = self.given.flat.complete.copy()
        changed[:, 2] = np.maximum(changed[:, 2] + self.time_gap, 0.0)
        changed[:, 5] = np.maximum(changed[:, 5] + self.delay, 0.0)
        return Parameters.of(changed)

    def response(self, omega: FloatArray) -> NDArray[np.complex128]:
        """(M, K) H(jω) at (K,) frequencies in rad/s, the feed-forward included."""
        parameters, at = checked(self.parameters), np.asarray(omega, float)
        plain = response(parameters, at)
        if not self.feedforward:
            return plain
        s = 1j * at
        delay = parameters.delay[:, None]
        _, lower = polynomials(parameters)
        # Without α the polynomials have lost a factor s.
        power = np.where(parameters.alpha > 0, 2, 1)[:, None]
        inside = 1.0 + delay * s / 2.0 + (delay * s) ** 2 / 12.0
        more = self.feedforward * np.exp(-self.latency * s) * s**power * inside
        return np.asarray(plain + more / polyval(s, lower.T))

    @cached_property
    def decays(self) -> Mask:
        """(M,) whether each vehicle's own motion decays."""
        return is_damped(checked(self.parameters))

    @cached_property
    def peaks(self) -> Peak:
        """(M,) the largest gain of each vehicle; infinite where its own motion does not decay."""
        return _largest(np.abs(self.response(FREQUENCIES)), self.decays)

    def to_frame(self) -> "DataFrame":
        """A row a vehicle: changed parameters, the largest gain, and whether it is L₂ stable."""
        from pandas import DataFrame

        found, peaks = self.parameters, self.peaks
        names = self.names or tuple(f"Follower {k + 1}" for k in range(len(found)))
        return DataFrame(
            {
                "name": names,
                **{name: getattr(found, name) for name in ("alpha", "beta", "tau", "lag", "delay")},
                "feedforward": self.feedforward,
                "latency": self.latency,
                "peak_gain": peaks.gain,
                "peak_omega": peaks.omega,
                "l2_stable": peaks.gain <= 1.0 + GROWS,
            }
        )


def what_if(
    parameters: Parameters, *, time_gap: Seconds = 0.0, delay: Seconds = 0.0,
    feedforward: float = 0.0, latency: Seconds = 0.0,
) -> WhatIf:  # fmt: skip
    """How vehicles would pass on disturbances with another control, see `WhatIf`.

    Args:
        parameters: (M,) of a CTHP, or the linearisation of another model.
        time_gap: in s, added to that of each vehicle.
        delay: in s, added likewise.
        feedforward: share of the acceleration of the car ahead that is commanded as well.
        latency: age of that acceleration in s.

    Raises:
        ParameterError: for a change beyond any vehicle, or parameters that none has.

    Examples:
        >>> import accpinn
        >>> car = accpinn.Parameters([0.08], [0.3], [1.2], delay=0.3)
        >>> accpinn.what_if(car).peaks.gain.round(2).tolist()
        [1.16]
        >>> accpinn.what_if(car, feedforward=0.5, latency=0.1).peaks.gain.round(2).tolist()
        [1.01]
    """
    return WhatIf(parameters, time_gap, delay, feedforward, latency)


def response_peaks(parameters: Parameters) -> Peak:
    """(M,) the largest gains of vehicles without a change, at the same frequencies."""
    clean = checked(parameters)
    return _largest(np.abs(response(clean, FREQUENCIES)), is_damped(clean))


def _largest(gains: FloatArray, decays: Mask) -> Peak:
    """The largest of gains (M, K) at `FREQUENCIES`; 1 at ω = 0 where none is above."""
    best = gains.argmax(axis=1)
    gain = gains[np.arange(len(gains)), best]
    grows = gain > 1.0 + GROWS
    gain = np.where(decays, np.where(grows, gain, 1.0), np.inf)
    return Peak.of(np.log(gain), np.where(grows & decays, FREQUENCIES[best], 0.0))
