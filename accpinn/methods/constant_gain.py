"""A Kalman filter with constant gains, over many models at once: its limits and its recursion.

Once the covariance no longer changes and nothing is missing, neither do the gains, and what is left
of `kalman`'s filter is one linear recursion, x' = x B + (the measurements' share), which goes on in
blocks of instants. With predicted covariance P, noise R, transition F and added covariance Q,

    C P Cᵀ + R = W⁻¹ V W⁻ᵀ,   K = V⁻¹ W C P Fᵀ,   P* = F P* Fᵀ - K*ᵀ V* K* + Q.

P* and the information O of all instants to come on the first state come from doubling the instants.

Sources: Lainiotis, IEEE Trans. Autom. Control 16 (1971) 160-170 (a first state in two parts);
Anderson, International Journal of Control 28 (1978) 295-306 (doubling).
"""

from functools import cached_property
from typing import NamedTuple

import numpy as np

from accpinn.methods.state_space import OBSERVED
from accpinn.units import FloatArray

DOUBLED, DOUBLINGS = 1e-6, 16
"""Largest change of a variance in a doubling after which there is no further one, as the next one
would change the square of it; and most of them."""
FORGOTTEN = 1e-8
"""Largest share of a state that later ones keep, taken for none."""
BLOCK = 8
"""Instants whose innovations are found at once with constant gains, a power of two; more and fewer
are slower."""
WIDTH = len(OBSERVED)


def first_axis(part: FloatArray) -> FloatArray:
    """(u, n, m) from (n, m, u), in order in memory."""
    return np.ascontiguousarray(part.transpose(2, 0, 1))


def turned(matrix: FloatArray) -> FloatArray:
    """The transposes (u, m, n) of matrices (u, n, m), in order in memory."""
    return np.ascontiguousarray(matrix.transpose(0, 2, 1))


def evened(matrix: FloatArray) -> FloatArray:
    """Matrices (u, n, n) that rounding made uneven."""
    return np.asarray((matrix + matrix.transpose(0, 2, 1)) / 2)


class Gains(NamedTuple):
    """The filter's update by the measurements of an instant."""

    variances: FloatArray
    """(u, 3) V; infinite where a sample is missing."""
    whitening: FloatArray
    """(u, 3, 3) W."""
    moved: FloatArray
    """(u, 3, n) V K."""

    @classmethod
    def of(cls, covariance: FloatArray, back: FloatArray, noise: FloatArray) -> "Gains":
        """Gains by P (u, n, n), Fᵀ (u, n, n), and the noise's variances (3, u)."""
        p = np.ascontiguousarray(covariance[:, :WIDTH, :WIDTH].transpose(1, 2, 0))
        count = len(covariance)
        variances, whitening = np.empty((count, WIDTH)), np.tile(np.eye(WIDTH), (count, 1, 1))
        first = p[0, 0] + noise[0]
        v_on_p, u_on_p = p[1, 0] / first, p[2, 0] / first
        second = p[1, 1] - v_on_p * p[1, 0] + noise[1]
        left = p[2, 1] - u_on_p * p[1, 0]
        u_on_v = left / second
        third = p[2, 2] - u_on_p * p[2, 0] - u_on_v * left + noise[2]
        variances[:, 0], variances[:, 1], variances[:, 2] = first, second, third
        whitening[:, 1, 0], whitening[:, 2, 1] = -v_on_p, -u_on_v
        whitening[:, 2, 0] = u_on_v * v_on_p - u_on_p
        return cls(variances, whitening, whitening @ (covariance[:, :WIDTH] @ back))

    @property
    def gains(self) -> FloatArray:
        """(u, 3, n) K."""
        return self.moved / self.variances[:, :, None]

    def models(self, some: slice) -> "Gains":
        """The gains of some models."""
        return Gains(*(part[some] for part in self))


def limits(
    transition: FloatArray, process: FloatArray, noise: FloatArray, together: int
) -> tuple[FloatArray, FloatArray]:
    """(u, n, n) P*, and O of all instants to come.

    From F (u, n, n), Q (u, n, n), and the noise's variances (3, u). Of models that are together and
    hardly differ, those beside the first follow from its limits by one step of Newton's method.
    """
    covariance, information = _doubled(
        transition[::together], process[::together], noise[:, ::together]
    )
    if together == 1:
        return covariance, information
    back = turned(transition)
    covariance, information = (
        np.repeat(part, together, axis=0) for part in (covariance, information)
    )
    gains = Gains.of(covariance, back, noise)
    off = transition @ (covariance @ back) - turned(gains.moved) @ gains.gains
    off += process - covariance
    near = ConstantGain(transition[::together], gains.models(slice(None, None, together)))
    covariance = evened(covariance + near.summed(off, together))
    gains = Gains.of(covariance, back, noise)
    settled = ConstantGain(transition, gains)
    off = settled.back @ information @ turned(settled.back) - information
    off[:, :WIDTH, :WIDTH] += turned(settled.whitening) @ settled.whitening
    return covariance, evened(information + near.summed(off, together, is_back=True))


def _doubled(
    transition: FloatArray, process: FloatArray, noise: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """The limits P* and O (u, n, n), by doubling the instants."""
    unit, covariance = np.eye(transition.shape[1]), process
    forward, back = transition, turned(transition)
    information = np.zeros_like(transition)  # on the first state
    for i, variances in zip(OBSERVED, noise, strict=True):
        information[:, i, i] = 1.0 / variances
    for _ in range(DOUBLINGS):
        inverse = np.linalg.inv(information @ covariance + unit)
        moved = inverse @ back
        added = forward @ (covariance @ moved)
        information = information + back @ (inverse @ information @ forward)
        covariance = covariance + added
        back = back @ moved
        forward = turned(back)
        variances = np.einsum("uii->ui", covariance)
        if not (np.einsum("uii->ui", added) > DOUBLED * variances).any():
            break
    covariance, information = evened(covariance), evened(information)
    inverse = np.linalg.inv(information @ covariance + unit)
    return covariance, evened(inverse @ information)


class ConstantGain:
    """A step of the filter with constant covariance, as linear maps of rows.

    Over a block of instants, innovations and next state are one linear map of the state at its
    start and of all its measurements.
    """

    def __init__(self, transition: FloatArray, gains: Gains) -> None:
        """Set up the filter of a transition F (u, n, n) and its gains."""
        self.whitening = gains.whitening / np.sqrt(gains.variances)[:, :, None]
        """(u, 3, 3): from measurements less the predicted ones to e, in its deviations."""
        self._drive = turned(gains.whitening) @ gains.gains
        """(u, 3, n): what the measurements add to the next predicted state."""
        self.back = turned(transition)
        """(u, n, n): of the predicted state, the measurements' share taken out."""
        self.back[:, :WIDTH] -= self._drive

    @cached_property
    def _block(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Over L = `BLOCK` instants.

        (u, 3 L, n): from measurements to the state after them; (u, n + 3 L, 3 L): from the state
        before and the measurements to the innovations; (u, n, n): from the state before to the one
        after.
        """
        count, _, size = self._drive.shape
        rows, whitening = BLOCK * WIDTH, turned(self.whitening)
        pushes, errors = np.empty((count, rows, size)), np.zeros((count, size + rows, rows))
        free, direct = errors[:, :size], errors[:, size:]
        pushes[:, -WIDTH:], free[:, :WIDTH, :WIDTH] = self._drive, -whitening
        power, reach = self.back, WIDTH
        while reach < rows:
            pushes[:, -2 * reach : rows - reach] = pushes[:, -reach:] @ power
            free[:, :, reach : 2 * reach] = power @ free[:, :, :reach]
            power, reach = power @ power, 2 * reach
        responses = np.concatenate([whitening, self._drive @ free[:, :, :-WIDTH]], axis=2)
        for start in range(0, rows, WIDTH):
            direct[:, start : start + WIDTH, start:] = responses[:, :, : rows - start]
        return pushes, errors, power

    def over(self, measured: FloatArray, state: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Innovations (u, r, m, 3 J), in deviations, of measurements (u, r, m, 3 J).

        They are m blocks of `BLOCK` instants J, or one of less; the state (u, r, n) is that
        predicted for the first instant. Also returned is the state after them.
        """
        pushes, errors, power = self._block
        count, series, blocks, rows = measured.shape
        size = len(power[0])
        if rows < BLOCK * WIDTH:
            power = np.linalg.matrix_power(self.back, rows // WIDTH)
            errors = np.concatenate([errors[:, :size], errors[:, size : size + rows]], axis=1)
        inputs = measured.reshape(count, -1, rows)
        pushed = (inputs @ pushes[:, -rows:]).reshape(count, series, blocks, -1)
        every = recursion(power, pushed, state)
        starts = every[:, :, :-1].reshape(count, series * blocks, -1)
        innovations = np.concatenate([starts, inputs], axis=2) @ errors[:, :, :rows]
        return innovations.reshape(measured.shape), every[:, :, -1]

    def whole(
        self, measured: FloatArray, samples: int, apart: FloatArray, information: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Innovations (u, r, m, 3 L), in deviations, with the most probable first state δ.

        From measurements (u, r, m, 3 L), of which so many ``samples`` N are there, P₀ - P*
        (u, n, n), and O (u, n, n) of all instants to come. Also returned are b - O δ (u, r, n), and
        (u, r) what δ adds to -2 log L.
        """
        _, free, power = self._block
        free = free[:, : len(power[0])]
        blocks, reaching, reach = measured.shape[2], power, 1
        while reach < blocks and np.abs(reaching).max() > FORGOTTEN:
            reaching, reach = reaching @ reaching, 2 * reach
        zero = np.zeros((*measured.shape[:2], len(power[0])))
        near = zero.copy()  # what is measured first, which the first state will be close to
        near[..., :WIDTH] = measured[:, :, 0, :WIDTH]
        errors = self.over(measured, near)[0]
        errors.reshape(*zero.shape[:2], -1, WIDTH)[:, :, samples:] = 0.0
        if reach >= blocks:
            reach = blocks
            after: FloatArray = np.asarray(np.linalg.matrix_power(self.back, samples), float)
            information = information - after @ information @ after.transpose(0, 2, 1)
        by_block = errors[:, :, :reach] @ turned(free)[:, None]
        b = -recursion(turned(power), by_block[:, :, ::-1], zero)[:, :, -1]
        matrix = np.eye(len(power[0])) + apart @ information
        further = turned(np.asarray(np.linalg.solve(matrix, turned(b @ apart - near)), float))
        push = b - further @ information
        more = ((near + further) * push).sum(axis=2) + np.linalg.slogdet(matrix)[1][:, None]
        states = recursion(power, np.zeros_like(by_block[:, :, 1:]), further)
        errors[:, :, :reach] += states @ free[:, None]
        errors.reshape(*zero.shape[:2], -1, WIDTH)[:, :, samples:] = 0.0
        return errors, push, more

    def summed(self, matrices: FloatArray, together: int, is_back: bool = False) -> FloatArray:
        """Sums of A^k M Aᵀ^k over all k, of symmetric matrices M (u, n, n), so many per A together.

        The other way round, ``is_back``, they are of Aᵀ^k M A^k.
        """
        count, size, _ = self.back.shape
        power = turned(self.back) if is_back else self.back
        total = matrices
        for _ in range(DOUBLINGS):
            half = total.reshape(count, -1, size) @ power
            half = turned(half.reshape(-1, size, size)).reshape(count, -1, size)
            added = (half @ power).reshape(total.shape)
            total = total + added
            if not (np.abs(added) > DOUBLED * np.abs(total).max()).any():
                break
            power = power @ power
        return total

    def states(self, measured: FloatArray, states: FloatArray) -> FloatArray:
        """(u, K, n) predicted under measurements (u, K, 3), from (u, n) for the first instant."""
        driven = (measured @ self._drive)[:, None]
        return recursion(self.back, driven, states[:, None])[:, 0, :-1]

    def backward(self, errors: FloatArray, information: FloatArray) -> FloatArray:
        """The smoother's r (u, K, n) from that after K instants (u, n), and their errors (u, K, 3).

        These are in their deviations.
        """
        pushes = np.zeros((len(errors), 1, errors.shape[1], information.shape[1]))
        pushes[:, 0, :, :WIDTH] = errors[:, ::-1] @ self.whitening
        every = recursion(turned(self.back), pushes, information[:, None])
        return every[:, 0, :0:-1]


def recursion(back: FloatArray, driven: FloatArray, state: FloatArray) -> FloatArray:
    """(u, r, m+1, n) of the rows x_{k+1} = x_k B + d_k, from B (u, n, n), d (u, r, m, n), x_0.

    They are cut into stretches that go on together: first each from zero, which gives where all of
    them begin, and then from there.
    """
    count, series, m, size = driven.shape
    steps = max(1, round(np.sqrt(m)))
    stretches = m // steps + 1
    pushes = np.zeros((steps, count, series, stretches, size))
    for k, push in enumerate(pushes):
        some = driven[:, :, k::steps]
        push[:, :, : some.shape[2]] = some
    pushes = pushes.reshape(steps, count, -1, size)
    ends = pushes[0]
    for push in pushes[1:]:
        ends = ends @ back
        ends += push
    ends = ends.reshape(count, series, stretches, size)
    states = np.empty_like(pushes)
    begins = states[0].reshape(count, series, stretches, size)
    begins[:, :, 0] = state
    over_stretch = np.linalg.matrix_power(back, steps)
    for k in range(1, stretches):
        begins[:, :, k] = begins[:, :, k - 1] @ over_stretch + ends[:, :, k - 1]
    for reached, later, push in zip(states, states[1:], pushes, strict=False):
        np.matmul(reached, back, out=later)
        later += push
    every = states.reshape(steps, count, series, stretches, size).transpose(1, 2, 3, 0, 4)
    return np.asarray(every.reshape(count, series, -1, size)[:, :, : m + 1])


def blocks_of(measured: FloatArray) -> FloatArray:
    """(S, m, 3 J) the measurements (J m, 3, S) of m blocks of J = `BLOCK` instants, or one."""
    length, count = min(BLOCK, len(measured)), measured.shape[2]
    blocks = measured.reshape(-1, length * WIDTH, count)
    return np.ascontiguousarray(blocks.transpose(2, 0, 1))
