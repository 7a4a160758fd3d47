"""The joint likelihood of windows: the parameters under which all of them are most probable.

The model of `state_space` says how probable a recording is, disturbance and noise included, and
its Kalman filter computes it exactly. So α, ατ and β are sought together with the size, memory and
rise of the disturbance and the receivers' noise: `likelihood` has the criterion and the search,
this module where searches start and what an estimate of several series is.

One set of parameters may hold for several series: the followers of a platoon (Case I), or several
windows of one vehicle. Their log-likelihoods add up; disturbance and noise are shared as well.
"""

from collections.abc import Iterator, Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from accpinn.findings import Finding
from accpinn.methods import Segments
from accpinn.methods.estimate import Estimate
from accpinn.methods.kalman import smooth
from accpinn.methods.likelihood import Criterion, Maximum, ascend, first_rows, maximise
from accpinn.methods.series import measured_of, series_of, stride_of
from accpinn.methods.state_space import LEAST, Form, state_space
from accpinn.model.cthp import Case, Parameters, Trajectories
from accpinn.model.registry import FOLLOWING
from accpinn.model.spec import PAPER_SPEC, ModelSpec
from accpinn.segment import Segment
from accpinn.units import FloatArray, Metres, MetresPerSecond, Seconds

UNKNOWNS = "unknowns"
"""Name of the array (M, P) of an estimate with all unknowns of the likelihood."""
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


class Rise(NamedTuple):
    """The state of the search for the maxima of G groups; of each the best of its starts.

    At first it is where a caller's initial values are.
    """

    form: Form
    """The model that is searched: first the CTHP, then the one that is asked for."""
    coordinates: FloatArray
    """(G, P) z."""
    value: FloatArray
    """(G,) log likelihood + log prior."""
    information: FloatArray
    """(G, P, P) expected information there."""
    maxima: tuple[Maximum, ...] = ()
    """(G,) at the end; before that empty."""


def rising(
    segments: Segments,
    case: Case,
    spec: ModelSpec = PAPER_SPEC,
    followers: tuple[int, ...] | None = None,
    initial: Parameters | None = None,
) -> Iterator[Rise]:
    """Search for the maxima that `joint_maxima` returns, one round after the other.

    The first search begins at the ``initial`` α, β and τ, else in the middle of published ones, and
    at two further places. The maxima of the CTHP are where searches for a model with further terms
    begin.
    """
    series = series_of(segments, case, followers)
    criterion = Criterion(series, PAPER_SPEC)
    rows = first_rows(criterion)
    if initial is not None:
        theta = np.maximum(initial.theta, LEAST)
        rows[: series.groups, :3] = np.log(theta)
    yield from (rise := _Rising()).through(criterion, rows, from_first=initial is not None)
    if spec != PAPER_SPEC:
        starts = _further_starts(spec.model, [maximum.coordinates for maximum in rise.maxima])
        yield from rise.through(Criterion(series, spec), np.array(starts))


class _Rising:
    """The rounds of one search, and the maxima that it ends with."""

    maxima: tuple[Maximum, ...] = ()

    def through(
        self, criterion: Criterion, rows: FloatArray, from_first: bool = False
    ) -> Iterator[Rise]:
        """Ascend from rows (S * G, P), and yield the best of each group after every round.

        Before the first round it may be the first start of each that is yielded.
        """
        count = criterion.series.groups
        groups = np.arange(len(rows)) % count
        for at in ascend(criterion, rows, groups):
            start = 0 if from_first else at.value.reshape(-1, count).argmax(axis=0)
            best, from_first = start * count + np.arange(count), False
            self.maxima = tuple(at.maxima[k] for k in best) if at.maxima else ()
            yield Rise(
                criterion.form,
                at.coordinates[best].copy(),
                at.value[best].copy(),
                at.information[best].copy(),
                self.maxima,
            )


def joint_maxima(
    segments: Segments,
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
    segments: Segments, case: Case, spec: ModelSpec, followers: tuple[int, ...]
) -> tuple[Maximum, ...]:
    if spec == PAPER_SPEC:
        return maximise(series_of(segments, case, followers))
    simpler = _joint_maxima(segments, case, PAPER_SPEC, followers)
    starts = _further_starts(spec.model, [maximum.coordinates for maximum in simpler])
    return maximise(series_of(segments, case, followers), spec, starts)


def _further_starts(form: Form, maxima: Sequence[FloatArray]) -> list[FloatArray]:
    """Starts of a model with further terms, from the maxima (G, P) of the CTHP."""
    terms = FOLLOWING[form].terms
    intercept = INTERCEPT if "s0" in terms else 0.0
    starts = []
    for late in LATENESSES if terms[-1] != "s0" else (0.0,):
        further = [intercept if term == "s0" else late for term in terms]
        for z in maxima:
            tau = np.exp(z[1] - z[0]) - intercept / TYPICAL_SPEED
            start = np.append(z, further)
            start[1] = z[0] + np.log(max(tau, SHORTEST_HEADWAY))
            starts.append(start)
    return starts


def without_bounds(segments: Segments, case: Case) -> dict[int, Maximum]:
    """The maximum without the rational driving constraints, by group, where a bound is active.

    It is that of the CTHP.
    """
    maxima = joint_maxima(segments, case)
    bound = [g for g, maximum in enumerate(maxima) if (maximum.theta == 0.0).any()]
    if not bound:
        return {}
    near = [np.append(maxima[g].values[:3], maxima[g].coordinates[3:]) for g in bound]
    unbounded = maximise(series_of(segments, case, bound), ModelSpec("unbounded"), near)
    return dict(zip(bound, unbounded, strict=True))


def disturbance_sizes(vehicles: Sequence[int], estimate: Estimate) -> tuple[DisturbanceSize, ...]:
    """One finding a follower, or in Case I one for all; none for a method without a likelihood.

    The vehicles (M+1,) are numbers in the file, leader first.
    """
    unknowns = estimate.arrays.get(UNKNOWNS)
    if unknowns is None:
        return ()
    numbers = (0,) if estimate.case == "I" and len(vehicles) > 2 else vehicles[1:]
    rows = unknowns[:, DISTURBANCE].tolist()
    return tuple(DisturbanceSize(number, *row) for number, row in zip(numbers, rows, strict=False))


def smoothed(form: Form, values: FloatArray, segment: Segment) -> tuple[Trajectories, FloatArray]:
    """The motion and the disturbance (N, M) in m/s² that unknowns (M, P) say of a window.

    They stand at all instants. Between the samples used the motion is the cubic that has the
    smoothed values and rates.
    """
    from scipy.interpolate import CubicHermiteSpline  # takes a second to import, which few need

    step = stride_of(segment) * segment.sample_time
    model = state_space(form, values, step)
    means = smooth(model, measured_of(segment))  # (K, n, M)
    means[:, 0] += model.shift
    time = step * np.arange(len(means))
    rates = np.einsum("ijb,kjb->kib", model.rates, means)
    curves = CubicHermiteSpline(time, means[:, :3], rates[:, :3])(segment.time)
    gaps, speeds, ahead = np.moveaxis(curves, 1, 0)
    disturbance = np.stack(
        [np.interp(segment.time, time, column) for column in means[:, 3].T], axis=1
    )
    motion = Trajectories(segment.time, np.column_stack([ahead[:, 0], speeds]), gaps)
    return motion, disturbance
