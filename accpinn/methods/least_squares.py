"""Batch least squares: on finite differences of the measured signals, and on smoothed ones.

The model is linear in θ = (α, ατ, β), so with dv/dt at hand one 3x3 solve a follower gives, over
the instants of all windows that their masks do not exclude,

    θ = argmin Σ_t (dv/dt - α p + ατ v - β Δv)²   subject to α, ατ, β ≥ 0.

`fit` takes central differences of the measured speeds; noise in the regressors then biases the
gains towards zero. `fit_smoothed` fits a cubic to the samples of a short window about each instant;
its value and its slope there are the smoothed signal and its derivative. Smoothing is a convolution
and the model is linear, so what holds for the signals holds for the smoothed ones: the window adds
hardly any bias where the model holds, and it averages out the receivers' noise.

For an intercept s₀ see `regression`.

Source: Savitzky and Golay, Analytical Chemistry 36 (1964) 1627-1639; the pass band after Schafer,
IEEE Signal Processing Magazine 28 (2011) 111-117.
"""

from collections.abc import Sequence
from functools import partial
from typing import Any

from accpinn.methods import Segments, direct
from accpinn.methods.estimate import Estimate, Outcome
from accpinn.methods.regression import Regression
from accpinn.model.cthp import Case, Parameters, Trajectories
from accpinn.model.registry import PAPER
from accpinn.model.spec import PAPER_SPEC, ModelSpec
from accpinn.segment import Segment
from accpinn.units import Seconds

WINDOW: Seconds = 2.0
"""Passes up to about 0.75 Hz at 10 Hz: above what a platoon does, which stays below 0.3 Hz, and
well below the 3-5 Hz of the receivers' reports, whose splining leaves ripples."""
MODELS = (PAPER, "cthp-s0")
"""Models that are linear in their parameters and need no earlier instants."""
DEGREE = 3
LEAST_SAMPLES = 5
"""In a window: with fewer, the cubic interpolates every sample and smooths nothing."""


def fit(segments: Segments, case: Case = "II", spec: ModelSpec = PAPER_SPEC) -> Estimate:
    """The least-squares parameters of windows (K,); takes milliseconds."""
    parts = [Regression.of(segment) for segment in segments]
    return _estimate("least-squares", segments, case, spec, parts)


def fit_smoothed(segments: Segments, case: Case = "II", spec: ModelSpec = PAPER_SPEC) -> Estimate:
    """The least-squares parameters of smoothed windows (K,), which are the curves."""
    curves, parts = zip(*map(_smoothed, segments), strict=True)
    samples, degree = map(max, zip(*map(_filter_for, segments), strict=True))
    settings = {"window": samples * segments[0].sample_time, "degree": degree}
    return _estimate(
        "savitzky-golay", segments, case, spec, parts, curves=curves, settings=settings
    )


def _filter_for(segment: Segment) -> tuple[int, int]:
    """Samples and degree of the smoothing: less in a segment that is as short as `WINDOW`."""
    # An odd number, as the window is centred; no more than there are.
    wanted = max(LEAST_SAMPLES, 2 * round(WINDOW / segment.sample_time / 2) + 1)
    samples = min(wanted, segment.samples - 1 + segment.samples % 2)
    return samples, min(DEGREE, samples - 1)


def _smoothed(segment: Segment) -> tuple[Trajectories, Regression]:
    """The smoothed signals, and their rows."""
    from scipy.signal import savgol_filter  # takes a second to import, which few need

    samples, degree = _filter_for(segment)
    smoothing = partial(
        savgol_filter, window_length=samples, polyorder=degree, delta=segment.sample_time, axis=0
    )
    speeds, gaps = smoothing(segment.speeds), smoothing(segment.gaps)
    acceleration = smoothing(segment.speeds[:, 1:], deriv=1)
    # The window reaches into masked instants, as the signals there are as good as elsewhere.
    regression = Regression.of_motion(speeds, gaps, acceleration, segment.mask)
    return Trajectories(segment.time, speeds, gaps), regression


def _estimate(
    method: str,
    segments: Segments,
    case: Case,
    spec: ModelSpec,
    parts: Sequence[Regression],
    **others: Any,
) -> Estimate:
    """The estimate by the rows of all windows (K,), with that of each window by itself."""
    by_window = [part.solve(case, spec).parameters.everything for part in parts]
    return Estimate.of(
        method,
        segments,
        case,
        spec,
        Regression.joined(parts).solve(case, spec),
        windows=Parameters.of(by_window),
        outcome=Outcome.SOLVED,
        **others,
    )


METHOD = direct(
    "least-squares", "Least squares", fit, MODELS, typical_seconds=0.1,
    summary="batch least squares on finite differences of the speeds",
)  # fmt: skip

SMOOTHED = direct(
    "savitzky-golay", "Savitzky-Golay", fit_smoothed, MODELS, typical_seconds=0.1,
    summary="batch least squares on smoothed signals",
)  # fmt: skip
