"""What both training recipes have in common: the data as tensors, and the shape of a training."""

from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from accpinn.methods.fit import Outcome, Progress
from accpinn.methods.pinn.config import PinnConfig
from accpinn.methods.pinn.loss import LossTerms, loss_terms
from accpinn.methods.pinn.output_layout import stack_outputs
from accpinn.methods.pinn.warm_start import WarmStart
from accpinn.model.cthp import Case, PlatoonSolution
from accpinn.segment.segment import Segment
from accpinn.units import FloatArray

Checkpoint = dict[str, NDArray[np.generic]]
"""Everything a training needs to go on, by name, as plain arrays."""


@dataclass(frozen=True, eq=False)
class Problem:
    """What is to be learned: a segment, the case and the settings."""

    segment: Segment
    case: Case
    config: PinnConfig
    time: FloatArray = field(init=False)
    """(N,) in s."""
    measured: FloatArray = field(init=False)
    """(N, 2M+1) the data in the order of the network's outputs."""
    counted: Tensor | None = field(init=False)
    """(N, M) 1 where the law's equation counts, else 0; None where it does throughout."""

    def __post_init__(self) -> None:
        """Arrange the data once."""
        object.__setattr__(self, "time", np.asarray(self.segment.time))
        stacked = stack_outputs(self.segment.speeds, self.segment.gaps)
        object.__setattr__(self, "measured", stacked)
        mask = self.segment.mask
        counted = None if mask is None else torch.from_numpy(mask.astype(float))
        object.__setattr__(self, "counted", counted)

    @property
    def followers(self) -> int:
        """M."""
        return self.segment.followers

    def evaluate(self, outputs: Tensor, rates: Tensor, theta: FloatArray) -> LossTerms:
        """Ψ over all instants of outputs and rates (N, 2M+1) with parameters θ (M, 3)."""
        measured = torch.from_numpy(self.measured)
        law = torch.from_numpy(theta)
        return loss_terms(outputs, rates, measured, law, self.config, self.counted)

    def progress(
        self, phase: str, iteration: int, terms: LossTerms, parameters: FloatArray, planned: int
    ) -> Progress:
        """A moment of the training; ``parameters`` (M, 3) or (1, 3) as α, β, τ."""
        return Progress(
            phase=phase,
            iteration=iteration,
            iterations=planned,
            seconds=0.0,
            total=float(terms.total.detach()),
            data=float(terms.data.detach()),
            physics=float(terms.physics.detach()),
            initial=float(terms.initial.detach()),
            parameters=parameters[:1] if self.case == "I" else parameters,
        )


@dataclass(frozen=True, eq=False)
class Learned:
    """What a training has learned so far."""

    outputs: FloatArray
    """(N, 2M+1) the surrogate on all instants."""
    solution: PlatoonSolution
    """The parameters within the rational driving constraints, and what they would be without."""
    loss: dict[str, float]
    network_weights: int
    arrays: dict[str, FloatArray]
    """The network."""
    notes: tuple[str, ...]


class Training(Protocol):
    """A recipe at work: `advance` in small steps, look at `progress`, stop at any moment."""

    problem: Problem
    progress: Progress
    """The present moment; its seconds are left to whoever drives the training."""
    outcome: Outcome | None
    """None while there is more to do."""

    def begin_from(self, warm: WarmStart) -> None:
        """Begin at an earlier fit's weights and parameters; called before anything else.

        Raises:
            ConfigError: when they are another network's.
        """

    def advance(self) -> None:
        """Do a fraction of a second's work."""

    def state(self) -> Checkpoint:
        """Everything needed to go on from here in another process."""

    def restore(self, state: Checkpoint) -> None:
        """Go on from ``state``, which a training of the same problem gave."""

    def learned(self) -> Learned:
        """The present surrogate and parameters."""


def as_table(theta: FloatArray) -> FloatArray:
    """(M, 3) linear α, ατ, β to α, β, τ; τ is nan where α = 0."""
    alpha, alpha_tau, beta = theta.T
    tau = np.divide(alpha_tau, alpha, out=np.full_like(alpha, np.nan), where=alpha > 0)
    return np.stack([alpha, beta, tau], 1)


def from_table(table: FloatArray) -> FloatArray:
    """(M, 3) α, β, τ to linear α, ατ, β."""
    alpha, beta, tau = table.T
    return np.stack([alpha, alpha * tau, beta], 1)
