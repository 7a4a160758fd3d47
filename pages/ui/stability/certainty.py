"""How sure the answer is: what the data allow beside what the estimate says."""

from math import isnan

from accpinn.channels import PARAMETERS
from accpinn.inference.intervals import Uncertainty
from accpinn.model.published import ParameterSet
from accpinn.results.tables.table import between
from accpinn.stability.report import StabilityReport
from pages.ui.components.text import escape_markdown

SURE = 0.95
"""If so many of the laws that the data allow have the estimate's verdict, it is certain."""


def certainty(laws: ParameterSet, report: StabilityReport, uncertainty: Uncertainty) -> str:
    """The interval of the largest peak, and which verdicts are not certain, as markdown."""
    worst = max(range(len(laws)), key=lambda k: report.vehicles[k].peak.gain)
    unsure = [k for k in range(len(laws)) if not _sure(report, uncertainty, k)]
    parts = [
        _extent(laws, report, uncertainty, worst),
        _outside(laws, uncertainty),
        _verdicts(laws, uncertainty, unsure),
    ]
    return " ".join(part for part in parts if part)


def _sure(report: StabilityReport, uncertainty: Uncertainty, k: int) -> bool:
    stable, no_gap_control = (
        float(uncertainty.probability_l2[k]),
        float(uncertainty.no_gap_control[k]),
    )
    agreeing = stable if report.vehicles[k].l2.stable else 1.0 - stable - no_gap_control
    return agreeing >= SURE


def _extent(laws: ParameterSet, report: StabilityReport, uncertainty: Uncertainty, k: int) -> str:
    if isnan(uncertainty.probability_l2[k]):
        name = escape_markdown(laws.spoken[k])
        return f"The data do not determine what {name} does to disturbances."
    allowed = between(
        float(uncertainty.peak_gain.lower[k]), float(uncertainty.peak_gain.upper[k]), 2
    )
    gain = report.vehicles[k].peak.gain
    return (
        f"By this estimate {gain:.3g} times; the data allow {allowed}"
        f" ({100 * uncertainty.level:.0f} % interval)."
    )


def _outside(laws: ParameterSet, uncertainty: Uncertainty) -> str:
    """Which estimates the data do not support."""
    parts = []
    for name, row in zip(laws.spoken, uncertainty.inside, strict=True):
        symbols = [one.symbol for one, inside in zip(PARAMETERS, row, strict=True) if not inside]
        if symbols:
            whose = f" of {escape_markdown(name)}" if len(laws) > 1 else ""
            parts.append(f"{' and '.join(symbols)}{whose}")
    if not parts:
        return ""
    return f"The data do not support the estimate's {'; '.join(parts)}."


def _verdicts(laws: ParameterSet, uncertainty: Uncertainty, unsure: list[int]) -> str:
    known = [k for k in unsure if not isnan(uncertainty.probability_l2[k])]
    if not unsure:
        which = "This verdict is" if len(laws) == 1 else "Each vehicle's verdict is"
        return f"{which} certain: at least {_percent(SURE)} of the laws that the data allow agree."
    if not known:
        return ""
    shares = "; ".join(
        (f"{escape_markdown(laws.spoken[k])} " if len(laws) > 1 else "") + _shares(uncertainty, k)
        for k in known
    )
    return f"**Not certain.** Of the laws that the data allow: {shares}."


def _shares(uncertainty: Uncertainty, k: int) -> str:
    """What the laws that the data allow do, as adds up to all of them."""
    stable, no_gap_control = (
        float(uncertainty.probability_l2[k]),
        float(uncertainty.no_gap_control[k]),
    )
    rest = max(0.0, 1.0 - stable - no_gap_control)
    said = f"{_percent(rest)} amplify, {_percent(stable)} do not"
    return f"{said}, {_percent(no_gap_control)} keep no gap (α = 0)" if no_gap_control else said


def _percent(share: float) -> str:
    """As the pages print it; no share is called nothing or all that is not."""
    if 0.0 < share < 0.005:
        return "under 1 %"
    return f"{100 * share:.0f} %"
