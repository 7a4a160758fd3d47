"""The exact likelihood of a linear state-space model, by a Kalman filter over many models at once.

With predicted state x and covariance P, the measurements of an instant are taken in one by one,
as their noise is independent (e and s are innovation and its variance):

    e = y_i - x_i,   s = P_ii + R_i,   K = P_·i / s,   x += K e,   P -= K P_i·
    log L = -½ Σ (e²/s + log 2πs);   then x = F x,  P = F P Fᵀ + Q.

A missing sample is not taken in. Once P no longer changes and nothing is missing, neither do the
gains, and what is left is one linear recursion, which goes on in blocks of instants. Sets of
parameters, followers and windows lie on the last axis, so that a step in time is one operation for
all that miss the same samples. P does not depend on the measurements, so that complete windows of
one model share it.

Source: Durbin and Koopman, Time Series Analysis by State Space Methods, 2nd ed., 2012, chapters
4 (filter, smoother) and 6.4 (one measurement at a time).
"""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from accpinn.methods.state_space import OBSERVED, Columns, StateSpace
from accpinn.units import FloatArray, Mask

SETTLED = 1e-11
"""Largest change of the covariance in a step, in units of its deviations, taken for none."""
BLOCK = 7
"""Instants whose innovations are found at once with constant gains; more and fewer are slower."""
STRETCH = 30_000
"""Instants times models that a step of constant gains covers, so that they fit the cache."""
LOG_TWO_PI = float(np.log(2 * np.pi))
Places = NDArray[np.intp]


@dataclass(frozen=True, eq=False)
class Innovations:
    """The part of each measurement that the filter did not predict; (N, 3, B)."""

    errors: FloatArray
    """Independent of each other if the model holds; 0 where a sample is missing."""
    known: Mask
    """Whether the sample is there."""
    distinct: FloatArray
    """(V, 3, B) the variances before each of their changes; 1 where a sample is missing."""
    which: NDArray[np.intp]
    """(N,) of V, in order."""

    @property
    def variances(self) -> FloatArray:
        """(N, 3, B)."""
        return self.distinct[self.which]

    @property
    def log_density(self) -> FloatArray:
        """(N, 3, B): what each measurement adds to log L; 0 where it is missing."""
        density = -0.5 * (self.errors**2 / self.variances + np.log(self.variances) + LOG_TWO_PI)
        return np.where(self.known, density, 0.0)


class Pairs(NamedTuple):
    """Which models meet which measurements."""

    models: Places
    """(B,) of U models."""
    series: Places
    """(B,) of S series of measurements."""

    @classmethod
    def each(cls, count: int) -> "Pairs":
        """Every model with measurements of its own."""
        return cls(np.arange(count), np.arange(count))


def log_likelihood(
    model: StateSpace, measured: FloatArray, pairs: Pairs | None = None
) -> FloatArray:
    """(B,) log L of pairs of U models and S measurements (N, 3, S) of p, v, u, nan where missing.

    By default each model meets its own measurements.
    """
    pairs = pairs or Pairs.each(measured.shape[2])
    total = np.zeros(len(pairs.series))
    for columns, _, steps in _by_columns(model, measured, pairs):
        for step in steps:
            total[columns] = step.added_to(total[columns])
    return -0.5 * total


def innovations(
    model: StateSpace, measured: FloatArray, pairs: Pairs | None = None
) -> tuple[FloatArray, Innovations]:
    """Log L (B,), and the innovations it is made of; arguments as for `log_likelihood`."""
    pairs = pairs or Pairs.each(measured.shape[2])
    known: Mask = np.asarray(~np.isnan(measured))[:, :, pairs.series]
    errors, total = np.zeros(known.shape), np.zeros(known.shape[2])
    steps = []
    changes = np.zeros(len(measured), bool)
    changes[:1] = True
    for columns, end, each in _by_columns(model, measured, pairs):
        for step in each:
            total[columns] = step.added_to(total[columns])
            for k, row in enumerate(step.rows):
                errors[step.at, row, columns] = step.errors[:, k]
            steps.append((columns, step.rows, step.at, step.variances))
            changes[step.first] = True
        changes[end : end + 1] = True
    which = changes.cumsum() - 1
    distinct = np.ones((changes.sum(), *known.shape[1:]))
    for columns, rows, at, variances in steps:
        places = slice(which[at.start], which[at.stop - 1] + 1)
        for row, variance in zip(rows, variances, strict=True):
            distinct[places, row, columns] = np.where(np.isinf(variance), 1.0, variance)
    return -0.5 * total, Innovations(errors, known, distinct, which)


def _by_columns(
    model: StateSpace, measured: FloatArray, pairs: Pairs
) -> Iterator[tuple[Places, int, "Iterator[_Step]"]]:
    """Pairs that are filtered together, how many instants they have, and the filter over these.

    The arguments are those of `log_likelihood`.
    """
    used, own_series = np.unique(pairs.series, return_inverse=True)
    known = ~np.isnan(measured[:, :, used])
    for alike in _alike(known):
        part = known[:, :, alike]
        instants = np.flatnonzero(part.any(axis=(1, 2)))
        end = int(instants[-1]) + 1 if len(instants) else 0
        member = np.full(len(used), -1)
        member[alike] = np.arange(part.shape[2])
        columns = np.flatnonzero(member[own_series] >= 0)
        places, series = pairs.models[columns], own_series[columns]
        values = measured[:end, :, used[series]]
        shared, which = np.unique(places, return_inverse=True)
        are_shared = len(shared) < len(places) and bool(part[:end].all())
        sharing = (model.of(shared), which) if are_shared else ()
        steps = _filtered(model.of(places), values, part[:end], member[series], *sharing)
        yield columns, end, steps


def _alike(known: Mask) -> Iterator[Columns]:
    """The columns of (N, 3, B) that are best filtered together, group by group.

    A missing sample keeps the gains of its group from settling. So series that miss different
    samples, such as those of different length, go apart if fewer instants are incomplete then.
    """
    if known.all():
        yield slice(None)
        return
    patterns = np.packbits(known.reshape(-1, known.shape[2]).T, axis=1)
    alike: dict[bytes, list[int]] = {}
    for column, pattern in enumerate(patterns):
        alike.setdefault(pattern.tobytes(), []).append(column)
    groups = [np.array(columns) for columns in alike.values()]
    if sum(_incomplete(known[:, :, columns[:1]]) for columns in groups) < _incomplete(known):
        yield from groups
    else:
        yield slice(None)


def _incomplete(known: Mask) -> int:
    """Instants (N, 3, B) before the last sample at which one is missing."""
    instants = np.flatnonzero(known.any(axis=(1, 2)))
    whole = known.all(axis=(1, 2))
    return int(instants[-1]) + 1 - int(whole.sum()) if len(instants) else 0


def times(matrix: FloatArray, vector: FloatArray) -> FloatArray:
    """The products (n, B) of matrices (n, n, B) and vectors (n, B)."""
    result: FloatArray = np.einsum("ijb,jb->ib", matrix, vector)
    return result


class Covariance:
    """Covariance and gains of U models, instant by instant."""

    def __init__(self, model: StateSpace) -> None:
        """Before the first instant."""
        # Products of many small matrices are fastest with the models on the first axis.
        self._transition, self._process, self.predicted = (
            np.ascontiguousarray(part.transpose(2, 0, 1))
            for part in (model.transition, model.process, model.first_covariance)
        )
        """(U, n, n), predicted for the present instant."""
        self._back = np.ascontiguousarray(self._transition.transpose(0, 2, 1))
        self._noise = model.noise
        self.has_settled = False

    def taken_in(
        self, rows: tuple[int, ...], missing: dict[int, Mask]
    ) -> tuple[FloatArray, FloatArray]:
        """Variances (r, U) and gains (r, n, U) of an instant's measurements.

        The rows are those of p, v, u that are there; a row's sample may be ``missing`` (U,).
        """
        covariance = self.predicted
        count, size, _ = covariance.shape
        variances = np.empty((len(rows), count))
        gains, taken = np.empty((2, len(rows), size, count))
        for row, number in enumerate(rows):
            i = OBSERVED[number]
            taken[row] = covariance[:, i].T
            for gain, other in zip(gains[:row], taken[:row], strict=True):
                taken[row] -= gain[i] * other
            variance = np.add(taken[row, i], self._noise[number], out=variances[row])
            if number in missing:
                variance[missing[number]] = np.inf
            np.divide(taken[row], variance, out=gains[row])
        self._updated = covariance
        if rows:
            left, right = gains.transpose(2, 1, 0), taken.transpose(2, 0, 1)
            product = np.ascontiguousarray(left) @ np.ascontiguousarray(right)
            self._updated = covariance - product
        return variances, gains

    def go_on(self, is_whole: bool) -> None:
        """To the next instant; it may settle where no sample of this and that one is missing."""
        after = self._transition @ self._updated @ self._back + self._process
        after = (after + after.transpose(0, 2, 1)) / 2
        self.has_settled = is_whole and _has_settled(self.predicted, after)
        self.predicted = after


def _has_settled(before: FloatArray, after: FloatArray) -> bool:
    """Whether the covariances (U, n, n) are the same."""
    if (np.abs(after[:, 0, 0] - before[:, 0, 0]) > SETTLED * after[:, 0, 0]).any():
        return False
    deviation = np.sqrt(np.maximum(np.einsum("bii->bi", after), 1e-30))
    change = np.abs(after - before) / (deviation[:, :, None] * deviation[:, None])
    return bool(change.max(initial=0.0) < SETTLED)


class ConstantGain:
    """A step of the filter once its covariance has settled, as linear maps.

    Over a block of instants, innovations and next state are one linear map of the state at its
    start and of all its measurements.
    """

    def __init__(self, model: StateSpace, variances: FloatArray, gains: FloatArray) -> None:
        """Those of an instant after which the covariance has settled, see `Covariance.taken_in`."""
        size, count = model.first.shape
        whitening, total = np.zeros((3, 3, count)), np.zeros((size, 3, count))
        for row, (i, gain) in enumerate(zip(OBSERVED, gains, strict=True)):
            whitening[row, row] = 1.0
            whitening[row] -= total[i]
            total = total + gain[:, None] * whitening[row]
        self._variances, self._whitening = variances, whitening
        """(3, B), and (3, 3, B) from y minus the predicted p, v, u to the innovations."""
        self._drive: FloatArray = np.einsum("ijb,jkb->ikb", model.transition, total)
        """(n, 3, B): what the measurements add to the next predicted state."""
        self._transition = model.transition.copy()
        """(n, n, B): of the predicted state, the measurements' share taken out."""
        self._transition[:, OBSERVED] -= self._drive

    @cached_property
    def _block(self) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Over L = `BLOCK` instants, the first three with the models on the first axis.

        (B, n, 3 L): from measurements to the state after them; (B, 3 L, n): from the state before
        to the innovations; (B, 3 L, 3 L): from measurements to the innovations; (n, n, B): from the
        state before to the one after.
        """
        transition, drive, whitening = (
            np.ascontiguousarray(part.transpose(2, 0, 1))
            for part in (self._transition, self._drive, self._whitening)
        )
        count, size, width = drive.shape
        pushes = np.empty((count, size, BLOCK, width))
        free = np.empty((count, BLOCK, width, size))
        direct = np.zeros((count, BLOCK, width, BLOCK, width))
        predicted = -whitening @ np.eye(width, size)
        reached = predicted
        for k in range(BLOCK):
            free[:, k], direct[:, k, :, k], pushes[:, :, BLOCK - 1 - k] = reached, whitening, drive
            answered = predicted @ drive
            for start in range(BLOCK - 1 - k):
                direct[:, start + k + 1, :, start] = answered
            reached, drive = reached @ transition, transition @ drive
        rows = BLOCK * width
        return (
            pushes.reshape(count, size, rows),
            free.reshape(count, rows, size),
            direct.reshape(count, rows, rows),
            self._power(BLOCK),
        )

    def _power(self, instants: int) -> FloatArray:
        """(n, n, B): the transition over some instants."""
        power = np.linalg.matrix_power(self._transition.transpose(2, 0, 1), instants)
        return np.ascontiguousarray(power.transpose(1, 2, 0))

    def over(self, measured: FloatArray, state: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Innovations (K, 3, B) of measurements (K, 3, B), and the state predicted after them.

        K is a whole number of blocks, or less than one; the state (n, B) is that predicted for the
        first instant.
        """
        pushes, free, direct, power = self._block
        samples, width, count = measured.shape
        length = min(samples, BLOCK)
        rows, blocks = length * width, samples // length
        inputs = np.ascontiguousarray(measured.reshape(blocks, rows, count).transpose(2, 1, 0))
        pushed = (pushes[:, :, -rows:] @ inputs).transpose(2, 1, 0)
        if length < BLOCK:
            power = self._power(length)
        states = recursion(power, pushed, state)
        starts = np.ascontiguousarray(states[:-1].transpose(2, 1, 0))
        errors = direct[:, :rows, :rows] @ inputs + free[:, :rows] @ starts
        return errors.transpose(2, 1, 0).reshape(measured.shape), states[-1]

    def states(self, measured: FloatArray, state: FloatArray) -> FloatArray:
        """(K, n, B) predicted under measurements (K, 3, B), from (n, B) for the first instant."""
        driven = np.einsum("ijb,kjb->kib", self._drive, measured)
        return recursion(self._transition, driven, state)[:-1]

    def backward(self, errors: FloatArray, information: FloatArray) -> FloatArray:
        """The smoother's r (K, n, B) at K instants, from that after them (n, B)."""
        back = np.ascontiguousarray(self._transition.transpose(1, 0, 2))
        pushes = np.zeros((len(errors), *information.shape))
        weighted = errors[::-1] / self._variances
        pushes[:, : len(OBSERVED)] = np.einsum("jib,kjb->kib", self._whitening, weighted)
        return recursion(back, pushes, information)[:0:-1]


def recursion(transition: FloatArray, driven: FloatArray, state: FloatArray) -> FloatArray:
    """(K+1, n, B) x_{k+1} = F x_k + d_k of B systems, from F (n, n, B), d (K, n, B), x_0 (n, B)."""
    states = np.empty((len(driven) + 1, *state.shape))
    states[0] = state
    for k, push in enumerate(driven):
        np.add(times(transition, states[k]), push, out=states[k + 1])
    return states


class _Step(NamedTuple):
    """The filter at one instant, or at K of them that have the same gains."""

    first: int
    """The instant, or the first of them."""
    measured: FloatArray
    """(K, 3, B): the measurements, without the intercept."""
    rows: tuple[int, ...]
    """The r of them that are taken in."""
    state: FloatArray
    """(n, B): predicted for the first instant."""
    covariance: FloatArray
    """(B, n, n): predicted; (U, n, n) where models are shared."""
    errors: FloatArray
    """(K, r, B)"""
    variances: FloatArray
    """(r, B); infinite where a sample is missing."""
    gains: FloatArray
    """(r, n, B)"""
    constant: ConstantGain | None = None
    """The maps that the instants share; None for a single instant."""

    @property
    def at(self) -> slice:
        """The instants."""
        return slice(self.first, self.first + len(self.measured))

    @property
    def states(self) -> FloatArray:
        """(K, n, B): predicted."""
        if self.constant is None:
            return self.state[None]
        return self.constant.states(self.measured, self.state)

    def added_to(self, total: FloatArray) -> FloatArray:
        """(B,): a total of -2 log L with these measurements."""
        if self.constant is None:
            density = self.errors[0] ** 2 / self.variances + np.log(self.variances) + LOG_TWO_PI
            missing = np.isinf(self.variances)
            return np.asarray(total + np.where(missing, 0.0, density).sum(axis=0))
        squares = np.einsum("krb,krb->rb", self.errors, self.errors)
        constant = np.log(self.variances) + LOG_TWO_PI
        added = squares / self.variances + len(self.errors) * constant
        return np.asarray(total + added.sum(axis=0))


def _filtered(
    model: StateSpace,
    measured: FloatArray,
    known: Mask,
    series: Columns,
    shared: StateSpace | None = None,
    which: Columns = slice(None),
) -> Iterator[_Step]:
    """The filter over measurements (N, 3, B), ``known`` (N, 3, S) of the ``series`` of each column.

    Where all are there, the models may be those that are ``shared`` (U), each column ``which``.
    """
    shared = shared or model
    if model.shift.any():
        measured = measured.copy()
        measured[:, OBSERVED[0]] -= model.shift
    somewhere: Mask = np.asarray(known.any(axis=2))
    everywhere: Mask = np.asarray(known.all(axis=2))
    whole: Mask = np.asarray(everywhere.all(axis=1))
    samples, _, count = measured.shape
    state, covariance = model.first, Covariance(shared)
    k = 0
    while k < samples:
        predicted, before = state, covariance.predicted
        rows = tuple(np.flatnonzero(somewhere[k]).tolist())
        missing = {
            number: ~known[k, number, series] for number in rows if not everywhere[k, number]
        }
        variances, gains = (part[..., which] for part in covariance.taken_in(rows, missing))
        errors = np.empty((1, len(rows), count))
        for row, number in enumerate(rows):
            error = np.subtract(measured[k, number], state[OBSERVED[number]], out=errors[0, row])
            if number in missing:
                error[missing[number]] = 0.0
            state = state + gains[row] * error
        taken_in = measured[k : k + 1]
        step = _Step(k, taken_in, rows, predicted, before, errors, variances, gains)
        yield step
        state = times(model.transition, state)
        k += 1
        covariance.go_on(is_whole=bool(k < samples and whole[k - 1] and whole[k]))
        if covariance.has_settled:
            end = samples if whole[k:].all() else k + int(np.argmin(whole[k:]))
            constant = ConstantGain(model, variances, gains)
            before = covariance.predicted
            while k < end:
                blocks = max(1, min((end - k) // BLOCK, STRETCH // (BLOCK * count)))
                taken_in = measured[k : min(end, k + blocks * BLOCK)]
                errors, after = constant.over(taken_in, state)
                yield _Step(
                    k, taken_in, step.rows, state, before, errors, variances, gains, constant
                )
                state = after
                k += len(taken_in)


def smooth(model: StateSpace, measured: FloatArray) -> FloatArray:
    """(N, n, B) the mean of every state, given all measurements (N, 3, B), before and after.

    Backward, Durbin and Koopman's r: the measurements of an instant are taken out, last first.
    """
    means = np.empty((len(measured), *model.first.shape))
    known = ~np.isnan(measured)
    for columns in _alike(known):
        part = model.of(columns)
        steps = _filtered(part, measured[:, :, columns], known[:, :, columns], slice(None))
        back, information = part.transition.transpose(1, 0, 2), np.zeros_like(part.first)
        for step in reversed(list(steps)):
            if step.constant:
                every = step.constant.backward(step.errors, information)
                information = every[0]
            else:
                information = times(back, information)
                taken = [*zip(step.rows, step.errors[0], step.gains, step.variances, strict=True)]
                for row, error, gain, variance in reversed(taken):
                    moved: FloatArray = np.einsum("jb,jb->b", gain, information)
                    information[OBSERVED[row]] += error / variance - moved
                every = information[None]
            pulled: FloatArray = np.einsum("bij,kjb->kib", step.covariance, every)
            means[step.at, :, columns] = step.states + pulled
    return means
