"""The `paper` preset: everything by gradient, as Apostolakis and Ampountolas (2024) train.

Raw time in seconds goes in, the full training set is used in every iteration, all in double
precision; network weights and (α, β, τ) are learned together by Adam, then, if asked for, by
L-BFGS. The time derivative is the exact tangent, not nested differentiation (`network`): the
mathematics is the same, an iteration costs less. After each iteration α, β and τ are clipped at
zero, the rational driving constraints.

In place of α, β and τ another model has z, its parameters in standard deviations of their priors
(see `model.following`), which are clipped at its bounds.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.optim.adam import adam

from accpinn.errors import ConfigError
from accpinn.methods.estimate import Checkpoint, Fit, HoldoutLoss
from accpinn.methods.pinn.config import PinnConfig
from accpinn.methods.pinn.loss import (
    LossTerms,
    Motion,
    Training,
    loss_terms,
    output_columns,
    trajectories,
)
from accpinn.methods.pinn.network import Network, State
from accpinn.methods.regression import Regression, Solution
from accpinn.methods.simulation import bounds_of
from accpinn.model.cthp import Case, Parameters, Trajectories
from accpinn.model.following import FollowingModel
from accpinn.model.registry import CTHPS, FOLLOWING, PAPER
from accpinn.model.spec import ModelSpec
from accpinn.segment import Segment, median_speeds
from accpinn.units import FloatArray, Mask

Part = tuple[Tensor, Tensor, Tensor | None]
"""Time, data and mask at some instants."""
CHUNK = 5
"""Iterations per `advance`: some tens of milliseconds, so that a stop is felt at once."""


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


def initial_scores(model: FollowingModel, config: PinnConfig, bounds: FloatArray) -> FloatArray:
    """(n,) z of the user's initial values, or of typical ones for what has none.

    Raises:
        ConfigError: where these are not the model's.
    """
    own, named = config.initial.own, model.parameters
    if model.key in CTHPS:
        ends = np.array([(p.lower, p.upper) for p in named])
        own = np.clip([*config.initial.values, *model.typical[3:]], *ends.T)
    elif not own.size:
        return np.clip(np.zeros(len(named)), *bounds)
    if len(own) != len(named) or any(
        not p.lower <= value <= p.upper for p, value in zip(named, own, strict=True)
    ):
        allowed = ", ".join(f"{p.name} {p.lower:g} to {p.upper:g}" for p in named)
        raise ConfigError(f"initial: {model.title} begins with {len(named)} numbers: {allowed}.")
    scores = np.array([p.score(value) for p, value in zip(named, own, strict=True)])
    return np.asarray(np.clip(scores, *bounds))


def values_of(model: FollowingModel, z: FloatArray, followers: int) -> FloatArray:
    """(n, M) parameters at z (S, n), one row a follower or one for all."""
    return model.values_at(np.broadcast_to(z, (followers, z.shape[1])))


class PaperTraining(Training):
    """See the module's head; one `advance` is `CHUNK` iterations."""

    has_checkpoints = True

    def __init__(
        self, segment: Segment, case: Case, config: PinnConfig, threads: int, spec: ModelSpec
    ) -> None:
        """Build network, parameters and the split into training and test instants.

        As another model may have no acceleration at the gap of zero with which the paper's network
        begins, its curves begin near the data's mean.
        """
        self.model = None if spec.model == PAPER else FOLLOWING[spec.model]
        super().__init__(segment, case, config)
        torch.set_num_threads(threads)
        self.network = Network(self.followers, config, float(segment.time[-1]))
        initial, bounds = config.initial.values, np.array([3 * [0.0], 3 * [np.inf]])
        if self.model:
            bounds = bounds_of(self.model, spec.fixed)
            initial = initial_scores(self.model, config, bounds)
            self.network.output.bias[:] = self.measured.mean(axis=0)
        self._bounds = [*map(torch.from_numpy, bounds)]
        sets = 1 if case == "I" else self.followers
        self._parameters = torch.tensor(np.tile(initial, (sets, 1)), requires_grad=True)
        """(sets, 3) α, β, τ, or (sets, n) z."""
        self._learnable = self.network.learnable()
        self._unknowns = [*self._learnable.weights(), self._parameters]
        self._adam = Adam(self._unknowns)
        self._lbfgs: torch.optim.LBFGS | None = None
        self._test = _draw_test(segment.samples, config.test_share, config.seed)
        self._train, self._kept_out = self._at(~self._test), self._at(self._test)
        self._iteration = 0
        self._note("Adam")

    def advance(self) -> None:
        """`CHUNK` iterations, or as many as are left of the present phase."""
        left = self.config.iterations - self._iteration
        if left > 0:
            self._note("Adam", self._descend(min(CHUNK, left)))
        else:
            self._refine(min(CHUNK, self.planned - self._iteration))
            self._note("L-BFGS")

    @torch.no_grad()
    def _note(self, phase: str, terms: LossTerms | None = None) -> None:
        """Look at the present moment, with Ψ where it is known already."""
        self._look(phase, self._iteration, terms or self._loss(), self._now())

    def _descend(self, iterations: int) -> LossTerms:
        """Adam; the terms are those before the last step, as they come with its gradient."""
        for _ in range(iterations):
            terms = self._loss()
            self._adam.step(terms.total, self.config.learning_rate)
            self._clip()
        self._iteration += iterations
        return terms

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
        return self.model.linearisations(theta, median_speeds((self.segment,)))

    @torch.no_grad()
    def _clip(self) -> None:
        self._parameters.clamp_(*self._bounds)

    def _theta(self) -> Tensor:
        """(M, 3) α, ατ, β or (n, M) those of another model; a line search may leave the bounds."""
        each = self._parameters.clamp(*self._bounds).expand(self.followers, -1).T
        if not self.model:
            alpha, beta, tau = each
            return torch.stack([alpha, alpha * tau, beta], 1)
        named = zip(self.model.parameters, each, strict=True)
        return torch.stack([parameter.value(part, torch) for parameter, part in named])

    def _loss(self, part: Part | None = None) -> LossTerms:
        """Ψ of the training instants, or of others."""
        time, data, mask = part or self._train
        theta = self._theta()
        motion = Motion(*self._learnable(time, self.order))
        if self.model and "delay" in self.terms:
            motion = motion.with_earlier(self._learnable, time, self.model.term(theta, "delay"))
        return loss_terms(motion, data, theta, self.config, mask, self.model)

    def surrogate(self) -> Trajectories:
        """The present surrogate on all instants."""
        return trajectories(self.segment.time, self.network(self.segment.time)[0])

    @torch.no_grad()
    def fit(self) -> Fit:
        """The surrogate on all instants, the parameters, and the losses on both parts."""
        outputs, rates = self.network(self.segment.time)
        loss = self._loss().values()
        arrays = self.network.arrays()
        findings: tuple[HoldoutLoss, ...] = ()
        if self._test.any():
            arrays["test"] = self._test.astype(float)
            kept_out = self._loss(self._kept_out).values()
            loss |= {"test_data": kept_out["data"], "test_physics": kept_out["physics"]}
            instants = int(self._test.sum())
            findings = (HoldoutLoss(instants, kept_out["data"], kept_out["physics"]),)
        fit = self._fit(
            self._solution(outputs, rates),
            trajectories(self.segment.time, outputs),
            loss,
            network_weights=self.network.size,
            arrays=arrays,
            findings=findings,
        )
        return replace(fit, parameters=self._now(), unconstrained=None) if self.model else fit

    def _at(self, instants: Mask) -> Part:
        mask = None if self.mask is None else torch.from_numpy(self.mask[instants])
        time, measured = self.segment.time[instants], self.measured[instants]
        return torch.from_numpy(time), torch.from_numpy(measured), mask

    def _solution(self, outputs: FloatArray, rates: FloatArray) -> Solution:
        """The learned parameters; where one was clipped, least squares on the surrogate beside."""
        if self.model:
            return Solution.of(self._now().theta)
        theta = self._theta().detach().numpy()
        active = theta == 0
        if not active.any() or not np.isfinite(rates).all():
            return Solution(theta, theta, active)
        speeds, gaps = output_columns(self.followers)
        motion = outputs[:, speeds], outputs[:, gaps], rates[:, speeds[1:]]
        free = Regression.of_motion(*motion, self.segment.mask).solve(self.case)
        return Solution(theta, free.unconstrained, active)

    def state(self) -> Checkpoint:
        """Network, parameters and Adam's moments."""
        state = self.network.arrays() | self._adam.arrays()
        state["table"] = self._parameters.detach().numpy().copy()
        state["iteration"] = np.array(self._iteration)
        return state

    def restore(self, state: Checkpoint) -> None:
        """Continue from ``state``."""
        self.network.load_arrays(state)
        with torch.no_grad():
            self._parameters.copy_(torch.tensor(state["table"]))
        self._adam.load_arrays(state)
        self._iteration = int(state["iteration"])
        self._note("Adam" if self._iteration <= self.config.iterations else "L-BFGS")


def _draw_test(count: int, share: float, seed: int) -> Mask:
    """(count,) which instants are kept out; the first one stays in, as Ψ_R looks at it."""
    test = np.zeros(count, dtype=bool)
    drawn = np.random.default_rng(seed).permutation(np.arange(1, count))
    test[drawn[: round(share * count)]] = True
    return test
