"""What is judged where a result's string stability is shown: the answer, where it can be known.

Pages, report and command line take vehicles, verdicts, intervals and the measured gain's word on
them from here, so that they say the same.
"""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from accpinn.errors import ParameterError
from accpinn.inference.gain_check import GainCheck
from accpinn.inference.intervals import Uncertainty
from accpinn.methods.fit import Outcome
from accpinn.model.published import ParameterSet
from accpinn.results.tables.estimates import learned_parameters
from accpinn.stability.report import StabilityReport, stability_report
from accpinn.study.result import Result


@dataclass(frozen=True, eq=False)
class Judged:
    """Followers whose string stability is judged, and what is known of them."""

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


def judged(result: Result) -> Judged:
    """The answer's followers; those of the method where the answer is not known."""
    vehicles, stored = learned_parameters(result.info, result.fit), result.known_answer
    if stored and np.isfinite(stored.parameters.complete).all():
        vehicles = replace(vehicles, parameters=stored.parameters)
        return Judged(vehicles, stored.uncertainty, result.gain_checks)
    stopped = result.fit.outcome is Outcome.STOPPED
    return Judged(vehicles, None if stopped else result.uncertainty)
