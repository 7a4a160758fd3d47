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

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import chdtrc, chdtri, stdtrit

from accpinn.channels import PARAMETERS
from accpinn.errors import SegmentError
from accpinn.findings import Finding, Labelled, Words
from accpinn.inference.intervals import LEVEL
from accpinn.methods.maximum_likelihood import maxima_of
from accpinn.methods.series import series_of, stride_of
from accpinn.model.cthp import Case
from accpinn.segment.cut import SLACK
from accpinn.segment.segment import Segment
from accpinn.study.result import Result
from accpinn.units import FloatArray

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


def log_errors(window: Result) -> FloatArray:
    """(M, 3) standard errors of ln α, ln β, ln τ of one window; nan where a bound is active."""
    (segment,) = window.segments
    times = segment.followers if window.fit.case == "I" else 1
    by_curvature = np.tile([maximum.errors for maximum in maxima_of(segment, window.fit.case)],
                           (times, 1))  # fmt: skip
    return np.asarray(np.maximum(by_curvature, np.log(window.uncertainty.draws.values).std(axis=0)))


def between_windows(result: Result, level: float = LEVEL) -> tuple[BetweenWindows, ...]:
    """(M,) how far each follower's parameters vary between windows; equal ones in Case I."""
    values = np.array([window.parameters.values for window in result.windows])
    logs = np.log(np.where(values > 0, values, np.nan))
    errors = np.array([log_errors(window) for window in result.windows])
    return tuple(
        BetweenWindows(
            vehicle,
            *(random_effects(logs[:, k, i], errors[:, k, i], level) for i in range(3)),
        )
        for k, vehicle in enumerate(result.info.vehicles[1:])
    )


def differing_windows(between: Sequence[BetweenWindows], case: Case) -> tuple[WindowsDiffer, ...]:
    """A finding for each follower whose windows differ by more than sampling error explains."""
    findings = []
    for follower in between[:1] if case == "I" else between:
        pairs = zip(PARAMETERS, follower.effects, strict=True)
        symbols = tuple(p.symbol for p, effect in pairs if effect.probability < SIGNIFICANCE)
        if symbols:
            windows = max(effect.windows for effect in follower.effects)
            vehicle = 0 if case == "I" else follower.vehicle
            findings.append(WindowsDiffer(vehicle, symbols, windows))
    return tuple(findings)


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


def check_windows(segments: tuple[Segment, ...], case: Case) -> None:
    """Refuse segments that cannot share one likelihood.

    Raises:
        SegmentError: when they overlap or do not match, or one is too short.
    """
    first = segments[0]
    for other in segments[1:]:
        if other.followers != first.followers:
            raise SegmentError(
                f"{other.source}: {other.window} has {other.followers} followers and"
                f" {first.window} of {first.source} has {first.followers}; take windows of the same"
                " vehicles."
            )
        steps = [stride_of(segment) * segment.sample_time for segment in (first, other)]
        if abs(steps[1] - steps[0]) > SLACK:
            raise SegmentError(
                f"{other.source}: its samples are {other.sample_time:g} s apart and those of"
                f" {first.source} {first.sample_time:g} s, so one likelihood cannot hold both; take"
                " recordings with equal steps."
            )
    for earlier, later in combinations(segments, 2):
        shared = min(earlier.window.end, later.window.end) - max(earlier.start, later.start)
        same = earlier is later or (
            earlier.sha256 == later.sha256 != "" and earlier.vehicles == later.vehicles
        )
        if same and shared > SLACK:
            raise SegmentError(
                f"{earlier.source}: the windows {earlier.window} and {later.window} overlap, so"
                " their data would count twice; choose disjoint ones."
            )
    for segment in segments:
        series_of([segment], case)  # refuses one that is too short before any search begins
