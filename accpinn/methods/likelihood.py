"""Search for the largest likelihood of the model of `state_space`.

    maximise  log L(z) + log prior(z),   z = ln of all unknowns (the offset, λ and d as they are),

the prior weak and on disturbance, noise and further unknowns alone. The search is scoring: the
gradient g of the criterion and the expected information I, both from differences of the
innovations, give z + I⁻¹g, within a region that grows with success. Near the end the curvature is
corrected by what the gradient shows (BFGS), as the expected information is not the curvature where
the model is incomplete. Several searches run at once; one that comes close to a better one ends.

Source: Ljung, System Identification, 2nd ed., 1999, chapters 7 and 10.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from accpinn.methods.kalman import Pairs, Part, constant, log_likelihood, parts
from accpinn.methods.series import Series
from accpinn.methods.state_space import COMMON, Form, StateSpace, complete, coordinates, state_space
from accpinn.model.spec import PAPER_SPEC, ModelSpec
from accpinn.units import FloatArray, Mask

DIFFERENCE = 1e-5
"""Difference of a coordinate, for the slopes."""
ROUNDS = 60
LONGEST_STEP = 1.5
"""Longest step of any coordinate in a round."""
SCORING, NEAR = 10, 1.0
"""Rounds after which the curvature is corrected, and the gain in log L below which it is."""
CLOSE = 1e-5
"""The search ends when a full step would gain less than this in log L."""
SAME = 0.3
"""Squared standard errors from a better search within which another one is given up."""
MEMORY = [unknown.name for unknown in COMMON].index("memory")
Groups = NDArray[np.int64]
AT_ONCE = 240
"""Models filtered at once: as many as have covariances that fit a processor's cache."""
LARGEST_BATCH = 3_000_000
"""Samples times models filtered at once, which bounds the memory of very long recordings."""
STARTS = ((0.0, 0.0, (0.0, 0.0)), (-1.5, 1.4, (0.0, 0.0)), (0.0, 0.0, (1.5, -1.2)))
"""ln of factors that each search starts with: on α and ατ, on the disturbance's memory, and on the
noise of gap and speed.

Near the middle of published parameters; far below it, where weak controllers lie that are disturbed
for long; and in the middle with coarse gaps, as what the model does not explain may pass for noise
of the gap or for a lasting disturbance, with a maximum each. In 85 windows of 20 recordings these
three found the largest maximum of all that were tried, under two models."""
GAP_NOISE = [unknown.name for unknown in COMMON].index("gap_noise")
"""The place of the gap's noise; that of the speed is the next."""


@dataclass(frozen=True, eq=False)
class Maximum:
    """The maximum of the criterion of one group."""

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
    def complete(self) -> FloatArray:
        """(6,) the complete parameters of a model; those at their least value are 0."""
        return complete(self.form, np.append(self.theta, self.values[3:]))

    @property
    def theta(self) -> FloatArray:
        """(3,) α, ατ, β; 0 where the search ends at the least value."""
        return vanishing(self.form, self.coordinates)


def log_errors(curvature: FloatArray) -> FloatArray:
    """(3,) standard errors of ln α, ln β, ln τ by a curvature (P, P); nan where a bound is active.

    A bound on α or ατ leaves ln τ without an error, too.
    """
    free = np.diag(curvature) > 0
    covariance = np.full(curvature.shape, np.nan)
    part = curvature[np.ix_(free, free)]
    covariance[np.ix_(free, free)] = np.linalg.inv(part + 1e-9 * np.eye(len(part)))
    alpha, alpha_tau, beta = np.diag(covariance)[:3]
    tau = alpha + alpha_tau - 2.0 * covariance[0, 1]
    return np.asarray(np.sqrt([alpha, beta, tau]))


def natural(form: Form, z: FloatArray) -> FloatArray:
    """Unknowns in their own units from coordinates (.., P)."""
    logarithmic = np.array([unknown.logarithmic for unknown in coordinates(form)])
    return np.where(logarithmic, np.exp(np.where(logarithmic, z, 0.0)), z)


def vanishing(form: Form, z: FloatArray) -> FloatArray:
    """θ (.., 3) from coordinates (.., P); components at their least value are 0."""
    theta = natural(form, z)[..., :3]
    least = np.array([unknown.lower for unknown in coordinates(form)[:3]])
    return np.where(theta <= least * (1 + 1e-9), 0.0, theta)


class Criterion:
    """log L + log prior of every group, as a function of its coordinates."""

    negligible: float = 0.0
    """Gain that is worth no further round; a search that expects less ends."""

    def __init__(self, series: Series, spec: ModelSpec = PAPER_SPEC, is_flat: bool = False) -> None:
        """Set up the criterion of series under a CTHP, whose terms have no prior if it is flat."""
        self.series, self.form, values = series, spec.model, dict(spec.fixed)
        unknowns = [
            replace(unknown, start=value, lower=value, upper=value)
            if (value := values.get(unknown.name)) is not None
            else unknown
            for unknown in coordinates(spec.model)
        ]
        self.size = len(unknowns)
        self.lower, self.upper = np.array([unknown.bounds for unknown in unknowns]).T
        self.start = np.array([unknown.centre for unknown in unknowns])
        self._weight = np.array(
            [0.0 if unknown.spread is None else unknown.spread**-2 for unknown in unknowns]
        )
        if is_flat:
            self._weight[len(COMMON) :] = 0.0
        self._members = [series.members(g) for g in range(series.groups)]

    def model(self, z: FloatArray) -> StateSpace:
        """The models of coordinates (B, P)."""
        return state_space(self.form, natural(self.form, z), self.series.step)

    def log_prior(self, z: FloatArray) -> FloatArray:
        """(..) of coordinates (.., P), up to a constant."""
        return np.asarray(-0.5 * ((z - self.start) ** 2 * self._weight).sum(axis=-1))

    def log_likelihood(self, z: FloatArray, groups: Groups) -> FloatArray:
        """(K,) log L at coordinates (K, P), each of the group (K,) that is named with it."""
        total = np.zeros(len(z))
        pairs = np.array([(k, j) for k, g in enumerate(groups) for j in self._members[g]])
        most = max(1, min(AT_ONCE, LARGEST_BATCH // len(self.series.measured)))
        for part in np.array_split(pairs, range(most, len(pairs), most)):
            which, series = part.T
            rows, models = np.unique(which, return_inverse=True)
            matches = Pairs(models, series)
            part_total = log_likelihood(self.model(z[rows]), self.series.measured, matches)
            np.add.at(total, which, part_total)
        return total

    def score(
        self, z: FloatArray, groups: Groups, present: FloatArray | None = None
    ) -> tuple[FloatArray, ...]:
        """Criterion (K,), gradient (K, P) and expected information (K, P, P), prior included.

        Each row of z (K, P) belongs to one of the groups (K,). The values ``present`` (K,) are to
        be exceeded: a lower row needs no gradient.
        """
        size = self.size
        around = np.stack([z, *(z + move for move in DIFFERENCE * np.eye(size))], axis=1)
        pairs = [(k, j) for k, g in enumerate(groups) for j in self._members[g]]
        which, series = np.array(pairs).T
        models = (which[:, None] * (size + 1) + np.arange(size + 1)).ravel()
        matches = Pairs(models, np.repeat(series, size + 1))
        total = constant(self.series.measured, matches)
        information = np.zeros((len(z), size, size))
        model = self.model(around.reshape(-1, size))
        for part in parts(model, self.series.measured, matches, size + 1):
            is_there = part.columns >= 0
            total[part.columns[is_there]] += part.deviance[is_there]
            rows = matches.models[part.columns[:: size + 1, 0]] // (size + 1)
            information[rows] += _information(part, size)
        value, gradient = self.log_prior(z), -(z - self.start) * self._weight
        curvature = np.tile(np.diag(self._weight), (len(z), 1, 1))
        total = -0.5 * total.reshape(len(pairs), -1)
        np.add.at(value, which, total[:, 0])
        slopes = (total[:, 1:] - total[:, :1]) / DIFFERENCE
        # A forward difference has half the curvature too much of it.
        np.add.at(gradient, which, slopes)
        gradient += DIFFERENCE / 2 * np.einsum("kii->ki", information)
        return value, gradient, curvature + information


def _information(part: Part, size: int) -> FloatArray:
    """(K, P, P) expected of K rows of P + 1 models, from the differences of P to the first."""
    shape, where = part.errors.shape, part.columns >= 0
    errors = part.errors * where[:, :, None, None]
    rows = shape[0] // (size + 1)
    errors = errors.reshape(rows, size + 1, -1)
    if part.first is not None:
        first = part.first * where[:, :, None]
        errors = np.concatenate([errors, first.reshape(rows, size + 1, -1)], axis=2)
    slope = errors[:, 1:] - errors[:, :1]
    logs = np.log(part.variances).reshape(rows, size + 1, -1)
    times = where[:: size + 1].sum(axis=1) * part.repeats / 2.0
    growth = (logs[:, 1:] - logs[:, :1]) * np.sqrt(times)[:, None, None]
    products = slope @ slope.transpose(0, 2, 1) + growth @ growth.transpose(0, 2, 1)
    return np.asarray(products / DIFFERENCE**2)


def first_rows(criterion: Criterion) -> FloatArray:
    """(S * G, P) coordinates at which the searches of all groups begin, start by start."""
    starts = np.tile(criterion.start, (len(STARTS), 1))
    for start, (gains, memory, noise) in zip(starts, STARTS, strict=True):
        start[:2] += gains
        start[MEMORY] += memory
        start[GAP_NOISE : GAP_NOISE + 2] += noise
    return np.repeat(starts, criterion.series.groups, axis=0)


def maximise(
    series: Series, spec: ModelSpec = PAPER_SPEC, near: Sequence[FloatArray] | None = None
) -> tuple[Maximum, ...]:
    """The maximum of each of G groups, the best of several searches.

    They begin at ``near`` (S * G, P), coordinates of all groups in turn, else at `STARTS`.
    """
    criterion = Criterion(series, spec)
    z = first_rows(criterion) if near is None else np.array(near)
    groups = np.arange(len(z)) % series.groups
    ends = search(criterion, z, groups)
    rivals = (ends[group :: series.groups] for group in range(series.groups))
    return tuple(max(ends, key=lambda end: end.criterion) for ends in rivals)


def search(
    criterion: Criterion, z: FloatArray, groups: Groups, is_last_held: bool = False
) -> tuple[Maximum, ...]:
    """The maxima at which `ascend` ends; arguments as there."""
    *_, last = ascend(criterion, z, groups, is_last_held)
    return last.maxima


class Ascending(NamedTuple):
    """The state of a search of K rows."""

    coordinates: FloatArray
    """(K, P) z."""
    value: FloatArray
    """(K,) the criterion."""
    information: FloatArray
    """(K, P, P) expected at those rows; the curvature that the search corrects is another. At the
    end without the coordinates that a bound holds."""
    maxima: tuple[Maximum, ...] = ()
    """(K,) the maximum that each row leads to, at the end; before that empty."""


def ascend(
    criterion: Criterion, z: FloatArray, groups: Groups, is_last_held: bool = False
) -> Iterator[Ascending]:
    """Ascend from each row of z (K, P), all at once; ``groups`` (K,) are those of the rows.

    Where the last unknown is held, it keeps its value, each row its own.

    Yields:
        The present rows, at the start, after each round and, with the maxima, at the end; the
        arrays change later.
    """
    z = np.clip(z, criterion.lower, criterion.upper)
    value, gradient, curvature = criterion.score(z, groups)
    damping, reach = np.full(len(z), 1e-2), np.full(len(z), LONGEST_STEP)
    rounds = np.zeros(len(z), int)
    done = np.zeros(len(z), bool)
    latest = curvature.copy()
    yield Ascending(z, value, latest)
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
            gain = gradient[k] @ step
            done[k] = (is_full and gain < CLOSE) or gain < criterion.negligible
        active = active[~done[active]]
        if not len(active):
            break
        scores = criterion.score(trial[active], groups[active], value[active])
        rounds[active] += 1
        for k, new, slope, information in zip(active, *scores, strict=True):
            if not new > value[k] - 1e-9:
                damping[k] *= 8.0
                reach[k] = np.abs(trial[k] - z[k]).max() / 4.0
                done[k] = damping[k] > 1e8
                continue
            if new - value[k] < NEAR or rounds[k] > SCORING:
                curvature[k] = corrected_curvature(
                    curvature[k], trial[k] - z[k], gradient[k] - slope
                )
            else:
                curvature[k] = information
            latest[k] = information
            z[k], value[k], gradient[k] = trial[k], new, slope
            damping[k] = max(damping[k] / 8.0, 1e-9)
            reach[k] = min(4.0 * reach[k], LONGEST_STEP)
        for k in active if not is_last_held else ():
            rivals = np.flatnonzero((groups == groups[k]) & (value > value[k]))
            away = z[rivals] - z[k]
            done[k] |= (np.einsum("ki,kij,kj->k", away, curvature[rivals], away) < SAME).any()
        yield Ascending(z, value, latest)
    maxima = []
    for end, top, slope, bend, is_done, taken in zip(
        z, value, gradient, curvature, done & (damping < 1.0), rounds, strict=True
    ):
        free = not_held(criterion, end, slope)
        # A lag of almost nothing is as uncertain as any other, unless it is held.
        free[len(COMMON) :] = (criterion.lower < criterion.upper)[len(COMMON) :]
        bend = np.where(np.logical_and.outer(free, free), bend, 0.0)
        likelihood = float(top - criterion.log_prior(end))
        maxima.append(
            Maximum(criterion.form, end, float(top), likelihood, bend, bool(is_done), int(taken))
        )
    curvatures = [maximum.curvature for maximum in maxima]
    yield Ascending(z, value, np.where(curvatures, latest, 0.0), tuple(maxima))


def not_held(criterion: Criterion, z: FloatArray, gradient: FloatArray) -> Mask:
    """(P,) whether a coordinate is not held by a bound."""
    held = (z <= criterion.lower) & (gradient < 0) | (z >= criterion.upper) & (gradient > 0)
    return np.asarray(~held)


def scoring_step(
    curvature: FloatArray, gradient: FloatArray, free: Mask, damping: float, reach: float
) -> FloatArray:
    """(P,) the damped Newton step of the free coordinates (P,); 0 for the others.

    The curvature (P, P) is -d²/dz² of the criterion; ``damping`` is the share of each diagonal
    entry that is added to it, ``reach`` the longest step of any coordinate.
    """
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
