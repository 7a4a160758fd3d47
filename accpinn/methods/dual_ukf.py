"""Dual unscented Kalman filter: one filter for the motion, one for the law, side by side.

At each sample, with f the law's motion over one step h, u the predecessor's speed, w and r noise:

    motion   x_k = f(x_{k-1}, θ̂_{k-1}, u) + w,      y_k = x_k + r         x = (p, v)
    law      θ_k = θ_{k-1} + drift,                 y_k = f(x̂_{k-1}, θ_k, u) + innovation

Either filter takes the other's last estimate as given. Both carry mean and covariance through f
by the scaled unscented transform: 2n+1 points with the covariance's spread are moved, and their
weighted mean and covariance are taken. The noise is that of `filtering`.
The paper measures p and Δv; with u known that is the same as p and v.

The parameters of the fit are the last estimate: what the filter holds once it has seen the whole
window, the older parts a little less than the newer ones, as the law may drift. Where that
estimate breaks the rational driving constraints, the most likely lawful θ is taken instead; the
filter itself runs free, as a bound inside it would bias what it learns later. The surrogate is
the filtered motion, which follows the recording closely whatever the law.

Case I stacks the measurements of all followers in one filter for the law.

Source: Ampountolas, IEEE Transactions on Intelligent Vehicles (2023), doi 10.1109/TIV.2023.3272660;
Wan and van der Merwe, in Kalman Filtering and Neural Networks (2001), chapter 7.
"""

import time
from dataclasses import dataclass

import numpy as np

from accpinn.methods.filtering import (
    TYPICAL,
    Measurements,
    State,
    drift,
    law_covariance,
    measurement_noise,
    motion_noise,
    move,
    settings,
)
from accpinn.methods.fit import Fit, Outcome, bound_notes
from accpinn.methods.method import direct
from accpinn.methods.online import doubts, kept_samples, nearest_lawful, track
from accpinn.methods.unscented import Unscented, symmetric
from accpinn.model.cthp import Case, Parameters, PlatoonSolution, Trajectories
from accpinn.segment.segment import Segment
from accpinn.units import FloatArray, Seconds

UNCERTAIN = (0.3, 1.0, 1.0)
"""Standard deviations of α, τ, β at first: so large that `TYPICAL` soon counts for nothing."""

NOTHING = 1e12
"""In m² and m²/s²: variance of a measurement that says nothing of the law."""


def fit(segment: Segment, case: Case = "II") -> Fit:
    """The last estimate of the law, its course, and the filtered motion."""
    started = time.perf_counter()
    kept = kept_samples(segment)
    try:
        filtered = _run(Measurements.of(segment, case), kept)
    except np.linalg.LinAlgError:
        return _diverged(segment, case, time.perf_counter() - started)
    lawful = [
        [nearest_lawful(*pair) for pair in zip(*now, strict=True)]
        for now in zip(filtered.theta, filtered.covariance, strict=True)
    ]
    solution = PlatoonSolution.of(lawful[-1], segment.followers)
    theta = np.array([[one.theta for one in now] for now in lawful])
    path = track(segment.time[kept], theta, filtered.covariance, segment.followers)
    shape = (segment.samples, segment.followers)
    return Fit(
        method="dual-ukf",
        case=case,
        parameters=Parameters.from_theta(solution.theta),
        surrogate=Trajectories(
            segment.time,
            np.column_stack([segment.speeds[:, 0], filtered.states[..., 1].reshape(shape)]),
            filtered.states[..., 0].reshape(shape),
        ),
        outcome=Outcome.FILTERED,
        seconds=time.perf_counter() - started,
        config={**settings(), "uncertain": list(UNCERTAIN)},
        unconstrained=Parameters.from_theta(solution.unconstrained),
        active_bounds=solution.active,
        track=path,
        notes=bound_notes(segment.vehicles, solution) + doubts(segment, path),
    )


def _diverged(segment: Segment, case: Case, seconds: Seconds) -> Fit:
    """For measurements that no motion follows: a covariance has lost its meaning."""
    unknown = Parameters.of(np.full((segment.followers, 3), np.nan))
    return Fit(
        method="dual-ukf",
        case=case,
        parameters=unknown,
        surrogate=None,
        outcome=Outcome.DIVERGED,
        seconds=seconds,
        config={**settings(), "uncertain": list(UNCERTAIN)},
        unconstrained=unknown,
        active_bounds=((),) * segment.followers,
        notes=(
            "The filter lost the motion, as speeds and space-gaps jump by more than vehicles can;"
            " choose another window.",
        ),
    )


@dataclass(frozen=True, eq=False)
class _Filtered:
    """What the two filters held, G laws for F followers each."""

    theta: FloatArray
    """(K, G, 3) at the kept instants."""
    covariance: FloatArray
    """(K, G, 3, 3)"""
    states: FloatArray
    """(N, G, F, 2) p, v at every instant."""


def _run(platoon: Measurements, kept: list[int]) -> _Filtered:
    measured = np.stack([platoon.gaps, platoon.speeds], axis=-1)
    dual = _Dual(measured[0], platoon.step)
    states = np.empty_like(measured)
    states[0] = dual.states
    thetas, covariances = [], []
    keep = set(kept)
    for now in range(1, len(measured)):
        dual.take_in(platoon.ahead[now - 1], platoon.ahead[now], measured[now], platoon.told[now])
        states[now] = dual.states
        if now in keep:
            thetas.append(dual.theta)
            covariances.append(dual.covariance)
    return _Filtered(np.array(thetas), np.array(covariances), states)


class _Dual:
    """Means and covariances of both filters; G laws, F followers each."""

    def __init__(self, first: FloatArray, step: Seconds) -> None:
        laws, followers, _ = first.shape
        self._step = step
        self._noise, self._motion_noise = measurement_noise(), motion_noise(step)
        self._drift = drift(step)
        self._of_state, self._of_law = Unscented(2), Unscented(3)
        self.states = first
        self.spread = np.tile(self._noise, (laws, followers, 1, 1))
        self.theta = np.tile(TYPICAL.theta, (laws, 1))
        self.covariance = np.tile(law_covariance(UNCERTAIN), (laws, 1, 1))

    def take_in(
        self, before: FloatArray, after: FloatArray, measured: FloatArray, told: FloatArray
    ) -> None:
        """One more sample (G, F, 2).

        Args:
            before: the predecessors' speeds (G, F) at the step's beginning.
            after: the same at its end.
            measured: (G, F, 2) p, v.
            told: (G, F) whether the step tells of the law.
        """
        points = self._of_state.points(self.states, self.spread)
        motion = self._of_state.moments(
            self._moved(self.theta[:, None, None], points, before[..., None], after[..., None])
        )
        predicted = motion.covariance + self._motion_noise
        innovation = predicted + self._noise
        untold = told == 0
        said = innovation + NOTHING * untold[..., None, None] * np.eye(2)
        self._learn(before, after, measured, said)
        gain = predicted @ np.linalg.inv(innovation)
        error = (measured - motion.mean)[..., None]
        self.states = motion.mean + (gain @ error)[..., 0]
        self.spread = symmetric(predicted - gain @ predicted)
        # What is left out is taken as measured, errors and all.
        self.states[untold] = measured[untold]
        self.spread[untold] = self._noise

    def _learn(
        self, before: FloatArray, after: FloatArray, measured: FloatArray, innovation: FloatArray
    ) -> None:
        """The law's filter, with the motion's last estimate, errors (G, F, 2, 2) and all."""
        self.covariance = self.covariance + self._drift
        points = self._of_law.points(self.theta, self.covariance)
        moved = self._moved(
            points[:, :, None], self.states[:, None], before[:, None], after[:, None]
        )
        told = self._of_law.moments(moved.reshape(*points.shape[:2], -1))
        error = told.covariance
        laws, followers = before.shape
        # The followers' blocks on the diagonal, as a view.
        blocks = error.reshape(laws, followers, 2, followers, 2)
        np.einsum("gfifj->gfij", blocks)[...] += innovation
        crossed = told.weighted @ (points - self.theta[:, None])
        gain = np.linalg.solve(error, crossed).swapaxes(1, 2)
        surprise = measured.reshape(laws, -1, 1) - told.mean[..., None]
        self.theta = self.theta + (gain @ surprise)[..., 0]
        self.covariance = symmetric(self.covariance - gain @ crossed)

    def _moved(
        self, law: FloatArray, states: FloatArray, before: FloatArray, after: FloatArray
    ) -> FloatArray:
        """Laws (.., 3) and states (.., 2), which broadcast, one step on: (.., 2)."""
        terms = (law[..., 0], law[..., 1], law[..., 2])
        state = State(states[..., 0], states[..., 1])
        return np.stack(move(terms, state, before, after, self._step), axis=-1)


METHOD = direct("dual-ukf", "Dual UKF", fit, typical_seconds=2.0)
