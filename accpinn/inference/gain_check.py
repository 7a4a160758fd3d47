"""An estimate's |H| against the gain that the recording itself has, by Welch's method.

Both have a band. They are compared at the frequencies up to `FASTEST` at which the coherence is
at least `COHERENT`: the root mean square of the difference of both gains in dB, the difference of
their peaks, and the share of the frequencies at which the bands have nothing in common. A verdict
on string stability is contradicted where the measured gain does not allow it at any of K
frequencies together: the measured band has the level 1 - (1 - level)/K there (Bonferroni), as one
of many single bands lies apart by chance.
"""

from collections.abc import Sequence
from math import nan
from typing import Literal

import numpy as np

from accpinn.errors import SegmentError
from accpinn.findings import Finding, Labelled, Words
from accpinn.inference.intervals import Uncertainty, gain_band
from accpinn.segment import Segment
from accpinn.stability import assessment
from accpinn.stability.criteria import response
from accpinn.stability.measured_gain import (
    LEVEL,
    MeasuredGain,
    measured_gain,
)
from accpinn.units import FloatArray, Mask, RadiansPerSecond

COHERENT = 0.8
"""Least coherence at which a measured gain is compared."""
FASTEST: RadiansPerSecond = 1.0
"""Highest frequency at which it is compared."""
LEAST = 5
"""Fewer frequencies than these say nothing about a model."""
MUCH = 3.0
"""Difference in dB from which a measured peak above the model's is said in words."""
APART = 1 / 3
"""Share of the frequencies beyond which bands that lie apart contradict the model."""

Contradiction = Literal["", "amplifies", "damps", "apart"]
"""The measured gain's contradiction of the model's verdict; "apart" for bands that differ."""
_TEXTS: dict[Contradiction, str] = {
    "": "{vehicle}: {distance}.",
    "amplifies": "{vehicle}: L₂ string stable by the model; the measured gain contradicts it (peak"
    " {peak:.1f} dB at {omega:.2g} rad/s). {Distance}.",
    "damps": "{vehicle}: amplifies disturbances by the model; the measured gain contradicts it (at"
    " most {highest:.1f} dB where the model amplifies). {Distance}.",
    "apart": "{vehicle}: the measured gain contradicts the model: their bands lie apart at"
    " {apart:.0%} of the frequencies. {Distance}.",
}


class GainCheck(Finding, frozen=True):
    """The comparison of a vehicle's estimated gain with the measured one."""

    vehicle: int
    frequencies: int
    """Number of frequencies compared; with fewer than `LEAST` there is no comparison, and what
    follows is nan."""
    rms: float = nan
    """Root mean square of the difference in dB."""
    peak: float = nan
    """Largest measured gain at these frequencies in dB."""
    model_peak: float = nan
    """The model's largest gain at these frequencies in dB."""
    omega: RadiansPerSecond = nan
    """Frequency of the measured peak."""
    apart: float = nan
    """Share of the frequencies at which the bands have nothing in common."""
    highest: float = nan
    """Largest measured gain in dB where the model amplifies; nan where it does not."""
    contradiction: Contradiction = ""

    @property
    def is_underrated(self) -> bool:
        """Whether the measured peak is far above the model's."""
        return bool(self.peak - self.model_peak > MUCH)

    @property
    def short(self) -> str:
        """The contradiction in a few words; empty where there is none."""
        return {
            "": "",
            "amplifies": f"peak {self.peak:.1f} dB",
            "damps": f"at most {self.highest:.1f} dB",
            "apart": f"{self.rms:.1f} dB apart",
        }[self.contradiction]

    def sentence(self, about: Labelled) -> str:
        """The verdict where it is contradicted, and how far model and measurement are apart."""
        if self.frequencies < LEAST:
            text = (
                "{vehicle}: the verdict could not be held against a measured gain, as fewer than"
                f" {LEAST} frequencies up to {FASTEST:g} rad/s have a coherence of {COHERENT:g}; a"
                " longer window has more."
            )
            return self.filled(text, about)
        return self.filled(_TEXTS[self.contradiction], about)

    def _words(self, about: Labelled) -> Words:
        more = self.model_peak - self.peak
        side = f"{abs(more):.1f} dB {'above' if more > 0 else 'below'} the measured one"
        distance = (
            f"the model is {self.rms:.1f} dB off the measured gain (rms, {self.frequencies}"
            f" frequencies), its peak there {'the same' if abs(more) < 0.05 else side}"
        )
        if self.is_underrated:
            distance += f": disturbances may grow up to {10 ** (self.peak / 20):.1f} times"
        return {"distance": distance, "Distance": distance[:1].upper() + distance[1:]}


def gain_checks(segments: Sequence[Segment], uncertainty: Uncertainty) -> tuple[GainCheck, ...]:
    """Hold each follower's estimate against its measured gain.

    Args:
        segments: (K,) the windows of the estimate.
        uncertainty: the estimate of M followers with what is known of it; one that is not
            determined has no check.

    Returns:
        One finding a follower that is determined.
    """
    return tuple(
        _check(segments, uncertainty, k, number)
        for k, number in enumerate(segments[0].vehicles[1:])
        if np.isfinite(uncertainty.centre[k].complete).all()
    )


def compared(measured: MeasuredGain) -> Mask:
    """(K,) the frequencies at which a measured gain is compared with a model's."""
    return (measured.omega <= FASTEST) & (measured.coherence >= COHERENT)


def _check(
    segments: Sequence[Segment], uncertainty: Uncertainty, k: int, vehicle: int
) -> GainCheck:
    model = uncertainty.centre[[k]]
    try:
        measured = measured_gain(segments, k, reference=model)
    except SegmentError:
        return GainCheck(vehicle, 0)
    at = compared(measured)
    count = int(at.sum())
    if count < LEAST:
        return GainCheck(vehicle, count)
    sure = measured_gain(segments, k, 1.0 - (1.0 - LEVEL) / count, model)
    omega, levels = measured.omega[at], decibels(measured.gain[at])
    band = gain_band(uncertainty, k, omega)
    apart = (band.lower > measured.upper[at]) | (band.upper < measured.lower[at])
    modelled = decibels(np.abs(response(model, omega))[0])
    amplified = band.lower > 1.0
    verdict = assessment(float(uncertainty.probability_l2[k]))
    contradiction: Contradiction = "apart" if apart.mean() > APART else ""
    if verdict == "stable" and (sure.lower[at] > 1.0).any():
        contradiction = "amplifies"
    elif verdict == "unstable" and amplified.any() and (sure.upper[at][amplified] < 1.0).all():
        contradiction = "damps"
    return GainCheck(
        vehicle,
        count,
        rms=float(np.sqrt(np.mean((modelled - levels) ** 2))),
        peak=float(levels.max()),
        model_peak=float(modelled.max()),
        omega=float(omega[levels.argmax()]),
        apart=float(apart.mean()),
        highest=float(levels[amplified].max()) if amplified.any() else nan,
        contradiction=contradiction,
    )


def decibels(gain: FloatArray) -> FloatArray:
    """A gain in dB, finite whatever it is."""
    return np.asarray(20 * np.log10(np.clip(gain, 1e-6, 1e6)))
