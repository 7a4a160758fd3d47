"""The output layer at its most probable value, given the parameters, disturbance and noise.

The surrogate is y(t) = Φ(t) W, Φ = [φ, h(φ)], Fourier features and activations. With the whitened
residuals of `evidence.physics`, the negative log density of data and weights is

    Ψ = 1/n [ ½ Σ_samples |y - ŷ|²/σ² + ½ Σ_i ∫ e_r² + e_g² dt + ½ ∫ e_u² dt + first instant ],

n the number of measurements, e_u the leader's alone: a follower's speed is the speed ahead of the
next one. Ψ is quadratic in W; the platoon's chain of blocks is that of `variable_projection`.
"""

import numpy as np

from accpinn.methods.pinn.evidence import ORDER, Physics, physics
from accpinn.methods.pinn.network import FourierFeatures, Numbers, output_columns
from accpinn.methods.pinn.variable_projection import RIDGE, Link, solve_chain
from accpinn.units import FloatArray, Mask, Seconds

GRID: Seconds = 0.25
"""At most so far apart are the instants at which the residuals' squares are summed."""


class Grams:
    """∫ D^aΦᵀ D^bΦ dt of all derivatives; what Fourier features share is summed once."""

    def __init__(self, fourier: FourierFeatures, features: FloatArray, weights: FloatArray) -> None:
        """For Fourier features (N, F) at instants with quadrature weights (N,)."""
        self._fourier, self._weights = fourier, weights[:, None]
        self._weighted = features * self._weights
        self._static = self._all(rise(fourier, self._weighted.T @ features))

    def _all(self, products: FloatArray) -> FloatArray:
        """(4, 4, F, B) from φᵀ D^bΦ (4, F, B)."""
        return rise(self._fourier, products.swapaxes(1, 2)).swapaxes(2, 3)

    def __call__(self, active: FloatArray) -> FloatArray:
        """(4, 4, K, K) of Φ = [φ, h], from the activations' derivatives (4, N, H)."""
        cross = self._all(self._weighted.T @ active)
        weighted = (active * self._weights).swapaxes(1, 2)
        inner = weighted[:, None] @ active[None]
        return np.block([[self._static, cross], [cross.transpose(1, 0, 3, 2), inner]])


def rise(fourier: FourierFeatures, products: FloatArray) -> FloatArray:
    """Features, or products with them on the last axis, with derivatives 0 to 3: (4, ..)."""
    found = [products]
    for _ in range(ORDER):
        found.append(fourier.derivative(found[-1]))
    return np.stack(found)


class OutputLayer:
    """The quadratic Ψ of a platoon, at unknowns that do not change."""

    def __init__(
        self,
        measured: FloatArray,
        stride: int,
        sample_time: Seconds,
        mask: Mask | None,
        fourier: FourierFeatures,
        values: FloatArray,
    ) -> None:
        """Sum what the Fourier features contribute.

        Args:
            measured: (N, 2M+1) in the order of `output_columns`, at all instants.
            stride: from one sample that counts to the next.
            sample_time: in s.
            mask: (N, M) where a follower's equation counts; None for everywhere.
            fourier: features.
            values: (M, 9) each follower's unknowns.
        """
        followers = len(values)
        self._physics: list[Physics] = [physics(one) for one in values]
        time: FloatArray = sample_time * np.arange(len(measured), dtype=np.float64)
        every = max(1, int(GRID / sample_time))
        grid = time[::every]
        quadrature = np.full(len(grid), every * sample_time)
        quadrature[[0, -1]] /= 2
        self.on_grid, self.at_samples = fourier(grid), fourier(time[::stride])
        """(N, F) and (S, F) the features."""
        self.orders = rise(fourier, self.on_grid)
        """(4, N, F) with their derivatives."""
        self.data = measured[::stride]
        """(S, 2M+1)"""
        self.count = self.data.size
        self.forms = self._forms()
        """(4, 2M+1, 2M+1) derivative, output, residual: e_r and e_g of each follower, then e_u."""
        self.weights = np.repeat(quadrature[:, None], 2 * followers + 1, axis=1)
        """(N, 2M+1) of the residuals' squares."""
        self._grams = Grams(fourier, self.on_grid, quadrature)
        self._masked: list[Grams] = []
        if mask is not None:
            self.weights[:, : 2 * followers : 2] *= mask[::every]
            own = self.weights[:, : 2 * followers : 2].T
            self._masked = [Grams(fourier, self.on_grid, row) for row in own]
        speeds, gaps = output_columns(followers)
        noise = np.empty(measured.shape[1])
        noise[speeds], noise[gaps] = np.r_[values[0, 7], values[:, 7]], values[:, 6]
        self.precision = noise**-2

    def _forms(self) -> FloatArray:
        size = 2 * len(self._physics) + 1
        forms = np.zeros((ORDER + 1, size, size))
        for k, equations in enumerate(self._physics):
            residuals = [2 * k, 2 * k + 1, size - 1][: 3 if k == 0 else 2]
            for residual, form in zip(residuals, equations.running, strict=False):
                forms[:, self._columns(k), residual] = form.T
        return forms

    def _columns(self, follower: int) -> list[int]:
        """Where its space-gap, its speed and the speed ahead stand among the outputs."""
        speeds, gaps = output_columns(len(self._physics))
        return [gaps[follower], speeds[follower + 1], speeds[follower]]

    def solve(self, active: FloatArray, active_samples: FloatArray) -> FloatArray:
        """W (K, 2M+1), from the activations on the grid (4, N, H) and at the samples (S, H)."""
        grams = self._grams(active)
        value = np.hstack([self.at_samples, active_samples])
        data = value.T @ value
        right = value.T @ self.data * self.precision
        first = np.hstack([self.orders[:, 0], active[:, 0]])[:ORDER]
        data += RIDGE * data.trace() / len(data) * np.eye(len(data))
        links = []
        leader = data * self.precision[0]
        for k, (running, start) in enumerate(self._physics):
            if self._masked:
                blocks = _blocks(running[:1], self._masked[k](active))
                blocks += _blocks(running[1:2], grams)
            else:
                blocks = _blocks(running[:2], grams)
            at_first = start[[0, 1, 3, 4]] @ first
            blocks += np.tensordot(at_first, at_first, (0, 0)).swapaxes(1, 2)
            p, v, u = range(3)
            gap, own_speed, _ = self._columns(k)
            blocks[v, v] += data * self.precision[own_speed]
            blocks[p, p] += data * self.precision[gap]
            own = np.block([[blocks[v, v], blocks[v, p]], [blocks[p, v], blocks[p, p]]])
            coupling = np.vstack([blocks[v, u], blocks[p, u]])
            ahead = blocks[u, u].copy()  # a view would keep all blocks
            links.append(Link(own, coupling, ahead, right[:, [own_speed, gap]].T.reshape(-1)))
            if k == 0:
                leader += _blocks(running[2:, u:], grams)[0, 0]
                ends = start[[2, 5], u] @ first
                leader += ends.T @ ends
        return solve_chain(links, leader, right[:, 0])

    def terms(self, orders: FloatArray, outputs: FloatArray) -> tuple[float, float, float]:
        """Ψ's data, physics and first instant.

        Args:
            orders: (4, N, 2M+1) the surrogate with its derivatives, on the grid.
            outputs: (S, 2M+1) the surrogate at the samples.
        """
        misfit = ((outputs - self.data) ** 2 * self.precision).sum()
        running = (self.weights * self.residuals(orders) ** 2).sum()
        first = 0.0
        for k, (_, start) in enumerate(self._physics):
            at_first = np.tensordot(start, orders[:ORDER, 0, self._columns(k)], ((1, 2), (1, 0)))
            first += ((at_first if k == 0 else at_first[[0, 1, 3, 4]]) ** 2).sum()
        data, physics, initial = (float(part) / 2 / self.count for part in (misfit, running, first))
        return data, physics, initial

    def residuals(self, orders: Numbers) -> Numbers:
        """(N, 2M+1) the whitened residuals of a surrogate (4, N, 2M+1)."""
        return np.tensordot(orders, self.forms, ((0, 2), (0, 1)))


def _blocks(forms: FloatArray, grams: FloatArray) -> FloatArray:
    """(O, O, K, K) of residuals (E, O, 4) squared and integrated."""
    squares = np.tensordot(forms, forms, (0, 0)).swapaxes(1, 2)
    outputs, size = forms.shape[1], grams.shape[-1]
    flat = squares.reshape(outputs**2, -1) @ grams.reshape((ORDER + 1) ** 2, -1)
    return flat.reshape(outputs, outputs, size, size)
