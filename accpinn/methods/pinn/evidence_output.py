"""The output layer at its most probable value, given the parameters, disturbance and noise.

The surrogate is y(t) = Φ(t) W, Φ = [φ, h(φ)], Fourier features and activations. With the whitened
residuals of `evidence.physics`, the negative log density of data and weights is

    Ψ = 1/n [ ½ Σ_samples |y - ŷ|²/σ² + ½ Σ_i ∫ e_r² + e_g² dt + ½ ∫ e_u² dt + first instant ],

n the number of measurements, e_u the leader's alone: a follower's speed is the speed ahead of the
next one. Ψ is quadratic in W; the platoon's chain of blocks is that of `variable_projection`.
"""

import numpy as np
import torch
from torch import Tensor, nn

from accpinn.methods.pinn.evidence import ORDER, Physics, physics
from accpinn.methods.pinn.method import FourierFeatures, output_columns
from accpinn.methods.pinn.network import HiddenLayers
from accpinn.methods.pinn.variable_projection import RIDGE, Link, solve_chain
from accpinn.units import FloatArray, Mask, Seconds

GRID: Seconds = 0.25
"""At most so far apart are the instants at which the residuals' squares are summed."""


class FourierOrders:
    """Fourier features with their derivatives; the derivative is linear in the features."""

    def __init__(self, features: FourierFeatures) -> None:
        """Of a window."""
        self._features = features
        self.angular = torch.from_numpy(features.angular)
        self._slope = 2.0 / features.duration
        self.size = features.size

    def __call__(self, time: FloatArray) -> Tensor:
        """(4, N, size) at instants (N,)."""
        orders = [torch.from_numpy(self._features(time))]
        for _ in range(ORDER):
            orders.append(self.derivative(orders[-1]))
        return torch.stack(orders)

    def derivative(self, products: Tensor) -> Tensor:
        """(.., size): each feature on the last axis by its derivative."""
        moved = torch.zeros_like(products)
        moved[..., 1] = self._slope * products[..., 0]
        moved[..., 2::2] = self.angular * products[..., 3::2]
        moved[..., 3::2] = -self.angular * products[..., 2::2]
        return moved


def activations(hidden: HiddenLayers, orders: Tensor) -> Tensor:
    """The tanh layers with derivatives up to the third; (4, N, inputs) to (4, N, 60).

    With t = tanh z and s = 1 - t²,  t' = s z',  t'' = s z'' - 2ts z'²,
    t''' = s z''' - 6ts z' z'' + (6t² - 2)s z'³.
    """
    for layer in hidden.layers:
        assert isinstance(layer, nn.Linear)
        z = orders @ layer.weight.T
        first, second, third = z[1], z[2], z[3]
        t = torch.tanh(z[0] + layer.bias)
        s = 1 - t * t
        orders = torch.stack(
            [
                t,
                s * first,
                s * (second - 2 * t * first**2),
                s * (third - 6 * t * first * second + (6 * t * t - 2) * first**3),
            ]
        )
    return orders


class Grams:
    """∫ D^aΦᵀ D^bΦ dt of all derivatives; what Fourier features share is summed once."""

    def __init__(self, fourier: FourierOrders, orders: Tensor, weights: Tensor) -> None:
        """For Fourier features (4, N, F) at instants with quadrature weights (N,)."""
        self._fourier, self._weights = fourier, weights
        self._weighted = orders[0] * weights[:, None]
        gram = self._weighted.T @ orders[0]
        self._static = self._all(torch.stack(self._rise(gram)))

    def _rise(self, products: Tensor) -> list[Tensor]:
        """Products with the features' derivatives 0 to 3 on the last axis."""
        found = [products]
        for _ in range(ORDER):
            found.append(self._fourier.derivative(found[-1]))
        return found

    def _all(self, products: Tensor) -> Tensor:
        """(4, 4, F, B) from φᵀ D^bΦ (4, F, B)."""
        rows = self._rise(products.transpose(1, 2))
        return torch.stack([one.transpose(1, 2) for one in rows])

    def __call__(self, active: Tensor) -> Tensor:
        """(4, 4, K, K) of Φ = [φ, h], from the activations' derivatives (4, N, H)."""
        cross = self._all(torch.einsum("nf,bnh->bfh", self._weighted, active))
        weighted = active * self._weights[:, None]
        inner = torch.einsum("anh,bng->abhg", weighted, active)
        top = torch.cat([self._static, cross], 3)
        bottom = torch.cat([cross.permute(1, 0, 3, 2), inner], 3)
        return torch.cat([top, bottom], 2)


class OutputLayer:
    """The quadratic Ψ of a platoon, at unknowns that do not change."""

    def __init__(
        self,
        measured: FloatArray,
        stride: int,
        sample_time: Seconds,
        mask: Mask | None,
        fourier: FourierOrders,
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
        self.followers = len(values)
        self._physics: list[Physics] = [physics(one) for one in values]
        time: FloatArray = sample_time * np.arange(len(measured), dtype=np.float64)
        every = max(1, int(GRID / sample_time))
        self.grid, self.samples = time[::every], time[::stride]
        weights = np.full(len(self.grid), every * sample_time)
        weights[[0, -1]] /= 2
        self.grid_orders, self.sample_orders = fourier(self.grid), fourier(self.samples)
        self.weights = torch.from_numpy(weights)
        self._grams = Grams(fourier, self.grid_orders, self.weights)
        masks = None if mask is None else torch.from_numpy(mask[::every].astype(float)).T
        self.masks = masks
        self._masked = [
            Grams(fourier, self.grid_orders, self.weights * row)
            for row in ([] if masks is None else masks)
        ]
        self.data = torch.from_numpy(measured[::stride].copy())
        self.count = self.data.numel()
        speeds, gaps = output_columns(self.followers)
        noise = np.empty(measured.shape[1])
        noise[speeds], noise[gaps] = np.r_[values[0, 7], values[:, 7]], values[:, 6]
        self.precision = torch.from_numpy(noise**-2)

    def solve(self, active: Tensor, active_samples: Tensor) -> Tensor:
        """W (K, 2M+1), from the activations on the grid (4, N, H) and at the samples."""
        grams = self._grams(active)
        value = torch.cat([self.sample_orders[0], active_samples[0]], 1)
        data = value.T @ value
        right = value.T @ self.data * self.precision
        first = torch.cat([self.grid_orders[:, 0], active[:, 0]], 1)[:ORDER]
        size = data.shape[0]
        ridge = RIDGE * data.trace() / size * torch.eye(size, dtype=data.dtype)
        data = data + ridge
        speeds, gaps = output_columns(self.followers)
        links = []
        leader = data * self.precision[0]
        for k, equations in enumerate(self._physics):
            running, start = (torch.from_numpy(part) for part in equations)
            if self._masked:
                blocks = _blocks(running[:1], self._masked[k](active))
                blocks = blocks + _blocks(running[1:2], grams)
            else:
                blocks = _blocks(running[:2], grams)
            at_first = torch.einsum("eoa,ak->eok", start[[0, 1, 3, 4]], first)
            blocks = blocks + torch.einsum("eok,epl->opkl", at_first, at_first)
            p, v, u = range(3)
            own_speed, gap = speeds[k + 1], gaps[k]
            blocks[v, v] += data * self.precision[own_speed]
            blocks[p, p] += data * self.precision[gap]
            own = torch.cat(
                [
                    torch.cat([blocks[v, v], blocks[v, p]], 1),
                    torch.cat([blocks[p, v], blocks[p, p]], 1),
                ]
            )
            coupling = torch.cat([blocks[v, u], blocks[p, u]])
            links.append(
                Link(own, coupling, blocks[u, u], right[:, [own_speed, gap]].T.reshape(-1))
            )
            if k == 0:
                leader = leader + _blocks(running[2:, u:], grams)[0, 0]
                ends = torch.einsum("ea,ak->ek", start[[2, 5], u], first)
                leader = leader + ends.T @ ends
        return solve_chain(links, leader, right[:, 0])

    def terms(
        self,
        orders: Tensor,
        outputs: Tensor,
        data: Tensor,
        weights: Tensor,
        masks: Tensor | None,
        share: float = 1.0,
    ) -> tuple[Tensor, Tensor]:
        """Ψ's data and physics of outputs.

        Args:
            orders: (4, N, 2M+1) the surrogate with its derivatives, on some of the grid.
            outputs: (S, 2M+1) the surrogate at some samples.
            data: (S, 2M+1) what was measured there.
            weights: (N,) of the quadrature.
            masks: (M, N) or None.
            share: of the samples that these are.
        """
        precision = self.precision.to(outputs.dtype)
        misfit = 0.5 * ((outputs - data) ** 2 * precision).sum() / share
        speeds, gaps = output_columns(self.followers)
        total = torch.zeros((), dtype=outputs.dtype)
        for k, equations in enumerate(self._physics):
            running = torch.from_numpy(equations.running).to(outputs.dtype)
            columns = [gaps[k], speeds[k + 1], speeds[k]]
            squares = torch.einsum("eoa,ano->en", running, orders[:, :, columns]) ** 2
            own = weights if masks is None else weights * masks[k]
            total = total + (squares[0] * own).sum() + (squares[1] * weights).sum()
            if k == 0:
                total = total + (squares[2] * weights).sum()
        return misfit / self.count, 0.5 * total / self.count

    def first_terms(self, orders: Tensor) -> Tensor:
        """Ψ's terms of the first instant, from (4, 2M+1) the surrogate there."""
        speeds, gaps = output_columns(self.followers)
        total = torch.zeros((), dtype=orders.dtype)
        for k, equations in enumerate(self._physics):
            start = torch.from_numpy(equations.first).to(orders.dtype)
            columns = [gaps[k], speeds[k + 1], speeds[k]]
            squares = torch.einsum("eoa,ao->e", start, orders[:ORDER, columns]) ** 2
            total = total + (squares if k == 0 else squares[[0, 1, 3, 4]]).sum()
        return 0.5 * total / self.count


def _blocks(forms: Tensor, grams: Tensor) -> Tensor:
    """(O, O, K, K) of residuals (E, O, 4) squared and integrated."""
    squares = torch.einsum("eoa,epb->opab", forms, forms)
    outputs, size = forms.shape[1], grams.shape[-1]
    flat = squares.reshape(outputs**2, -1) @ grams.reshape((ORDER + 1) ** 2, -1)
    return flat.reshape(outputs, outputs, size, size)
