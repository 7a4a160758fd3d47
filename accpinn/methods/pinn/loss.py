"""The PiNN's loss Ψ = Ψ_F + Ψ_R + Ψ_D of a surrogate, and the base of the trainings that lower it.

    Ψ_F = 1/(|T| M) Σ_i Σ_t  Q₁ (dp̂_i - v̂_{i-1} + v̂_i)²
                           + Q₂ (dv̂_i - α_i(p̂_i - τ_i v̂_i) - β_i(v̂_{i-1} - v̂_i))²
    Ψ_D = 1/(|T| M) Σ_t  [ S₂ (v_0 - v̂_0)² + Σ_i S₁ (p_i - p̂_i)² + S₂ (v_i - v̂_i)² ]
    Ψ_R = R/M Σ_i (p_i - p̂_i)² + (v_i - v̂_i)²   at the first instant

At masked instants the term with Q₂ is zero; |T| counts all instants.

Source: Apostolakis and Ampountolas 2024, section V.B, extended there from M = 1; the leader's
term stands inside the same average, which reproduces the paper's Tables II and III.

With another model than the CTHP its acceleration f(p̂, v̂, û; θ) stands in the term with Q₂:

    dv̂/dt - f;   behind a lag  λ d²v̂/dt² + dv̂/dt - f;   behind a delay  dv̂/dt(t) - f(t - d)

With a delay the instants of the first `DELAY.upper` seconds have no such residual, as f(t - d) may
lie before the window. The formulas serve numpy's arrays and torch's tensors alike.

Of windows w = 1..K each has its own surrogate, and θ is shared,

    Ψ = Σ_w n_w Ψ_w / Σ_w n_w,    n_w the number of instants
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib import import_module
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple, Self, TypeVar

import numpy as np

from accpinn.methods import Segments
from accpinn.methods.estimate import Checkpoint, Estimate, Outcome, Progress
from accpinn.methods.pinn.config import PinnConfig
from accpinn.methods.regression import Solution
from accpinn.model.cthp import Case, Parameters, Trajectories
from accpinn.model.following import DELAY, FollowingModel
from accpinn.model.spec import ModelSpec
from accpinn.segment import Segment
from accpinn.units import FloatArray, Mask

if TYPE_CHECKING:
    from torch import Tensor

Array = TypeVar("Array", FloatArray, "Tensor")


def library_of(values: Any) -> Any:
    """The module of an array's functions: numpy, or torch for its tensors."""
    return np if isinstance(values, np.ndarray) else import_module("torch")


def output_columns(followers: int) -> tuple[list[int], list[int]]:
    """Columns of speeds (M+1) and space-gaps (M) among the outputs v_0, v_1, p_1, v_2, p_2, .."""
    return [0, *range(1, 2 * followers, 2)], list(range(2, 2 * followers + 1, 2))


def command_columns(followers: int) -> list[list[int]]:
    """(3, M) where gaps, own speeds and speeds ahead, of which f is a function, stand."""
    speeds, gaps = output_columns(followers)
    return [gaps, speeds[1:], speeds[:-1]]


def trajectories(time: FloatArray, outputs: FloatArray) -> Trajectories:
    """Outputs (N, 2M+1) at instants (N,) in s as speeds and gaps."""
    speeds, gaps = output_columns(outputs.shape[1] // 2)
    return Trajectories(time, outputs[:, speeds], outputs[:, gaps])


def stack_outputs(speeds: FloatArray, gaps: FloatArray) -> FloatArray:
    """(N, M+1) speeds and (N, M) gaps as (N, 2M+1) in the order of `output_columns`."""
    followers = gaps.shape[1]
    stacked = np.empty((len(gaps), 2 * followers + 1))
    speed_columns, gap_columns = output_columns(followers)
    stacked[:, speed_columns], stacked[:, gap_columns] = speeds, gaps
    return stacked


def shares_of(counts: Sequence[int]) -> tuple[float, ...]:
    """(K,) each window's share of the instants of all; exactly 1 of a single one."""
    return tuple(count / sum(counts) for count in counts)


def weighted_sum(parts: Sequence[Any], shares: Sequence[float]) -> Any:
    """The sum over windows (K,) of what each has, by its share."""
    return sum(share * part for share, part in zip(shares, parts, strict=True))


class Motion(NamedTuple):
    """A surrogate at N instants, as far as the loss looks at it."""

    outputs: Any
    """(N, 2M+1) in m and m/s, in the order of `output_columns`."""
    rates: Any
    """(N, 2M+1) their time derivative."""
    bends: Any = None
    """(N, 2M+1) their second time derivative, for a model with a lag."""
    earlier: Any = None
    """(3, N, M) gap, own speed and speed ahead at t - d, for a model with a delay."""
    earlier_rates: Any = None
    """(3, N, M) their time derivative, where d is not moved by gradient."""

    def with_earlier(self, network: Callable[..., Any], time: Any, delays: Any) -> "Motion":
        """The motion with a network's outputs a delay d (M,) before the instants (N,), from 0 on.

        All are arrays, or all are tensors.
        """
        places = zip(delays, np.transpose(command_columns(len(delays))), strict=True)
        parts = [network((time - d).clip(min=0.0), 0)[0][:, columns] for d, columns in places]
        return self._replace(earlier=library_of(time).stack(parts, 2).swapaxes(0, 1))

    @property
    def commanding(self) -> Any:
        """(3, N, M) gap, own speed and speed ahead, of which the command is a function."""
        if self.earlier is not None:
            return self.earlier
        columns = command_columns(self.outputs.shape[1] // 2)
        return [self.outputs[:, group] for group in columns]


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

    @classmethod
    def mean(cls, parts: Sequence[Self], shares: Sequence[float]) -> Self:
        """The terms of all windows (K,) from those of each and its share of the instants."""
        names = ("data", "physics", "initial")
        return cls(*(weighted_sum([getattr(part, n) for part in parts], shares) for n in names))

    def values(self) -> dict[str, float]:
        """Ψ and its terms by name."""
        names = ("total", "data", "physics", "initial")
        return {name: float(getattr(self, name)) for name in names}


def loss_terms(
    motion: Motion,
    measured: Array,
    theta: Array,
    config: PinnConfig,
    mask: Array | None = None,
    model: FollowingModel | None = None,
    lags: Any = 0.0,
) -> LossTerms:
    """Ψ of a surrogate; the first row must be the first instant where Ψ_R is used.

    Args:
        motion: the surrogate at N instants.
        measured: (N, 2M+1) the data, in the order of `output_columns`.
        theta: (M, 3) α, ατ, β per follower, or (n, M) the parameters of another model.
        config: holds the weights Q, R, S.
        mask: (N, M) 1 where the residual of dv/dt counts, else 0; None where it does throughout.
        model: the model, unless it is the CTHP with α, ατ, β.
        lags: (M,) λ of that CTHP; all others have theirs among their parameters.
    """
    own_columns = output_columns(motion.outputs.shape[1] // 2)[0][1:]
    gap, speed, ahead = motion.commanding
    if model is None:
        alpha, alpha_tau, beta = theta.T
        command = alpha * gap - alpha_tau * speed + beta * (ahead - speed)
    else:
        command = model.acceleration(gap, speed, ahead, theta, library_of(motion.outputs))
        lags = model.term(theta, "lag")
    residual = motion.rates[:, own_columns] - command
    if motion.bends is not None:
        residual = residual + lags * motion.bends[:, own_columns]
    return weighted_terms(motion, residual, measured, config, mask)


def weighted_terms(
    motion: Motion,
    residual: Array,
    measured: Array,
    config: PinnConfig,
    mask: Array | None = None,
) -> LossTerms:
    """Ψ of a surrogate whose residual (N, M) of dv/dt is known; for all others see `loss_terms`."""
    outputs, rates = motion.outputs, motion.rates
    count, followers = len(outputs), outputs.shape[1] // 2
    speed_columns, gap_columns = output_columns(followers)
    speeds = outputs[:, speed_columns]
    gap_rate = rates[:, gap_columns] - (speeds[:, :-1] - speeds[:, 1:])
    if mask is not None:
        residual = residual * mask
    error = outputs - measured
    gap, speed = error[:, gap_columns], error[:, speed_columns]

    (q_gap, q_speed), (s_gap, s_speed) = config.weight_physics, config.weight_data
    scale = 1.0 / (count * followers)
    physics = scale * (q_gap * _square(gap_rate) + q_speed * _square(residual))
    data = scale * (s_gap * _square(gap) + s_speed * _square(speed))
    at_start = _square(gap[0]) + _square(speed[0, 1:])
    return LossTerms(data, physics, config.weight_initial / followers * at_start)


def _square(values: Any) -> Any:
    return (values * values).sum()


def has_earlier(segment: Segment) -> Mask:
    """(N, M) where the acceleration counts in a model with a delay; see the module's head."""
    late = np.tile(segment.time[:, None] >= DELAY.upper, segment.followers)
    return late if segment.mask is None else segment.mask & late


@dataclass(frozen=True, eq=False)
class WindowData:
    """The data of a window, as the loss takes them."""

    segment: Segment
    measured: FloatArray
    """(N, 2M+1) in the order of `output_columns`."""
    mask: FloatArray | None
    """(N, M) 1 where the residual of dv/dt counts, else 0; None where it does throughout."""


class Training(ABC):
    """A preset at work: `advance` in small steps, look at `progress`, stop at any moment."""

    progress: Progress
    """The present moment, a new object whenever it has moved on; its seconds are left to whoever
    drives the training."""
    outcome: Outcome | None
    """None while there is more to do."""
    has_checkpoints: ClassVar[bool] = False
    """Whether `state` and `restore` let it continue in another process."""

    def __init__(self, segments: Segments, case: Case, config: PinnConfig, spec: ModelSpec) -> None:
        """Keep what is asked: windows (K,) of M followers."""
        self.segments, self.case, self.config, self.spec = segments, case, config, spec
        self.followers = segments[0].followers
        self.planned = config.iterations + config.lbfgs_iterations

    @abstractmethod
    def advance(self) -> None:
        """Do a fraction of a second's work."""

    @abstractmethod
    def curves(self) -> Trajectories:
        """The present motion in the first window, on all its instants."""

    @abstractmethod
    def estimate(self) -> Estimate:
        """The present parameters and the curves of all windows, without history and seconds."""

    def point(self) -> Estimate | None:
        """The estimate without what takes time to draw; None where nothing does."""
        return None

    def state(self) -> Checkpoint:
        """Everything needed to continue from here in another process."""
        raise NotImplementedError

    def restore(self, state: Checkpoint) -> None:
        """Continue from ``state``, which a training of the same problem gave."""
        raise NotImplementedError


class LossTraining(Training):
    """A training that lowers Ψ."""

    model: FollowingModel | None = None
    """The model in the loss; None for the CTHP, in whose parameters Ψ is quadratic."""

    def __init__(self, segments: Segments, case: Case, config: PinnConfig, spec: ModelSpec) -> None:
        """Take the windows' data as arrays."""
        super().__init__(segments, case, config, spec)
        self.terms = self.model.terms if self.model else ()
        self.order = 2 if "lag" in self.terms else 1  # of the highest derivative in the residuals
        is_delayed = "delay" in self.terms
        masks = [has_earlier(s) if is_delayed else s.mask for s in segments]
        self.windows = tuple(
            WindowData(
                segment,
                stack_outputs(segment.speeds, segment.gaps),
                None if mask is None else mask.astype(float),
            )
            for segment, mask in zip(segments, masks, strict=True)
        )
        self.shares = shares_of([segment.samples for segment in segments])

    def _estimate(
        self, solution: Solution | Parameters, curves: Sequence[Trajectories], **others: Any
    ) -> Estimate:
        """The estimate so far, of a solution (M, 3) or parameters (M,); see `Estimate.of`."""
        return Estimate.of(
            "pinn",
            self.segments,
            self.case,
            self.spec,
            solution,
            curves=tuple(curves),
            outcome=self.outcome or Outcome.STOPPED,
            settings=self.config.to_json(),
            iterations=self.progress.iteration,
            **others,
        )

    def _look(
        self,
        phase: str,
        iteration: int,
        terms: LossTerms,
        parameters: Parameters,
        expected: int | None = None,
    ) -> None:
        """Note the present moment, with parameters (M,) or (1,), and see if it is the last one.

        The phase is ``expected`` to end at an iteration, by default at the last that is planned.
        """
        self.progress = Progress(
            phase=phase,
            iteration=iteration,
            iterations=self.planned if expected is None else min(expected, self.planned),
            seconds=0.0,
            total=float(terms.total),
            data=float(terms.data),
            physics=float(terms.physics),
            initial=float(terms.initial),
            parameters=parameters[:1] if self.case == "I" else parameters,
        )
        self.outcome = Outcome.FINISHED if iteration >= self.planned else None
        if not np.isfinite(self.progress.total):
            self.outcome = Outcome.DIVERGED
