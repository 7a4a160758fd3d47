"""String stability as tables in the manner of the paper's Table III, with the exact L∞ gain."""

from collections.abc import Iterator

import numpy as np

from accpinn.channels import FREQUENCY, LINF_GAIN, MAGNITUDE
from accpinn.inference.intervals import Interval, Uncertainty
from accpinn.model.cthp import Parameters
from accpinn.model.published import ParameterSet
from accpinn.platoon.simulation import PlatoonRun
from accpinn.results.tables.estimates import (
    PROBABILITY,
    Filled,
    driver_cells,
    parameter_cells,
    supported_columns,
)
from accpinn.results.tables.table import Cell, Column, Range, Table
from accpinn.stability.report import StabilityReport, Verdict
from accpinn.units import FloatArray

L2, LINF = "L₂ string stability", "L∞ string stability"
HEADWAY = "Smallest stable τ"


def stability_table(
    vehicles: ParameterSet, report: StabilityReport, uncertainty: Uncertainty | None = None
) -> Table:
    """One row a vehicle: parameters, verdicts, peak, crossover, exact gain, smallest headways.

    Args:
        vehicles: names and parameters.
        report: theirs.
        uncertainty: of the fit that they are from; adds the probabilities of string stability.
    """
    found = report.vehicles
    headways = [vehicle.smallest_tau for vehicle in found]
    gain = Column(LINF_GAIN.symbol, "", LINF_GAIN.digits, LINF, key="linf_gain")
    frequency, digits = FREQUENCY.unit, FREQUENCY.digits
    return Table.of(
        f"String stability, {vehicles.title}",
        [
            (Column("Vehicle"), vehicles.labels),
            *driver_cells(vehicles.drivers),
            *parameter_cells(
                Parameters.stack(vehicle.parameters for vehicle in found),
                columns=supported_columns(uncertainty),
            ),
            *_probability(L2, uncertainty.probability_l2 if uncertainty else None),
            (Column("Stable", group=L2), [answer(v.l2) for v in found]),
            (Column("Peak", "dB", MAGNITUDE.digits, L2), [v.peak.db for v in found]),
            (Column("at ω", frequency, digits, L2), [v.peak.omega or None for v in found]),
            (Column("Amplified below", frequency, digits, L2), [v.crossover for v in found]),
            *_probability(LINF, uncertainty.probability_linf if uncertainty else None),
            (Column("Paper's criterion", group=LINF), [answer(v.linf_paper) for v in found]),
            (Column("Exact criterion", group=LINF), [answer(v.linf_exact) for v in found]),
            (gain, [v.linf_gain for v in found]),
            (Column("L₂", "s", 2, HEADWAY), [h.l2 if h else None for h in headways]),
            (Column("L∞", "s", 2, HEADWAY), [h.linf_exact if h else None for h in headways]),
        ],
    )


def _probability(group: str, shares: FloatArray | None) -> Iterator[Filled]:
    if shares is not None:
        yield Column("Probability", "%", 0, group), 100 * shares


def stability_interval_table(vehicles: ParameterSet, uncertainty: Uncertainty) -> Table:
    """One row a vehicle: intervals of peak, crossover and gain; probability of stability."""
    percent = f"{100 * uncertainty.level:.0f} % interval"
    l2, linf = 100 * uncertainty.probability_l2, 100 * uncertainty.probability_linf
    with np.errstate(divide="ignore"):  # minus infinity where nothing passes
        decibels = Interval(
            20 * np.log10(uncertainty.peak_gain.lower), 20 * np.log10(uncertainty.peak_gain.upper)
        )
    return Table.of(
        f"Uncertainty of string stability, {vehicles.title}",
        [
            (Column("Vehicle"), vehicles.labels),
            (Column("Peak of |H|", "dB", MAGNITUDE.digits, percent), _ranges(decibels)),
            (
                Column("Amplified below", FREQUENCY.unit, FREQUENCY.digits, percent),
                _ranges(uncertainty.crossover),
            ),
            (Column("‖h‖₁", "", 2, percent), _ranges(uncertainty.linf_gain)),
            (Column("L₂", "%", 0, PROBABILITY), l2),
            (Column("L∞", "%", 0, PROBABILITY), linf),
        ],
    )


def amplitude_table(run: PlatoonRun) -> Table:
    """One row a vehicle, leader first: amplitudes behind a sinusoid, and the smallest gap."""
    waves, followers = run.amplitudes, len(run.minimum_gap)
    assert waves is not None
    return Table.of(
        "",
        [
            (Column("Vehicle"), ["Leader", *(f"Follower {k + 1}" for k in range(followers))]),
            (Column("Amplitude", "m/s", 4), waves.measured),
            (Column("Predicted", "m/s", 4), waves.predicted),
            (Column("Smallest gap", "m", 2), [None, *run.minimum_gap]),
        ],
    )


def answer(verdict: Verdict) -> str:
    """YES or NO as the paper prints it; marginal cases are named."""
    word = "YES" if verdict.stable else "NO"
    return f"{word}, marginal" if verdict.marginal else word


def _ranges(interval: Interval) -> list[Cell]:
    pairs = zip(interval.lower.tolist(), interval.upper.tolist(), strict=True)
    return [Range(low, high) for low, high in pairs]
