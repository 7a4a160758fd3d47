"""The same vehicles in several windows: one parameter set, and how far the windows differ.

The joint estimate takes parameters, disturbance and noise as the same in all of K windows, whose
log-likelihoods then add up (see `methods.maximum_likelihood`):

    maximise  Σ_k log L_k(z) + log prior(z)

A vehicle is not quite so constant: its speed, the slope and the driver's setting change, and the
CTHP has no place for them. How far its parameters vary is a random-effects model. In window k, x_k
is the maximum-likelihood estimate of ln α, ln β or ln τ, and s_k its standard error:

    x_k = μ + b_k + e_k,   b_k ~ N(0, d²),   e_k ~ N(0, s_k²)

The curvature of log L_k gives an s_k that is too small where log L_k is not quadratic, for τ by a
fifth on simulated recordings of 300 s; the deviation of the posterior is right there, and too small
where a window says so little that the prior of α, β and τ matters. So the larger of the two is s_k.

The between-window deviation d solves (Paule and Mandel)

    Q(d) = K - 1,   Q(d) = Σ w_k (x_k - μ)²,   w_k = 1/(s_k² + d²),   μ = Σ w_k x_k / Σ w_k

and is zero where Q(0), Cochran's Q, is smaller than K - 1. Under d = 0, Q(0) has a χ² distribution
with K - 1 degrees of freedom, and I² = max(0, 1 - (K - 1)/Q(0)) is the share of the variance that
sampling error does not explain. The interval of d holds every d whose Q(d) lies between quantiles
of that distribution; a further window has ln α, ln β or ln τ in μ ± t_{K-2} √(d² + 1/Σ w_k).

Sources: Paule and Mandel, Journal of Research of the National Bureau of Standards 87 (1982)
377-385; Cochran, Biometrics 10 (1954) 101-129; Higgins and Thompson, Statistics in Medicine 21
(2002) 1539-1558 (I²); Viechtbauer, Statistics in Medicine 26 (2007) 37-52 (interval of d); Higgins,
Thompson and Spiegelhalter, Journal of the Royal Statistical Society A 172 (2009) 137-159 (further
window).
"""

import time
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import chdtrc, chdtri, stdtrit

from accpinn.channels import PARAMETERS
from accpinn.errors import ConfigError, SegmentError
from accpinn.findings import Finding, Labelled, Words
from accpinn.inference.intervals import LEVEL, Uncertainty, intervals
from accpinn.methods.fit import Fit
from accpinn.methods.maximum_likelihood import fit_among, maxima_of
from accpinn.methods.series import series_of, stride_of
from accpinn.model.cthp import Case, Parameters
from accpinn.segment.cut import SLACK
from accpinn.segment.segment import Segment
from accpinn.units import FloatArray, Seconds

SIGNIFICANCE = 0.05
"""Below this probability of a larger Q, windows are said to differ."""
PLAUSIBLE = (1e-9, 1e9)
"""Standard errors of a logarithm between which a window counts; beyond them its weight is all or
nothing, as in a table that somebody has changed."""


class WindowsDiffer(Finding, frozen=True):
    """A follower's parameters differ between windows by more than sampling error explains."""

    text = (
        "{vehicle}: {symbols} {differ} between the {windows} windows by more than sampling error"
        " explains, so the intervals of the joint estimate are too narrow; where a further window"
        " matters, use the interval for one."
    )

    vehicle: int
    """0 for all followers together."""
    symbols: tuple[str, ...]
    """Symbols of the parameters: some of α, β and τ."""
    windows: int
    """Number of windows."""

    def _words(self, about: Labelled) -> Words:
        return {"differ": "differs" if len(self.symbols) == 1 else "differ"}


@dataclass(frozen=True)
class RandomEffects:
    """One parameter's logarithm over K windows; nan where fewer than two windows determine it."""

    windows: int
    """K: those with an estimate above zero and a standard error."""
    mean: float
    """μ, the mean of the logarithm."""
    error: float
    """Standard error of μ, between-window deviation included."""
    deviation: float
    """d, the standard deviation of the logarithm between windows beyond sampling error; for small
    values the relative deviation of the parameter."""
    lower: float
    """Of the interval of d."""
    upper: float
    level: float
    """Of that interval, and of the one for a further window."""
    q: float
    """Cochran's Q."""
    probability: float
    """Of a Q at least as large if the windows differed by sampling error alone."""
    i_squared: float
    """I², 0 to 1."""

    @property
    def typical(self) -> float:
        """The median over windows, exp(μ), in the parameter's unit."""
        return float(np.exp(self.mean))

    @property
    def further(self) -> tuple[float, float]:
        """The interval of the parameter in a further window, in its unit; nan for K < 3."""
        if self.windows < 3:
            return float("nan"), float("nan")
        reach = stdtrit(self.windows - 2, (1 + self.level) / 2)
        reach *= np.hypot(self.deviation, self.error)
        return float(np.exp(self.mean - reach)), float(np.exp(self.mean + reach))


@dataclass(frozen=True)
class BetweenWindows:
    """How far one follower's parameters vary between windows."""

    vehicle: int
    """Its number in the first window's file."""
    alpha: RandomEffects
    """Of ln α."""
    beta: RandomEffects
    """Of ln β."""
    tau: RandomEffects
    """Of ln τ."""

    @property
    def effects(self) -> tuple[RandomEffects, RandomEffects, RandomEffects]:
        """In the order α, β, τ."""
        return self.alpha, self.beta, self.tau


@dataclass(frozen=True, eq=False)
class WindowEstimate:
    """What one window says by itself about its M followers."""

    segment: Segment
    fit: Fit
    """The maximum of this window's likelihood."""
    uncertainty: Uncertainty
    """Given this window alone."""
    errors: FloatArray
    """(M, 3) standard errors of ln α, ln β, ln τ; nan where a bound is active."""


@dataclass(frozen=True, eq=False)
class JointFit:
    """One parameter set for M followers over K windows, and how far the windows differ."""

    case: Case
    windows: tuple[WindowEstimate, ...]
    """(K,) each window by itself."""
    fits: tuple[Fit, ...]
    """(K,) the joint estimate on each window: equal parameters, the window's smoothed motion."""
    uncertainty: Uncertainty
    """Of the joint estimate; it assumes that the windows share their parameters."""
    between: tuple[BetweenWindows, ...]
    """(M,) one a follower; equal ones in Case I."""
    seconds: Seconds
    """Duration of all estimates and intervals."""
    findings: tuple[WindowsDiffer, ...]

    @property
    def parameters(self) -> Parameters:
        """(M,) the joint estimate: α [1/s²], β [1/s], τ [s]."""
        return self.fits[0].parameters


def fit_windows(segments: Sequence[Segment], case: Case = "II", level: float = LEVEL) -> JointFit:
    """One parameter set by the joint likelihood of several windows, and how far these differ.

    Args:
        segments: at least two, of the same vehicles in the same order: disjoint windows of one
            recording, or windows of several recordings, with the same step in time. The first one's
            numbers and names of vehicles serve for all.
        case: "I" for one parameter set, "II" for one per follower.
        level: of all intervals, above 0 and below 1.

    Raises:
        ConfigError: for fewer than two segments, or a level that is not allowed.
        SegmentError: when segments overlap or do not match, or one is too short.
    """
    segments = tuple(segments)
    check_windows(segments)
    for segment in segments:
        series_of([segment], case)  # refuses one that is too short before any search begins
    started = time.perf_counter()
    own = tuple(estimate(segment, case, level) for segment in segments)
    fits = tuple(fit_among(segments, segment, case) for segment in segments)
    uncertainty = intervals(segments, fits[0], level)
    between = _between(own, level)
    return JointFit(
        case,
        own,
        fits,
        uncertainty,
        between,
        time.perf_counter() - started,
        _findings(between, case),
    )


def estimate(segment: Segment, case: Case = "II", level: float = LEVEL) -> WindowEstimate:
    """What one window says by itself.

    Args:
        segment: with M followers.
        case: "I" or "II".
        level: of the intervals, above 0 and below 1.

    Raises:
        ConfigError: for a level that is not allowed.
        SegmentError: when the window is too short.
    """
    fit = fit_among((segment,), segment, case)
    uncertainty = intervals(segment, fit, level)
    times = segment.followers if case == "I" else 1
    by_curvature = np.tile([one.errors for one in maxima_of(segment, case)], (times, 1))
    errors = np.maximum(by_curvature, np.log(uncertainty.draws.values).std(axis=0))
    return WindowEstimate(segment, fit, uncertainty, errors)


def _between(windows: Sequence[WindowEstimate], level: float) -> tuple[BetweenWindows, ...]:
    values = np.array([one.fit.parameters.values for one in windows])
    logs = np.log(np.where(values > 0, values, np.nan))
    errors = np.array([one.errors for one in windows])
    return tuple(
        BetweenWindows(
            vehicle,
            *(random_effects(logs[:, k, i], errors[:, k, i], level) for i in range(3)),
        )
        for k, vehicle in enumerate(windows[0].segment.vehicles[1:])
    )


def _findings(between: Sequence[BetweenWindows], case: Case) -> tuple[WindowsDiffer, ...]:
    found = []
    for one in between[:1] if case == "I" else between:
        pairs = zip(PARAMETERS, one.effects, strict=True)
        symbols = tuple(p.symbol for p, effect in pairs if effect.probability < SIGNIFICANCE)
        if symbols:
            windows = max(effect.windows for effect in one.effects)
            found.append(WindowsDiffer(0 if case == "I" else one.vehicle, symbols, windows))
    return tuple(found)


def random_effects(estimates: ArrayLike, errors: ArrayLike, level: float = LEVEL) -> RandomEffects:
    """Mean and between-window deviation of a parameter's logarithm.

    Args:
        estimates: (K,) of the logarithm, one a window; those that are not finite do not count.
        errors: (K,) their standard errors; windows count whose error is one of `PLAUSIBLE`.
        level: of the intervals, above 0 and below 1.
    """
    x, s = np.asarray(estimates, float), np.asarray(errors, float)
    known = np.isfinite(x) & (PLAUSIBLE[0] < s) & (s < PLAUSIBLE[1])
    x, variances, windows = x[known], s[known] ** 2, int(known.sum())
    if windows < 2:
        nan = float("nan")
        return RandomEffects(windows, nan, nan, nan, nan, nan, level, nan, nan, nan)

    from scipy.optimize import brentq  # takes a quarter of a second, which few commands need

    def heterogeneity(variance: float) -> float:
        """Q(d) for d²; falls as it grows."""
        weights = 1.0 / (variances + variance)
        return float(weights @ (x - weights @ x / weights.sum()) ** 2)

    def deviation(target: float) -> float:
        """The d at which Q(d) is as large; zero where it is never so large."""
        if heterogeneity(0.0) <= target:
            return 0.0
        # Q(d) is at most the sum of squares over d², so the root lies below this.
        most = float(((x - x.mean()) ** 2).sum()) / target
        return float(np.sqrt(brentq(lambda d2: heterogeneity(d2) - target, 0.0, most)))

    freedom, tail = windows - 1, (1.0 - level) / 2.0
    found, q = deviation(freedom), heterogeneity(0.0)
    weights = 1.0 / (variances + found**2)
    return RandomEffects(
        windows=windows,
        mean=float(weights @ x / weights.sum()),
        error=float(weights.sum() ** -0.5),
        deviation=found,
        lower=deviation(float(chdtri(freedom, tail))),
        upper=deviation(float(chdtri(freedom, 1.0 - tail))),
        level=level,
        q=q,
        probability=float(chdtrc(freedom, q)),
        i_squared=max(0.0, 1.0 - freedom / q) if q > 0 else 0.0,
    )


def check_windows(segments: tuple[Segment, ...]) -> None:
    """Refuse segments that cannot share one likelihood.

    Args:
        segments: at least two.

    Raises:
        ConfigError: for fewer.
        SegmentError: when they overlap or do not match.
    """
    if len(segments) < 2:
        raise ConfigError("windows: one is no comparison; give at least two, or use fit for one.")
    first = segments[0]
    for other in segments[1:]:
        if other.followers != first.followers:
            raise SegmentError(
                f"{other.source}: {other.window} has {other.followers} followers and"
                f" {first.window} of {first.source} has {first.followers}; take windows of the same"
                " vehicles."
            )
        steps = [stride_of(one) * one.sample_time for one in (first, other)]
        if abs(steps[1] - steps[0]) > SLACK:
            raise SegmentError(
                f"{other.source}: its samples are {other.sample_time:g} s apart and those of"
                f" {first.source} {first.sample_time:g} s, so one likelihood cannot hold both; take"
                " recordings with equal steps."
            )
    for one, other in combinations(segments, 2):
        shared = min(one.window.end, other.window.end) - max(one.start, other.start)
        same = one is other or (one.sha256 == other.sha256 != "" and one.vehicles == other.vehicles)
        if same and shared > SLACK:
            raise SegmentError(
                f"{one.source}: the windows {one.window} and {other.window} overlap, so their data"
                " would count twice; choose disjoint ones."
            )
