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

from accpinn.methods.fit import Checkpoint, HoldoutLoss, Outcome
from accpinn.methods.pinn.config import PinnConfig
from accpinn.methods.pinn.loss import Learned, LossTerms, Training, loss_terms
from accpinn.methods.pinn.method import WarmStart, output_columns
from accpinn.methods.pinn.network import Adam, PaperNetwork, count_weights, load_state, state_of
from accpinn.methods.regression import Regression, Solution
from accpinn.model.cthp import Case, Parameters
from accpinn.segment.segment import Segment
from accpinn.units import FloatArray, Mask

CHUNK = 5
"""Iterations per `advance`: some tens of milliseconds, so that a stop is felt at once."""


class PaperTraining(Training):
    """See the module's head; one `advance` is `CHUNK` iterations."""

    def __init__(self, segment: Segment, case: Case, config: PinnConfig) -> None:
        """Build network, parameters and the split into training and test instants."""
        super().__init__(segment, case, config)
        self.network = PaperNetwork(self.followers, config.hidden, config.seed)
        sets = 1 if case == "I" else self.followers
        initial = np.tile(config.initial.values, (sets, 1))
        self._parameters = torch.tensor(initial, requires_grad=True)  # (sets, 3) α, β, τ
        self._unknowns = [*self.network.parameters(), self._parameters]
        self._adam = Adam(self._unknowns)
        self._second_order: torch.optim.LBFGS | None = None
        self._test = _draw_test(segment.samples, config.test_share, config.seed)
        self._time = torch.tensor(segment.time)
        train = torch.from_numpy(~self._test)
        self._train_time, self._train_data = self._time[train], self.measured[train]
        self._train_mask = None if self.mask is None else self.mask[train]
        self._iteration = 0
        self._note("Adam")

    def begin_from(self, warm: WarmStart) -> None:
        """Begin anew, from what an earlier training has learned."""
        initial = warm.initial(self.case, self.followers)
        load_state(self.network, warm.arrays, "network.")
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
            self._adam.step(self.config.learning_rate)
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
            total = self._loss().total
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
        outputs, rates = self.network(self._train_time)
        data, mask = self._train_data, self._train_mask
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
        mask = None if self.mask is None else self.mask[rows]
        parts = outputs[rows], rates[rows], self.measured[rows]
        return loss_terms(*parts, self._theta(), self.config, mask)

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
        self._note("Adam" if self._iteration <= self.config.iterations else "L-BFGS")


def _draw_test(count: int, share: float, seed: int) -> Mask:
    """(count,) which instants are kept out; the first one stays in, as Ψ_R looks at it."""
    test = np.zeros(count, dtype=bool)
    drawn = np.random.default_rng(seed).permutation(np.arange(1, count))
    test[drawn[: round(share * count)]] = True
    return test
