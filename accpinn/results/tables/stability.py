"""String stability as tables in the manner of the paper's Table III, with the exact L∞ gain."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from accpinn.channels import FREQUENCY, LINF_GAIN, MAGNITUDE, PARAMETER_KEYS
from accpinn.inference.intervals import Interval, Uncertainty
from accpinn.model.cthp import Parameters
from accpinn.model.published import ParameterSet
from accpinn.platoon.simulation import PlatoonRun
from accpinn.results.tables.estimates import (
    driver_cells,
    parameter_cells,
    probability_cells,
    supported_columns,
)
from accpinn.results.tables.table import (
    Cell,
    Column,
    Filled,
    Table,
    estimate_cells,
    percent_cells,
    range_cells,
)
from accpinn.stability.measured_gain import MeasuredGain
from accpinn.stability.report import Assessment, StabilityReport, Verdict, assessment
from accpinn.units import FloatArray

L2, LINF = "L₂ string stability", "L∞ string stability"
PEAK = Column("Peak", "dB", MAGNITUDE.digits, L2)
PEAK_AT = Column("at ω", FREQUENCY.unit, FREQUENCY.digits, L2)
GAIN = Column.of(LINF_GAIN, LINF, key="linf_gain")
HEADWAY = "Smallest stable τ"
WORDS: Mapping[Assessment, str] = {
    "unstable": "unstable",
    "stable": "stable",
    "open": "undecided",
    "not determined": "not determined",
}
"""The posterior's verdict on a vehicle, as a cell has it."""


def stability_table(
    vehicles: ParameterSet, report: StabilityReport, uncertainty: Uncertainty | None = None
) -> Table:
    """One row a vehicle: parameters, verdicts, peak, crossover, exact gain, smallest headways.

    Args:
        vehicles: names and parameters.
        report: theirs.
        uncertainty: of the fit that they are from; adds the probabilities of string stability.
    """
    assessed = report.vehicles
    headways = [vehicle.smallest_tau for vehicle in assessed]
    return Table.of(
        f"String stability, {vehicles.title}",
        [
            *_heads(vehicles, report, uncertainty),
            *_probability(L2, uncertainty.probability_l2 if uncertainty else None),
            (Column("Stable", group=L2), [answer(v.l2) for v in assessed]),
            (PEAK, [v.peak.db for v in assessed]),
            (PEAK_AT, [v.peak.omega or None for v in assessed]),
            (replace(PEAK_AT, title="Amplified below"), [v.crossover for v in assessed]),
            *_probability(LINF, uncertainty.probability_linf if uncertainty else None),
            (Column("Paper's criterion", group=LINF), [answer(v.linf_paper) for v in assessed]),
            (Column("Exact criterion", group=LINF), [answer(v.linf_exact) for v in assessed]),
            (GAIN, [v.linf_gain for v in assessed]),
            (Column("L₂", "s", 2, HEADWAY), [h.l2 if h else None for h in headways]),
            (Column("L∞", "s", 2, HEADWAY), [h.linf_exact if h else None for h in headways]),
        ],
    )


def without_parameters(table: Table) -> Table:
    """A `stability_table` without α, β and τ, where these stand elsewhere."""
    return table.only(lambda column: column.key not in PARAMETER_KEYS)


def _heads(
    vehicles: ParameterSet, report: StabilityReport, uncertainty: Uncertainty | None
) -> Iterator[Filled]:
    """The vehicles, who drives them, and their parameters."""
    yield Column("Vehicle"), vehicles.labels
    yield from driver_cells(vehicles.drivers)
    parameters = Parameters.stack(vehicle.parameters for vehicle in report.vehicles)
    yield from parameter_cells(parameters, columns=supported_columns(uncertainty))


def verdict_table(
    vehicles: ParameterSet, report: StabilityReport, uncertainty: Uncertainty | None = None
) -> Table:
    """One row a vehicle, fit for a narrow page: parameters, and by each norm gain and verdict.

    With an uncertainty the verdicts are those of the posterior, and gains have their intervals.

    Args:
        vehicles: names and parameters.
        report: theirs.
        uncertainty: of the fit that they are from.
    """
    assessed, known = report.vehicles, uncertainty
    peaks, gains = [v.peak.db for v in assessed], [v.linf_gain for v in assessed]
    decibels = _decibels(known.peak_gain) if known else None
    l2, linf = (known.probability_l2, known.probability_linf) if known else (None, None)
    return Table.of(
        "",
        [
            *_heads(vehicles, report, known),
            *_probability(L2, l2),
            (Column("Verdict", group=L2), _verdicts(l2, [v.l2 for v in assessed])),
            (PEAK, _with_ends(peaks, decibels)),
            (PEAK_AT, [v.peak.omega or None for v in assessed]),
            *_probability(LINF, linf),
            (Column("Verdict", group=LINF), _verdicts(linf, [v.linf_exact for v in assessed])),
            (GAIN, _with_ends(gains, known.linf_gain if known else None)),
        ],
    )


def _verdicts(shares: FloatArray | None, verdicts: Sequence[Verdict]) -> list[str]:
    """By the posterior where it is known, else by the criterion."""
    if shares is not None:
        return [WORDS[assessment(share)] for share in shares.tolist()]
    return [
        ("stable" if verdict.stable else "unstable") + (", marginal" if verdict.marginal else "")
        for verdict in verdicts
    ]


def _with_ends(values: Sequence[float], ends: Interval | None) -> Sequence[Cell]:
    """Values with their intervals, where these are known."""
    return values if ends is None else estimate_cells(values, ends.lower, ends.upper)


def _decibels(gain: Interval) -> Interval:
    with np.errstate(divide="ignore"):  # minus infinity where nothing passes
        return Interval(20 * np.log10(gain.lower), 20 * np.log10(gain.upper))


def _probability(group: str, shares: FloatArray | None) -> Iterator[Filled]:
    if shares is not None:
        yield Column("Probability", "%", 0, group), percent_cells(shares)


def stability_interval_table(vehicles: ParameterSet, uncertainty: Uncertainty) -> Table:
    """One row a vehicle: intervals of peak, crossover and gain; probability of stability."""
    percent = f"{100 * uncertainty.level:.0f} % interval"
    ranges = (
        (replace(PEAK, title="Peak of |H|", group=percent), _decibels(uncertainty.peak_gain)),
        (replace(PEAK_AT, title="Amplified below", group=percent), uncertainty.crossover),
        (Column("‖h‖₁", "", 2, percent), uncertainty.linf_gain),
    )
    return Table.of(
        f"Uncertainty of string stability, {vehicles.title}",
        [
            (Column("Vehicle"), vehicles.labels),
            *((column, range_cells(ends.lower, ends.upper)) for column, ends in ranges),
            *probability_cells(uncertainty),
        ],
    )


def amplitude_table(run: PlatoonRun, labels: Sequence[str] = ()) -> Table:
    """One row a vehicle, leader first: behind a sinusoid amplitudes, and else largest deviations.

    A vehicle that collides, and each one behind it, has no amplitude and no smallest gap.

    Args:
        run: a simulated platoon.
        labels: (M+1,) of the vehicles; by default their places.
    """
    waves, driving, followers = run.amplitudes, run.survivors, len(run.minimum_gap)
    labels = labels or ["Leader", *(f"Follower {k + 1}" for k in range(followers))]
    sizes: list[Filled] = [(Column("Largest deviation", "m/s", 2), run.largest_deviation)]
    if waves:
        alive = np.arange(followers + 1) < driving
        sizes = [
            (Column("Amplitude", "m/s", 3), np.where(alive, waves.measured, np.nan)),
            (Column("Predicted", "m/s", 3), waves.predicted),
        ]
    gaps = [None, *np.where(np.arange(followers) + 1 < driving, run.minimum_gap, np.nan)]
    return Table.of(
        "", [(Column("Vehicle"), labels), *sizes, (Column("Smallest gap", "m", 2), gaps)]
    )


def measured_gain_table(label: str, measured: MeasuredGain) -> Table:
    """One row a frequency: the gain measured by Welch's method, its band and the coherence."""
    return Table.of(
        f"Measured gain, {label}",
        [
            (Column.of(FREQUENCY), measured.omega),
            (Column("Gain", "", 3), estimate_cells(measured.gain, measured.lower, measured.upper)),
            (Column("Coherence", "", 3), measured.coherence),
        ],
    )


def answer(verdict: Verdict) -> str:
    """YES or NO as the paper prints it; marginal cases are named."""
    word = "YES" if verdict.stable else "NO"
    return f"{word}, marginal" if verdict.marginal else word
