"""The `calibrated` preset: parameters by the network's evidence, where `fast` minimises its loss.

    α, ατ, β, disturbance, noise    maximise the evidence of each follower given the vehicle ahead,
                                    all windows together
    curves                          the network's output layer, exact for these parameters

The evidence integrates the output layer out. In a space of functions that is rich enough it is the
likelihood of the Kalman filter, which is how it is computed (`joint_likelihood`); a test holds both
together. The search begins at the user's initial values, the paper's by default, and goes on in
rounds. Standard errors of the parameters meanwhile follow from the expected information.

The hidden layers stay as they were drawn by the seed: training them would lower Ψ by some percent
and move no parameter. Where samples are missing for long, the curves are those of the filter's
smoother, as the network's loss needs all samples.
"""

from itertools import compress
from typing import Any

import numpy as np

from accpinn.methods import Segments
from accpinn.methods.estimate import Estimate, Outcome, Progress, for_window
from accpinn.methods.findings import WeaklyDetermined
from accpinn.methods.forecast import PARAMETERS
from accpinn.methods.joint_likelihood import UNKNOWNS, Rise, rising, smoothed, without_bounds
from accpinn.methods.likelihood import log_errors, natural, vanishing
from accpinn.methods.pinn.config import PinnConfig
from accpinn.methods.pinn.loss import (
    LossTerms,
    Motion,
    Training,
    has_earlier,
    loss_terms,
    stack_outputs,
    trajectories,
)
from accpinn.methods.pinn.network import Network
from accpinn.methods.pinn.projection import Projection, solve_output
from accpinn.methods.regression import Solution
from accpinn.methods.series import moving
from accpinn.methods.state_space import complete
from accpinn.model.cthp import Case, Trajectories
from accpinn.model.registry import PAPER, simulate
from accpinn.model.spec import ModelSpec
from accpinn.segment import Segment
from accpinn.units import FloatArray, frozen

FIRST_ROUNDS, FURTHER_ROUNDS = 20, 14
"""Rounds that a search usually takes: that of the CTHP, and from there that of a model with further
terms."""


class CalibratedTraining(Training):
    """See the module's head; one `advance` is a round of the search."""

    @np.errstate(all="ignore")  # absurd numbers end as diverged
    def __init__(self, segments: Segments, case: Case, config: PinnConfig, spec: ModelSpec) -> None:
        """Begin the search at the configuration's initial values."""
        super().__init__(segments, case, config, spec)
        self.outcome = None
        self._iteration = 0
        self._last_begins: int | None = None
        """Iteration at which the search of the model that is asked for began."""
        self._rounds = rising(segments, case, spec, initial=config.initial)
        self._at: Rise = next(self._rounds)
        self._note()

    @np.errstate(all="ignore")
    def advance(self) -> None:
        """A round of the search."""
        try:
            self._at = next(self._rounds)
            self._iteration += 1
            self._note()
        except StopIteration:
            self.outcome = Outcome.CONVERGED
        except np.linalg.LinAlgError:
            self.outcome = Outcome.DIVERGED

    def _note(self) -> None:
        """Look at the present moment."""
        value = float(self._at.value.sum())
        self.progress = Progress(
            phase=PARAMETERS,
            iteration=self._iteration,
            iterations=self._expected_rounds(),
            seconds=0.0,
            total=np.nan,
            data=np.nan,
            physics=np.nan,
            initial=np.nan,
            parameters=self._solution().parameters[: 1 if self.case == "I" else None],
            log_likelihood=value,
            deviations=np.array([log_errors(information) for information in self._at.information]),
        )
        is_late = self._iteration >= self.planned and not self._at.maxima
        self.outcome = Outcome.FINISHED if is_late else None
        if not np.isfinite(value):
            self.outcome = Outcome.DIVERGED

    def _expected_rounds(self) -> int:
        """The iteration at which the search probably ends."""
        if self._at.form == self.spec.model and self._last_begins is None:
            self._last_begins = self._iteration
        if self.spec.model == PAPER:
            return max(self._iteration + 2, FIRST_ROUNDS)
        if self._last_begins is None:
            return max(self._iteration + 2, FIRST_ROUNDS) + FURTHER_ROUNDS
        return max(self._iteration + 2, self._last_begins + FURTHER_ROUNDS)

    def _solution(self) -> Solution:
        """(M, 3) the present parameters."""
        form, z = self._at.form, self._at.coordinates
        everyone = np.broadcast_to(z, (self.segments[0].followers, z.shape[1]))
        unknowns, theta = natural(form, everyone), vanishing(form, everyone)
        terms = complete(form, unknowns)[:, 3:]
        # What would be without the constraints is known of the CTHP alone.
        active = np.asarray((theta == 0.0) & (form == PAPER))
        return Solution(frozen(theta), frozen(theta), active, terms)

    def curves(self) -> Trajectories:
        """The drive of the first window, each follower simulated behind the measured one ahead."""
        segment, parameters = self.segments[0], self._solution().parameters
        gaps, speeds = np.empty_like(segment.gaps), segment.speeds.copy()
        for k in range(segment.followers):
            pair = segment.pair(k)
            start = pair.speeds[0, 1:], pair.gaps[0]
            vehicle, ahead = parameters[[k]], pair.speeds[:, 0]
            with np.errstate(all="ignore"):  # the first values may be absurd
                motion = simulate(self._at.form, vehicle, pair.time, ahead, *start)
            gaps[:, k], speeds[:, k + 1] = motion.gaps[:, 0], motion.speeds[:, 1]
        return Trajectories(segment.time, speeds, gaps)

    def point(self) -> Estimate:
        """The parameters without the network's curves, which take a third of the time to draw."""
        return self._estimate(self._bounded(), {})

    @np.errstate(all="ignore")
    def estimate(self) -> Estimate:
        """The parameters and the network's curves, also of a search that was stopped."""
        solution, drawn = self._bounded(), dict[str, Any]()
        if self.outcome is not Outcome.DIVERGED:
            drawn = self._drawn(solution, self._unknowns)
        return self._estimate(solution, drawn)

    def _bounded(self) -> Solution:
        """The present parameters, and what they would be without the constraints."""
        solution = self._solution()
        if self.spec.model != PAPER or not self._at.maxima:
            return solution
        free = solution.unconstrained.copy()
        for g, maximum in without_bounds(self.segments, self.case).items():
            free[slice(None) if self.case == "I" else g] = maximum.values[:3]
        return Solution(solution.theta, frozen(free), solution.active, solution.terms)

    @property
    def _unknowns(self) -> FloatArray:
        """(M, P) all unknowns of each follower."""
        z = self._at.coordinates
        return natural(self._at.form, np.broadcast_to(z, (self.followers, z.shape[1])))

    def _estimate(self, solution: Solution, drawn: dict[str, Any]) -> Estimate:
        """The estimate with what was drawn, fields of an `Estimate`."""
        maxima = self._at.maxima
        total = sum(m.log_likelihood for m in maxima) if maxima else float(self._at.value.sum())
        moves = np.any([moving(segment, self.case) for segment in self.segments], axis=0)
        still = compress(self.segments[0].vehicles[1:], ~moves)  # in every window
        return Estimate.of(
            "pinn",
            self.segments,
            self.case,
            self.spec,
            solution,
            outcome=self.outcome or Outcome.STOPPED,
            settings=self.config.to_json(),
            iterations=self._iteration,
            findings=[WeaklyDetermined(vehicle) for vehicle in still],
            **drawn
            | {
                "loss": drawn.get("loss", {}) | {"log_likelihood": total},
                "arrays": {UNKNOWNS: self._unknowns} | drawn.get("arrays", {}),
            },
        )

    def _drawn(self, solution: Solution, unknowns: FloatArray) -> dict[str, Any]:
        """Curves, losses and arrays of all windows, as fields of an `Estimate`."""
        curves, losses, weights = list[Trajectories](), list[LossTerms](), 0
        arrays: dict[str, FloatArray] = {}
        for k, segment in enumerate(self.segments):
            motion, disturbance = smoothed(self._at.form, unknowns, segment)
            saved = {"disturbance": disturbance}
            if not segment.blocks_missing:  # else the curves are the smoother's
                motion, terms, network = drawn(segment, solution, self.config)
                losses.append(terms)
                saved, weights = network.arrays() | saved, max(weights, network.size)
            curves.append(motion)
            arrays |= for_window(saved, k)
        loss: dict[str, float] = {}
        if len(losses) == len(self.segments):  # the mean by number of samples
            samples = [segment.samples for segment in self.segments]
            rows = [list(terms.values().values()) for terms in losses]
            means = np.average(rows, axis=0, weights=samples)
            loss = dict(zip(losses[0].values(), means, strict=True))
        return {
            "curves": tuple(curves), "loss": loss, "arrays": arrays, "network_weights": weights,
        }  # fmt: skip


def drawn(
    segment: Segment, solution: Solution, config: PinnConfig
) -> tuple[Trajectories, LossTerms, Network]:
    """A window's curves, whose output layer minimises Ψ for parameters (M, 3), Ψ and the network.

    Ψ is of the gaps without s₀.
    """
    network = Network(segment.followers, config, float(segment.time[-1]))
    theta, (intercepts, lags, delays) = solution.theta, solution.terms.T
    shift = stack_outputs(np.zeros((1, segment.followers + 1)), intercepts[None])
    measured = stack_outputs(segment.speeds, segment.gaps) - shift
    mask = has_earlier(segment) if delays.any() else segment.mask
    order = 2 if lags.any() else 1
    projection = Projection(network, segment.time, measured, mask, order)
    hidden = projection.hidden()
    sums = projection.sums(hidden)
    if lags.any() or delays.any():
        # One follower after the other, as each takes as much memory as the network.
        late = (projection.late(hidden, *pair) for pair in zip(lags, delays, strict=True))
        sums = sums.with_late(late, mask)
    weights = solve_output(sums, theta, config)
    network.set_output(weights)
    motion = Motion(*projection.surrogate(hidden, weights))
    if delays.any():
        motion = motion.with_earlier(network, segment.time, delays)
    counts = None if mask is None else mask.astype(float)
    loss = loss_terms(motion, measured, theta, config, counts, lags=lags)
    weights[0] += shift[0]
    network.set_output(weights)
    return trajectories(segment.time, motion.outputs + shift), loss, network
