"""The exact likelihood of a linear state-space model, by a Kalman filter over many models at once.

With predicted state x and covariance P, the measurements of an instant are taken in one by one,
as their noise is independent (e and s are innovation and its variance):

    e = y_i - x_i,   s = P_ii + R_i,   K = P_·i / s,   x += K e,   P -= K P_i·
    log L = -½ Σ (e²/s + log 2πs);   then x = F x,  P = F P Fᵀ + Q.

A missing sample is not taken in. Once P no longer changes and nothing is missing, neither do the
gains, and what is left is one linear recursion. Sets of parameters, followers and windows lie on
the last axis, so that a step in time is one operation for all of them.

Source: Durbin and Koopman, Time Series Analysis by State Space Methods, 2nd ed., 2012, chapters
4 (filter, smoother) and 6.4 (one measurement at a time).
"""

from dataclasses import dataclass

import numpy as np

from accpinn.methods.state_space import OBSERVED, StateSpace
from accpinn.units import FloatArray, Mask

SETTLED = 1e-13
"""Largest change of the covariance in a step, in units of its deviations, taken for none."""
CHUNK = 256
LOG_TWO_PI = float(np.log(2 * np.pi))


@dataclass(frozen=True, eq=False)
class Innovations:
    """What the filter did not foresee of each measurement; (N, 3, B)."""

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
    return _filter(model, measured, None)


def innovations(model: StateSpace, measured: FloatArray) -> tuple[FloatArray, Innovations]:
    """Log L (B,), and the innovations it is made of; arguments as for `log_likelihood`."""
    known: Mask = np.asarray(~np.isnan(measured))
    kept = Innovations(np.zeros(known.shape), np.ones(known.shape), known)
    return _filter(model, measured, kept), kept


def _filter(model: StateSpace, measured: FloatArray, kept: Innovations | None) -> FloatArray:
    samples, _, count = measured.shape
    known: Mask = np.asarray(~np.isnan(measured))
    whole: Mask = np.asarray(known.all(axis=(1, 2)))
    measured = np.where(known, measured, 0.0)
    state, covariance = model.first, model.first_covariance
    back = np.ascontiguousarray(model.transition.transpose(1, 0, 2))
    total = np.zeros(count)
    k = 0
    while k < samples:
        before, gains, variances = covariance, [], []
        for row, i in enumerate(OBSERVED):
            there = known[k, row]
            variance = covariance[i, i] + model.noise[row]
            gain = np.where(there, covariance[:, i] / variance, 0.0)
            error = np.where(there, measured[k, row] - state[i], 0.0)
            state = state + gain * error
            covariance = covariance - gain[:, None] * covariance[i]
            total += np.where(there, error**2 / variance + np.log(variance) + LOG_TWO_PI, 0.0)
            gains.append(gain)
            variances.append(variance)
            if kept:
                kept.errors[k, row] = error
                kept.variances[k, row] = np.where(there, variance, 1.0)
        state = _times(model.transition, state)
        moved = np.einsum("ijb,jkb->ikb", model.transition, covariance)
        covariance = np.einsum("ijb,jkb->ikb", moved, back) + model.process
        covariance = (covariance + covariance.transpose(1, 0, 2)) / 2
        k += 1
        if k < samples and whole[k - 1] and whole[k] and _is_settled(before, covariance):
            end = samples if whole[k:].all() else k + int(np.argmin(whole[k:]))
            constant = _ConstantGain.of(model, gains, np.stack(variances))
            state = constant.run(state, measured[k:end], total, kept, k)
            k = end
    return -0.5 * total


def _times(matrix: FloatArray, vector: FloatArray) -> FloatArray:
    result: FloatArray = np.einsum("ijb,jb->ib", matrix, vector)
    return result


def _is_settled(before: FloatArray, after: FloatArray) -> bool:
    deviation = np.sqrt(np.maximum(np.einsum("iib->ib", after), 1e-30))
    change = np.abs(after - before) / (deviation[:, None] * deviation)
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
    def of(
        cls, model: StateSpace, gains: list[FloatArray], variances: FloatArray
    ) -> "_ConstantGain":
        size, count = model.first.shape
        whitening, total = np.zeros((3, 3, count)), np.zeros((size, 3, count))
        for row, (i, gain) in enumerate(zip(OBSERVED, gains, strict=True)):
            whitening[row, row] = 1.0
            whitening[row] -= total[i]
            total = total + gain[:, None] * whitening[row]
        drive: FloatArray = np.einsum("ijb,jkb->ikb", model.transition, total)
        transition = model.transition.copy()
        transition[:, OBSERVED] -= drive
        return cls(transition, drive, whitening, variances)

    def run(
        self,
        state: FloatArray,
        measured: FloatArray,
        total: FloatArray,
        kept: Innovations | None,
        first: int,
    ) -> FloatArray:
        """Filter on, add -2 log L to ``total`` (B,), and return the state predicted last."""
        for begin in range(0, len(measured), CHUNK):
            part = measured[begin : begin + CHUNK]
            driven = np.einsum("ijb,kjb->kib", self.drive, part)
            predicted = np.empty((len(part), len(OBSERVED), state.shape[1]))
            for k, push in enumerate(driven):
                predicted[k] = state[: len(OBSERVED)]
                state = _times(self.transition, state) + push
            errors = np.einsum("ijb,kjb->kib", self.whitening, part - predicted)
            total += (errors**2 / self.variances).sum(axis=(0, 1))
            if kept:
                rows = slice(first + begin, first + begin + len(part))
                kept.errors[rows], kept.variances[rows] = errors, self.variances
        total += len(measured) * (np.log(self.variances) + LOG_TWO_PI).sum(axis=0)
        return state


@dataclass(frozen=True, eq=False)
class SmoothedStates:
    """The states given all measurements, before and after."""

    means: FloatArray
    """(N, n, B)."""
    deviations: FloatArray
    """(N, n, B)."""


def smooth(model: StateSpace, measured: FloatArray) -> SmoothedStates:
    """Mean and deviation of every state at every instant, given all measurements.

    Args:
        model: B of them.
        measured: (N, 3, B) p, v, u; nan where missing.
    """
    samples, _, count = measured.shape
    size = len(model.first)
    known: Mask = np.asarray(~np.isnan(measured))
    measured = np.where(known, measured, 0.0)
    states, covariances = np.empty((samples, size, count)), np.empty((samples, size, size, count))
    errors, variances = np.zeros((samples, 3, count)), np.ones((samples, 3, count))
    gains = np.zeros((samples, 3, size, count))
    state, covariance = model.first, model.first_covariance
    back = model.transition.transpose(1, 0, 2)
    for k in range(samples):
        states[k], covariances[k] = state, covariance
        for row, i in enumerate(OBSERVED):
            there = known[k, row]
            variances[k, row] = covariance[i, i] + model.noise[row]
            gains[k, row] = np.where(there, covariance[:, i] / variances[k, row], 0.0)
            errors[k, row] = np.where(there, measured[k, row] - state[i], 0.0)
            state = state + gains[k, row] * errors[k, row]
            covariance = covariance - gains[k, row][:, None] * covariance[i]
        state = _times(model.transition, state)
        moved = np.einsum("ijb,jkb->ikb", model.transition, covariance)
        covariance = np.einsum("ijb,jkb->ikb", moved, back) + model.process
    # What the measurements from an instant on say beyond those before it: r and N of Durbin and
    # Koopman, with the measurements of an instant taken out one by one, last first.
    says, sure = np.zeros((size, count)), np.zeros((size, size, count))
    means, deviations = np.empty_like(states), np.empty_like(states)
    for k in range(samples - 1, -1, -1):
        says = _times(back, says)
        sure = np.einsum("ijb,jkb->ikb", back, sure)
        sure = np.einsum("ijb,jkb->ikb", sure, model.transition)
        for row in range(len(OBSERVED) - 1, -1, -1):
            i, gain, there = OBSERVED[row], gains[k, row], known[k, row]
            pull = np.einsum("jb,jb->b", gain, says)
            says = says.copy()
            says[i] += np.where(there, errors[k, row] / variances[k, row], 0.0) - pull
            left = sure.copy()
            left[i] -= np.einsum("jb,jkb->kb", gain, sure)
            sure = left.copy()
            sure[:, i] -= np.einsum("ijb,jb->ib", left, gain)
            sure[i, i] += np.where(there, 1.0 / variances[k, row], 0.0)
        means[k] = states[k] + _times(covariances[k], says)
        shrunk = np.einsum("ijb,jkb,kib->ib", covariances[k], sure, covariances[k], optimize=True)
        deviations[k] = np.sqrt(np.maximum(np.einsum("iib->ib", covariances[k]) - shrunk, 0.0))
    return SmoothedStates(means, deviations)
