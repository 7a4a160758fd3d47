"""Maximum likelihood: the parameters under which the recording is most probable.

The model of `state_space` says how probable a recording is, disturbance and noise included, and
its Kalman filter computes it exactly. So α, ατ and β are sought together with the size, memory and
rise of the disturbance and the receivers' noise (see `likelihood`).

One set of parameters may hold for several series: the followers of a platoon (Case I), or several
windows of one vehicle. Their log-likelihoods add up; disturbance and noise are shared as well.
"""

from collections.abc import Sequence
from functools import lru_cache

import numpy as np

from accpinn.findings import Finding
from accpinn.methods import best_first, direct
from accpinn.methods.estimate import Fit, Outcome, WeaklyDetermined
from accpinn.methods.kalman import smooth
from accpinn.methods.likelihood import Maximum, maximise
from accpinn.methods.regression import Solution
from accpinn.methods.series import measured_of, moving, series_of, stride_of
from accpinn.methods.state_space import Form, StateSpace, complete, state_space
from accpinn.model.cthp import Case, Trajectories
from accpinn.model.registry import CTHPS, FOLLOWING, PAPER
from accpinn.model.spec import PAPER_SPEC, ModelSpec
from accpinn.segment import Segment
from accpinn.units import FloatArray, Mask, Metres, MetresPerSecond, Seconds, frozen

KEY = "maximum-likelihood"
DISTURBANCE = slice(3, 6)
"""s, T and T₂ among the unknowns."""
INTERCEPT: Metres = 6.0
"""Value of s₀ from which it is sought; τ gives way at `TYPICAL_SPEED`."""
LATENESSES = (0.3, 0.9)
"""Values of a lag or a delay in s from which it is sought; its likelihood may have two maxima."""
TYPICAL_SPEED: MetresPerSecond = 25.0
SHORTEST_HEADWAY: Seconds = 0.2
"""Least τ of a start."""


class DisturbanceSize(Finding, frozen=True):
    """The stationary disturbance of a follower that has the greatest likelihood."""

    text = (
        "{vehicle}: the disturbance has a standard deviation of {deviation:.2f} m/s²; it is"
        " correlated over about {memory:.1f} s and builds up within about {rise:.1f} s."
    )

    vehicle: int
    deviation: float
    """Standard deviation s in m/s²."""
    memory: Seconds
    """Correlation time T."""
    rise: Seconds
    """Rise time T₂."""


def joint_maxima(
    segments: tuple[Segment, ...],
    case: Case,
    spec: ModelSpec = PAPER_SPEC,
    followers: tuple[int, ...] | None = None,
) -> tuple[Maximum, ...]:
    """The maximum of each follower, in Case I of all together, under the segments' likelihood.

    For segments and followers see `series_of`.
    """
    if followers is None or case == "I":
        followers = tuple(range(segments[0].followers))
    return _joint_maxima(segments, case, spec, followers)


@lru_cache(maxsize=64)
def _joint_maxima(
    segments: tuple[Segment, ...], case: Case, spec: ModelSpec, followers: tuple[int, ...]
) -> tuple[Maximum, ...]:
    series = series_of(segments, case, followers)
    if spec == PAPER_SPEC:
        return maximise(series)
    known = _joint_maxima(segments, case, PAPER_SPEC, followers)
    starts = _further_starts(spec.model, [maximum.coordinates for maximum in known])
    return maximise(series, spec, starts)


def _further_starts(form: Form, known: Sequence[FloatArray]) -> list[FloatArray]:
    """Starts of a model with further terms, from the maxima (G, P) of the CTHP."""
    terms = FOLLOWING[form].terms
    intercept = INTERCEPT if "s0" in terms else 0.0
    starts = []
    for late in LATENESSES if terms[-1] != "s0" else (0.0,):
        further = [intercept if term == "s0" else late for term in terms]
        for z in known:
            tau = np.exp(z[1] - z[0]) - intercept / TYPICAL_SPEED
            start = np.append(z, further)
            start[1] = z[0] + np.log(max(tau, SHORTEST_HEADWAY))
            starts.append(start)
    return starts


def fit(
    segment: Segment,
    case: Case = "II",
    spec: ModelSpec = PAPER_SPEC,
    segments: tuple[Segment, ...] = (),
) -> Fit:
    """The most probable parameters of the segment, or of all ``segments``, and its smoothed motion.

    Raises:
        SegmentError: when the window is too short to say anything.
    """
    segments = segments or (segment,)
    form = spec.model
    maxima = joint_maxima(segments, case, spec)
    followers = maxima * segment.followers if case == "I" else maxima
    theta = np.array([maximum.theta for maximum in followers])
    values = np.array([maximum.values for maximum in followers])
    # What would be without the constraints is known of the CTHP alone.
    active: Mask = np.asarray((theta == 0.0) & (form == PAPER))
    free = theta.copy()
    for g, maximum in _without_bounds(segments, case).items() if form == PAPER else ():
        free[slice(None) if case == "I" else g] = maximum.values[:3]
    step = stride_of(segment) * segment.sample_time
    model = state_space(form, values, step)
    means = smooth(model, measured_of(segment))
    means[:, 0] += model.shift
    surrogate, disturbance = _at_instants(segment, step, model, means)
    return Fit.of(
        KEY,
        segment,
        case,
        Solution(frozen(theta), frozen(free), active, complete(form, values)[:, 3:]),
        outcome=Outcome.SOLVED if all(m.converged for m in maxima) else Outcome.FINISHED,
        config={"spacing": step},
        surrogate=surrogate,
        loss={"log_likelihood": sum(maximum.log_likelihood for maximum in maxima)},
        iterations=max(maximum.rounds for maximum in maxima),
        findings=[
            WeaklyDetermined(vehicle)
            for vehicle, moves in zip(segment.vehicles[1:], moving(segment, case), strict=True)
            if not moves
        ],
        arrays={"disturbance": disturbance, "unknowns": values},
    )


@lru_cache(maxsize=64)
def _without_bounds(segments: tuple[Segment, ...], case: Case) -> dict[int, Maximum]:
    """Where a bound is active, by group: the maximum without the rational driving constraints."""
    maxima = joint_maxima(segments, case)
    bound = [g for g, maximum in enumerate(maxima) if (maximum.theta == 0.0).any()]
    if not bound:
        return {}
    near = [np.append(maxima[g].values[:3], maxima[g].coordinates[3:]) for g in bound]
    unbounded = maximise(series_of(segments, case, bound), ModelSpec("unbounded"), near)
    return dict(zip(bound, unbounded, strict=True))


def disturbance_sizes(vehicles: Sequence[int], fit: Fit) -> tuple[DisturbanceSize, ...]:
    """One finding a follower, or in Case I one for all; none of another method's fit.

    The vehicles (M+1,) are numbers in the file, leader first.
    """
    if fit.method != KEY or "unknowns" not in fit.arrays:
        return ()
    numbers = (0,) if fit.case == "I" and len(vehicles) > 2 else vehicles[1:]
    rows = fit.arrays["unknowns"][:, DISTURBANCE].tolist()
    return tuple(DisturbanceSize(number, *row) for number, row in zip(numbers, rows, strict=False))


def _at_instants(
    segment: Segment, step: Seconds, model: StateSpace, means: FloatArray
) -> tuple[Trajectories, FloatArray]:
    """The smoothed motion, and the disturbance (N, M) in m/s², at all instants of the segment.

    The smoothed states (K, n, M) are those at the samples used, which are a step apart. Between
    these the motion is the cubic that has the smoothed values and rates.
    """
    from scipy.interpolate import CubicHermiteSpline  # takes a second to import, which few need

    time = step * np.arange(len(means))
    rates = np.einsum("ijb,kjb->kib", model.rates, means)
    curves = CubicHermiteSpline(time, means[:, :3], rates[:, :3])(segment.time)
    gaps, speeds, ahead = np.moveaxis(curves, 1, 0)
    disturbance = np.stack(
        [np.interp(segment.time, time, column) for column in means[:, 3].T], axis=1
    )
    motion = Trajectories(segment.time, np.column_stack([ahead[:, 0], speeds]), gaps)
    return motion, disturbance


METHOD = direct(
    KEY, "Maximum likelihood", fit, best_first(CTHPS), typical_seconds=0.9, tolerance=1e-3,
    allows_missing=True, takes_windows=True,
    summary="exact likelihood of a model with lasting disturbances; unbiased, with intervals",
)  # fmt: skip
