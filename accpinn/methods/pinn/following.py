"""The preset `fast` with the residual of any car-following model in the loss.

The parameters are z, in standard deviations of their priors (see `model.following`), within the
model's bounds. Gauss-Newton steps in the output layer W and z together are taken, of

    ½ m M ln Ψ(W, z) + ½ |z|²,    m = duration / `MEMORY`

as `methods.simulation` has it for simulations, where W are the output layers of all windows, which
z alone links, and the duration is that of all. Near the present outputs a follower's residual is

    v̂' - f ≈ D w - c - F dz,    D = (-f_p Φ, Φ' - f_v Φ, -f_u Φ),    F = ∂f/∂z,

so w = w₀ + Y dz is the chain of `projection`, solved window by window for several right-hand sides,
and dz follows from the Schur complement, the curvature of the objective's profile. Gradients are of
all instants; DᵀD, DᵀF and FᵀF, which only steer the steps, are summed over some. Derivatives are
exact, by complex steps. A parameter whose deviation by that curvature exceeds `OPEN` of its prior's
is not determined.

A lag λ or a delay d between command f and acceleration adds

    lag      λ v̂'' + v̂' - f            D: λ Φ''                       F: -v̂''
    delay    v̂' - f(p̂, v̂, û at t - d)   D: f's slopes and Φ at t - d   F: -df/dt at t - d

As some tenths of a second are then sought, noise of the measurements is taken as independent from
sample to sample, so that the number of independent errors is

    m = Ψ / (Ψ_F / m_F + (Ψ - Ψ_F) / N),    m_F = duration / `MEMORY`

With m_F in its place the prior moved a lag of 0.8 s to 0.5 s in 300 s that obey the model. Without
the prior, lags and delays of real cars, whose residuals last, would end at their bounds.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from accpinn.methods import Segments
from accpinn.methods.estimate import Estimate
from accpinn.methods.findings import MethodFinding, Undetermined
from accpinn.methods.pinn.config import PinnConfig
from accpinn.methods.pinn.fast import FastTraining, Fitted, Optimum, Seen, Surrogate
from accpinn.methods.pinn.initial import initial_scores, values_of
from accpinn.methods.pinn.loss import Motion, command_columns, weighted_sum
from accpinn.methods.pinn.projection import data_moments, gap_blocks, solve_chain
from accpinn.methods.simulation import MEMORY, OPEN, bounded_step, bounds_of
from accpinn.model.cthp import Case, Parameters
from accpinn.model.following import COMPLEX_STEP, FollowingModel
from accpinn.model.registry import FOLLOWING
from accpinn.model.spec import ModelSpec
from accpinn.segment import median_speeds
from accpinn.units import FloatArray, Seconds

APART: Seconds = 0.3
"""Between instants over which D's squares are summed."""
SHORTENED = 6
"""Times that a step which does not lower the objective is halved."""


def thinned(count: int, every: int) -> tuple[NDArray[np.intp], FloatArray]:
    """Every so many of N instants with the last, and the instants each stands for in a sum.

    By the trapezoidal rule, which is all but exact for curves that are smooth from one to the next.
    """
    some = np.append(np.arange(0, count - 1, every), count - 1)
    counts = np.convolve(np.diff(some), [0.5, 0.5])
    counts[[0, -1]] += 0.5
    return some, counts


@dataclass(frozen=True, eq=False)
class Step:
    """The Gauss-Newton step of one window, by its output layer W and all z."""

    layers: FloatArray
    """(K, 2M+1, 1 + S n) w₀ and Y."""
    gradient: FloatArray
    """(S n,) of the profile of ½ M Ψ_w."""
    curvature: FloatArray
    """(S n, S n)"""


class FollowingFast(FastTraining):
    """`fast` for any model; what it solves for is z (S, n), S = 1 in Case I, M in Case II."""

    model: FollowingModel

    @np.errstate(all="ignore")
    def __init__(
        self, segments: Segments, case: Case, config: PinnConfig, threads: int, spec: ModelSpec
    ) -> None:
        """Begin at the user's initial values or at typical ones."""
        self.model = FOLLOWING[spec.model]
        self._bounds, self._speeds = bounds_of(self.model, spec.fixed), median_speeds(segments)
        self._places = np.array(command_columns(segments[0].followers))
        super().__init__(segments, case, config, threads, spec)

    def _initial(self) -> FloatArray:
        start = initial_scores(self.model, self.config, self._bounds)
        return np.tile(start, (1 if self.case == "I" else self.followers, 1))

    def _theta(self, solution: FloatArray) -> FloatArray:
        return values_of(self.model, solution, self.followers)

    def _parameters(self, solution: FloatArray) -> Parameters:
        return self.model.linearisations(self._theta(solution), self._speeds)

    def _move(self, now: FloatArray, before: FloatArray) -> float:
        """Largest change of z; behind a lag or a delay relative to positive parameters."""
        is_late = self.model.is_late
        shares = [p.spread if is_late and p.is_positive else 1.0 for p in self.model.parameters]
        return float((np.abs(now - before) * shares).max())

    def _output(
        self, window: Surrogate, seen: Seen, solution: FloatArray, near: FloatArray | None
    ) -> FloatArray:
        weights = self._smooth(seen) if near is None else near
        at = Fitted(seen, weights, self._motion(window, seen, weights))
        return self._linear(window, at, solution).layers[..., 0]

    def _smooth(self, seen: Seen) -> FloatArray:
        """The output layer of the curves that smooth the data, near which the first step is."""
        right = data_moments(seen.sums, self.config)[..., None]
        kinematic = gap_blocks(seen.sums, self.config)
        return solve_chain(seen.sums, lambda _: kinematic.copy(), right, self.config)[..., 0]

    def _seen(self, window: Surrogate, solution: FloatArray) -> Seen:
        seen = super()._seen(window, solution)
        whole = window.projection.seen(seen.hidden)
        return self._seen_with(window, replace(seen, whole=whole), solution)

    def _seen_with(self, window: Surrogate, seen: Seen, solution: FloatArray) -> Seen:
        """The inputs with Φ at t - d, where the model has a delay; at first that of t = 0."""
        if "delay" not in self.terms:
            return seen
        time = window.data.segment.time
        delays = self.model.term(self._theta(solution), "delay")
        earlier = (window.projection.seen_at(np.maximum(time - d, 0.0)) for d in delays)
        return replace(seen, earlier=tuple(earlier))

    def _motion(self, window: Surrogate, seen: Seen, weights: FloatArray) -> Motion:
        motion = super()._motion(window, seen, weights)
        if not seen.earlier:
            return motion
        places = np.transpose(command_columns(self.followers))
        parts = [columns @ weights[:, k] for columns, k in zip(seen.earlier, places, strict=True)]
        earlier, rates = np.stack(parts, axis=3).transpose(1, 2, 0, 3)
        return motion._replace(earlier=earlier, earlier_rates=rates)

    def _motion_of_hidden(self, k: int) -> Callable[[Any], Motion]:
        motion_at = super()._motion_of_hidden(k)
        if "delay" not in self.terms:
            return motion_at
        window = self.surrogates[k]
        window.network.set_output(self._best.windows[k].weights)
        time, theta = torch.tensor(window.data.segment.time), self._theta(self._best.solution)
        delays = self.model.term(theta, "delay")
        return lambda pick: motion_at(pick).with_earlier(window.learnable, time[pick], delays)

    def _solved(self, at: Optimum) -> Optimum:
        """A step that lowers the objective, in W and z."""
        errors = self._errors(at)
        steps, gradient, curvature = self._steps_at(at, self._loss(at).total / errors)
        before, z = self._objective(at, errors), at.solution.reshape(1, -1)
        bounds = np.tile(self._bounds, len(at.solution))
        move = bounded_step(z, gradient[None], curvature[None], bounds) - z
        turns = [
            step.layers[..., 0] + step.layers[..., 1:] @ move[0] - part.weights
            for step, part in zip(steps, at.windows, strict=True)
        ]
        for share in 0.5 ** np.arange(SHORTENED):
            solution = at.solution + share * move.reshape(at.solution.shape)
            fitted = []
            for window, part, turn in zip(self.surrogates, at.windows, turns, strict=True):
                seen = self._seen_with(window, part.seen, solution)
                weights = part.weights + share * turn
                fitted.append(Fitted(seen, weights, self._motion(window, seen, weights)))
            trial = Optimum(tuple(fitted), solution)
            if self._objective(trial, errors) <= before:
                return trial
        return at

    def _errors(self, at: Optimum) -> float:
        """The m of the module's head."""
        lasting = sum(segment.window.duration for segment in self.segments) / MEMORY
        if not self.model.is_late:
            return lasting
        loss, samples = self._loss(at), sum(segment.samples for segment in self.segments)
        fitted = loss.total - loss.physics
        return float(loss.total / (loss.physics / lasting + fitted / samples))

    def _objective(self, at: Optimum, errors: float) -> float:
        fitted = errors * self.followers * np.log(self._loss(at).total)
        return float(0.5 * fitted + 0.5 * (at.solution**2).sum())

    def _expanded(self, motion: Motion, z: FloatArray) -> tuple[FloatArray, FloatArray]:
        """F (N, M), and its derivatives (3 + n, N, M) by gap, own speed, speed ahead and z."""
        by_follower = np.broadcast_to(z, (self.followers, z.shape[1])).T
        at = [*motion.commanding, *by_follower]

        def command(moved: list[FloatArray]) -> FloatArray:
            gap, speed, ahead, *scores = moved
            theta = [p.value(z) for p, z in zip(self.model.parameters, scores, strict=True)]
            pushed = self.model.acceleration(gap, speed, ahead, theta, np)
            return np.asarray(np.broadcast_to(pushed, at[0].shape))

        slopes = [
            command([*at[:k], at[k] + 1j * COMPLEX_STEP, *at[k + 1 :]]).imag / COMPLEX_STEP
            for k in range(len(at))
        ]
        value, derivatives = command(at), np.array(slopes)
        if self.model.is_late:  # the last is minus that of the residual by the lag or the delay
            if motion.earlier is None:
                rate = motion.bends[:, command_columns(self.followers)[1]]
            else:
                rate = (derivatives[:3] * motion.earlier_rates).sum(axis=0)
            last = self.model.parameters[-1].value(z[:, -1] + 1j * COMPLEX_STEP)
            derivatives[-1] = -rate * (last.imag / COMPLEX_STEP)
        return value, derivatives

    def _steps_at(self, at: Optimum, prior: float) -> tuple[Sequence[Step], FloatArray, FloatArray]:
        """Each window's step; gradient and curvature of the profile of ½ M Ψ + ½ prior |z|²."""
        z = at.solution
        pairs = zip(self.surrogates, at.windows, strict=True)
        steps = [self._linear(window, part, z) for window, part in pairs]
        gradient = weighted_sum([step.gradient for step in steps], self.shares)
        curvature = weighted_sum([step.curvature for step in steps], self.shares)
        return steps, gradient + prior * z.ravel(), curvature + prior * np.eye(z.size)

    def _linear(self, window: Surrogate, at: Fitted, z: FloatArray) -> Step:
        """The step of one window, by its output layer and z."""
        seen, speed_columns, data = at.seen, self._places[1], window.data
        value, slopes = self._expanded(at.motion, z)
        lags = np.broadcast_to(self.model.term(self._theta(z), "lag"), self.followers)
        missing = value - at.motion.rates[:, speed_columns]
        if at.motion.bends is not None:
            missing -= lags * at.motion.bends[:, speed_columns]
        weight = self.config.weight_physics[1] / len(value)
        some, counts = thinned(len(value), max(1, round(APART / data.segment.sample_time)))
        root = np.sqrt(weight * counts)[:, None]
        right = np.zeros((*at.weights.shape, 1 + z.size))
        right[..., 0] = data_moments(seen.sums, self.config)
        gradient, curvature = np.zeros(z.size), np.zeros((z.size, z.size))
        kinematic, blocks = gap_blocks(seen.sums, self.config), []
        for k, lag in enumerate(lags):
            then = seen.earlier[k] if seen.earlier else seen.whole
            rate = seen.whole[:, 1] + lag * seen.whole[:, 2] if lag else seen.whole[:, 1]
            slope, by_z, error = slopes[:3, :, k].T, slopes[3:, :, k].T, missing[:, k, None]
            if data.mask is not None:
                parts, counted = (rate, slope, by_z, error), data.mask[:, k, None]
                rate, slope, by_z, error = (part * counted for part in parts)
            unknowns = np.arange(z.shape[1]) + (z.shape[1] * k if self.case == "II" else 0)
            columns = self._places[:, k]
            gradient[unknowns] += weight * (by_z.T @ error)[:, 0]
            right[:, columns, 0] -= weight * (then[:, 0].T @ (slope * error))
            right[:, columns[1], 0] += weight * (rate.T @ error)[:, 0]

            design = slope[some, :, None] * -then[some, :1]
            design[:, 1] += rate[some]
            design = root * design.reshape(len(root), -1)
            beside = root * by_z[some]
            squares, products = design.T @ design, design.T @ beside
            old = squares @ at.weights[:, columns].T.ravel()
            right[:, columns, 0] += old.reshape(3, -1).T
            right[:, columns[:, None], 1 + unknowns] += products.reshape(
                3, -1, z.shape[1]
            ).swapaxes(0, 1)
            curvature[np.ix_(unknowns, unknowns)] += beside.T @ beside
            blocks.append(kinematic + squares)
        layers = solve_chain(seen.sums, blocks.__getitem__, right, self.config)
        coupling = right[..., 1:].reshape(-1, z.size).T
        gradient -= coupling @ (layers[..., 0] - at.weights).ravel()
        curvature -= coupling @ layers[..., 1:].reshape(-1, z.size)
        return Step(layers, gradient, curvature)

    def _result(self) -> Parameters:
        return self._parameters(self._best.solution)

    @np.errstate(all="ignore")
    def estimate(self) -> Estimate:
        """The surrogates, the parameters, and which of them the data do not determine."""
        estimate = super().estimate()
        if not self.outcome:  # what the data say shows at the end of the search
            return estimate
        return replace(estimate, findings=(*estimate.findings, *self._undetermined()))

    def _undetermined(self) -> list[MethodFinding]:
        at = self._best
        prior = self._loss(at).total / self._errors(at)
        curvature = self._steps_at(at, prior)[2]
        if not np.isfinite(curvature).all():
            return []
        free = np.tile(self._bounds[0] < self._bounds[1], len(at.solution))
        open_ = np.zeros(at.solution.size, bool)
        among = curvature[np.ix_(free, free)]
        open_[free] = prior * np.diag(np.linalg.pinv(among)) > OPEN**2
        findings: list[MethodFinding] = []
        first = self.segments[0]
        for k, row in enumerate(open_.reshape(at.solution.shape)):
            named = zip(self.model.parameters, row, strict=True)
            if symbols := tuple(p.symbol for p, is_open in named if is_open):
                vehicle = 0 if first.shares(self.case) else first.vehicles[k + 1]
                findings.append(Undetermined(vehicle, self.model.title, symbols))
        return findings
