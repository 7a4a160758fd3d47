"""Batch least squares on smoothed signals, with derivatives from the same smoothing.

Around each instant a cubic is fitted to the samples of a short window; its value and its slope at
the instant are the smoothed signal and its derivative. With v, p and dv/dt so obtained,

    θ = argmin Σ_t (dv/dt - α p + ατ v - β Δv)²   subject to α, ατ, β ≥ 0.

Smoothing is a convolution and the model is linear, so what holds for the signals holds for the
smoothed ones: the window adds hardly any bias where the model holds, and it averages out the
receivers' noise, which in the regressors would bias the gains towards zero.

Source: Savitzky and Golay, Analytical Chemistry 36 (1964) 1627-1639; the pass band after Schafer,
IEEE Signal Processing Magazine 28 (2011) 111-117.
"""

import time
from functools import partial

from scipy.signal import savgol_filter

from accpinn.methods.fit import Fit, Outcome
from accpinn.methods.method import direct
from accpinn.methods.regression import Regression
from accpinn.model.cthp import Case, Trajectories
from accpinn.segment.segment import Segment
from accpinn.units import Seconds

WINDOW: Seconds = 2.0
"""Passes up to about 0.75 Hz at 10 Hz: above what a platoon does, which stays below 0.3 Hz, and
well below the 3-5 Hz of the receivers' reports, whose splining leaves ripples."""
DEGREE = 3
LEAST_SAMPLES = 5
"""In a window: with fewer, the cubic interpolates every sample and smooths nothing."""


def fit(segment: Segment, case: Case = "II", window: Seconds = WINDOW) -> Fit:
    """The least-squares parameters of the smoothed segment; the surrogate is that segment."""
    started = time.perf_counter()
    samples = _window_samples(segment, window)
    degree = min(DEGREE, samples - 1)
    smoothing = partial(
        savgol_filter, window_length=samples, polyorder=degree, delta=segment.sample_time, axis=0
    )
    speeds, gaps = smoothing(segment.speeds), smoothing(segment.gaps)
    acceleration = smoothing(segment.speeds[:, 1:], deriv=1)
    # The window reaches into masked instants, as the signals there are as good as elsewhere.
    solution = Regression.of_motion(speeds, gaps, acceleration, segment.mask).solve(case)
    return Fit.of(
        "savitzky-golay",
        segment,
        case,
        solution,
        surrogate=Trajectories(segment.time, speeds, gaps),
        outcome=Outcome.SOLVED,
        seconds=time.perf_counter() - started,
        config={"window": samples * segment.sample_time, "degree": degree},
    )


def _window_samples(segment: Segment, window: Seconds) -> int:
    """An odd number of samples, as the window is centred; no more than there are."""
    wanted = max(LEAST_SAMPLES, 2 * round(window / segment.sample_time / 2) + 1)
    return min(wanted, segment.samples - 1 + segment.samples % 2)


METHOD = direct(
    "savitzky-golay", "Savitzky-Golay", fit, typical_seconds=0.1,
    summary="batch least squares on smoothed signals",
)  # fmt: skip
