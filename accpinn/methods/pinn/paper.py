"""The `paper` preset: everything by gradient, as Apostolakis and Ampountolas (2024) train.

Raw time in seconds goes in, the full training set is used in every iteration, all in double
precision; network weights and (α, β, τ) are learned together by Adam, then, if asked for, by
L-BFGS. Of several windows each has a network of its own, and one optimiser learns the weights of
all together with the parameters that they share. The time derivative is the exact tangent, not
nested differentiation (`network`): the mathematics is the same, an iteration costs less. After each
iteration α, β and τ are clipped at zero, the rational driving constraints.

In place of α, β and τ another model has z, its parameters in standard deviations of their priors
(see `model.following`), which are clipped at its bounds.
"""

from collections.abc import Sequence
from itertools import chain
from typing import Any, NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.optim.adam import adam

from accpinn.methods import Segments
from accpinn.methods.estimate import Checkpoint, Estimate, for_window, of_window
from accpinn.methods.findings import HoldoutLoss
from accpinn.methods.pinn.config import PinnConfig
from accpinn.methods.pinn.initial import initial_scores, values_of
from accpinn.methods.pinn.loss import (
    LossTerms,
    LossTraining,
    Motion,
    WindowData,
    loss_terms,
    output_columns,
    shares_of,
    trajectories,
)
from accpinn.methods.pinn.network import Network, State
from accpinn.methods.regression import Regression, Solution
from accpinn.methods.simulation import bounds_of
from accpinn.model.cthp import Case, Parameters, Trajectories
from accpinn.model.registry import FOLLOWING, PAPER
from accpinn.model.spec import ModelSpec
from accpinn.segment import median_speeds
from accpinn.units import FloatArray, Mask

CHUNK = 5
"""Iterations per `advance` of one window: some tens of milliseconds, so that it soon stops."""


class Part(NamedTuple):
    """Some instants of a window."""

    time: Tensor
    measured: Tensor
    mask: Tensor | None

    @classmethod
    def of(cls, data: WindowData, instants: Mask) -> "Part":
        """The instants at which a mask (N,) is True."""
        mask = None if data.mask is None else torch.from_numpy(data.mask[instants])
        time, measured = data.segment.time[instants], data.measured[instants]
        return cls(torch.from_numpy(time), torch.from_numpy(measured), mask)


class Adam:
    """PyTorch's Adam by its function, with the optimiser's moments of some weights.

    The class `torch.optim.Adam` loads a compiler for a second. Source: Kingma and Ba 2014.
    """

    def __init__(self, weights: Sequence[Tensor], b2: float = 0.999) -> None:
        """The moments start at zero; b2 is the share of the squares' mean kept in a step."""
        self._weights, self._b2 = list(weights), b2
        self._means, self._squares = ([torch.zeros_like(w) for w in weights] for _ in range(2))
        self._steps = [torch.zeros(()) for _ in weights]

    @torch.no_grad()
    def step(self, loss: Tensor, learning_rate: float) -> None:
        """Move the weights along the gradient of a loss."""
        with torch.enable_grad():
            slopes = torch.autograd.grad(loss, self._weights)
        adam(
            self._weights, list(slopes), self._means, self._squares, [], self._steps,
            foreach=False, amsgrad=False, beta1=0.9, beta2=self._b2, lr=learning_rate,
            weight_decay=0.0, eps=1e-8, maximize=False,
        )  # fmt: skip

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Moments and count of steps, by name."""
        named = zip(self._means, self._squares, self._steps, strict=True)
        return {
            f"adam.{k}.{part}": values.numpy().copy()
            for k, group in enumerate(named)
            for part, values in enumerate(group)
        }

    def load_arrays(self, state: State) -> None:
        """Continue from what `arrays` gave."""
        for k, group in enumerate(zip(self._means, self._squares, self._steps, strict=True)):
            for part, values in enumerate(group):
                values.copy_(torch.tensor(state[f"adam.{k}.{part}"]))


class PaperTraining(LossTraining):
    """See the module's head; one `advance` is `CHUNK` iterations, or fewer of several windows."""

    has_checkpoints = True

    def __init__(
        self, segments: Segments, case: Case, config: PinnConfig, threads: int, spec: ModelSpec
    ) -> None:
        """Build networks, parameters and each window's split into training and test instants.

        As another model may have no acceleration at the gap of zero with which the paper's network
        begins, its curves begin near the data's mean.
        """
        self.model = None if spec.model == PAPER else FOLLOWING[spec.model]
        super().__init__(segments, case, config, spec)
        torch.set_num_threads(threads)
        self.networks = tuple(Network(self.followers, config, float(s.time[-1])) for s in segments)
        initial, bounds = config.initial.values, np.array([3 * [0.0], 3 * [np.inf]])
        if self.model:
            bounds = bounds_of(self.model, spec.fixed)
            initial = initial_scores(self.model, config, bounds)
            for network, data in zip(self.networks, self.windows, strict=True):
                network.output.bias[:] = data.measured.mean(axis=0)
        self._bounds = [*map(torch.from_numpy, bounds)]
        sets = 1 if case == "I" else self.followers
        self._parameters = torch.tensor(np.tile(initial, (sets, 1)), requires_grad=True)
        """(sets, 3) α, β, τ, or (sets, n) z."""
        self._learnable = tuple(network.learnable() for network in self.networks)
        weights = chain.from_iterable(network.weights() for network in self._learnable)
        self._unknowns = [*weights, self._parameters]
        self._adam = Adam(self._unknowns)
        self._lbfgs: torch.optim.LBFGS | None = None
        self._chunk = max(1, CHUNK // len(segments))
        self._tests: list[Mask] = []
        """Of each window (N,) which instants are kept out."""
        for segment in segments:  # the first instant stays in, as Ψ_R looks at it
            random = np.random.default_rng(config.seed)
            drawn = random.permutation(np.arange(1, segment.samples))
            test = np.zeros(segment.samples, dtype=bool)
            test[drawn[: round(config.test_share * segment.samples)]] = True
            self._tests.append(test)
        pairs = [*zip(self.windows, self._tests, strict=True)]
        self._train = [Part.of(data, ~test) for data, test in pairs]
        self._kept_out = [Part.of(data, test) for data, test in pairs]
        self._iteration = 0
        self._note("Adam")

    def advance(self) -> None:
        """Some iterations, or as many as are left of the present phase."""
        left = self.config.iterations - self._iteration
        if left > 0:
            for _ in range(min(self._chunk, left)):
                terms = self._loss()
                self._adam.step(terms.total, self.config.learning_rate)
                self._clip()
                self._iteration += 1
            self._note("Adam", terms)  # of before the last step, as they come with its gradient
        else:
            self._refine(min(self._chunk, self.planned - self._iteration))
            self._note("L-BFGS")

    @torch.no_grad()
    def _note(self, phase: str, terms: LossTerms | None = None) -> None:
        """Look at the present moment, with Ψ where it is known already."""
        self._look(phase, self._iteration, terms or self._loss(), self._now())

    def _refine(self, iterations: int) -> None:
        """L-BFGS; after a checkpoint it begins its curvature anew."""
        optimiser = self._lbfgs or torch.optim.LBFGS(
            self._unknowns, max_eval=1000, history_size=50, line_search_fn="strong_wolfe"
        )
        optimiser.param_groups[0]["max_iter"] = iterations
        self._lbfgs = optimiser

        def closure() -> Tensor:
            optimiser.zero_grad()
            total: Tensor = self._loss().total
            total.backward()
            return total

        optimiser.step(closure)
        self._clip()
        self._iteration += iterations

    def _now(self) -> Parameters:
        """(sets,) the present parameters; (M,) those of another model."""
        values = self._parameters.detach().numpy()
        if not self.model:
            return Parameters.of(values)
        theta = values_of(self.model, values, self.followers)
        return self.model.linearisations(theta, median_speeds(self.segments))

    @torch.no_grad()
    def _clip(self) -> None:
        self._parameters.clamp_(*self._bounds)

    def _theta(self) -> Tensor:
        """(M, 3) α, ατ, β or (n, M) those of another model; a line search may leave the bounds."""
        values = self._parameters.clamp(*self._bounds).expand(self.followers, -1).T
        if not self.model:
            alpha, beta, tau = values
            return torch.stack([alpha, alpha * tau, beta], 1)
        named = zip(self.model.parameters, values, strict=True)
        return torch.stack([parameter.value(part, torch) for parameter, part in named])

    def _loss(self, parts: Sequence[Part] | None = None) -> LossTerms:
        """Ψ of the training instants, or of others."""
        parts, theta, terms = parts or self._train, self._theta(), []
        for network, (time, measured, mask) in zip(self._learnable, parts, strict=True):
            motion = Motion(*network(time, self.order))
            if self.model and "delay" in self.terms:
                motion = motion.with_earlier(network, time, self.model.term(theta, "delay"))
            terms.append(loss_terms(motion, measured, theta, self.config, mask, self.model))
        return LossTerms.mean(terms, shares_of([len(part.time) for part in parts]))

    def curves(self) -> Trajectories:
        """The present surrogate of the first window, on all instants."""
        time = self.segments[0].time
        return trajectories(time, self.networks[0](time)[0])

    @torch.no_grad()
    def estimate(self) -> Estimate:
        """The surrogates on all instants, the parameters, and the losses on both parts."""
        pairs = zip(self.networks, self.segments, strict=True)
        motions = [Motion(*network(segment.time)) for network, segment in pairs]
        loss = self._loss().values()
        arrays: dict[str, FloatArray] = {}
        findings: tuple[HoldoutLoss, ...] = ()
        for k, (network, test) in enumerate(zip(self.networks, self._tests, strict=True)):
            split = {"test": test.astype(float)} if test.any() else {}
            arrays |= for_window(network.arrays() | split, k)
        if instants := int(sum(test.sum() for test in self._tests)):
            kept_out = self._loss(self._kept_out).values()
            loss |= {"test_data": kept_out["data"], "test_physics": kept_out["physics"]}
            findings = (HoldoutLoss(instants, kept_out["data"], kept_out["physics"]),)
        named = zip(self.segments, motions, strict=True)
        return self._estimate(
            self._now() if self.model else self._solution(motions),
            [trajectories(segment.time, motion.outputs) for segment, motion in named],
            loss=loss,
            network_weights=self.networks[0].size,
            arrays=arrays,
            findings=findings,
        )

    def _solution(self, motions: Sequence[Motion]) -> Solution:
        """The learned parameters; where one was clipped, least squares on the surrogate beside."""
        theta = self._theta().detach().numpy()
        active = theta == 0
        if not active.any() or not all(np.isfinite(motion.rates).all() for motion in motions):
            return Solution(theta, theta, active)
        speeds, gaps = output_columns(self.followers)
        regressions = [
            Regression.of_motion(
                motion.outputs[:, speeds],
                motion.outputs[:, gaps],
                motion.rates[:, speeds[1:]],
                segment.mask,
            )
            for segment, motion in zip(self.segments, motions, strict=True)
        ]
        free = Regression.joined(regressions).solve(self.case)
        return Solution(theta, free.unconstrained, active)

    def state(self) -> Checkpoint:
        """Networks, parameters and Adam's moments."""
        state: Checkpoint = {"table": self._parameters.detach().numpy().copy()}
        state["iteration"] = np.array(self._iteration)
        for k, network in enumerate(self.networks):
            state |= for_window(network.arrays(), k)
        return state | self._adam.arrays()

    def restore(self, state: Checkpoint) -> None:
        """Continue from ``state``."""
        for k, network in enumerate(self.networks):
            network.load_arrays(of_window(state, k))
        with torch.no_grad():
            self._parameters.copy_(torch.tensor(state["table"]))
        self._adam.load_arrays(state)
        self._iteration = int(state["iteration"])
        self._note("Adam" if self._iteration <= self.config.iterations else "L-BFGS")
