"""Particle filter: many parameter sets, of which those that predict the motion well multiply.

Each particle is a θ with a motion x̂ = (p, v) of its own. From one sample to the next

    x̂ = f(x̂, θ, u) + K (y - f(x̂, θ, u)),      weight × exp(-½ eᵀ S⁻¹ e),   e = y - f(x̂, θ, u),

with f the model's motion over one step behind the predecessor's measured speed u, S the covariance
of e and K the Kalman gain. Given θ the motion is linear and its noise normal, so the distribution
of x need not be sampled: only θ is. S and K hardly depend on θ and are those of the cloud's mean
when it was last drawn, so that particles are weighted by their predictions alone.

Where fewer than half of the particles count (effective number 1 / Σ weight²), they are drawn anew
by systematic resampling and moved a little, so that no two are the same:

    θ -> a θ + (1 - a) θ̄ + N(0, (1 - a²) V + drift since the last time),

which keeps the cloud's mean θ̄ and covariance V, but for the drift. A component below zero changes
its sign: the rational driving constraints hold for every particle.

The parameters are the cloud's mean at the end, in which older parts of the windows count a little
less than newer ones. The curves are the cloud's mean motion, which follows the recording closely
whatever the parameters. Case I weighs each particle by all followers.

Source: Wang, Gunter, Nice, Delle Monache and Work, IEEE Transactions on Intelligent Vehicles 6
(2021) 288-298. They sample the motion too; that it need not be is Schön, Gustafsson and Nordlund,
IEEE Transactions on Signal Processing 53 (2005) 2279-2289. The kernel is Liu and West's, in
Sequential Monte Carlo Methods in Practice (2001), chapter 10.
"""

from dataclasses import replace

import numpy as np

from accpinn.methods import Segments, direct, online
from accpinn.methods.estimate import Estimate
from accpinn.model.cthp import SPREAD, TYPICAL, Case
from accpinn.model.spec import PAPER_SPEC, ModelSpec
from accpinn.segment import Segment
from accpinn.units import FloatArray, Mask

PARTICLES = 4000
"""Twice as many, or another seed, move no parameter of OpenACC's Casale and AstaZero runs by more
than its own deviation."""
SEED = 0
SHRINK = 0.995
"""The a above; Liu and West's discount factor is then 0.99."""
LEAST_EFFECTIVE = 0.5
"""Share of the particles that must count."""
STEADY = 1e-6
"""Relative change in a step below which S and K stand still."""


def fit(segments: Segments, case: Case = "II", spec: ModelSpec = PAPER_SPEC) -> Estimate:
    """The last mean of the cloud, its track, and its mean motion in each window."""
    config = {"particles": PARTICLES, "seed": SEED, "shrink": SHRINK}
    fitted = online.filtered("particle", segments, case, spec, _Cloud, config)
    return replace(fitted, unconstrained=None)  # no particle leaves the bounds


class _Cloud(online.Filter):
    """P particles for each of G parameter sets, with F followers each."""

    def __init__(self, followers: int, case: Case) -> None:
        super().__init__(followers, case)
        sets = self.sets
        self._random = np.random.default_rng(SEED)
        draws = self._random.standard_normal((3, sets, PARTICLES)).T * SPREAD
        alpha, beta, tau = (TYPICAL.values * np.exp(draws)).T
        self._theta = np.stack([alpha, alpha * tau, beta])
        self._spread, self._transition, self._precision = np.empty((3, sets, 2, 2))
        self._is_steady = False
        self._maps = np.empty((sets, 4, 2, PARTICLES))
        self._returns = np.empty((sets, 2, 2, PARTICLES))
        self._known = np.empty((sets, self.members, 4))
        """(G, F, 4) p, v and the predecessor's speed before and after a step, as measured."""
        self._offsets = np.empty((sets, self.members, 2, PARTICLES))
        """S⁻¹ e. A motion differs from the measured one by -R S⁻¹ e, as 1 - K = R S⁻¹."""
        self._logs = np.zeros((sets, PARTICLES))
        self._weights = np.full((sets, PARTICLES), 1 / PARTICLES)
        self._steps_since = np.full(sets, -1)
        self.mean = self._theta.mean(axis=2).T

    def begin(self, segment: Segment) -> None:
        """See `online.Filter`; the cloud and its weights are kept."""
        super().begin(segment)
        for k in range(self.sets):
            self._prepare(k)
        self._restart(self.states[0])

    def update(self, ahead: FloatArray, measured: FloatArray, mask: FloatArray) -> None:
        """See `online.Filter`; where too few particles count, they are drawn anew first."""
        self._steps_since += 1
        effective = 1 / np.einsum("gp,gp->g", self._weights, self._weights)
        for k in np.flatnonzero(effective < LEAST_EFFECTIVE * self._weights.shape[1]):
            self._redraw(int(k))
        if not mask.any():
            self._restart(measured)
            return
        if not self._is_steady:
            self._follow_spread()
        self._known[..., 2:] = ahead
        predicted = self._known @ self._maps.reshape(len(self._maps), 4, -1)
        errors = np.einsum("gjip,gfjp->gfip", self._returns, self._offsets)
        errors -= predicted.reshape(errors.shape)
        self._known[..., :2] = measured
        errors += self._known[..., :2, None]
        if not mask.all():  # a masked motion becomes the measured one, errors and all
            errors *= mask[..., None, None]
            self._forget((mask == 0).any(axis=1))
        self._offsets = self._precision[:, None] @ errors
        squares = np.einsum("gfip,gfip->gp", errors, self._offsets)
        self._logs -= squares / 2
        self._logs -= self._logs.max(axis=1, keepdims=True)
        self._weights = np.exp(self._logs)
        self._weights /= self._weights.sum(axis=1, keepdims=True)
        self.mean = np.einsum("cgp,gp->gc", self._theta, self._weights)

    def _restart(self, measured: FloatArray) -> None:
        """All motions are the measured one (G, F, 2), errors and all."""
        self._known[..., :2] = measured
        self._forget()
        self._offsets[:] = 0

    def _follow_spread(self) -> None:
        """Bring S⁻¹ and the motion's spread to the next step, until they stand still."""
        moved = self._transition @ self._spread @ self._transition.swapaxes(1, 2)
        predicted = moved + self._motion_noise
        self._precision = np.asarray(np.linalg.inv(predicted + self._noise), np.float64)
        spread = online.symmetric(predicted - predicted @ self._precision @ predicted)
        moves = np.abs(spread - self._spread) > STEADY * np.abs(spread)
        self._is_steady = not moves.any()
        self._spread = spread

    def _forget(self, masked: Mask | slice = slice(None)) -> None:
        """The motion of these parameter sets is the measured one, errors and all."""
        self._spread[masked], self._is_steady = self._noise, False

    @property
    def motion(self) -> FloatArray:  # type: ignore[override]
        """(G, F, 2) the mean of p and v."""
        offsets = (self._offsets @ self._weights[:, None, :, None])[..., 0]
        return np.asarray(self._known[..., :2] - offsets * np.diag(self._noise))

    @property
    def covariance(self) -> FloatArray:  # type: ignore[override]
        """(G, 3, 3) of θ."""
        return np.array([self._covariance(k) for k in range(len(self.mean))])

    def _covariance(self, k: int) -> FloatArray:
        apart = self._theta[:, k] - self.mean[k, :, None]
        return np.asarray((apart * self._weights[k]) @ apart.T)

    def _prepare(self, k: int) -> None:
        """The update of a set's particles by a step's measurements and offsets."""
        self._maps[k] = online.step_maps(self._theta[:, k].T, self._step).T
        mean = self._theta[:, k].mean(axis=1)
        self._transition[k], self._is_steady = online.step_maps(mean, self._step)[:, :2], False
        self._returns[k] = self._maps[k, :2] * np.diag(self._noise)[:, None, None]

    def _redraw(self, k: int) -> None:
        ladder = (np.arange(PARTICLES) + self._random.random()) / PARTICLES
        chosen = np.searchsorted(np.cumsum(self._weights[k]), ladder).clip(max=PARTICLES - 1)
        mean = self.mean[k, :, None]
        kernel = (1 - SHRINK**2) * self._covariance(k) + self._steps_since[k] * self._drift
        apart = SHRINK * (self._theta[:, k, chosen] - mean)
        noise = np.linalg.cholesky(kernel) @ self._random.standard_normal((3, PARTICLES))
        self._theta[:, k] = np.abs(mean + apart + noise)
        self._prepare(k)
        self._offsets[k] = self._offsets[k][..., chosen]
        self._logs[k] = 0.0
        self._steps_since[k] = 0


METHOD = direct(
    "particle", "Particle filter", fit, typical_seconds=2.4,
    summary="particle filter over motion and parameters",
)  # fmt: skip
