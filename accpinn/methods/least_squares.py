"""Batch least squares: on finite differences of the measured signals, and on smoothed ones.

The model is linear in θ = (α, ατ, β), so with dv/dt at hand one 3x3 solve a follower gives, over
the instants in the segment's mask,

    θ = argmin Σ_t (dv/dt - α p + ατ v - β Δv)²   subject to α, ατ, β ≥ 0.

`fit` takes central differences of the measured speeds; noise in the regressors then biases the
gains towards zero. `fit_smoothed` fits a cubic to the samples of a short window about each instant;
its value and its slope there are the smoothed signal and its derivative. Smoothing is a convolution
and the model is linear, so what holds for the signals holds for the smoothed ones: the window adds
hardly any bias where the model holds, and it averages out the receivers' noise.

With an intercept s₀ the same holds of the rows about their means.

Source: Savitzky and Golay, Analytical Chemistry 36 (1964) 1627-1639; the pass band after Schafer,
IEEE Signal Processing Magazine 28 (2011) 111-117.
"""

from functools import partial

from accpinn.methods import direct
from accpinn.methods.estimate import Fit, Outcome
from accpinn.methods.regression import Regression, Solution
from accpinn.model.cthp import Case, Trajectories
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


def fit(segment: Segment, case: Case = "II", spec: ModelSpec = PAPER_SPEC) -> Fit:
    """The least-squares parameters of a segment; takes milliseconds."""
    solution = solved(Regression.of(segment), case, spec)
    return Fit.of("least-squares", segment, case, solution, outcome=Outcome.SOLVED, config={})


def solved(regression: Regression, case: Case, spec: ModelSpec) -> Solution:
    """The solution under a model of `MODELS`."""
    return regression.solve(case) if spec == PAPER_SPEC else regression.solve_with_intercept(case)


def fit_smoothed(segment: Segment, case: Case = "II", spec: ModelSpec = PAPER_SPEC) -> Fit:
    """The least-squares parameters of the smoothed segment; the surrogate is that segment."""
    from scipy.signal import savgol_filter  # takes a second to import, which few need

    # An odd number, as the window is centred; no more than there are.
    wanted = max(LEAST_SAMPLES, 2 * round(WINDOW / segment.sample_time / 2) + 1)
    samples = min(wanted, segment.samples - 1 + segment.samples % 2)
    degree = min(DEGREE, samples - 1)
    smoothing = partial(
        savgol_filter, window_length=samples, polyorder=degree, delta=segment.sample_time, axis=0
    )
    speeds, gaps = smoothing(segment.speeds), smoothing(segment.gaps)
    acceleration = smoothing(segment.speeds[:, 1:], deriv=1)
    # The window reaches into masked instants, as the signals there are as good as elsewhere.
    regression = Regression.of_motion(speeds, gaps, acceleration, segment.mask)
    return Fit.of(
        "savitzky-golay",
        segment,
        case,
        solved(regression, case, spec),
        surrogate=Trajectories(segment.time, speeds, gaps),
        outcome=Outcome.SOLVED,
        config={"window": samples * segment.sample_time, "degree": degree},
    )


METHOD = direct(
    "least-squares", "Least squares", fit, MODELS, typical_seconds=0.1,
    summary="batch least squares on finite differences of the speeds",
)  # fmt: skip

SMOOTHED = direct(
    "savitzky-golay", "Savitzky-Golay", fit_smoothed, MODELS, typical_seconds=0.1,
    summary="batch least squares on smoothed signals",
)  # fmt: skip
