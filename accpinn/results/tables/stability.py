"""String stability as a table in the manner of the paper's Table III, with the exact L∞ gain."""

from accpinn.model.published import ParameterSet
from accpinn.results.tables.results import PARAMETER_COLUMNS
from accpinn.results.tables.table import Cell, Column, Table
from accpinn.stability.report import StabilityReport, Verdict

L2, LINF = "L₂ string stability", "L∞ string stability"
HEADWAY = "Smallest stable time headway"


def stability_table(laws: ParameterSet, report: StabilityReport) -> Table:
    """One row a vehicle: parameters, verdicts, peak, crossover, exact gain, smallest headways."""
    columns = (
        Column("Vehicle"),
        *PARAMETER_COLUMNS,
        Column("Stable", group=L2),
        Column("Peak", "dB", 2, L2),
        Column("at ω", "rad/s", 3, L2),
        Column("Amplified below", "rad/s", 3, L2),
        Column("Paper's criterion", group=LINF),
        Column("Exact", group=LINF),
        Column("‖h‖₁", "", 3, LINF),
        Column("L₂", "s", 2, HEADWAY),
        Column("L∞", "s", 2, HEADWAY),
    )
    rows: list[tuple[Cell, ...]] = []
    for label, vehicle in zip(laws.labels, report.vehicles, strict=True):
        law, headway = vehicle.parameters, vehicle.smallest_tau
        grows = vehicle.peak.omega > 0
        rows.append(
            (
                label,
                law.alpha,
                law.beta,
                law.tau,
                answer(vehicle.l2),
                vehicle.peak.db,
                vehicle.peak.omega if grows else None,
                vehicle.crossover,
                answer(vehicle.linf_paper),
                answer(vehicle.linf_exact),
                vehicle.linf_gain,
                headway.l2 if headway else None,
                headway.linf_exact if headway else None,
            )
        )
    return Table(f"String stability, {laws.title}", columns, tuple(rows))


def answer(verdict: Verdict) -> str:
    """YES or NO as the paper prints it; marginal cases are named."""
    word = "YES" if verdict.stable else "NO"
    return f"{word}, marginal" if verdict.marginal else word
