"""String stability: what a learned controller does to disturbances, from closed forms."""

from accpinn.stability.cascade import Gains
from accpinn.stability.criteria import MARGINAL, Laws
from accpinn.stability.frequency import (
    Peak,
    Peaks,
    peaks,
    response,
    slowest_rate,
    transfer_function,
)
from accpinn.stability.impulse import Swings, impulse_response, swings
from accpinn.stability.maps import (
    Boundaries,
    GainMap,
    boundaries_over_alpha,
    boundaries_over_beta,
    gains_over_alpha,
    gains_over_beta,
)
from accpinn.stability.report import (
    PlatoonStability,
    StabilityReport,
    VehicleStability,
    report,
)
from accpinn.stability.vehicle import Behaviour, Headways, Margins
from accpinn.stability.verdicts import Verdict

__all__ = [
    "MARGINAL",
    "Behaviour",
    "Boundaries",
    "GainMap",
    "Gains",
    "Headways",
    "Laws",
    "Margins",
    "Peak",
    "Peaks",
    "PlatoonStability",
    "StabilityReport",
    "Swings",
    "VehicleStability",
    "Verdict",
    "boundaries_over_alpha",
    "boundaries_over_beta",
    "gains_over_alpha",
    "gains_over_beta",
    "impulse_response",
    "peaks",
    "report",
    "response",
    "slowest_rate",
    "swings",
    "transfer_function",
]
