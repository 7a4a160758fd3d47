"""The answer on string stability in words: who amplifies, how much, and how certain that is."""

from math import isinf, isnan

from accpinn.inference.intervals import SYMBOLS, Uncertainty
from accpinn.model.published import ParameterSet
from accpinn.results.tables.table import between
from accpinn.stability.report import StabilityReport

NUMBERS = ("no", "one", "two", "three", "four", "five", "six", "seven", "eight", "nine", "ten")
CERTAIN = 0.95
"""A verdict is certain if so large a share of the posterior samples agree with it."""


def amplification(chosen: ParameterSet, report: StabilityReport) -> str:
    """How many vehicles amplify disturbances, and which most, in a sentence.

    Args:
        chosen: the vehicles' names and parameters.
        report: theirs.
    """
    who = [k for k, vehicle in enumerate(report.vehicles) if not vehicle.l2.stable]
    count, total = len(who), len(chosen)
    if not who:
        growing = any(not vehicle.linf_exact.stable for vehicle in report.vehicles)
        peaks = " But peaks can still grow: see the L∞ gain." if growing else ""
        if total == 1:
            return f"{_capital(chosen.spoken[0])} does not amplify any frequency.{peaks}"
        return f"None of the vehicles amplifies any frequency.{peaks}"
    worst = max(who, key=lambda k: report.vehicles[k].peak.gain)
    peak, name = report.vehicles[worst].peak, chosen.spoken[worst]
    extent = "without limit" if isinf(peak.gain) else f"up to {peak.gain:.3g} times"
    most = f"{extent} at {peak.omega:.3g} rad/s"
    if total == 1:
        return f"{_capital(name)} amplifies disturbances {most}."
    if count == 1:
        return f"One of {_number(total)} vehicles amplifies disturbances: {name}, {most}."
    start = f"All {_number(total)}" if count == total else f"{_number(count)} of {_number(total)}"
    return f"{_capital(start)} vehicles amplify disturbances, {name} the most: {most}."


def certainty(chosen: ParameterSet, report: StabilityReport, uncertainty: Uncertainty) -> str:
    """The interval of the largest peak, and which verdicts are not certain.

    Args:
        chosen: the vehicles' names and parameters.
        report: theirs.
        uncertainty: of the fit that the parameters are from.
    """
    worst = max(range(len(chosen)), key=lambda k: report.vehicles[k].peak.gain)
    unsure = [k for k in range(len(chosen)) if not _is_certain(report, uncertainty, k)]
    parts = (
        _extent(chosen, report, uncertainty, worst),
        _outside(chosen, uncertainty),
        _shares(chosen, uncertainty, unsure),
    )
    return " ".join(part for part in parts if part)


def _is_certain(report: StabilityReport, uncertainty: Uncertainty, k: int) -> bool:
    stable, gapless = float(uncertainty.probability_l2[k]), float(uncertainty.gapless[k])
    agreeing = stable if report.vehicles[k].l2.stable else 1.0 - stable - gapless
    return agreeing >= CERTAIN


def _extent(chosen: ParameterSet, report: StabilityReport, uncertainty: Uncertainty, k: int) -> str:
    if isnan(uncertainty.probability_l2[k]):
        return f"The data do not determine whether {chosen.spoken[k]} amplifies disturbances."
    peak = uncertainty.peak_gain
    interval = between(float(peak.lower[k]), float(peak.upper[k]), 2)
    gain, level = report.vehicles[k].peak.gain, 100 * uncertainty.level
    return f"Peak gain of the estimate: {gain:.3g}; {level:.0f} % interval: {interval}."


def _outside(chosen: ParameterSet, uncertainty: Uncertainty) -> str:
    """Which estimates lie outside their intervals."""
    parts = []
    for name, row in zip(chosen.spoken, uncertainty.inside, strict=True):
        symbols = [symbol for symbol, inside in zip(SYMBOLS, row, strict=True) if not inside]
        if symbols:
            whose = f" of {name}" if len(chosen) > 1 else ""
            parts.append(f"{' and '.join(symbols)}{whose}")
    return f"Estimates outside their intervals: {'; '.join(parts)}." if parts else ""


def _shares(chosen: ParameterSet, uncertainty: Uncertainty, unsure: list[int]) -> str:
    """What the posterior samples do, for the vehicles whose verdict is not certain."""
    if not unsure:
        which = "This verdict is" if len(chosen) == 1 else "Each vehicle's verdict is"
        return f"{which} certain: at least {_percent(CERTAIN)} of the posterior samples agree."
    parts = []
    for k in unsure:
        stable, gapless = float(uncertainty.probability_l2[k]), float(uncertainty.gapless[k])
        if isnan(stable):
            continue
        name = f"{chosen.spoken[k]} " if len(chosen) > 1 else ""
        rest = max(0.0, 1.0 - stable - gapless)
        share = f"{name}{_percent(rest)} amplify, {_percent(stable)} do not"
        parts.append(f"{share}, {_percent(gapless)} have no gap control" if gapless else share)
    return f"Not certain. Of the posterior samples: {'; '.join(parts)}." if parts else ""


def _percent(share: float) -> str:
    """A share that is not zero is never printed as zero."""
    return "under 1 %" if 0.0 < share < 0.005 else f"{100 * share:.0f} %"


def _capital(words: str) -> str:
    return words[:1].upper() + words[1:]


def _number(count: int) -> str:
    return NUMBERS[count] if count < len(NUMBERS) else str(count)
