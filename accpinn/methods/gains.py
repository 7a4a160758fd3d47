"""The part of a Kalman filter that does not depend on the measurements, for many models at once.

Covariance and gains follow the Riccati equation, each measurement of an instant by itself:

    s = P_ii + R_i,   K = P_·i / s,   P -= K P_i·;   then P = F P Fᵀ + Q

Once P no longer changes, neither do the gains, and the filter is one linear recursion, which goes
on in blocks of instants. Source: see `kalman`.
"""

from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from accpinn.methods.state_space import OBSERVED, StateSpace
from accpinn.units import FloatArray, Mask

SETTLED = 1e-11
"""Largest change of the covariance in a step, in units of its deviations, taken for none."""
BLOCK = 7
"""Instants whose innovations are found at once with constant gains; more and fewer are slower."""
Places = NDArray[np.intp]


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

        Args:
            rows: those of p, v, u that are there.
            missing: (U,) where a row's sample is not.
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

        Args:
            measured: a whole number of blocks, or less than one.
            state: (n, B) predicted for the first instant.
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
    """The linear recursion x_{k+1} = F x_k + d_k of B systems.

    Args:
        transition: (n, n, B) F.
        driven: (K, n, B) d.
        state: (n, B) x_0.

    Returns:
        (K+1, n, B).
    """
    states = np.empty((len(driven) + 1, *state.shape))
    states[0] = state
    for k, push in enumerate(driven):
        np.add(times(transition, states[k]), push, out=states[k + 1])
    return states
