"""The PiNN's loss Ψ = Ψ_F + Ψ_R + Ψ_D of a surrogate, and the base of the trainings that lower it.

    Ψ_F = 1/(|T| M) Σ_i Σ_t  Q₁ (dp̂_i - v̂_{i-1} + v̂_i)²
                           + Q₂ (dv̂_i - α_i(p̂_i - τ_i v̂_i) - β_i(v̂_{i-1} - v̂_i))²
    Ψ_D = 1/(|T| M) Σ_t  [ S₂ (v_0 - v̂_0)² + Σ_i S₁ (p_i - p̂_i)² + S₂ (v_i - v̂_i)² ]
    Ψ_R = R/M Σ_i (p_i - p̂_i)² + (v_i - v̂_i)²   at the first instant

At masked instants the term with Q₂ is zero; |T| counts all instants.

Source: Apostolakis and Ampountolas 2024, section V.B, extended there from M = 1; the leader's
term stands inside the same average, which reproduces the paper's Tables II and III.

The formulas serve numpy's arrays and, for the preset `paper`, torch's tensors alike.
"""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Generic, NamedTuple, TypeVar

from accpinn.methods.fit import (
    Checkpoint,
    HiddenLayersGain,
    IterationsExhausted,
    MethodFinding,
    Outcome,
    Progress,
)
from accpinn.methods.pinn.config import PinnConfig
from accpinn.methods.pinn.network import output_columns, stack_outputs
from accpinn.methods.pinn.request import WarmStart
from accpinn.methods.regression import Solution
from accpinn.model.cthp import Case, Parameters
from accpinn.segment.segment import Segment
from accpinn.units import FloatArray

if TYPE_CHECKING:
    from torch import Tensor

Array = TypeVar("Array", FloatArray, "Tensor")


@dataclass(frozen=True)
class LossTerms:
    """The three terms of Ψ, weighted: numbers, or tensors of one."""

    data: Any
    physics: Any
    initial: Any

    @property
    def total(self) -> Any:
        """Ψ."""
        return self.data + self.physics + self.initial

    def values(self) -> dict[str, float]:
        """Ψ and its terms by name."""
        names = ("total", "data", "physics", "initial")
        return {name: float(getattr(self, name)) for name in names}


def loss_terms(
    outputs: Array,
    rates: Array,
    measured: Array,
    theta: Array,
    config: PinnConfig,
    mask: Array | None = None,
) -> LossTerms:
    """Ψ of a surrogate; the first row must be the first instant where Ψ_R is used.

    Args:
        outputs: (N, 2M+1) in m and m/s, in the order of `output_columns`.
        rates: (N, 2M+1) their time derivative.
        measured: (N, 2M+1) the data, in the same order.
        theta: (M, 3) α, ατ, β per follower.
        config: holds the weights Q, R, S.
        mask: (N, M) 1 where the residual of dv/dt counts, else 0; None where it does throughout.
    """
    count, followers = len(outputs), theta.shape[0]
    found = residuals(outputs, rates, measured, theta, mask)
    q_gap, q_speed = config.weight_physics
    s_gap, s_speed = config.weight_data
    scale = 1.0 / (count * followers)
    physics = scale * (q_gap * _square(found.gap_rate) + q_speed * _square(found.speed_rate))
    data = scale * (s_gap * _square(found.gap) + s_speed * _square(found.speed))
    at_start = _square(found.gap[0]) + _square(found.speed[0, 1:])
    return LossTerms(data, physics, config.weight_initial / followers * at_start)


class Residuals(NamedTuple, Generic[Array]):
    """What Ψ squares; linear in outputs, rates and data together."""

    gap_rate: Array
    """(N, M) of dp/dt, in m/s."""
    speed_rate: Array
    """(N, M) of dv/dt, in m/s²."""
    gap: Array
    """(N, M) in m."""
    speed: Array
    """(N, M+1) in m/s."""


def residuals(
    outputs: Array, rates: Array, measured: Array, theta: Array, mask: Array | None = None
) -> Residuals[Array]:
    """The residuals of a surrogate; arguments as of `loss_terms`."""
    speed_columns, gap_columns = output_columns(theta.shape[0])
    speeds, gaps = outputs[:, speed_columns], outputs[:, gap_columns]
    ahead, own = speeds[:, :-1], speeds[:, 1:]
    relative = ahead - own
    alpha, alpha_tau, beta = theta.T

    model = alpha * gaps - alpha_tau * own + beta * relative
    speed_residual = rates[:, speed_columns[1:]] - model
    if mask is not None:
        speed_residual = speed_residual * mask
    error = outputs - measured
    return Residuals(
        rates[:, gap_columns] - relative,
        speed_residual,
        error[:, gap_columns],
        error[:, speed_columns],
    )


def _square(values: Any) -> Any:
    return (values * values).sum()


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


class Training(ABC):
    """A preset at work: `advance` in small steps, look at `progress`, stop at any moment."""

    progress: Progress
    """The present moment; its seconds are left to whoever drives the training."""
    outcome: Outcome | None
    """None while there is more to do."""

    def __init__(self, segment: Segment, case: Case, config: PinnConfig, threads: int = 1) -> None:
        """The data as arrays; M followers, N instants."""
        self.segment, self.case, self.config = segment, case, config
        self.followers, self.threads = segment.followers, threads
        self.planned = config.iterations + config.lbfgs_iterations
        self.measured = stack_outputs(segment.speeds, segment.gaps)
        self.mask = None if segment.mask is None else segment.mask.astype(float)

    @abstractmethod
    def begin_from(self, warm: WarmStart) -> None:
        """Begin at an earlier fit's weights and parameters; called before anything else.

        Raises:
            ValueError: when they are another network's.
        """

    @abstractmethod
    def advance(self) -> None:
        """Do a fraction of a second's work."""

    @abstractmethod
    def state(self) -> Checkpoint:
        """Everything needed to go on from here in another process."""

    @abstractmethod
    def restore(self, state: Checkpoint) -> None:
        """Go on from ``state``, which a training of the same problem gave."""

    @abstractmethod
    def outputs(self) -> FloatArray | None:
        """(N, 2M+1) the present surrogate on all instants; None where there is none yet."""

    @abstractmethod
    def learned(self) -> Learned:
        """The present surrogate and parameters."""

    def _training_findings(self, start: float) -> tuple[MethodFinding, ...]:
        """What the hidden layers gained since Ψ was ``start``, and whether iterations ran out."""
        now, found = self.progress, list[MethodFinding]()
        if now.phase == "Adam" and start > 0:
            found.append(HiddenLayersGain(start, now.total))
        if self.outcome is Outcome.FINISHED:
            found.append(IterationsExhausted(now.iteration))
        return tuple(found)

    def _look(
        self,
        phase: str,
        iteration: int,
        terms: LossTerms,
        parameters: Parameters,
        evidence: float = 0.0,
        deviations: FloatArray | None = None,
    ) -> None:
        """Note the present moment, with parameters (M,) or (1,), and see `Progress`."""
        self.progress = Progress(
            phase=phase,
            iteration=iteration,
            iterations=self.planned,
            seconds=0.0,
            **terms.values(),
            parameters=parameters[:1] if self.case == "I" else parameters,
            evidence=evidence,
            deviations=deviations,
            surrogate=None,
        )
