"""A car-following model: an acceleration with named parameters, and all that follows from it.

A model is an acceleration f(p, v, u; θ) of the space-gap p [m], the own speed v [m/s] and the speed
ahead u [m/s], with names, units, bounds and typical values of its parameters θ:

    equilibrium     f(p_e, v, v) = 0, and the time gap p_e / v
    linearisation   δp' = δu - δv,   δv' = f_p δp + f_v δv + f_u δu      at (p_e, v, v)
    response        H(s) = (f_u s + f_p) / (s² - f_v s + f_p)

That is a CTHP with α = f_p, β = f_u and τ = -(f_v + f_u) / f_p, so whatever is known of the CTHP's
string stability holds for every model at a stated speed. Derivatives are exact: by the complex step
f(x + ih) = f(x) + ih f'(x) with h = 1e-30 nothing cancels.

A term may stand between the command c = f and the acceleration dv/dt:

    lag λ [s]      λ d²v/dt² + dv/dt = c
    delay d [s]    dv/dt = c a time d ago; where states are needed, its Padé approximant
                   e^(-ds) ≈ (1 - ds/2 + d²s²/12) / (1 + ds/2 + d²s²/12),
                   whose phase is right within 1 % up to ωd = 2

Simulations integrate f by the classical Runge-Kutta method with a fixed step, which is divided
where it would diverge beside a short lag or delay. Complex parameters give exact derivatives of a
simulation by the same integration.

Sources: Wilson and Ward, Transportation Planning and Technology 34 (2011) 3-18, for linearisation
and stability; Squire and Trapp, SIAM Review 40 (1998) 110-112, for the complex step.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from math import ceil
from types import ModuleType
from typing import Any

import numpy as np

from accpinn.errors import ParameterError
from accpinn.model.cthp import TERMS, Parameters, Term, Trajectories
from accpinn.units import FloatArray, Metres, MetresPerSecond, Seconds

Acceleration = Callable[[Any, Any, Any, Any, ModuleType | Any], Any]
"""f(p, v, u, θ, xp) in m/s²: p, v, u and each of θ are arrays of one library or plain numbers, and
xp is that library (numpy or torch). Only operators and functions of xp that both have, and that
have a derivative for complex numbers (sqrt, exp, log, tanh; no abs, no maximum), may be used."""
Values = Sequence[float] | FloatArray
"""(n,) parameters of one vehicle."""
COMPLEX_STEP = 1e-30
HALVINGS = 60
"""Number of times that the interval of an equilibrium is halved: to all digits of a number."""
STEP: Seconds = 0.4
"""Longest step of a simulation."""
STABLE = 2.0
"""Longest step by the time constant of a lag or a delay; beyond 2.7 the method diverges."""
SHORTEST: Seconds = 0.01
"""Shortest lag or delay for which a step is divided."""
WIDEST: Metres = 2000.0
"""Gap beyond which no equilibrium is looked for."""


@dataclass(frozen=True)
class Parameter:
    """One parameter of a model; its prior is log-normal, or normal where it may be negative."""

    name: str
    """In files, documents and on the command line."""
    symbol: str
    unit: str
    lower: float
    upper: float
    typical: float
    """The median of the prior, from which searches start."""
    spread: float
    """The prior's standard deviation: of the logarithm, or of the value where ``lower`` < 0."""

    @property
    def is_positive(self) -> bool:
        """Whether it is positive, so that the prior is log-normal."""
        return self.lower > 0

    @property
    def heading(self) -> str:
        """Its symbol, with its unit in brackets where it has one."""
        return f"{self.symbol} [{self.unit}]" if self.unit else self.symbol

    def value(self, z: Any, xp: ModuleType | Any = np) -> Any:
        """The parameter that lies z standard deviations of the prior above its median."""
        if self.is_positive:
            return self.typical * xp.exp(self.spread * z)
        return self.typical + self.spread * z

    def score(self, value: Any) -> Any:
        """The z of a value."""
        if self.is_positive:
            return np.log(value / self.typical) / self.spread
        return (value - self.typical) / self.spread


LAG = Parameter("lag", "λ", "s", 0.15, 3.0, 0.4, 0.5)
DELAY = Parameter("delay", "d", "s", 0.15, 3.0, 0.6, 0.5)
TERM_RANGES: dict[Term, tuple[float, float]] = {
    "s0": (-30.0, 60.0), "lag": (0.05, 3.0), "delay": (0.05, 3.0),
}  # fmt: skip
"""Least and largest s₀ in m, λ and d in s beside the CTHP, in its likelihood and where fixed."""


@dataclass(frozen=True)
class FollowingModel:
    """A car-following model: all that is its own, which the rest of the package asks of it.

    Its instances are the entries of `model.registry`; those of the CTHP are `ConstantTimeHeadway`.
    """

    key: str
    """Its name on the command line and in files."""
    title: str
    """Its name for people."""
    parameters: tuple[Parameter, ...]
    """In the order of θ; those of a lag and a delay are last."""
    acceleration: Acceleration
    """See `Acceleration`; it is given the whole θ."""
    terms: tuple[Term, ...] = ()
    """Terms beside the CTHP's α, β, τ; a lag or a delay between f and the acceleration is last."""
    formula: str = ""
    """f in symbols, for people: of p, v, Δv = u - v and the parameters' symbols."""
    meaning: str = ""
    """What parameters say of a vehicle, in a few words with their names in braces: "eases off {q}
    times as hard as it closes up"."""

    @property
    def is_linear(self) -> bool:
        """Whether it is a CTHP: the same at every speed, with exact solutions and likelihood."""
        return False

    @property
    def nonlinear_count(self) -> int:
        """The number of parameters that stand in `Parameters.nonlinear`; 0 for a CTHP."""
        return len(self.parameters)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the parameters."""
        return tuple(parameter.name for parameter in self.parameters)

    @property
    def typical(self) -> FloatArray:
        """(n,) θ at its typical values."""
        return np.array([parameter.typical for parameter in self.parameters])

    def values_at(self, z: Any) -> FloatArray:
        """(n, ..) θ at scores z (.., n), in standard deviations of the priors."""
        return np.array([p.value(z[..., k]) for k, p in enumerate(self.parameters)])

    @property
    def is_late(self) -> bool:
        """Whether a lag or a delay stands between f and the acceleration."""
        return self.terms[-1:] in (("lag",), ("delay",))

    @property
    def fixable(self) -> dict[str, tuple[float, float]]:
        """The parameters that may keep a given value, with its least and largest."""
        return {p.name: (p.lower, p.upper) for p in self.parameters}

    @property
    def equation(self) -> str:
        """The equation of motion in symbols; without a formula the model's name stands for f."""
        left = "λ d²v/dt² + dv/dt" if "lag" in self.terms else "dv/dt"
        later = " (a time d later)" if "delay" in self.terms else ""
        return f"{left}{later} = {self.formula or self.title.partition(' with ')[0]}"

    def behind_a(self, term: Term) -> "FollowingModel":
        """The model with a lag or a delay between f and the acceleration."""
        added = {"lag": (LAG, "lag λ"), "delay": (DELAY, "delay d")}[term]
        joined = "and" if " with " in self.title else "with"
        return replace(
            self,
            key=f"{self.key}-{term}",
            title=f"{self.title} {joined} {added[1]}",
            parameters=(*self.parameters, added[0]),
            terms=(*self.terms, term),
        )

    def term(self, theta: Any, name: Term) -> Any:
        """A term beside α, β, τ, as a lag in s; 0 where the model has none."""
        return theta[self.names.index(name)] if name in self.terms else 0.0

    def equilibrium_gaps(self, theta: Any, speed: Any) -> FloatArray:
        """(..) the gap p_e in m that is kept at a constant speed (..) in m/s; nan without one."""
        theta = np.asarray(theta, float)
        shape = np.broadcast_shapes(theta.shape[1:], np.shape(speed))

        def excess(gap: FloatArray) -> FloatArray:
            with np.errstate(all="ignore"):  # absurd parameters have no equilibrium
                pushed = self.acceleration(gap, speed, speed, theta, np)
            return np.asarray(np.broadcast_to(pushed, np.broadcast_shapes(gap.shape, shape)))

        ends = np.geomspace(1e-3, WIDEST, 60)
        signs = np.sign(excess(ends.reshape(-1, *(1 for _ in shape))))
        rises = (signs[:-1] <= 0) & (signs[1:] > 0)
        at = rises.argmax(axis=0)
        low, high = ends[at], ends[at + 1]
        for _ in range(HALVINGS):
            middle = (low + high) / 2
            above = excess(middle) > 0
            low, high = np.where(above, low, middle), np.where(above, middle, high)
        return np.where(rises.any(axis=0), (low + high) / 2, np.nan)

    def linearisations(self, theta: Any, speed: Any) -> Parameters:
        """(..) the CTHP, lag and delay included, that the model is near equilibrium at a speed.

        Its s₀ makes the equilibrium gap s₀ + τv. The parameters (n, ..) stand in
        `Parameters.nonlinear`; those without an equilibrium at the speed (..) have nan.
        """
        gap, slopes = self.equilibrium_gaps(theta, speed), []
        with np.errstate(all="ignore"):  # where there is no equilibrium
            for moved in COMPLEX_STEP * 1j * np.eye(3):
                p, v, u = gap + moved[0], speed + moved[1], speed + moved[2]
                slopes.append(np.imag(self.acceleration(p, v, u, theta, np)) / COMPLEX_STEP)
            by_gap, by_speed, by_ahead = slopes
            tau = -(by_speed + by_ahead) / by_gap
        terms = (self.term(theta, "lag"), self.term(theta, "delay"))
        return Parameters(by_gap, by_ahead, tau, gap - tau * speed, *terms, *theta)

    def linearised(self, theta: Values, speed: MetresPerSecond) -> Parameters:
        """The CTHP that one vehicle (n,) is near equilibrium at a speed; see `linearisations`.

        Raises:
            ParameterError: where there is no equilibrium, as above the IDM's desired speed.
        """
        near = self.linearisations(theta, speed)
        if np.isnan(near.s0):
            raise ParameterError(
                f"{self.title}: these parameters have no equilibrium at {speed:.1f} m/s; choose"
                " another speed."
            )
        return near

    def has_terms_of(self, parameters: Parameters) -> bool:
        """Whether it has all terms that parameters have, so that each has the same meaning."""
        return bool(parameters.nonlinear.shape[-1] == len(self.parameters))

    def simulate(
        self,
        theta: Any,
        time: FloatArray,
        leader_speed: FloatArray,
        initial_speeds: FloatArray,
        initial_gaps: FloatArray,
        substeps: int = 1,
    ) -> Trajectories:
        """Simulate a platoon in closed loop: only the leader's speed is given.

        A follower that collides drives on through the vehicle ahead. The arguments are those of
        `cthp.simulate`, but parameters (n,) of all followers or (n, M) of each, and ``substeps``,
        the number of steps of the integration between two samples.
        """
        theta = np.asarray(theta, float).reshape(len(self.parameters), -1)
        sample_time = (time[-1] - time[0]) / (len(time) - 1)
        substeps = max(substeps, ceil(sample_time / STEP - 1e-9))
        fine = np.linspace(time[0], time[-1], 2 * substeps * (len(time) - 1) + 1)
        leader = np.interp(fine, time, leader_speed)
        step = sample_time / substeps
        moved = self.integrate(theta, leader, initial_gaps, initial_speeds, step)[::substeps]
        speeds = np.column_stack([np.asarray(leader_speed, float), moved[:, 1]])
        return Trajectories(np.asarray(time, float), speeds, moved[:, 0])

    def integrate(self, theta: Any, ahead: Any, gaps: Any, speeds: Any, step: Seconds) -> Any:
        """Gaps and speeds by the classical Runge-Kutta method, of platoons of M vehicles at once.

        Args:
            theta: (n, M, ..) or what broadcasts so; complex parameters give derivatives.
            ahead: (2K+1, ..) speed ahead of the first vehicle at every half step, in m/s.
            gaps: (M, ..) in m, at first.
            speeds: (M, ..) in m/s, at first.
            step: in s.

        Returns:
            (K+1, 2, M, ..) gaps and speeds; what diverges is not finite.
        """
        if (divided := self._divided(theta, step)) > 1:
            from scipy.interpolate import interp1d  # takes most of a second

            at = np.linspace(0.0, len(ahead) - 1.0, divided * (len(ahead) - 1) + 1)
            fine = interp1d(np.arange(len(ahead)), ahead, axis=0, copy=False)(at)
            return self.integrate(theta, fine, gaps, speeds, step / divided)[::divided]
        parts = np.broadcast_arrays(gaps, speeds, theta[0], ahead[0][None])
        start = np.zeros((2 + ("lag" in self.terms) + 2 * ("delay" in self.terms), *parts[0].shape))
        state = start.astype(np.result_type(*theta, ahead, gaps))
        state[:2] = parts[:2]
        command = self._command(theta, state, ahead[0])
        if "delay" in self.terms:
            state[2] = command * self.term(theta, "delay") ** 2 / 12.0
        if "lag" in self.terms:
            state[-1] = command
        moved = np.empty((len(ahead) // 2 + 1, 2, *state.shape[1:]), state.dtype)
        moved[0] = state[:2]
        with np.errstate(all="ignore"):  # what diverges is the caller's to judge
            for now in range(len(moved) - 1):
                first, middle, last = ahead[2 * now : 2 * now + 3]
                k1 = self._rates(theta, state, first)
                k2 = self._rates(theta, state + k1 * (step / 2), middle)
                k3 = self._rates(theta, state + k2 * (step / 2), middle)
                k4 = self._rates(theta, state + k3 * step, last)
                state = state + (2.0 * (k2 + k3) + k1 + k4) * (step / 6)
                moved[now + 1] = state[:2]
        return moved

    def _divided(self, theta: Any, step: Seconds) -> int:
        """The number of parts into which a step is divided so that no filter diverges."""
        if not self.is_late:
            return 1
        late = np.real(theta[-1])  # nan of a follower that is not determined
        shortest = max(float(np.min(late, initial=np.inf, where=late > 0.0)), SHORTEST)
        pole = 1.0 if "lag" in self.terms else 12.0**0.5  # by the inverse of the lag or the delay
        return ceil(step * pole / shortest / STABLE - 1e-9)

    def _command(self, theta: Any, state: Any, leader: Any) -> Any:
        return self.acceleration(state[0], state[1], _ahead(state, leader), theta, np)

    def _rates(self, theta: Any, state: Any, leader: Any) -> Any:
        """Time derivatives of gap, speed, the delay's two states and the lag's acceleration."""
        rates = np.empty_like(state)
        np.subtract(_ahead(state, leader), state[1], out=rates[0])
        reached = self._command(theta, state, leader)
        if "delay" in self.terms:
            delay = self.term(theta, "delay")
            rates[2] = state[3]
            rates[3] = reached - 12.0 / delay**2 * state[2] - 6.0 / delay * state[3]
            reached = reached - 12.0 / delay * state[3]
        if "lag" in self.terms:
            rates[-1] = (reached - state[-1]) / self.term(theta, "lag")
            reached = state[-1]
        rates[1] = reached
        return rates


class ConstantTimeHeadway(FollowingModel):
    """A CTHP: α, β, τ and its terms are the parameters of `Parameters` themselves.

    It is the same at every speed, and `model.cthp` has its exact solutions.
    """

    @property
    def is_linear(self) -> bool:
        """See `FollowingModel.is_linear`."""
        return True

    @property
    def nonlinear_count(self) -> int:
        """See `FollowingModel.nonlinear_count`."""
        return 0

    @property
    def fixable(self) -> dict[str, tuple[float, float]]:
        """See `FollowingModel.fixable`."""
        return {term: TERM_RANGES[term] for term in self.terms}

    def linearisations(self, theta: Any, speed: Any) -> Parameters:
        """(..) the parameters themselves at every speed (..); see `FollowingModel`."""
        shape = np.broadcast_shapes(np.shape(theta)[1:], np.shape(speed))
        complete = *theta[:3], *(self.term(theta, name) for name in TERMS)
        return Parameters(*(np.broadcast_to(value, shape) for value in complete))

    def has_terms_of(self, parameters: Parameters) -> bool:
        """See `FollowingModel.has_terms_of`."""
        used = parameters.complete[..., 3:].reshape(-1, len(TERMS)).any(axis=0)
        missing = [term not in self.terms for term in TERMS]
        return parameters.is_linear and not bool((used & np.array(missing)).any())


def _ahead(state: Any, leader: Any) -> Any:
    """(M, ..) the speed ahead of each vehicle."""
    if state.shape[1] == 1:
        return leader
    first = np.broadcast_to(leader, state[1, :1].shape)
    return np.concatenate([first, state[1, :-1]])
