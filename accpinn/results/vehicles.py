"""The vehicles of a result where their string stability is shown: the answer, where it is known.

Pages, report and command line take vehicles, verdicts, intervals and the measured gain's word on
them from here, so that they say the same.
"""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from accpinn.errors import ParameterError
from accpinn.inference.answer import Answer
from accpinn.inference.gain_check import GainCheck
from accpinn.inference.intervals import Uncertainty, from_draws
from accpinn.methods.fit import Outcome
from accpinn.model.cthp import Parameters
from accpinn.model.published import ParameterSet
from accpinn.model.registry import FOLLOWING
from accpinn.results.tables.estimates import learned_parameters
from accpinn.stability import StabilityReport, stability_report
from accpinn.study.result import Result
from accpinn.units import MetresPerSecond


@dataclass(frozen=True, eq=False)
class KnownVehicles:
    """Followers whose string stability is shown, and what is known of them."""

    vehicles: ParameterSet
    uncertainty: Uncertainty | None = None
    """That of the vehicles; None for parameters without a recording, and a stopped training."""
    checks: tuple[GainCheck, ...] = ()
    """The measured gain of each that has one; empty for the estimate of a method."""

    @cached_property
    def report(self) -> StabilityReport | None:
        """The stability of each vehicle and the platoon; None where the parameters allow none."""
        try:
            return stability_report(self.vehicles.parameters)
        except ParameterError:
            return None


def at_speed(
    vehicles: ParameterSet, uncertainty: Uncertainty | None, speed: MetresPerSecond
) -> tuple[ParameterSet, Uncertainty | None]:
    """Vehicles of a model that is no CTHP, and what is known of them, linearised at a speed.

    Raises:
        ParameterError: where a vehicle has no equilibrium there.
    """
    model, own = FOLLOWING[vehicles.model], vehicles.parameters.own
    for row in own:
        model.linearised(row, speed)
    there = replace(vehicles, parameters=model.linearisations(own.T, speed))
    if uncertainty is None:
        return there, None
    own = np.moveaxis(uncertainty.draws.own, -1, 0)
    drawn = model.linearisations(own, speed).everything.copy()
    for k in range(drawn.shape[1]):  # a vehicle has an equilibrium where its answer has one
        kept = np.isfinite(drawn[:, k]).all(axis=1)
        drawn[~kept, k] = np.resize(drawn[kept, k], ((~kept).sum(), drawn.shape[2]))
    return there, from_draws(there.parameters, Parameters.of(drawn), uncertainty.level)


def known_vehicles(result: Result) -> KnownVehicles:
    """The answer's followers; those of the method where the answer is not known."""
    vehicles, stored = learned_parameters(result.info, result.fit), result.known_answer
    if len(result.infos) > 1:
        windows = f"{result.info.source}, {len(result.infos)} windows"
        vehicles = replace(vehicles, title=windows)
    if stored and (known := of_answer(vehicles, stored, result.gain_checks)):
        return known
    is_known = result.parts.uncertainty is not None or bool(result.segments)
    stopped = result.fit.outcome is Outcome.STOPPED
    return KnownVehicles(vehicles, result.uncertainty if is_known and not stopped else None)


def of_answer(
    vehicles: ParameterSet, known: Answer, checks: tuple[GainCheck, ...]
) -> KnownVehicles | None:
    """The followers of an answer in place of a method's; None where one is not determined."""
    if not np.isfinite(known.parameters.complete).all():
        return None
    vehicles = replace(vehicles, parameters=known.parameters, model=known.model)
    return KnownVehicles(vehicles, known.uncertainty, checks)
