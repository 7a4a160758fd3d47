"""What both presets have in common: the data as tensors, and the interface of a training."""

from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import torch
from torch import Tensor

from accpinn.methods.fit import MethodFinding, Outcome
from accpinn.methods.history import Checkpoint, Progress
from accpinn.methods.pinn.config import PinnConfig
from accpinn.methods.pinn.loss import LossTerms, loss_terms
from accpinn.methods.pinn.method import WarmStart
from accpinn.methods.pinn.surrogate import stack_outputs
from accpinn.methods.regression import Solution
from accpinn.model.cthp import Case, Parameters
from accpinn.segment.segment import Segment
from accpinn.units import FloatArray


@dataclass(frozen=True, eq=False)
class Problem:
    """What is to be learned: a segment, the case and the settings."""

    segment: Segment
    case: Case
    config: PinnConfig

    @property
    def time(self) -> FloatArray:
        """(N,) in s."""
        return self.segment.time

    @cached_property
    def measured(self) -> FloatArray:
        """(N, 2M+1) the data in the order of the network's outputs."""
        return stack_outputs(self.segment.speeds, self.segment.gaps)

    @cached_property
    def mask(self) -> Tensor | None:
        """(N, M) 1 where the residual of dv/dt counts, else 0; None where it does throughout."""
        mask = self.segment.mask
        return None if mask is None else torch.from_numpy(mask.astype(float))

    @property
    def followers(self) -> int:
        """M."""
        return self.segment.followers

    def evaluate(self, outputs: Tensor, rates: Tensor, theta: FloatArray) -> LossTerms:
        """Ψ over all instants of outputs and rates (N, 2M+1) with θ (M, 3)."""
        measured, fixed = torch.from_numpy(self.measured), torch.tensor(theta)
        return loss_terms(outputs, rates, measured, fixed, self.config, self.mask)

    def progress(
        self, phase: str, iteration: int, terms: LossTerms, parameters: Parameters, planned: int
    ) -> Progress:
        """A moment of the training; its seconds are left to whoever drives it.

        Args:
            phase: what runs.
            iteration: how many are done.
            terms: Ψ.
            parameters: (M,) or (1,)
            planned: iterations at most.
        """
        return Progress(
            phase=phase,
            iteration=iteration,
            iterations=planned,
            seconds=0.0,
            **terms.values(),
            parameters=parameters[:1] if self.case == "I" else parameters,
        )


@dataclass(frozen=True, eq=False)
class Learned:
    """The present result of a training."""

    outputs: FloatArray
    """(N, 2M+1) the surrogate on all instants."""
    solution: Solution
    """The parameters within the rational driving constraints, and what they would be without."""
    loss: dict[str, float]
    network_weights: int
    arrays: dict[str, FloatArray]
    """The network."""
    findings: tuple[MethodFinding, ...]


class Training(Protocol):
    """A preset at work: `advance` in small steps, look at `progress`, stop at any moment."""

    problem: Problem
    progress: Progress
    """The present moment; its seconds are left to whoever drives the training."""
    outcome: Outcome | None
    """None while there is more to do."""

    def begin_from(self, warm: WarmStart) -> None:
        """Begin at an earlier fit's weights and parameters; called before anything else.

        Raises:
            ValueError: when they are another network's.
        """

    def advance(self) -> None:
        """Do a fraction of a second's work."""

    def state(self) -> Checkpoint:
        """Everything needed to go on from here in another process."""

    def restore(self, state: Checkpoint) -> None:
        """Go on from ``state``, which a training of the same problem gave."""

    def learned(self) -> Learned:
        """The present surrogate and parameters."""
