"""Vehicles whose string stability is assessed: those of a result, published, or typed in.

Pages, report and command line take vehicles, verdicts, intervals and margins from here, so that
they show the same.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from math import isnan, nan
from typing import Self

import numpy as np

from accpinn.errors import ParameterError
from accpinn.inference.gain_check import GainCheck
from accpinn.inference.intervals import LEVEL, Interval, Uncertainty, from_draws
from accpinn.inference.intervals import growth as growth_band
from accpinn.inference.measured_growth import Growth, different, growth_along
from accpinn.model.cthp import Case, Parameters
from accpinn.model.published import ParameterSet
from accpinn.model.registry import FOLLOWING
from accpinn.platoon.leader import Sinusoid
from accpinn.segment import SegmentInfo
from accpinn.stability import (
    Assessment,
    StabilityReport,
    VehicleStability,
    Verdict,
    assessment,
    stability_report,
)
from accpinn.stability.criteria import response
from accpinn.stability.head_to_tail import head_to_tail_peaks
from accpinn.stability.margin import Margins, NormMargin, l2_margins, margins
from accpinn.stability.modes import Modes, modes
from accpinn.stability.waves import Waves, waves
from accpinn.study.result import Result
from accpinn.units import (
    FloatArray,
    MetresPerSecond,
    Quantity,
    RadiansPerSecond,
    interval_ends,
)

ALL_OF_IT = 0.995
"""Share of the time from which a vehicle counts as driven by hand throughout."""


@dataclass(frozen=True)
class PeakGrowth:
    """The largest gain from the speed ahead of some cars in a row to that of the last of them."""

    gain: Quantity
    """At least 1; the measured one where the recording holds it, else the model's."""
    omega: RadiansPerSecond
    """0 where no frequency is amplified."""
    model: float
    """The model's largest gain."""
    is_measured: bool


@dataclass(frozen=True)
class NormAssessment:
    """The string stability of one vehicle by one norm."""

    assessment: Assessment
    """By the share of posterior samples that are stable, or by the parameters alone."""
    probability: float | None
    """That share; None for a point."""
    gain: Quantity
    """max |H| by L₂ and ‖h‖₁ by L∞: 1 where nothing is amplified, infinite where a disturbance
    grows without limit; all nan where it is not determined."""

    @classmethod
    def of(
        cls,
        verdict: Verdict | None,
        gain: float,
        place: int,
        shares: FloatArray | None = None,
        ends: Interval | None = None,
    ) -> Self:
        """From the verdict and gain of the vehicle in a place, and what samples (M,) say of all.

        The verdict is None where the parameters allow none.
        """
        share = None if shares is None else float(shares[place])
        if verdict is None or (share is not None and isnan(share)):
            return cls("not determined", share, Quantity(nan, nan, nan))
        if share is None or ends is None:
            return cls("stable" if verdict.stable else "unstable", None, Quantity(gain, nan, nan))
        lower, upper = float(ends.lower[place]), float(ends.upper[place])
        return cls(assessment(share), share, Quantity(gain, lower, upper))


@dataclass(frozen=True)
class AssessedVehicle:
    """The string stability of one vehicle, with intervals where it has a posterior."""

    stability: VehicleStability | None
    """That of the parameters; None where they allow none."""
    l2: NormAssessment
    linf: NormAssessment
    """By the exact criterion."""


@dataclass(frozen=True, eq=False)
class AssessedVehicles:
    """Followers with their parameters, whose string stability is assessed."""

    vehicles: ParameterSet
    uncertainty: Uncertainty | None = None
    """That of the vehicles; None for a point."""
    checks: tuple[GainCheck, ...] = ()
    """Their gain beside the measured one; empty for a point."""
    result: Result | None = None
    """The result that they are of; None for parameters that are published or typed in."""
    speed: MetresPerSecond | None = None
    """Speed at which they are linearised, where that is not each vehicle's median speed."""
    origin: str = ""
    """Where they come from, for a page's headline."""
    cars: tuple[tuple[Result, int], ...] = ()
    """(M,) of vehicles of several results: the result of each, and its place there."""
    typed_speeds: tuple[MetresPerSecond, ...] = ()
    """(M,) at which each is linearised whose parameters are typed in, where its model needs one."""

    @cached_property
    def report(self) -> StabilityReport:
        """The stability of each vehicle and the platoon.

        Raises:
            ParameterError: where the parameters allow none.
        """
        return stability_report(self.vehicles.parameters)

    @property
    def has_report(self) -> bool:
        """Whether the parameters allow one."""
        try:
            return bool(self.report)
        except ParameterError:
            return False

    @cached_property
    def assessed(self) -> tuple[AssessedVehicle, ...]:
        """(M,) the string stability of each, also where the parameters of others allow none."""
        if self.has_report:
            return tuple(map(self._assessed, range(len(self.vehicles)), self.report.vehicles))
        found = (_stability_of(parameters) for parameters in self.vehicles.parameters)
        return tuple(map(self._assessed, range(len(self.vehicles)), found))

    def _assessed(self, place: int, stability: VehicleStability | None) -> AssessedVehicle:
        drawn = self.uncertainty
        if stability is None:
            shares = (drawn.probability_l2, drawn.probability_linf) if drawn else (None, None)
            nothing = [NormAssessment.of(None, nan, place, share) for share in shares]
            return AssessedVehicle(None, *nothing)
        l2 = (stability.l2, stability.peak.gain, place)
        linf = (stability.linf_exact, stability.linf_gain, place)
        if drawn is None:
            return AssessedVehicle(stability, NormAssessment.of(*l2), NormAssessment.of(*linf))
        return AssessedVehicle(
            stability,
            NormAssessment.of(*l2, drawn.probability_l2, drawn.peak_gain),
            NormAssessment.of(*linf, drawn.probability_linf, drawn.linf_gain),
        )

    @cached_property
    def margins(self) -> Margins:
        """The time gap that separates each vehicle, and the platoon, from string stability.

        It is that of `Result.margin` where the vehicles are those of one estimate.
        """
        vehicles, uncertainty = self.vehicles, self.uncertainty
        at: MetresPerSecond | FloatArray = self.speed or self.median_speed
        if self.speed is None and self.result:
            at = self.result.assessed_speeds[: len(vehicles)]
        draws, level = (uncertainty.draws, uncertainty.level) if uncertainty else (None, LEVEL)
        return margins(
            vehicles.parameters, at, draws, level, vehicles.labels, vehicles.vehicles[1:]
        )

    def time_gap(self, place: int, speed: MetresPerSecond) -> Quantity:
        """The time gap in s of one vehicle (0 for the first), linearised, at a speed."""
        value = float(self.vehicles.parameters[place].time_gap(speed))
        if self.uncertainty is None:
            return Quantity(value, nan, nan)
        drawn = self.uncertainty.draws[:, place].time_gap(speed)
        lower, upper = interval_ends(drawn, self.uncertainty.level)
        return Quantity(value, float(lower), float(upper))

    @cached_property
    def waves(self) -> Waves | None:
        """The growth of waves by size and direction; None under a CTHP, where all grow alike.

        It is that of `Result.waves` where the vehicles are those of one estimate.
        """
        vehicles, theta = self.vehicles, self.vehicles.parameters.nonlinear
        if not theta.size:
            return None
        speeds = np.full(len(vehicles), self.speed or self.median_speed)
        if self.speed is None and self.result:
            speeds = self.result.estimate.speeds[: len(vehicles)]
        elif self.speed is None and self.typed_speeds:
            speeds = np.array(self.typed_speeds)
        model, numbers = FOLLOWING[vehicles.model], vehicles.vehicles[1:]
        return waves(model, theta, speeds, vehicles.labels, numbers)

    @property
    def l2_margins(self) -> tuple[NormMargin, ...]:
        """(M,) those of `margins` by L₂, which take a tenth of the time."""
        drawn = self.uncertainty
        draws, level = (drawn.draws, drawn.level) if drawn else (None, LEVEL)
        return l2_margins(self.vehicles.parameters, draws, level)

    @property
    def modes(self) -> tuple[Modes, ...]:
        """(M,) poles, damping and settling of each vehicle."""
        return tuple(map(modes, self.vehicles.parameters))

    @property
    def median_speed(self) -> MetresPerSecond:
        """The vehicles' median speed in the recording, or at which they are typed in."""
        if self.result:
            return float(np.median(self.result.estimate.speeds))
        return float(np.median(self.typed_speeds)) if self.typed_speeds else Sinusoid.speed

    def growth(
        self, order: Sequence[int], omega: RadiansPerSecond | None = None
    ) -> Quantity | None:
        """How much a disturbance at ω grows along a platoon, by index of each of its vehicles.

        Without ω, at the frequency at which it grows most. None where no uncertainty is known, or
        a vehicle is not determined.
        """
        if self.uncertainty is None:
            return None
        lower, upper = growth_band(self.uncertainty, tuple(order), omega)
        platoon = self.vehicles.parameters[[*order]]
        at = head_to_tail_peaks(platoon).omega[-1] if omega is None else omega
        gain = np.abs(response(platoon, np.array([at]))).prod()
        return Quantity(float(gain), lower, upper) if np.isfinite(lower) else None

    def measured_growth(self, order: Sequence[int]) -> Growth | None:
        """The growth along a platoon, by index of each of its vehicles, as far as it was measured.

        None where no vehicle was recorded or its posterior is not known, and at another speed than
        the recorded one.
        """
        if self.speed is not None or self.uncertainty is None:
            return None
        if self.result:
            is_shared = self.result.info.shares(self.result.estimate.case)
            if is_shared and len(order) == 1:  # one parameter set stands for all followers
                return None
            return self.result.measured_growth(tuple(order))
        if not self.cars:
            return None
        cars = [self.cars[k] for k in order]
        gains = [
            result.measured_gains[place] if result.segments else None for result, place in cars
        ]
        return growth_along(gains, self.vehicles.parameters[[*order]])

    @cached_property
    def growths(self) -> tuple[PeakGrowth, ...]:
        """(M,) the largest growth behind each vehicle alone."""
        peaks = [v.stability.peak.omega if v.stability else 0.0 for v in self.assessed]
        return tuple(
            self._peak_growth([k], vehicle.l2.gain, omega)
            for k, (vehicle, omega) in enumerate(zip(self.assessed, peaks, strict=True))
        )

    @cached_property
    def platoon_growth(self) -> PeakGrowth:
        """The largest growth from the leader to the last of all vehicles.

        Raises:
            ParameterError: where the parameters of one allow none.
        """
        order, known = tuple(range(len(self.vehicles))), self.uncertainty
        peak = self.report.platoon.peaks[-1]
        ends = growth_band(known, order) if known else (nan, nan)
        return self._peak_growth(order, Quantity(peak.gain, *ends), peak.omega)

    def _peak_growth(
        self, order: Sequence[int], model: Quantity, omega: RadiansPerSecond
    ) -> PeakGrowth:
        """The measured largest growth along some vehicles, or that of their models."""
        growth = self.measured_growth(order)
        if growth and growth.is_peak_measured:
            return PeakGrowth(growth.peak, growth.peak_omega, model.value, True)
        return PeakGrowth(model, omega, model.value, False)

    @cached_property
    def platoon_difference(self) -> float:
        """The share of the frequencies at which the measured platoon differs from its cars' models.

        It is nan where there is nothing to compare.
        """
        order = range(len(self.vehicles))
        growth = self.measured_growth(order)
        if growth is None or self.uncertainty is None or len(order) < 2:
            return np.nan
        return different(growth, self.uncertainty, order)

    def at_speed(self, speed: MetresPerSecond) -> "AssessedVehicles":
        """Vehicles of a model that is no CTHP, and what is known of them, linearised at a speed.

        The measured gain is that of the recorded speeds, so it checks nothing here.

        Raises:
            ParameterError: where a vehicle has no equilibrium there.
        """
        vehicles, uncertainty = self.vehicles, self.uncertainty
        model, theta = FOLLOWING[vehicles.model], vehicles.parameters.nonlinear
        for row in theta:
            model.linearised(row, speed)
        there = replace(vehicles, parameters=model.linearisations(theta.T, speed))
        if uncertainty:
            drawn = model.linearisations(np.moveaxis(uncertainty.draws.nonlinear, -1, 0), speed)
            every = drawn.everything.copy()
            for k in range(every.shape[1]):  # a vehicle has an equilibrium where its estimate has
                is_complete = np.isfinite(every[:, k]).all(axis=1)
                if is_complete.any():
                    every[~is_complete, k] = np.resize(
                        every[is_complete, k], ((~is_complete).sum(), every.shape[2])
                    )
            uncertainty = from_draws(there.parameters, Parameters.of(every), uncertainty.level)
        return replace(self, vehicles=there, uncertainty=uncertainty, checks=(), speed=speed)


def _stability_of(parameters: Parameters) -> VehicleStability | None:
    """The string stability of one vehicle; None where its parameters allow none."""
    try:
        return stability_report(parameters).vehicles[0]
    except ParameterError:
        return None


def where(info: SegmentInfo, case: Case | None = None, windows: Sequence[SegmentInfo] = ()) -> str:
    """The segment in a few words: file, window or windows, regimes excluded, a platoon's Case."""
    seconds = sum(part.window.duration for part in windows)
    several = f"{len(windows)} windows, {seconds:g} s together" if len(windows) > 1 else ""
    parts = [info.source, several or str(info.window)]
    parts += [f"without {', '.join(info.excluded_regimes)}"] if info.excluded_regimes else []
    return ", ".join(parts + ([f"Case {case}"] if case and info.followers > 1 else []))


def by_hand(info: SegmentInfo) -> tuple[float, ...]:
    """(M,) the share of the time that a driver controls each follower; empty where none does."""
    hand = info.driven_by_hand
    if hand is None:
        return ()
    share = dict(zip(hand.vehicles, hand.shares, strict=True))
    return tuple(share.get(number, 0.0) for number in info.vehicles[1:])


def assessed_vehicles(result: Result) -> AssessedVehicles:
    """The followers of an estimate, with the intervals and gain checks that a posterior gives."""
    info, estimate = result.info, result.estimate
    vehicles = ParameterSet(
        where(info, windows=result.infos),
        info.names[1:],
        estimate.parameters,
        info.vehicles,
        info.labels[1:],
        by_hand(info),
        estimate.model,
    )
    return AssessedVehicles(vehicles, result.uncertainty, result.gain_checks, result)


def typed_vehicles(
    title: str, model: str, names: tuple[str, ...], values: FloatArray, speeds: FloatArray
) -> ParameterSet:
    """Followers of parameters that somebody types in, or takes over from a result.

    Args:
        title: of the set.
        model: the key; of a CTHP all terms may stand, whatever it is called.
        names: (M,) of the followers.
        values: (M, 6) α, β, τ, s₀, λ, d of a CTHP, where a term that is missing is 0; or (M, n) the
            parameters of another model.
        speeds: (M,) in m/s, at which another model is linearised.

    Raises:
        ParameterError: naming the follower whose parameters allow nothing.
    """
    following = FOLLOWING[model]
    if following.is_linear:
        terms = np.nan_to_num(values[:, 3:], nan=0.0)
        complete = Parameters.of(np.column_stack([values[:, :3], terms]))
        return ParameterSet(title, names, complete, model=model)
    for name, row, speed in zip(names, values, speeds.tolist(), strict=True):
        for parameter, value in zip(following.parameters, row.tolist(), strict=True):
            if not np.isfinite(value) or (parameter.is_positive and value <= 0):
                more = "a number above 0" if parameter.is_positive else "a number"
                given = "is missing" if np.isnan(value) else f"= {value:g} is not allowed"
                raise ParameterError(f"{name}: {parameter.symbol} {given}; give {more}.")
        if not speed > 0:
            raise ParameterError(
                f"{name}: the speed is missing at which the model is linearised; give one in m/s."
            )
        following.linearised(row, speed)
    return ParameterSet(title, names, following.linearisations(values.T, speeds), model=model)
