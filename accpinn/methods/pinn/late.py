"""The preset `fast` for models with a lag λ or a delay d between command f and acceleration.

To the Gauss-Newton step of `following` they add

    lag      λ v̂'' + v̂' - f            D: λ Φ''                       F: -v̂''
    delay    v̂' - f(p̂, v̂, û at t - d)   D: f's slopes and Φ at t - d   F: -df/dt at t - d

As some tenths of a second are sought, noise of the measurements is taken as independent from sample
to sample, so that the number of independent errors is

    m = Ψ / (Ψ_F / m_F + (Ψ - Ψ_F) / N),    m_F = duration / `MEMORY`

With m_F in its place the prior moved a lag of 0.8 s to 0.5 s in 300 s that obey the model. Without
the prior, lags and delays of real cars, whose residuals last, would end at their bounds.
"""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import torch

from accpinn.methods.pinn.fast import Optimum, Seen
from accpinn.methods.pinn.following import FollowingFast
from accpinn.methods.pinn.loss import Motion, command_columns
from accpinn.model.following import COMPLEX_STEP
from accpinn.units import FloatArray


class LateFast(FollowingFast):
    """See the module's head."""

    def _move(self, now: FloatArray, before: FloatArray) -> float:
        """Largest change of a parameter, as a share of its value where that is positive."""
        shares = [p.spread if p.is_positive else 1.0 for p in self.model.parameters]
        return float((np.abs(now - before) * shares).max())

    def _seen(self, solution: FloatArray) -> Seen:
        return self._seen_with(super()._seen(solution), solution)

    def _seen_with(self, seen: Seen, solution: FloatArray) -> Seen:
        """The same with Φ at t - d, where the model has a delay; at first that of t = 0."""
        if "delay" not in self.terms:
            return seen
        time, delays = self.segment.time, self.model.term(self._theta(solution), "delay")
        earlier = (self._projection.seen_at(np.maximum(time - d, 0.0)) for d in delays)
        return replace(seen, earlier=tuple(earlier))

    def _motion(self, seen: Seen, weights: FloatArray) -> Motion:
        motion = super()._motion(seen, weights)
        if not seen.earlier:
            return motion
        places = np.transpose(command_columns(self.followers))
        parts = [columns @ weights[:, k] for columns, k in zip(seen.earlier, places, strict=True)]
        earlier, rates = np.stack(parts, axis=3).transpose(1, 2, 0, 3)
        return motion._replace(earlier=earlier, earlier_rates=rates)

    def _motion_of_hidden(self) -> Callable[[Any], Motion]:
        motion_at = super()._motion_of_hidden()
        if "delay" not in self.terms:
            return motion_at
        self.network.set_output(self._best.weights)
        time, theta = torch.tensor(self.segment.time), self._theta(self._best.solution)
        delays = self.model.term(theta, "delay")
        return lambda pick: motion_at(pick).with_earlier(self._learnable, time[pick], delays)

    def _errors(self, at: Optimum) -> float:
        loss, lasting = self._loss(at), super()._errors(at)
        fitted = loss.total - loss.physics
        return float(loss.total / (loss.physics / lasting + fitted / self.segment.samples))

    def _expanded(self, motion: Motion, z: FloatArray) -> tuple[FloatArray, FloatArray]:
        """The last derivative is minus that of the residual by the lag or the delay."""
        value, slopes = super()._expanded(motion, z)
        if motion.earlier is None:
            rate = motion.bends[:, command_columns(self.followers)[1]]
        else:
            rate = (slopes[:3] * motion.earlier_rates).sum(axis=0)
        moved = self.model.parameters[-1].value(z[:, -1] + 1j * COMPLEX_STEP).imag / COMPLEX_STEP
        slopes[-1] = -rate * moved
        return value, slopes
