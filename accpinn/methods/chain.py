"""Followers simulated behind a measured vehicle, with the exact derivatives of their motion.

K followers with one law, one behind the other; only the speed u of the vehicle ahead of the first
is measured. Their motion x = (p_1, v_1, .., p_K, v_K) is a linear system,

    dx/dt = A(θ) x + b(θ) u,

and A, b are linear in θ = (α, ατ, β). So the derivatives s_j = ∂x/∂θ_j obey

    ds_j/dt = A s_j + A_j x + b_j u,    s_j(0) = 0,

a linear system again, and all are stepped exactly between the samples of u.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm

from accpinn.mask import stretches
from accpinn.model.cthp import Case, Parameters, motion_matrix, orbit, respond
from accpinn.segment.segment import Segment
from accpinn.units import FloatArray, Seconds


@dataclass(frozen=True, eq=False)
class Chain:
    """K followers that share one law; N instants."""

    ahead: FloatArray
    """(N,) u in m/s."""
    measured: FloatArray
    """(N, 2K) x as recorded."""
    step: Seconds
    first: int = 0
    """Where in the segment it begins."""

    def stretches(self, mask: NDArray[np.bool_], least: Seconds) -> tuple["Chain", ...]:
        """What is left of it at the instants of the mask (N,), in runs of ``least`` or longer."""
        kept = [run for run in stretches(mask) if (len(run) - 1) * self.step >= least]
        rows = [slice(run.first, run.last + 1) for run in kept]
        return tuple(Chain(self.ahead[r], self.measured[r], self.step, r.start) for r in rows)

    @cached_property
    def parts(self) -> FloatArray:
        """(4, 2K, 2K+1): [A | b] at θ = 0, and its derivatives by α, ατ, β."""
        followers = self.measured.shape[1] // 2

        def at(alpha: float, beta: float, tau: float) -> FloatArray:
            return motion_matrix(Parameters(*([value] * followers for value in (alpha, beta, tau))))

        rest, gain = at(0, 0, 0), at(1, 0, 0)
        return np.stack([rest, gain - rest, at(1, 0, 1) - gain, at(0, 1, 0) - rest])

    def states(self, theta: FloatArray, start: FloatArray) -> FloatArray:
        """(N, 2K) x for the law θ (3,) from the first state (2K,) on."""
        return respond(self._matrix(theta), self.ahead, self.step, start)

    def slopes(self, theta: FloatArray, start: FloatArray) -> FloatArray:
        """(N, 2K, 3 + 2K): the derivatives of `states` by θ, then by the first state."""
        matrix, size = self._matrix(theta), len(start)
        joint = np.kron(np.eye(4), matrix[:, :-1])
        joint[size:, :size] += self.parts[1:, :, :-1].reshape(3 * size, size)
        drive = np.concatenate([matrix[:, -1], self.parts[1:, :, -1].ravel()])
        begin = np.concatenate([start, np.zeros(3 * size)])
        driven = respond(np.column_stack([joint, drive]), self.ahead, self.step, begin)
        by_theta = driven[:, size:].reshape(-1, 3, size).transpose(0, 2, 1)
        transition = expm(matrix[:, :-1] * self.step)
        by_start = [orbit(transition, unit, len(driven)) for unit in np.eye(size)]
        return np.concatenate([by_theta, np.stack(by_start, axis=2)], axis=2)

    def _matrix(self, theta: FloatArray) -> FloatArray:
        """[A | b], (2K, 2K+1)."""
        return np.asarray(self.parts[0] + np.tensordot(theta, self.parts[1:], 1))


def chains(segment: Segment, case: Case) -> tuple[Chain, ...]:
    """Case I: the platoon behind its leader. Case II: each follower behind its predecessor."""
    size = segment.followers if case == "I" else 1
    states = np.stack([segment.gaps, segment.speeds[:, 1:]], axis=2)
    return tuple(
        Chain(
            segment.speeds[:, first],
            states[:, first : first + size].reshape(segment.samples, -1),
            segment.sample_time,
        )
        for first in range(0, segment.followers, size)
    )
