"""String stability as tables in the manner of the paper's Table III, with the exact L∞ gain."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import zip_longest
from math import nan

import numpy as np
from numpy.typing import NDArray

from accpinn.channels import FREQUENCY, LINF_GAIN, MAGNITUDE, PARAMETER_KEYS
from accpinn.inference.gain_check import GainCheck
from accpinn.inference.intervals import Interval, Uncertainty
from accpinn.model.cthp import Parameters
from accpinn.model.published import ParameterSet
from accpinn.platoon import PlatoonRun
from accpinn.results.marks import AGAINST
from accpinn.results.tables import (
    Cell,
    Column,
    Filled,
    Marked,
    Table,
    estimates,
    interval_cells,
    percent_cells,
)
from accpinn.segment import Segment
from accpinn.stability import StabilityReport, assessment
from accpinn.stability.margin import l2_margins
from accpinn.stability.measured_gain import MeasuredGain
from accpinn.stability.waves import Waves
from accpinn.study.vehicles import AssessedVehicles
from accpinn.units import FloatArray, Quantity

L2, LINF = "L₂ string stability", "L∞ string stability"
PEAK = Column("Peak", "dB", MAGNITUDE.digits, L2)
PEAK_AT = Column("at ω", FREQUENCY.unit, FREQUENCY.digits, L2)
ABOVE = Column("Amplified above", FREQUENCY.unit, FREQUENCY.digits, L2)
BELOW = Column("Amplified below", FREQUENCY.unit, FREQUENCY.digits, L2)
STABLE, EXACT = Column("Criterion", group=L2), Column("Exact criterion", group=LINF)
GAIN = Column.of(LINF_GAIN, LINF, key="linf_gain")
GAIN_ALONE = Column.of(LINF_GAIN, key="linf_gain")
MARGIN_DIGITS = 4
"""Most decimals of a margin with an interval; of one that is open two less are shown."""
PROBABILITY, VERDICT = "Probability", "Verdict"
HEADWAY = "Smallest stable τ"
MARGIN = Column("Margin", "s", 2, L2, key="margin_l2")


def stability_table(
    vehicles: ParameterSet,
    report: StabilityReport,
    uncertainty: Uncertainty | None = None,
    checks: Sequence[GainCheck] = (),
) -> Table:
    """One row a vehicle: parameters, verdicts, peak, crossover, margin, exact gain, headways.

    The margin is that of the time gap by L₂, see `stability.margin`. An uncertainty adds
    probabilities, the posterior's verdicts, and intervals; a verdict that the measured gain
    contradicts is marked.

    Examples:
        >>> import accpinn
        >>> parameters = accpinn.Parameters([0.08], [0.3], [1.2])
        >>> report = accpinn.stability_report(parameters)
        >>> cars = accpinn.ParameterSet("given", ("A car",), parameters)
        >>> accpinn.stability_table(cars, report).rows[0][0]
        'A car'
    """
    assessed, drawn = report.vehicles, uncertainty
    against = _contradictions(vehicles, checks)
    headways = [vehicle.smallest_tau for vehicle in assessed]
    parameters = Parameters.stack(vehicle.parameters for vehicle in assessed)
    peaks, crossovers = [v.peak.db for v in assessed], [v.crossover for v in assessed]
    bands = [v.onset for v in assessed]  # of few vehicles
    gains = [v.linf_gain for v in assessed]
    margins = l2_margins(parameters, *((drawn.draws, drawn.level) if drawn else ()))
    return Table.of(
        f"String stability, {vehicles.title}",
        [
            (Column("Vehicle"), vehicles.labels),
            *estimates.driver_cells(vehicles.by_hand),
            *estimates.parameter_cells(parameters, uncertainty=drawn, is_brief=True),
            *_posterior(L2, drawn.probability_l2 if drawn else None, against),
            (STABLE, [v.l2.word for v in assessed]),
            (PEAK, _with_ends(peaks, _decibels(drawn.peak_gain) if drawn else None)),
            (PEAK_AT, [v.peak.omega or None for v in assessed]),
            *([(ABOVE, [v.onset or None for v in assessed])] if any(bands) else []),
            (BELOW, _with_ends(crossovers, drawn.crossover if drawn else None)),
            (MARGIN, [_plain(margin.distance) for margin in margins]),
            *_posterior(LINF, drawn.probability_linf if drawn else None),
            (Column("Paper's criterion", group=LINF), [v.linf_paper.word for v in assessed]),
            (EXACT, [v.linf_exact.word for v in assessed]),
            (GAIN, _with_ends(gains, drawn.linf_gain if drawn else None)),
            (Column("L₂", "s", 2, HEADWAY), [h.l2 if h else None for h in headways]),
            (Column("L∞", "s", 2, HEADWAY), [h.linf_exact if h else None for h in headways]),
        ],
    )


def verdicts_part(table: Table) -> Table:
    """A `stability_table` without headways and margin, where a `margin_table` stands beside it."""
    return table.only(lambda column: column.group != HEADWAY and column.key != MARGIN.key)


def criteria_part(table: Table) -> Table:
    """A `stability_table` without α, β and τ, where these stand elsewhere."""
    return table.only(lambda column: column.key not in PARAMETER_KEYS)


def assessment_table(subject: AssessedVehicles) -> Table:
    """The `stability_table` of vehicles, with intervals and marks where these are known."""
    return stability_table(subject.vehicles, subject.report, subject.uncertainty, subject.checks)


def verdict_table(subject: AssessedVehicles) -> Table:
    """The part of `stability_table` that is fit for a narrow page: one verdict and gain a norm."""
    certain = [STABLE.title, EXACT.title] if subject.uncertainty else []
    aside = [ABOVE.title, BELOW.title, MARGIN.title, "Paper's criterion", *certain]
    table = assessment_table(subject)
    narrow = table.only(lambda column: column.title not in aside and column.group != HEADWAY)
    return replace(narrow, caption="")


def modes_table(subject: AssessedVehicles) -> Table:
    """One row a vehicle: its rightmost pole, damping, overshoot, settling and exact L∞ gain."""
    uncertainty, report, modes = subject.uncertainty, subject.report.vehicles, subject.modes
    gains = [vehicle.linf_gain for vehicle in report]
    return Table.of(
        f"Poles and responses, {subject.vehicles.title}",
        [
            (Column("Vehicle"), subject.vehicles.labels),
            (Column("Rightmost pole", "rad/s"), [_pole(motion.poles) for motion in modes]),
            (Column("ζ", "", 2, key="damping_ratio"), [motion.damping_ratio for motion in modes]),
            (
                Column("ωₙ", "rad/s", 3, key="natural_frequency"),
                [motion.natural_frequency for motion in modes],
            ),
            (Column("Overshoot", "%", 0), [100 * vehicle.overshoot for vehicle in report]),
            (
                Column("Settling, 2 %", "s", 1, key="settling"),
                [motion.settling for motion in modes],
            ),
            (GAIN_ALONE, _with_ends(gains, uncertainty.linf_gain if uncertainty else None)),
        ],
    )


def _pole(poles: NDArray[np.complex128]) -> str | None:
    """The rightmost pole, or pair."""
    if not len(poles):
        return None
    first = complex(poles[0])
    return f"{first.real:.3f}" + f" ± {abs(first.imag):.3f}j" * bool(first.imag)


def margin_table(subject: AssessedVehicles) -> Table:
    """One row a vehicle, and one of the platoon: the time gap, and by how much it is stable."""
    rows, platoon = subject.margins.vehicles, subject.margins.platoon
    digits = MARGIN_DIGITS if subject.margins.level else 2
    more: list[Cell] = [None] * bool(platoon)
    filled: list[Filled] = [
        (Column("Vehicle"), [*subject.vehicles.labels, *(["All cars in order"] * len(more))]),
        (Column("Time gap", "s", 2), [*(_plain(row.time_gap) for row in rows), *more]),
    ]
    for group, norms in ((L2, [row.l2 for row in rows]), (LINF, [row.linf for row in rows])):
        margins: list[Cell] = [
            _plain(norm.distance) if np.isfinite(norm.distance.value) else norm.state.value
            for norm in norms
        ]
        if platoon:
            is_known = group == L2 and np.isfinite(platoon.value)
            margins.append(_plain(platoon) if is_known else None)
        filled += [
            (
                Column("Smallest stable", "s", digits, group),
                [*(_plain(norm.smallest) for norm in norms), *more],
            ),
            (Column("Margin", "s", digits, group), margins),
        ]
    return Table.of(f"Margin of the time gap, {subject.vehicles.title}", filled)


def waves_table(found: Waves) -> Table:
    """One row a vehicle and size of a wave: how much its braking and accelerating half grow."""
    rows = [(name, v, k) for name, v in zip(found.names, found.vehicles, strict=True)
            for k in range(len(v.amplitude))]  # fmt: skip
    parts = (("Braking", "braking"), ("Accelerating", "accelerating"),
             ("First harmonic", "harmonic"))  # fmt: skip
    return Table.of(
        "Growth of waves",
        [
            (Column("Vehicle"), [name for name, *_ in rows]),
            (Column("Mean speed", "km/h", 0), [3.6 * v.speed for _, v, _ in rows]),
            (Column("Size", "m/s", 1), [float(v.amplitude[k]) for _, v, k in rows]),
            *(
                (Column(title, "", 3), [float(getattr(v, part)[k]) for _, v, k in rows])
                for title, part in parts
            ),
        ],
    )


def _plain(value: Quantity) -> Cell:
    """A value with its interval, or alone where it is that of a point, or infinite."""
    if np.isinf(value.value):
        return None
    return value.value if np.isnan(value.lower) else value


def _with_ends(values: Sequence[float | None], ends: Interval | None) -> Sequence[Cell]:
    """Values with their intervals, where these are known."""
    if ends is None:
        return values
    return interval_cells([nan if v is None else v for v in values], ends.lower, ends.upper)


def _decibels(gain: Interval) -> Interval:
    with np.errstate(divide="ignore"):  # minus infinity where nothing passes
        return Interval(20 * np.log10(gain.lower), 20 * np.log10(gain.upper))


def _contradictions(vehicles: ParameterSet, checks: Sequence[GainCheck]) -> list[str]:
    """For each vehicle the sentence by which the measured gain contradicts its verdict, or none.

    A row that stands for all followers has the number 0.
    """
    sentences = {c.vehicle: c.sentence(vehicles) for c in checks if c.contradiction}
    everyone = next(iter(sentences.values()), "")
    return [sentences.get(number, "" if number else everyone) for number in vehicles.vehicles[1:]]


def _posterior(
    group: str, shares: FloatArray | None, against: Sequence[str] = ()
) -> Iterator[Filled]:
    """The probability of string stability, and what it amounts to; marked where contradicted."""
    if shares is not None:
        yield Column.chance(PROBABILITY, group), percent_cells(shares)
        words = [assessment(share) for share in shares]
        pairs = zip_longest(words, against)
        marked = (Marked(word, why, AGAINST.glyph) if why else word for word, why in pairs)
        yield Column(VERDICT, group=group), marked


def amplitude_table(
    run: PlatoonRun, labels: Sequence[str], recorded: Segment | None = None
) -> Table:
    """One row a vehicle, leader first: behind a sinusoid amplitudes, and else largest deviations.

    A vehicle that collides, and each one behind it, has no amplitude and no smallest gap; where it
    collides, it says when. Labels are (M+1,). Where the run's leader was recorded, the window in
    which the vehicles themselves drove behind it stands beside.
    """
    waves, driving, followers = run.amplitudes, run.survivors, len(run.minimum_gap)
    sizes: list[Filled] = [(Column("Largest deviation", "m/s", 2), run.largest_deviation)]
    if waves:
        alive = np.arange(followers + 1) < driving
        sizes = [
            (Column("Amplitude", "m/s", 3), np.where(alive, waves.measured, np.nan)),
            (Column("Predicted", "m/s", 3), waves.predicted),
        ]
    gaps: list[Cell] = [None, *run.minimum_gap[: driving - 1].tolist()]
    gaps += (followers + 1 - len(gaps)) * [None]
    for hit in run.collisions:
        gaps[hit.follower] = f"collides at {hit.time:.0f} s"
    filled: list[Filled] = [*sizes, (Column("Smallest gap", "m", 2), gaps)]
    if recorded:
        moved = np.abs(recorded.measured_speeds - run.leader.speed)
        extremes = np.fmax.reduce(moved), [None, *np.fmin.reduce(recorded.measured_gaps).tolist()]
        beside = zip(filled, extremes, strict=True)
        filled = [
            (replace(column, title=title, group=column.title), cells)
            for (column, simulated), measured in beside
            for title, cells in (("Simulated", simulated), ("Recorded", measured))
        ]
    return Table.of("", [(Column("Vehicle"), labels), *filled])


def measured_gain_table(label: str, measured: MeasuredGain) -> Table:
    """One row a frequency: the gain measured by Welch's method, its band and the coherence."""
    return Table.of(
        f"Measured gain, {label}",
        [
            (Column.of(FREQUENCY), measured.omega),
            (Column("Gain", "", 3), interval_cells(measured.gain, measured.lower, measured.upper)),
            (Column("Coherence", "", 3), measured.coherence),
        ],
    )
