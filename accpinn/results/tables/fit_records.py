"""Earlier runs against the same method now: what came out, what was asked differently."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

from accpinn.results.tables.comparison import GAP
from accpinn.results.tables.names import method_name
from accpinn.results.tables.results import PARAMETER_COLUMNS
from accpinn.results.tables.table import Cell, Column, Table
from accpinn.study.comparison import FitRecord, differences

SAME = "nothing"


def earlier_table(runs: Sequence[FitRecord], now: Mapping[str, FitRecord], vehicle: int) -> Table:
    """One row a run that has the vehicle as a follower.

    Args:
        runs: in the order of the rows.
        now: the present run of each method; where there is none, what changed is not asked.
        vehicle: its number in the file.
    """
    delta = "Δ, now minus then"
    columns = (
        Column("Earlier run", prose=True),
        *PARAMETER_COLUMNS,
        Column("Closed loop", "m", 2, GAP),
        *(replace(column, group=delta) for column in PARAMETER_COLUMNS if now),
        *([Column("Differs now in", prose=True)] if now else []),
    )
    rows: list[tuple[Cell, ...]] = []
    for run in runs:
        then = run.of_vehicle(vehicle)
        if then is None:
            continue
        gap = float(run.closed_loop[run.info.vehicles[1:].index(vehicle)])
        changed = _changed(run, now.get(run.method), vehicle) if now else ()
        rows.append((title(run), *map(float, then), gap, *changed))
    return Table("", columns, tuple(rows))


def _changed(run: FitRecord, present: FitRecord | None, vehicle: int) -> tuple[Cell, ...]:
    """Δ of the three parameters, and what was asked differently."""
    then, value = run.of_vehicle(vehicle), present.of_vehicle(vehicle) if present else None
    if present is None or then is None or value is None:
        return (None,) * 4
    differs = "; ".join(differences(run, present)) or SAME
    return (*(float(x) for x in value - then), differs)


def title(run: FitRecord) -> str:
    """Method, file and window in a few words."""
    info = run.info
    window = f"{info.window}"
    left = f", {', '.join(info.excluded_regimes)} left out" if info.excluded_regimes else ""
    case = f", Case {run.case}" if info.followers > 1 else ""
    name = method_name(run.method, run.config, run.outcome)
    return f"{name}, {info.source} {window}{case}{left}"
