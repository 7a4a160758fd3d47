"""The exact likelihood of a linear state-space model, by a Kalman filter over many models at once.

With predicted state x and covariance P, the measurements of an instant are taken in one by one,
as their noise is independent (e and s are innovation and its variance):

    e = y_i - x_i,   s = P_ii + R_i,   K = P_·i / s,   x += K e,   P -= K P_i·
    log L = -½ Σ (e²/s + log 2πs);   then x = F x,  P = F P Fᵀ + Q.

A missing sample is not taken in. Once P no longer changes and nothing is missing, neither do the
gains, and what is left is one linear recursion. Sets of parameters, followers and windows lie on
the last axis, so that a step in time is one operation for all that miss the same samples.

Source: Durbin and Koopman, Time Series Analysis by State Space Methods, 2nd ed., 2012, chapters
4 (filter, smoother) and 6.4 (one measurement at a time).
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from accpinn.methods.state_space import OBSERVED, Columns, StateSpace
from accpinn.units import FloatArray, Mask

SETTLED = 1e-11
"""Largest change of the covariance in a step, in units of its deviations, taken for none."""
STRETCH = 30_000
"""Instants times models that a step of constant gains covers, so that they fit the cache."""
LEAST_STRETCH = 16
"""Instants that it covers at least."""
FEW = 12
"""Models up to which `recursion` takes on blocks of time together; with more, nothing is gained."""
LOG_TWO_PI = float(np.log(2 * np.pi))


@dataclass(frozen=True, eq=False)
class Innovations:
    """The part of each measurement that the filter did not predict; (N, 3, B)."""

    errors: FloatArray
    """Independent of each other if the model holds; 0 where a sample is missing."""
    variances: FloatArray
    """1 where a sample is missing."""
    known: Mask
    """Whether the sample is there."""

    @property
    def log_density(self) -> FloatArray:
        """(N, 3, B): what each measurement adds to log L; 0 where it is missing."""
        density = -0.5 * (self.errors**2 / self.variances + np.log(self.variances) + LOG_TWO_PI)
        return np.where(self.known, density, 0.0)


def log_likelihood(model: StateSpace, measured: FloatArray) -> FloatArray:
    """Log L of each of B models.

    Args:
        model: B of them.
        measured: (N, 3, B) p, v, u; nan where missing.

    Returns:
        (B,).
    """
    total = np.zeros(measured.shape[2])
    for columns in _alike(measured):
        for step in _filtered(model.of(columns), _measured_part(measured[:, :, columns])):
            total[columns] = step.added_to(total[columns])
    return -0.5 * total


def innovations(model: StateSpace, measured: FloatArray) -> tuple[FloatArray, Innovations]:
    """Log L (B,), and the innovations it is made of; arguments as for `log_likelihood`."""
    known: Mask = np.asarray(~np.isnan(measured))
    result = Innovations(np.zeros(known.shape), np.ones(known.shape), known)
    total = np.zeros(measured.shape[2])
    for columns in _alike(measured):
        for step in _filtered(model.of(columns), _measured_part(measured[:, :, columns])):
            total[columns] = step.added_to(total[columns])
            variances = np.where(np.isinf(step.variances), 1.0, step.variances)
            for k, row in enumerate(step.rows):
                result.errors[step.at, row, columns] = step.errors[:, k]
                result.variances[step.at, row, columns] = variances[k]
    return -0.5 * total, result


def _alike(measured: FloatArray) -> Iterator[Columns]:
    """The columns of (N, 3, B) that are best filtered together, group by group.

    A missing sample keeps the gains of its group from settling. So series that miss different
    samples, such as those of different length, go apart if fewer instants are incomplete then.
    """
    missing = np.isnan(measured)
    if not missing.any():
        yield slice(None)
        return
    patterns = np.packbits(missing.reshape(-1, measured.shape[2]), axis=0)
    group = np.unique(patterns, axis=1, return_inverse=True)[1].ravel()
    groups = [np.flatnonzero(group == k) for k in range(group.max() + 1)]
    if sum(_incomplete(missing[:, :, columns[:1]]) for columns in groups) < _incomplete(missing):
        yield from groups
    else:
        yield slice(None)


def _incomplete(missing: Mask) -> int:
    """Instants (N, 3, B) before the end at which a sample is missing."""
    instants = np.flatnonzero(~missing.all(axis=(1, 2)))
    return int(missing[: instants[-1] + 1].any(axis=(1, 2)).sum()) if len(instants) else 0


def _measured_part(measured: FloatArray) -> FloatArray:
    """Samples (N, 3, B) up to the last one that is not missing."""
    instants = np.flatnonzero(~np.isnan(measured).all(axis=(1, 2)))
    return measured[: instants[-1] + 1] if len(instants) else measured[:0]


class _Step(NamedTuple):
    """The filter at one instant, or at K of them that have the same gains."""

    first: int
    """The instant, or the first of them."""
    rows: tuple[int, ...]
    """The r measurements that are taken in."""
    states: FloatArray
    """(K, n, B): predicted."""
    covariance: FloatArray
    """(B, n, n): predicted."""
    errors: FloatArray
    """(K, r, B)"""
    variances: FloatArray
    """(r, B); infinite where a sample is missing."""
    gains: FloatArray
    """(r, n, B); of no row where `constant` stands for them."""
    constant: "_ConstantGain | None" = None
    """The maps that the instants share; None for a single instant."""

    @property
    def at(self) -> slice:
        """The instants."""
        return slice(self.first, self.first + len(self.states))

    def added_to(self, total: FloatArray) -> FloatArray:
        """(B,): a total of -2 log L with these measurements."""
        if self.constant is None:
            for error, variance in zip(self.errors[0], self.variances, strict=True):
                density = error**2 / variance + np.log(variance) + LOG_TWO_PI
                total = total + np.where(np.isinf(variance), 0.0, density)
            return total
        squares = np.einsum("krb,krb->rb", self.errors, self.errors)
        constant = np.log(self.variances) + LOG_TWO_PI
        added = squares / self.variances + len(self.errors) * constant
        return np.asarray(total + added.sum(axis=0))


def _filtered(model: StateSpace, measured: FloatArray) -> Iterator[_Step]:
    """The filter over measurements (N, 3, B)."""
    if model.shift.any():
        measured = measured.copy()
        measured[:, OBSERVED[0]] -= model.shift
    known: Mask = np.asarray(~np.isnan(measured))
    somewhere: Mask = np.asarray(known.any(axis=2))
    everywhere: Mask = np.asarray(known.all(axis=2))
    whole: Mask = np.asarray(everywhere.all(axis=1))
    samples, _, count = measured.shape
    width = max(LEAST_STRETCH, STRETCH // count)
    state = model.first
    # Products of many small matrices are fastest with the models on the first axis.
    transition, process, covariance = (
        np.ascontiguousarray(part.transpose(2, 0, 1))
        for part in (model.transition, model.process, model.first_covariance)
    )
    back = np.ascontiguousarray(transition.transpose(0, 2, 1))
    k = 0
    while k < samples:
        before, states = covariance, state[None]
        rows = tuple(np.flatnonzero(somewhere[k]).tolist())
        errors, variances = np.empty((1, len(rows), count)), np.empty((len(rows), count))
        gains, taken = np.empty((2, len(rows), *state.shape))
        for row, number in enumerate(rows):
            i = OBSERVED[number]
            taken[row] = covariance[:, i].T
            for gain, other in zip(gains[:row], taken[:row], strict=True):
                taken[row] -= gain[i] * other
            variance = np.add(taken[row, i], model.noise[number], out=variances[row])
            error = np.subtract(measured[k, number], state[i], out=errors[0, row])
            if not everywhere[k, number]:
                variance[~known[k, number]], error[~known[k, number]] = np.inf, 0.0
            gain = np.divide(taken[row], variance, out=gains[row])
            state = state + gain * error
        if rows:
            left, right = gains.transpose(2, 1, 0), taken.transpose(2, 0, 1)
            covariance = covariance - np.ascontiguousarray(left) @ np.ascontiguousarray(right)
        step = _Step(k, rows, states, before, errors, variances, gains)
        yield step
        state = _times(model.transition, state)
        covariance = transition @ covariance @ back + process
        covariance = (covariance + covariance.transpose(0, 2, 1)) / 2
        k += 1
        if k < samples and whole[k - 1] and whole[k] and _is_settled(before, covariance):
            end = samples if whole[k:].all() else k + int(np.argmin(whole[k:]))
            constant = _ConstantGain.of(model, step)
            while k < end:
                part = measured[k : min(end, k + width)]
                step, state = constant.over(part, state, covariance, k)
                yield step
                k += len(part)


def _times(matrix: FloatArray, vector: FloatArray) -> FloatArray:
    result: FloatArray = np.einsum("ijb,jb->ib", matrix, vector)
    return result


def _is_settled(before: FloatArray, after: FloatArray) -> bool:
    if np.abs(after[:, 0, 0] - before[:, 0, 0]).max() > SETTLED * after[:, 0, 0].max():
        return False
    deviation = np.sqrt(np.maximum(np.einsum("bii->bi", after), 1e-30))
    change = np.abs(after - before) / (deviation[:, :, None] * deviation[:, None])
    return bool(change.max() < SETTLED)


@dataclass(frozen=True, eq=False)
class _ConstantGain:
    """A step of the filter once its covariance has settled, as linear maps."""

    transition: FloatArray
    """(n, n, B): of the predicted state, the measurements' share taken out."""
    drive: FloatArray
    """(n, 3, B): what the measurements add to the next predicted state."""
    whitening: FloatArray
    """(3, 3, B): from y minus the predicted p, v, u to the innovations."""
    variances: FloatArray
    """(3, B)."""

    @classmethod
    def of(cls, model: StateSpace, step: _Step) -> "_ConstantGain":
        """Those of a step after which the covariance has settled."""
        size, count = model.first.shape
        whitening, total = np.zeros((3, 3, count)), np.zeros((size, 3, count))
        for row, (i, gain) in enumerate(zip(OBSERVED, step.gains, strict=True)):
            whitening[row, row] = 1.0
            whitening[row] -= total[i]
            total = total + gain[:, None] * whitening[row]
        drive: FloatArray = np.einsum("ijb,jkb->ikb", model.transition, total)
        transition = model.transition.copy()
        transition[:, OBSERVED] -= drive
        return cls(transition, drive, whitening, step.variances)

    def over(
        self, measured: FloatArray, state: FloatArray, covariance: FloatArray, first: int
    ) -> tuple[_Step, FloatArray]:
        """Filter on over measurements (K, 3, B); also the state predicted after them."""
        states, after = self._states(measured, state)
        errors = measured - states[:, : len(OBSERVED)]
        for row in range(len(OBSERVED) - 1, 0, -1):  # the whitening is lower triangular
            for before in range(row):
                errors[:, row] += self.whitening[row, before] * errors[:, before]
        rows, none = tuple(range(len(OBSERVED))), np.empty((0, *state.shape))
        return _Step(first, rows, states, covariance, errors, self.variances, none, self), after

    def _states(self, measured: FloatArray, state: FloatArray) -> tuple[FloatArray, FloatArray]:
        """(K, n, B) predicted under measurements (K, 3, B), and (n, B) after them."""
        size, count = state.shape
        if count <= FEW:
            driven = np.einsum("ijb,kjb->kib", self.drive, measured)
            every = recursion(self.transition, driven, state)
            return every[:-1], every[-1]
        both = np.concatenate([self.transition, self.drive], axis=1)
        known = np.empty((len(measured) + 1, size + len(OBSERVED), count))
        known[:-1, size:] = measured
        known[0, :size] = state
        for now, after in zip(known[:-1], known[1:, :size], strict=True):
            np.einsum("ijb,jb->ib", both, now, out=after)
        return known[:-1, :size], known[-1, :size]

    def backward(self, errors: FloatArray, information: FloatArray) -> FloatArray:
        """See `_backward`: r (K, n, B) from that after the K instants."""
        back = np.ascontiguousarray(self.transition.transpose(1, 0, 2))
        pushes = np.zeros((len(errors), *information.shape))
        weighted = errors[::-1] / self.variances
        pushes[:, : len(OBSERVED)] = np.einsum("jib,kjb->kib", self.whitening, weighted)
        return recursion(back, pushes, information)[:0:-1]


def recursion(transition: FloatArray, driven: FloatArray, state: FloatArray) -> FloatArray:
    """The linear recursion x_{k+1} = F x_k + d_k of B systems.

    Few systems are taken on in blocks of time, all blocks together: first from zero, which gives
    the state at each block's start, then from there.

    Args:
        transition: (n, n, B) F.
        driven: (K, n, B) d.
        state: (n, B) x_0.

    Returns:
        (K+1, n, B).
    """
    samples, size, count = driven.shape
    if count > FEW:
        every = np.empty((samples + 1, size, count))
        every[0] = state
        for k, push in enumerate(driven):
            every[k + 1] = _times(transition, every[k]) + push
        return every
    blocks = max(1, int(samples**0.5))
    length = samples // blocks + 1
    pushes = np.zeros((blocks * length, size, count))
    pushes[:samples] = driven
    pushes = np.ascontiguousarray(pushes.reshape(blocks, length, size, count).transpose(1, 2, 0, 3))

    def onward(states: FloatArray, push: FloatArray) -> FloatArray:
        moved: FloatArray = np.einsum("ijb,jcb->icb", transition, states)
        moved += push
        return moved

    now = np.empty((size, blocks, count))
    now[:, 0] = state
    reached = np.zeros((size, blocks, count))
    for push in pushes:
        reached = onward(reached, push)
    power = np.linalg.matrix_power(transition.transpose(2, 0, 1), length).transpose(1, 2, 0)
    for k in range(1, blocks):
        now[:, k] = _times(power, now[:, k - 1]) + reached[:, k - 1]
    states = np.empty((length, size, blocks, count))
    for k, push in enumerate(pushes):
        states[k] = now
        now = onward(now, push)
    return states.transpose(2, 0, 1, 3).reshape(-1, size, count)[: samples + 1]


def smooth(model: StateSpace, measured: FloatArray) -> FloatArray:
    """The mean of every state at every instant, given all measurements, before and after.

    Args:
        model: B of them.
        measured: (N, 3, B) p, v, u; nan where missing.

    Returns:
        (N, n, B).
    """
    means = np.empty((len(measured), *model.first.shape))
    for columns in _alike(measured):
        part = model.of(columns)
        for step, information in _backward(part, _filtered(part, measured[:, :, columns])):
            pulled: FloatArray = np.einsum("bij,kjb->kib", step.covariance, information)
            means[step.at, :, columns] = step.states + pulled
    return means


def _backward(model: StateSpace, steps: Iterator[_Step]) -> Iterator[tuple[_Step, FloatArray]]:
    """Backward recursion of the smoother, last step first: r (K, n, B) of Durbin and Koopman.

    The measurements of an instant are taken out one by one, last first.
    """
    back = model.transition.transpose(1, 0, 2)
    information = np.zeros_like(model.first)
    for step in reversed(list(steps)):
        if step.constant:
            every = step.constant.backward(step.errors, information)
            information = every[0]
            yield step, every
            continue
        information = _times(back, information)
        for row in range(len(step.rows) - 1, -1, -1):
            i, gain, variance = OBSERVED[step.rows[row]], step.gains[row], step.variances[row]
            information[i] += step.errors[0, row] / variance - np.einsum(
                "jb,jb->b", gain, information
            )
        yield step, information[None]
