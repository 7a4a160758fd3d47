"""The `paper` preset: everything by gradient, as Apostolakis and Ampountolas (2024) train.

Raw time in seconds goes in, the full training set is used in every iteration, all in double
precision; network weights and (α, β, τ) are learned together by Adam, then, if asked for, by
L-BFGS. The time derivative is the exact tangent of `network`, not nested differentiation: the
mathematics is the same, an iteration costs less.

After each iteration α, β and τ are clipped at zero, the rational driving constraints.
"""

import numpy as np
import torch
from torch import Tensor

from accpinn.mask import Mask
from accpinn.methods.fit import HoldoutLoss, Outcome
from accpinn.methods.history import Checkpoint
from accpinn.methods.pinn.loss import LossTerms, loss_terms
from accpinn.methods.pinn.method import WarmStart
from accpinn.methods.pinn.network import Adam, PaperNetwork, count_weights, load_state, state_of
from accpinn.methods.pinn.protocol import Learned, Problem
from accpinn.methods.pinn.surrogate import output_columns
from accpinn.methods.regression import Regression, Solution
from accpinn.model.cthp import Parameters
from accpinn.units import FloatArray

CHUNK = 5
"""Iterations per `advance`: some tens of milliseconds, so that a stop is felt at once."""


class PaperTraining:
    """See the module's head; one `advance` is `CHUNK` iterations."""

    def __init__(self, problem: Problem) -> None:
        """Build network, parameters and the split into training and test instants."""
        self.problem = problem
        config = problem.config
        self.network = PaperNetwork(problem.followers, config.seed)
        sets = 1 if problem.case == "I" else problem.followers
        initial = np.tile(config.initial.values, (sets, 1))
        self._parameters = torch.tensor(initial, requires_grad=True)  # (sets, 3) α, β, τ
        self._unknowns = [*self.network.parameters(), self._parameters]
        self._adam = Adam(self._unknowns)
        self._second_order: torch.optim.LBFGS | None = None
        self._test = _draw_test(len(problem.time), config.test_share, config.seed)
        self._time = torch.tensor(problem.time)
        self._train_time = torch.from_numpy(problem.time[~self._test])
        self._train_data = torch.from_numpy(problem.measured[~self._test])
        mask = problem.mask
        self._train_mask = None if mask is None else mask[torch.from_numpy(~self._test)]
        self._iteration = 0
        self._planned = config.iterations + config.lbfgs_iterations
        with torch.no_grad():
            self._look("Adam", self._loss())
        self.outcome = self._end()

    def begin_from(self, warm: WarmStart) -> None:
        """Begin anew, from what an earlier training has learned."""
        initial = warm.initial(self.problem.case, self.problem.followers)
        load_state(self.network, warm.arrays, "network.")
        with torch.no_grad():
            self._parameters.copy_(torch.tensor(initial.values))
            self._look("Adam", self._loss())
        self.outcome = self._end()

    def advance(self) -> None:
        """`CHUNK` iterations, or as many as are left of the present phase."""
        config = self.problem.config
        left = config.iterations - self._iteration
        if left > 0:
            terms = self._descend(min(CHUNK, left))
            self._look("Adam", terms)
        else:
            terms = self._lbfgs(min(CHUNK, self._planned - self._iteration))
            self._look("L-BFGS", terms)
        self.outcome = self._end()

    def _end(self) -> Outcome | None:
        """How the training has ended, if it has."""
        if not np.isfinite(self.progress.total):
            return Outcome.DIVERGED
        return Outcome.FINISHED if self._iteration >= self._planned else None

    def _descend(self, iterations: int) -> LossTerms:
        """Adam; the terms are those before the last step, as they come with its gradient."""
        for _ in range(iterations):
            terms = self._loss()
            terms.total.backward()
            self._adam.step(self.problem.config.learning_rate)
            self._clip()
        self._iteration += iterations
        return terms

    def _lbfgs(self, iterations: int) -> LossTerms:
        optimiser = self._second_order or torch.optim.LBFGS(
            self._unknowns, max_eval=1000, history_size=50, line_search_fn="strong_wolfe"
        )
        optimiser.param_groups[0]["max_iter"] = iterations
        self._second_order = optimiser

        def closure() -> Tensor:
            optimiser.zero_grad()
            total = self._loss().total
            total.backward()
            return total

        optimiser.step(closure)
        self._clip()
        self._iteration += iterations
        with torch.no_grad():
            return self._loss()

    def _clip(self) -> None:
        with torch.no_grad():
            self._parameters.clamp_(min=0.0)

    def _theta(self) -> Tensor:
        """(M, 3) α, ατ, β of the present parameters, also where a line search tries some < 0."""
        alpha, beta, tau = self._parameters.clamp(min=0.0).expand(self.problem.followers, 3).T
        return torch.stack([alpha, alpha * tau, beta], 1)

    def _loss(self) -> LossTerms:
        outputs, rates = self.network(self._train_time)
        data, mask = self._train_data, self._train_mask
        return loss_terms(outputs, rates, data, self._theta(), self.problem.config, mask)

    def _look(self, phase: str, terms: LossTerms) -> None:
        now = Parameters.of(self._parameters.detach().numpy())
        self.progress = self.problem.progress(phase, self._iteration, terms, now, self._planned)

    @torch.no_grad()
    def learned(self) -> Learned:
        """The surrogate on all instants, the parameters, and the losses on both parts."""
        outputs, rates = self.network(self._time)
        loss = self._loss_at(~self._test, outputs, rates).values()
        arrays = state_of(self.network, "network.")
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
            network_weights=count_weights(self.network),
            arrays=arrays,
            findings=findings,
        )

    def _loss_at(self, instants: Mask, outputs: Tensor, rates: Tensor) -> LossTerms:
        rows = torch.from_numpy(instants)
        measured = torch.from_numpy(self.problem.measured)[rows]
        mask, config = self.problem.mask, self.problem.config
        mask = None if mask is None else mask[rows]
        return loss_terms(outputs[rows], rates[rows], measured, self._theta(), config, mask)

    def _solution(self, outputs: FloatArray, rates: FloatArray) -> Solution:
        """The learned parameters; where one was clipped, least squares on the surrogate beside."""
        theta = self._theta().detach().numpy()
        active = theta == 0
        if not active.any() or not np.isfinite(rates).all():
            return Solution(theta, theta, active)
        speeds, gaps = output_columns(self.problem.followers)
        motion = outputs[:, speeds], outputs[:, gaps], rates[:, speeds[1:]]
        free = Regression.of_motion(*motion, self.problem.segment.mask).solve(self.problem.case)
        return Solution(theta, free.unconstrained, active)

    def state(self) -> Checkpoint:
        """Network, parameters and Adam's moments; L-BFGS begins its curvature anew."""
        state = state_of(self.network, "network.") | self._adam.state()
        state["table"] = self._parameters.detach().numpy()
        state["iteration"] = np.array(self._iteration)
        return state

    def restore(self, state: Checkpoint) -> None:
        """Go on from ``state``."""
        load_state(self.network, state, "network.")
        with torch.no_grad():
            self._parameters.copy_(torch.from_numpy(np.array(state["table"])))
        self._adam.restore(state)
        self._iteration = int(state["iteration"])
        with torch.no_grad():
            adam = self._iteration <= self.problem.config.iterations
            self._look("Adam" if adam else "L-BFGS", self._loss())
        self.outcome = self._end()


def _draw_test(count: int, share: float, seed: int) -> Mask:
    """(count,) which instants are kept out; the first one stays in, as Ψ_R looks at it."""
    test = np.zeros(count, dtype=bool)
    drawn = np.random.default_rng(seed).permutation(np.arange(1, count))
    test[drawn[: round(share * count)]] = True
    return test
