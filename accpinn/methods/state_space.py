"""The CTHP and what disturbs it, as a linear state-space model of one follower.

A vehicle does not obey the CTHP exactly. Its disturbance r lasts for seconds and moves its own
speed and space-gap, so that a method which only makes r small is biased. Here r is part of the
model, and so is the noise of the receivers:

    dp = (u - v) dt + √q dB                           space-gap p [m], wandering with the receivers
    dv = (α (p - τ v) + β (u - v) + r) dt             own speed v [m/s]
    dr = (w - r)/T₂ dt,  dw = -w/T dt + .. dW         disturbance r [m/s²]: deviation s, memory T,
                                                      rise T₂ (a red process; T₂ -> 0 is a
                                                      first-order Gauss-Markov process)
    du = a dt,  da = -a/3 dt + .. dW                  speed ahead u [m/s], acceleration's deviation
    y  = (p, v, u) + white noise                      measured at even steps; samples may be missing

Other CTHPs add terms (see `model.following`): an intercept s₀, which shifts the measured gaps, and
a lag or a delay (Padé, second order) between the command and the acceleration, the disturbance
being added behind it.

The discretisation is exact to rounding: the integrals of Van Loan (IEEE Trans. Autom. Control 23,
1978) over a short part of the step, as Taylor series, and then doubled.
Source of the approach: Kristensen, Madsen and Jørgensen, Automatica 40 (2004) 225-237.
"""

from dataclasses import dataclass, fields, replace

import numpy as np
from numpy.typing import NDArray

from accpinn.model.cthp import (
    LARGEST,
    LARGEST_ALPHA_TAU,
    TERMS,
    TYPICAL,
    Parameters,
    Term,
    add_command,
)
from accpinn.model.following import TERM_RANGES
from accpinn.model.registry import FOLLOWING
from accpinn.units import FloatArray, Seconds

Columns = slice | NDArray[np.int64]
"""Some of the models, which lie on the last axis."""
Form = str
"""Key of a CTHP, or "unbounded": the paper's model without the rational driving constraints."""
OBSERVED = (0, 1, 2)
"""The states p, v, u, which are measured."""
LEADER_MEMORY: Seconds = 3.0
GAP_DRIFT = 2 * 0.14**2 / 60
"""q in m²/s: two positions' errors make a deviation of 0.14 m that lasts a minute."""
USUAL_COMMAND = 0.25
"""Deviation of a command in m/s², of which a lag or a delay holds a part at the first sample."""
SHORT, TERMS_TAKEN = 0.0625, 7
"""Part of a step's exponent that is short, and terms of its series."""
FIRST = (100.0, 50.0, 50.0)
"""Deviations of the first p, v, u, about zero: nothing is known of them before the first sample."""


@dataclass(frozen=True)
class Coordinate:
    """One unknown of the model, and the interval and prior that keep it plausible."""

    name: str
    start: float
    lower: float
    upper: float
    spread: float | None = None
    """Deviation of its weak normal prior about ``start``; None for a flat one."""
    logarithmic: bool = True
    """Whether search and prior use its logarithm."""

    @property
    def bounds(self) -> tuple[float, float]:
        """Lower and upper end in the search's coordinate."""
        if self.logarithmic:
            return float(np.log(self.lower)), float(np.log(self.upper))
        return self.lower, self.upper

    @property
    def centre(self) -> float:
        """The start in the search's coordinate."""
        return float(np.log(self.start)) if self.logarithmic else self.start


_ALPHA, _BETA, _TAU = TYPICAL.values.tolist()
LEAST = 1e-4
"""A smaller α [1/s²] or β [1/s] has no effect that a recording could show: it stands for zero."""
COMMON = (
    Coordinate("alpha", _ALPHA, LEAST, LARGEST.alpha),
    Coordinate("alpha_tau", _ALPHA * _TAU, LEAST, LARGEST_ALPHA_TAU),
    Coordinate("beta", _BETA, LEAST, LARGEST.beta),
    Coordinate("disturbance", 0.25, 0.01, 3.0, 0.7),
    Coordinate("memory", 4.0, 0.3, 60.0, 0.7),
    Coordinate("rise", 0.3, 0.005, 20.0, 1.0),
    Coordinate("gap_noise", 0.03, 0.01, 3.0, 1.0),
    Coordinate("speed_noise", 0.05, 0.02, 1.0, 1.0),
    Coordinate("leader_acceleration", 0.5, 0.02, 3.0, 0.5),
)
"""θ = (α, ατ, β) first. The priors are about as wide as real followers differ, as far as their runs
tell (docs/validation.md). The least noise is what the receivers can resolve: with less, recordings
that were smoothed drive the disturbance's memory to absurd values."""
EXTRA: dict[Term, Coordinate] = {
    "s0": Coordinate("s0", 6.0, *TERM_RANGES["s0"], 6.0, logarithmic=False),
    "lag": Coordinate("lag", 0.5, *TERM_RANGES["lag"], 0.4, logarithmic=False),
    "delay": Coordinate("delay", 0.7, *TERM_RANGES["delay"], 0.4, logarithmic=False),
}
"""The terms beside the CTHP: s₀ in m, λ and d in s, with normal priors."""


def coordinates(form: Form) -> tuple[Coordinate, ...]:
    """The unknowns of a model: nine, and one more for each term beside the CTHP."""
    if form == "unbounded":
        theta = [replace(c, lower=-c.upper, logarithmic=False) for c in COMMON[:3]]
        return (*theta, *COMMON[3:])
    return (*COMMON, *(EXTRA[term] for term in FOLLOWING[form].terms))


def complete(form: str, values: FloatArray) -> FloatArray:
    """(.., 6) the complete parameters, as `Parameters` holds them, from the unknowns (.., P)."""
    result = np.zeros((*values.shape[:-1], 6))
    result[..., :3] = Parameters.from_theta(values[..., :3]).values
    for at, term in enumerate(FOLLOWING[form].terms, len(COMMON)):
        result[..., 3 + TERMS.index(term)] = values[..., at]
    return result


@dataclass(frozen=True, eq=False)
class StateSpace:
    """B discrete models with n states each; the models are the last axis of every array."""

    transition: FloatArray
    """(n, n, B): the states a step later."""
    process: FloatArray
    """(n, n, B): covariance of what is added in a step."""
    noise: FloatArray
    """(3, B): variances of the measurements of p, v, u."""
    shift: FloatArray
    """(B,) s₀ in m, by which the measured gap exceeds the state p."""
    first: FloatArray
    """(n, B): means of the states before the first sample."""
    first_covariance: FloatArray
    """(n, n, B)."""
    rates: FloatArray
    """(n, n, B): d/dt of the states, without noise."""

    def of(self, columns: Columns) -> "StateSpace":
        """Some of the models."""
        return StateSpace(*(getattr(self, field.name)[..., columns] for field in fields(self)))


def state_space(form: Form, values: FloatArray, step: Seconds) -> StateSpace:
    """The model for (B, P) sets of its unknowns, in the order and the units of `coordinates`."""
    alpha, alpha_tau, beta, deviation, memory, rise, gap, speed, leader = values[:, :9].T
    further = coordinates(form)[len(COMMON) :]
    terms = {term.name: column for term, column in zip(further, values[:, 9:].T, strict=True)}
    count = len(values)
    size = 6 + ("lag" in terms) + 2 * ("delay" in terms)
    rates, density, covariance = (np.zeros((count, size, size)) for _ in range(3))
    p, v, u, r, w, a = range(6)

    rates[:, p, u], rates[:, p, v] = 1.0, -1.0
    density[:, p, p] = GAP_DRIFT
    command = np.zeros((count, size))
    command[:, p], command[:, v], command[:, u] = alpha, -alpha_tau - beta, beta
    add_command(rates, command, v, 6, terms.get("lag", 0.0), terms.get("delay", 0.0))
    rates[:, v, r] += 1.0
    rates[:, r, r], rates[:, r, w] = -1.0 / rise, 1.0 / rise
    rates[:, w, w] = -1.0 / memory
    # Stationary: r has the deviation that is asked for, w is larger by what the rise smooths.
    white = deviation**2 * (memory + rise) / memory
    density[:, w, w] = 2.0 * white / memory
    rates[:, u, a] = 1.0
    rates[:, a, a] = -1.0 / LEADER_MEMORY
    density[:, a, a] = 2.0 * leader**2 / LEADER_MEMORY

    covariance[:, range(3), range(3)] = np.square(FIRST)
    if size > 6:
        # What has not yet passed the lag or the delay is about the command.
        scale = terms["delay"] ** 2 / 12.0 if "delay" in terms else np.ones(count)
        tied = scale[:, None] * command[:, :3] * np.square(FIRST)
        covariance[:, 6, :3] = covariance[:, :3, 6] = tied
        spread = np.einsum("bi,bi->b", tied, command[:, :3]) / scale
        covariance[:, 6, 6] = scale**2 * (spread + USUAL_COMMAND**2)
        if "delay" in terms:
            covariance[:, 7, 7] = (USUAL_COMMAND * terms["delay"] / 6.0) ** 2
    covariance[:, r, r] = covariance[:, r, w] = covariance[:, w, r] = deviation**2
    covariance[:, w, w] = white
    covariance[:, a, a] = leader**2

    transition, process = discretise(rates, density, step)
    return StateSpace(
        transition=_last(transition),
        process=_last(process),
        noise=np.stack([gap, speed, speed]) ** 2,
        shift=terms.get("s0", np.zeros(count)),
        first=np.zeros((size, count)),
        first_covariance=_last(covariance),
        rates=_last(rates),
    )


def discretise(
    rates: FloatArray, density: FloatArray, step: Seconds
) -> tuple[FloatArray, FloatArray]:
    """Transition and added covariance of a step, from d/dt of the states and their noise's density.

    All are (B, n, n). Both are Taylor series over a short part of the step, which is then doubled.
    The part is so short for the stiffest model that further terms would add less than 1e-11.
    """
    fourth = np.abs(np.linalg.matrix_power(rates, 4)).sum(axis=1)
    reach = step * fourth.max(initial=0.0, where=np.isfinite(fourth)) ** 0.25
    doublings = max(0, int(np.frexp(reach / SHORT)[1]))
    step /= 2.0**doublings
    transition = np.zeros_like(rates) + np.eye(rates.shape[1])
    process = np.zeros_like(rates)
    power, added = transition.copy(), density * step
    for term in range(1, TERMS_TAKEN + 1):
        power = rates @ power
        power *= step / term
        transition += power
        process += added
        moved = rates @ added
        added = moved + moved.transpose(0, 2, 1)
        added *= step / (term + 1)
    for _ in range(doublings):
        back = np.ascontiguousarray(transition.transpose(0, 2, 1))
        process += transition @ process @ back
        transition = transition @ transition
    return transition, (process + process.transpose(0, 2, 1)) / 2


def _last(stacked: FloatArray) -> FloatArray:
    """(n, n, B) from (B, n, n), in whose order in memory it stays: the filter reads it fastest."""
    return np.moveaxis(stacked, 0, -1)
