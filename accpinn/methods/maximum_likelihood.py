"""Maximum likelihood: the parameters under which the recording is most probable.

The model of `state_space` says how probable a recording is, disturbance and noise included, and
its Kalman filter computes it exactly. So α, ατ and β are sought together with the size, memory and
rise of the disturbance and the receivers' noise:

    maximise  log L(z) + log prior(z),   z = ln of all unknowns,

the prior weak and on disturbance and noise alone. The search is scoring: the gradient g of the
criterion and the expected information I, both from differences of the innovations, give
z + I⁻¹g; after a few rounds the curvature is corrected by what the gradient shows (BFGS), as the
expected information is not the curvature where the model is incomplete.

One set of parameters may hold for several series: the followers of a platoon (Case I), or several
windows of one vehicle. Their log-likelihoods add up; disturbance and noise are shared as well.

Samples: receivers report every 0.25 s and files of 10 Hz are smooth curves through the reports, so
neighbouring samples share their noise. One sample each 0.5 s is used. Missing samples are those
that the filter does not take in, so recordings with holes are used whole.

Source: Ljung, System Identification, 2nd ed., 1999, chapters 7 and 10.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicHermiteSpline

from accpinn.errors import Finding, SegmentError
from accpinn.methods.fit import Fit, Outcome, WeaklyDetermined
from accpinn.methods.kalman import SmoothedStates, innovations, log_likelihood, smooth
from accpinn.methods.method import direct
from accpinn.methods.regression import Solution
from accpinn.methods.state_space import (
    COMMON,
    Coordinate,
    Form,
    StateSpace,
    coordinates,
    state_space,
)
from accpinn.model.cthp import Case, Trajectories
from accpinn.segment.segment import Segment
from accpinn.units import FloatArray, Mask, MetresPerSecond, Seconds, frozen, stretches

KEY = "maximum-likelihood"
SPACING: Seconds = 0.5
"""Between the samples used; see above."""
DIFFERENCE = 1e-5
"""Of a coordinate, for the slopes; it moves the maximum by less."""
ROUNDS = 60
SCORING = 1.0
"""Rounds that use the expected information alone."""
SAME = 0.3
"""Squared standard errors from a better search within which another one is given up."""
LONGEST_STEP = 1.5
"""In ln of an unknown."""
CLOSE = 1e-5
"""The search ends when a full step would gain less than this in log L."""
LEAST_SAMPLES = 40
LEAST_MOTION: MetresPerSecond = 0.05
"""Deviation of a speed below which it may be noise alone, and no parameter is determined."""
DISTURBANCE = slice(3, 6)
"""s, T and T₂ among the unknowns."""
MEMORY = [one.name for one in COMMON].index("memory")
Groups = NDArray[np.int64]
SHORTEST_STRETCH = 10
"""Samples; what is left between masked instants and is shorter says next to nothing."""
LARGEST_BATCH = 3_000_000
"""Samples times models filtered at once, which bounds the memory."""
STARTS = ((0.0, 0.0), (-1.5, 1.4), (1.0, 0.0))
"""ln of two factors that each search starts with: on α and ατ, and on the disturbance's memory.

Near the middle of published parameters; far below it, where weak controllers lie that are disturbed
for long; and above it. A disturbance that lasts has a maximum of its own in some recordings."""

EXTRA_STARTS: dict[Form, tuple[float, ...]] = {
    "offset": (0.0,),
    "lag": (0.1, 0.5, 1.2),
    "delay": (0.1, 0.5, 1.2),
}
"""From which the further unknown is sought; the likelihood of a lag may have two maxima."""


class DisturbanceSize(Finding, frozen=True):
    """What disturbs a follower: the stationary process that the likelihood finds."""

    vehicle: int
    """0 for all followers together."""
    deviation: float
    """s in m/s²."""
    memory: Seconds
    """T."""
    rise: Seconds
    """T₂."""


@dataclass(frozen=True, eq=False)
class Series:
    """Measurements of p, v, u, one sample each `step`, and which of them share one set."""

    measured: FloatArray
    """(N, 3, S); nan where missing, and after the end of a series shorter than others."""
    group: tuple[int, ...]
    """(S,) 0 to G-1: the set of parameters that each series belongs to."""
    step: Seconds

    @property
    def groups(self) -> int:
        """G."""
        return max(self.group) + 1

    def members(self, group: int) -> list[int]:
        """The series of a group."""
        return [k for k, of in enumerate(self.group) if of == group]

    def of(self, groups: Sequence[int]) -> "Series":
        """Some of the groups, numbered anew."""
        kept = [(k, groups.index(of)) for k, of in enumerate(self.group) if of in groups]
        rows, group = zip(*kept, strict=True)
        return Series(self.measured[:, :, list(rows)], group, self.step)

    def until(self, share: float) -> "Series":
        """The same without what comes after a share of the time."""
        return Series(self.measured[: round(share * len(self.measured))], self.group, self.step)


def series_of(
    segments: Sequence[Segment], case: Case, followers: Sequence[int] | None = None
) -> Series:
    """The series of each follower; one group a follower (Case II), or one for all (Case I).

    Where the model's equation does not count (the segment's mask), a series ends, and another one
    begins after it.

    Args:
        segments: of the same vehicles and with the same step; several are taken as further windows
            of these vehicles.
        case: "I" or "II".
        followers: which ones in Case II, 0 for the first; by default all.

    Raises:
        SegmentError: when too little of a follower is measured.
    """
    chosen = range(segments[0].followers) if followers is None or case == "I" else followers
    parts = [_measured_parts(segments, k) for k in chosen]
    counts = [sum(map(_complete, one)) for one in parts]
    if lacking := [k for k, count in zip(chosen, counts, strict=True) if count < LEAST_SAMPLES]:
        if case == "II" or sum(counts) < LEAST_SAMPLES:
            raise SegmentError(_too_little(segments[0], lacking))
    group = [0 if case == "I" else at for at, one in enumerate(parts) for _ in one]
    every = [part for one in parts for part in one]
    measured = np.full((max(map(len, every)), 3, len(every)), np.nan)
    for k, part in enumerate(every):
        measured[: len(part), :, k] = part
    step = stride_of(segments[0]) * segments[0].sample_time
    return Series(measured, tuple(group), step)


def measured_followers(segments: Sequence[Segment], case: Case) -> tuple[int, ...]:
    """The followers of whom enough is measured for the likelihood; in Case I all or none."""
    counts = [
        sum(map(_complete, _measured_parts(segments, k))) for k in range(segments[0].followers)
    ]
    if case == "I":
        return tuple(range(len(counts))) if sum(counts) >= LEAST_SAMPLES else ()
    return tuple(k for k, count in enumerate(counts) if count >= LEAST_SAMPLES)


def _measured_parts(segments: Sequence[Segment], follower: int) -> list[FloatArray]:
    """What counts of a follower in one piece each, (N, 3); pieces that say next to nothing go."""
    parts = []
    for segment in segments:
        measured, mask = measured_of(segment)[:, :, follower], segment.mask
        stride = stride_of(segment)
        rows = np.ones(len(measured), bool) if mask is None else mask[::stride, follower]
        pieces = [measured[stretch.rows] for stretch in stretches(rows)]
        parts += [piece for piece in pieces if _complete(piece) >= SHORTEST_STRETCH]
    return parts


def _too_little(segment: Segment, lacking: Sequence[int]) -> str:
    """Which followers are hardly measured, and the cure."""
    least = f"take a window in which at least {LEAST_SAMPLES * SPACING:g} s count and are measured"
    if len(lacking) == segment.followers:
        left = f"{segment.source}: what is left of {segment.window}"
        return f"{left} is too short for the likelihood; {least}."
    who = " and ".join(segment.labels[k + 1] for k in lacking)
    return (
        f"{segment.source}: too little of {who} is measured at {segment.window} for the likelihood;"
        f" choose other vehicles, or {least}."
    )


def _complete(measured: FloatArray) -> int:
    """How many of the samples (N, 3) have p, v and u."""
    return int((~np.isnan(measured)).all(axis=1).sum())


def stride_of(segment: Segment) -> int:
    """Samples of the segment from one that is used to the next."""
    return max(1, round(SPACING / segment.sample_time))


def measured_of(segment: Segment) -> FloatArray:
    """(N, 3, M): p, v and the speed ahead of each follower at the samples used; nan if missing."""
    speeds = segment.measured_speeds
    pairs = (segment.measured_gaps, speeds[:, 1:], speeds[:, :-1])
    return np.stack(pairs, axis=1)[:: stride_of(segment)]


def moving(segment: Segment, case: Case) -> Mask:
    """(M,) whether a follower or the vehicle ahead changes its speed by more than noise does."""
    varies = segment.speeds.std(axis=0) > LEAST_MOTION
    moves = varies[1:] | varies[:-1]
    return np.full_like(moves, moves.any()) if case == "I" else moves


@dataclass(frozen=True, eq=False)
class Maximum:
    """Where the criterion of one group is largest."""

    form: Form
    coordinates: FloatArray
    """(P,) z."""
    criterion: float
    """log L + log prior."""
    log_likelihood: float
    curvature: FloatArray
    """(P, P): -d²/dz² of the criterion, positive definite; without those held by a bound, where
    rows and columns are zero."""
    converged: bool
    rounds: int

    @property
    def values(self) -> FloatArray:
        """(P,) the unknowns in their own units; α, ατ, β at their least value stand for zero."""
        return natural(self.form, self.coordinates)

    @property
    def theta(self) -> FloatArray:
        """(3,) α, ατ, β; 0 where the search ends at the least value."""
        return vanishing(self.form, self.coordinates)

    @property
    def errors(self) -> FloatArray:
        """(3,) standard errors of ln α, ln β, ln τ by the curvature; nan where a bound is active.

        A bound on α or ατ leaves ln τ without an error, too.
        """
        free = np.diag(self.curvature) > 0
        covariance = np.full(self.curvature.shape, np.nan)
        part = self.curvature[np.ix_(free, free)]
        covariance[np.ix_(free, free)] = np.linalg.inv(part + 1e-9 * np.eye(len(part)))
        alpha, alpha_tau, beta = np.diag(covariance)[:3]
        tau = alpha + alpha_tau - 2.0 * covariance[0, 1]
        return np.asarray(np.sqrt([alpha, beta, tau]))


def natural(form: Form, z: FloatArray) -> FloatArray:
    """Unknowns in their own units from coordinates (.., P)."""
    logarithmic = np.array([one.logarithmic for one in coordinates(form)])
    return np.where(logarithmic, np.exp(np.where(logarithmic, z, 0.0)), z)


def vanishing(form: Form, z: FloatArray) -> FloatArray:
    """θ (.., 3) from coordinates (.., P); components at their least value are 0."""
    theta = natural(form, z)[..., :3]
    least = np.array([one.lower for one in coordinates(form)[:3]])
    return np.where(theta <= least * (1 + 1e-9), 0.0, theta)


class Criterion:
    """log L + log prior of every group, as a function of its coordinates."""

    def __init__(self, series: Series, form: Form = "cthp") -> None:
        """For series, under a form of the model."""
        self.series, self.form = series, form
        unknowns: tuple[Coordinate, ...] = coordinates(form)
        self.size = len(unknowns)
        self.lower, self.upper = np.array([one.bounds for one in unknowns]).T
        self.start = np.array([one.centre for one in unknowns])
        self._weight = np.array([0.0 if one.spread is None else one.spread**-2 for one in unknowns])
        self._members = [series.members(g) for g in range(series.groups)]

    def model(self, z: FloatArray) -> StateSpace:
        """The models of coordinates (B, P)."""
        return state_space(self.form, natural(self.form, z), self.series.step)

    def log_prior(self, z: FloatArray) -> FloatArray:
        """(..) of coordinates (.., P), up to a constant."""
        return np.asarray(-0.5 * ((z - self.start) ** 2 * self._weight).sum(axis=-1))

    def log_likelihood(self, z: FloatArray, groups: Groups) -> FloatArray:
        """(K,) log L at coordinates (K, P), each of the group (K,) that is named with it."""
        found = np.zeros(len(z))
        pairs = np.array([(k, j) for k, g in enumerate(groups) for j in self._members[g]])
        most = max(1, LARGEST_BATCH // len(self.series.measured))
        for part in np.array_split(pairs, range(most, len(pairs), most)):
            which, series = part.T
            total = log_likelihood(self.model(z[which]), self.series.measured[:, :, series])
            np.add.at(found, which, total)
        return found

    def score(self, z: FloatArray, groups: Groups) -> tuple[FloatArray, ...]:
        """Criterion (K,), gradient (K, P) and expected information (K, P, P), prior included.

        Args:
            z: (K, P)
            groups: (K,) which group each row belongs to.
        """
        size = self.size
        around = np.stack([z, *(z + move for move in DIFFERENCE * np.eye(size))], axis=1)
        pairs = [(k, j) for k, g in enumerate(groups) for j in self._members[g]]
        which, series = np.array(pairs).T
        model = self.model(around[which].reshape(-1, size))
        measured = np.repeat(self.series.measured[:, :, series], size + 1, axis=2)
        total, found = innovations(model, measured)
        total = total.reshape(len(pairs), -1)
        errors = found.errors.reshape(-1, len(pairs), size + 1)
        variances = found.variances.reshape(errors.shape)
        slope = (errors[..., 1:] - errors[..., :1]) / np.sqrt(variances[..., :1])
        growth = np.log(variances[..., 1:] / variances[..., :1]) / np.sqrt(2.0)
        information = sum(
            np.einsum("tbi,tbj->bij", one, one, optimize=True) for one in (slope, growth)
        )
        value, gradient = self.log_prior(z), -(z - self.start) * self._weight
        curvature = np.tile(np.diag(self._weight), (len(z), 1, 1))
        np.add.at(value, which, total[:, 0])
        information = information / DIFFERENCE**2
        # A forward difference has half the curvature too much of it.
        slopes = (total[:, 1:] - total[:, :1]) / DIFFERENCE
        slopes += DIFFERENCE / 2 * np.einsum("kii->ki", information)
        np.add.at(gradient, which, slopes)
        np.add.at(curvature, which, information)
        return value, gradient, curvature


def maximise(
    series: Series, form: Form = "cthp", near: Sequence[FloatArray] | None = None
) -> tuple[Maximum, ...]:
    """The maximum of each group, the best of several searches.

    Args:
        series: G groups.
        form: of the model.
        near: (S * G, P) coordinates that the maximum is known to be near to, those of all groups
            in turn; else `STARTS` count.
    """
    criterion = Criterion(series, form)
    if near is None:
        z = np.tile(criterion.start, (len(STARTS) * series.groups, 1))
        gain, memory = np.repeat(STARTS, series.groups, axis=0).T
        z[:, :2] += gain[:, None]
        z[:, MEMORY] += memory
    else:
        z = np.array(near)
    groups = np.arange(len(z)) % series.groups
    found = search(criterion, z, groups)
    best = []
    for group in range(series.groups):
        best.append(max(found[group :: series.groups], key=lambda one: one.criterion))
    return tuple(best)


def search(
    criterion: Criterion, z: FloatArray, groups: Groups, is_last_held: bool = False
) -> list[Maximum]:
    """Ascend from each row of z (K, P); all rows move at once.

    Args:
        criterion: of all groups.
        z: (K, P)
        groups: (K,) the group of each row.
        is_last_held: whether the last unknown keeps its value, each row its own.
    """
    z = np.clip(z, criterion.lower, criterion.upper)
    value, gradient, curvature = criterion.score(z, groups)
    damping, reach = np.full(len(z), 1e-2), np.full(len(z), LONGEST_STEP)
    rounds = np.zeros(len(z), int)
    done = np.zeros(len(z), bool)
    for _ in range(ROUNDS):
        active = np.flatnonzero(~done)
        if not len(active):
            break
        trial = z.copy()
        for k in active:
            free = not_held(criterion, z[k], gradient[k])
            free[-1] &= not is_last_held
            step = scoring_step(curvature[k], gradient[k], free, damping[k], reach[k])
            trial[k] = np.clip(z[k] + step, criterion.lower, criterion.upper)
            is_full = damping[k] < 1.0 and np.abs(step).max() < 0.99 * reach[k]
            done[k] = is_full and gradient[k] @ step < CLOSE
        active = active[~done[active]]
        if not len(active):
            break
        found = criterion.score(trial[active], groups[active])
        rounds[active] += 1
        for k, new, slope, information in zip(active, *found, strict=True):
            if not new > value[k] - 1e-9:
                damping[k] *= 8.0
                reach[k] = np.abs(trial[k] - z[k]).max() / 4.0
                done[k] = damping[k] > 1e8
                continue
            if new - value[k] < SCORING:
                curvature[k] = corrected_curvature(
                    curvature[k], trial[k] - z[k], gradient[k] - slope
                )
            else:
                curvature[k] = information
            z[k], value[k], gradient[k] = trial[k], new, slope
            damping[k] = max(damping[k] / 8.0, 1e-9)
            reach[k] = min(4.0 * reach[k], LONGEST_STEP)
        for k in active if not is_last_held else ():
            rivals = np.flatnonzero((groups == groups[k]) & (value > value[k]))
            away = z[rivals] - z[k]
            done[k] |= (np.einsum("ki,kij,kj->k", away, curvature[rivals], away) < SAME).any()
    maxima = []
    for end, top, slope, bend, is_done, taken in zip(
        z, value, gradient, curvature, done & (damping < 1.0), rounds, strict=True
    ):
        free = not_held(criterion, end, slope)
        free[len(COMMON) :] = True  # a lag of almost nothing is as uncertain as any other
        bend = np.where(np.logical_and.outer(free, free), bend, 0.0)
        likelihood = float(top - criterion.log_prior(end))
        maxima.append(
            Maximum(criterion.form, end, float(top), likelihood, bend, bool(is_done), int(taken))
        )
    return maxima


def not_held(criterion: Criterion, z: FloatArray, gradient: FloatArray) -> Mask:
    """(P,) whether a coordinate is not held by a bound."""
    held = (z <= criterion.lower) & (gradient < 0) | (z >= criterion.upper) & (gradient > 0)
    return np.asarray(~held)


def scoring_step(
    curvature: FloatArray,
    gradient: FloatArray,
    free: Mask,
    damping: float,
    reach: float = LONGEST_STEP,
) -> FloatArray:
    """(P,) the damped Newton step of the free coordinates; 0 for the others."""
    part = curvature[np.ix_(free, free)]
    part = part + np.diag(damping * np.diag(part) + 1e-9)
    step = np.zeros(len(gradient))
    step[free] = np.linalg.solve(part, gradient[free])
    return step * min(1.0, reach / max(float(np.abs(step).max()), 1e-300))


def corrected_curvature(curvature: FloatArray, move: FloatArray, fall: FloatArray) -> FloatArray:
    """The BFGS update of a curvature, where the gradient falls along the move."""
    along = float(move @ fall)
    pulled = curvature @ move
    expected = float(move @ pulled)
    if along <= 1e-10 * max(expected, 1e-300):
        return curvature
    change = np.outer(fall, fall) / along - np.outer(pulled, pulled) / expected
    return np.asarray(curvature + change)


def maxima_of(segment: Segment, case: Case, form: Form = "cthp") -> tuple[Maximum, ...]:
    """The maximum of each follower, or in Case I of all together; remembered for a few segments."""
    return joint_maxima((segment,), case, form)


def joint_maxima(
    segments: tuple[Segment, ...],
    case: Case,
    form: Form = "cthp",
    followers: tuple[int, ...] | None = None,
) -> tuple[Maximum, ...]:
    """The same for several segments of the same vehicles, under one likelihood.

    Args:
        segments: as for `series_of`; so is ``followers``.
        case: "I" or "II".
        form: of the model.
        followers: by default all.
    """
    if followers is None or case == "I":
        followers = tuple(range(segments[0].followers))
    return _joint_maxima(segments, case, form, followers)


@lru_cache(maxsize=64)
def _joint_maxima(
    segments: tuple[Segment, ...], case: Case, form: Form, followers: tuple[int, ...]
) -> tuple[Maximum, ...]:
    series = series_of(segments, case, followers)
    if form == "cthp":
        return maximise(series)
    known = [one.coordinates for one in _joint_maxima(segments, case, "cthp", followers)]
    return maximise(series, form, near=[np.append(z, x) for x in EXTRA_STARTS[form] for z in known])


def fit(segment: Segment, case: Case = "II") -> Fit:
    """The parameters that make the segment most probable, and the smoothed motion.

    Args:
        segment: speeds (N, M+1) in m/s and space-gaps (N, M) in m.
        case: "I" or "II".

    Raises:
        SegmentError: when the window is too short to say anything.
    """
    return fit_at(segment, case, maxima_of(segment, case))


def fit_at(segment: Segment, case: Case, maxima: tuple[Maximum, ...]) -> Fit:
    """A segment's fit under given maxima, which may be those of several segments together.

    Args:
        segment: speeds (N, M+1) in m/s and space-gaps (N, M) in m.
        case: "I" or "II".
        maxima: one in Case I, M in Case II.
    """
    of = maxima * segment.followers if case == "I" else maxima
    theta = np.array([one.theta for one in of])
    active: NDArray[np.bool_] = np.asarray(theta == 0.0)
    free = theta
    bound = [g for g, one in enumerate(maxima) if (one.theta == 0.0).any()]
    if bound:  # what the data ask for, were it not for the rational driving constraints
        near = [np.append(maxima[g].values[:3], maxima[g].coordinates[3:]) for g in bound]
        found = maximise(series_of([segment], case).of(bound), "unbounded", near)
        free = theta.copy()
        for g, one in zip(bound, found, strict=True):
            free[slice(None) if case == "I" else g] = one.values[:3]
    step = stride_of(segment) * segment.sample_time
    model = state_space("cthp", np.array([one.values for one in of]), step)
    states = smooth(model, measured_of(segment))
    surrogate, disturbance = _at_instants(segment, step, model, states)
    return Fit.of(
        KEY,
        segment,
        case,
        Solution(frozen(theta), frozen(free), active),
        outcome=Outcome.SOLVED if all(one.converged for one in maxima) else Outcome.FINISHED,
        config={"spacing": step},
        surrogate=surrogate,
        loss={"log_likelihood": sum(one.log_likelihood for one in maxima)},
        iterations=max(one.rounds for one in maxima),
        findings=[
            WeaklyDetermined(vehicle)
            for vehicle, moves in zip(segment.vehicles[1:], moving(segment, case), strict=True)
            if not moves
        ],
        arrays={
            "disturbance": disturbance,
            "unknowns": np.array([one.values for one in of]),
        },
    )


def disturbance_sizes(vehicles: Sequence[int], fit: Fit) -> tuple[DisturbanceSize, ...]:
    """One finding a follower, or in Case I one for all; none of another method's fit.

    Args:
        vehicles: (M+1,) numbers in the file, leader first.
        fit: of any method.
    """
    if fit.method != KEY or "unknowns" not in fit.arrays:
        return ()
    numbers = (0,) if fit.case == "I" else vehicles[1:]
    rows = fit.arrays["unknowns"][:, DISTURBANCE].tolist()
    return tuple(DisturbanceSize(number, *row) for number, row in zip(numbers, rows, strict=False))


def _at_instants(
    segment: Segment, step: Seconds, model: StateSpace, states: SmoothedStates
) -> tuple[Trajectories, FloatArray]:
    """The smoothed motion, and the disturbance (N, M) in m/s², at all instants of the segment.

    Between the samples used the motion is the cubic that has the smoothed values and rates.
    """
    means = states.means
    time = step * np.arange(len(means))
    rates = np.einsum("ijb,kjb->kib", model.rates, means)
    curves = CubicHermiteSpline(time, means[:, :3], rates[:, :3])(segment.time)
    gaps, speeds, ahead = np.moveaxis(curves, 1, 0)
    disturbance = np.stack([np.interp(segment.time, time, one) for one in means[:, 3].T], axis=1)
    motion = Trajectories(segment.time, np.column_stack([ahead[:, 0], speeds]), gaps)
    return motion, disturbance


METHOD = direct(
    KEY, "Maximum likelihood", fit, typical_seconds=0.9, tolerance=1e-3, allows_missing=True,
    summary="exact likelihood of a model with lasting disturbances; unbiased, with intervals",
)  # fmt: skip
