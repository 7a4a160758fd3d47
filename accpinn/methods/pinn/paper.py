"""The `paper` preset: everything by gradient, as Apostolakis and Ampountolas (2024) train.

Raw time in seconds goes in, the full training set is used in every iteration, all in double
precision; network weights and (α, β, τ) are learned together by Adam, then, if asked for, by
L-BFGS. The time derivative is the exact tangent, not nested differentiation: the mathematics is
the same, an iteration costs less.

Time goes through tanh layers; its derivative of one goes along,

    h = tanh z,   dh/dt = (1 - h²) · dz/dt,   z = W h + b of the layer before.

After each iteration α, β and τ are clipped at zero, the rational driving constraints.

This is the only module that needs PyTorch, which takes seconds to be imported.
"""

from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn
from torch.nn.utils import parameters_to_vector

from accpinn.methods.fit import Checkpoint, HoldoutLoss, Outcome
from accpinn.methods.pinn.config import PinnConfig
from accpinn.methods.pinn.loss import Learned, LossTerms, Training, loss_terms
from accpinn.methods.pinn.network import Adam, output_columns
from accpinn.methods.pinn.request import WarmStart
from accpinn.methods.regression import Regression, Solution
from accpinn.model.cthp import Case, Parameters
from accpinn.segment.segment import Segment
from accpinn.units import FloatArray, Mask

CHUNK = 5
"""Iterations per `advance`: some tens of milliseconds, so that a stop is felt at once."""


class PaperNetwork(nn.Module):
    """The paper's network 1-60-60-60-(2M+1): 7,623 weights for M = 1 and 7,989 for M = 4."""

    def __init__(self, followers: int, hidden: Sequence[int], seed: int) -> None:
        """Xavier-uniform weights and zero biases, in double precision."""
        super().__init__()
        generator = torch.Generator().manual_seed(seed)
        self._layers = [_layer(*sizes, generator) for sizes in pairwise((1, *hidden))]
        # Nested, as snapshots name the weights so.
        self.hidden = nn.ModuleDict({"layers": nn.ModuleList(self._layers)})
        generator = torch.Generator().manual_seed(seed + 1)
        self.output = _layer(hidden[-1], 2 * followers + 1, generator)

    def forward(self, time: Tensor) -> tuple[Tensor, Tensor]:
        """(N,) seconds to (N, 2M+1) outputs, in the order of `output_columns`, and their rates."""
        value = time[:, None]
        rate = torch.ones_like(value)
        for layer in self._layers:
            value, through = torch.tanh(layer(value)), rate @ layer.weight.T
            rate = (1 - value * value) * through
        return self.output(value), rate @ self.output.weight.T

    @property
    def size(self) -> int:
        """How many numbers it learns."""
        return sum(parameter.numel() for parameter in self.parameters())

    def state(self) -> dict[str, NDArray[Any]]:
        """The weights by name."""
        return {f"network.{name}": value.numpy() for name, value in self.state_dict().items()}

    def load(self, state: Mapping[str, NDArray[Any]]) -> None:
        """Take the weights that `state` gave.

        Raises:
            ValueError: when they are another network's.
        """
        own = self.state()
        given = {name: state[name] for name in state if name.startswith("network.")}
        if {n: v.shape for n, v in given.items()} != {n: v.shape for n, v in own.items()}:
            raise ValueError("the weights are another network's")
        for name, values in own.items():  # they share the network's memory
            values[:] = given[name]


def _layer(inputs: int, outputs: int, generator: torch.Generator) -> nn.Linear:
    layer = nn.Linear(inputs, outputs, dtype=torch.float64)
    nn.init.xavier_uniform_(layer.weight, generator=generator)
    nn.init.zeros_(layer.bias)
    return layer


class PaperTraining(Training):
    """See the module's head; one `advance` is `CHUNK` iterations."""

    def __init__(self, segment: Segment, case: Case, config: PinnConfig, threads: int = 1) -> None:
        """Build network, parameters and the split into training and test instants."""
        super().__init__(segment, case, config, threads)
        torch.set_num_threads(threads)
        self.network = PaperNetwork(self.followers, config.hidden, config.seed)
        sets = 1 if case == "I" else self.followers
        initial = np.tile(config.initial.values, (sets, 1))
        self._parameters = torch.tensor(initial, requires_grad=True)  # (sets, 3) α, β, τ
        self._unknowns = [*self.network.parameters(), self._parameters]
        self._adam = Adam(_joined(self._unknowns))
        self._second_order: torch.optim.LBFGS | None = None
        self._test = _draw_test(segment.samples, config.test_share, config.seed)
        self._time = torch.tensor(segment.time)
        self._train = self._at(~self._test)
        self._iteration = 0
        self._note("Adam")

    def begin_from(self, warm: WarmStart) -> None:
        """Begin anew, from what an earlier training has learned."""
        initial = warm.initial(self.case, self.followers)
        self.network.load(warm.arrays)
        with torch.no_grad():
            self._parameters.copy_(torch.tensor(initial.values))
        self._note("Adam")

    def advance(self) -> None:
        """`CHUNK` iterations, or as many as are left of the present phase."""
        left = self.config.iterations - self._iteration
        if left > 0:
            self._note("Adam", self._descend(min(CHUNK, left)))
        else:
            self._lbfgs(min(CHUNK, self.planned - self._iteration))
            self._note("L-BFGS")

    @torch.no_grad()
    def _note(self, phase: str, terms: LossTerms | None = None) -> None:
        """Look at the present moment, with Ψ where it is known already, and see if it ends."""
        now = Parameters.of(self._parameters.detach().numpy())
        self._look(phase, self._iteration, terms or self._loss(), now)
        self.outcome = Outcome.FINISHED if self._iteration >= self.planned else None
        if not np.isfinite(self.progress.total):
            self.outcome = Outcome.DIVERGED

    def _descend(self, iterations: int) -> LossTerms:
        """Adam; the terms are those before the last step, as they come with its gradient."""
        for _ in range(iterations):
            terms = self._loss()
            terms.total.backward()
            slopes = [weight.grad for weight in self._unknowns if weight.grad is not None]
            gradient = parameters_to_vector(slopes).numpy()
            self._adam.step(gradient, self.config.learning_rate)
            for weight in self._unknowns:
                weight.grad = None
            self._clip()
        self._iteration += iterations
        return terms

    def _lbfgs(self, iterations: int) -> None:
        optimiser = self._second_order or torch.optim.LBFGS(
            self._unknowns, max_eval=1000, history_size=50, line_search_fn="strong_wolfe"
        )
        optimiser.param_groups[0]["max_iter"] = iterations
        self._second_order = optimiser

        def closure() -> Tensor:
            optimiser.zero_grad()
            total: Tensor = self._loss().total
            total.backward()
            return total

        optimiser.step(closure)
        self._clip()
        self._iteration += iterations

    @torch.no_grad()
    def _clip(self) -> None:
        self._parameters.clamp_(min=0.0)

    def _theta(self) -> Tensor:
        """(M, 3) α, ατ, β of the present parameters, also where a line search tries some < 0."""
        alpha, beta, tau = self._parameters.clamp(min=0.0).expand(self.followers, 3).T
        return torch.stack([alpha, alpha * tau, beta], 1)

    def _loss(self) -> LossTerms:
        time, data, mask = self._train
        outputs, rates = self.network(time)
        return loss_terms(outputs, rates, data, self._theta(), self.config, mask)

    @torch.no_grad()
    def outputs(self) -> FloatArray:
        """(N, 2M+1) the present surrogate on all instants."""
        outputs, _ = self.network(self._time)
        return np.asarray(outputs)

    @torch.no_grad()
    def learned(self) -> Learned:
        """The surrogate on all instants, the parameters, and the losses on both parts."""
        outputs, rates = self.network(self._time)
        loss = self._loss_at(~self._test, outputs, rates).values()
        arrays = self.network.state()
        findings: tuple[HoldoutLoss, ...] = ()
        if self._test.any():
            arrays["test"] = self._test.astype(float)
            kept_out = self._loss_at(self._test, outputs, rates).values()
            loss |= {"test_data": kept_out["data"], "test_physics": kept_out["physics"]}
            instants = int(self._test.sum())
            findings = (HoldoutLoss(instants, kept_out["data"], kept_out["physics"]),)
        return Learned(
            outputs=outputs.numpy(),
            solution=self._solution(outputs.numpy(), rates.numpy()),
            loss=loss,
            network_weights=self.network.size,
            arrays=arrays,
            findings=findings,
        )

    def _loss_at(self, instants: Mask, outputs: Tensor, rates: Tensor) -> LossTerms:
        rows, (_, data, mask) = torch.from_numpy(instants), self._at(instants)
        return loss_terms(outputs[rows], rates[rows], data, self._theta(), self.config, mask)

    def _at(self, instants: Mask) -> tuple[Tensor, Tensor, Tensor | None]:
        """Time, data and mask at some instants."""
        mask = None if self.mask is None else torch.from_numpy(self.mask[instants])
        return self._time[instants], torch.from_numpy(self.measured[instants]), mask

    def _solution(self, outputs: FloatArray, rates: FloatArray) -> Solution:
        """The learned parameters; where one was clipped, least squares on the surrogate beside."""
        theta = self._theta().detach().numpy()
        active = theta == 0
        if not active.any() or not np.isfinite(rates).all():
            return Solution(theta, theta, active)
        speeds, gaps = output_columns(self.followers)
        motion = outputs[:, speeds], outputs[:, gaps], rates[:, speeds[1:]]
        free = Regression.of_motion(*motion, self.segment.mask).solve(self.case)
        return Solution(theta, free.unconstrained, active)

    def state(self) -> Checkpoint:
        """Network, parameters and Adam's moments; L-BFGS begins its curvature anew."""
        state = self.network.state() | self._adam.state()
        state["table"] = self._parameters.detach().numpy()
        state["iteration"] = np.array(self._iteration)
        return state

    def restore(self, state: Checkpoint) -> None:
        """Go on from ``state``."""
        self.network.load(state)
        with torch.no_grad():
            self._parameters.copy_(torch.from_numpy(np.array(state["table"])))
        self._adam.restore(state)
        self._iteration = int(state["iteration"])
        self._note("Adam" if self._iteration <= self.config.iterations else "L-BFGS")


def _joined(weights: Sequence[Tensor]) -> NDArray[np.float64]:
    """All numbers of some tensors in a row, of which they become parts."""
    values = parameters_to_vector(weights).detach()
    parts = values.split([weight.numel() for weight in weights])
    for weight, part in zip(weights, parts, strict=True):
        weight.data = part.view_as(weight)
    return np.asarray(values)


def _draw_test(count: int, share: float, seed: int) -> Mask:
    """(count,) which instants are kept out; the first one stays in, as Ψ_R looks at it."""
    test = np.zeros(count, dtype=bool)
    drawn = np.random.default_rng(seed).permutation(np.arange(1, count))
    test[drawn[: round(share * count)]] = True
    return test
