"""Earlier runs against the same method now: what came out, what was asked differently."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

from accpinn.comparison import Earlier, differences
from accpinn.tables.comparison import GAP, TITLES
from accpinn.tables.results import PARAMETER_COLUMNS
from accpinn.tables.typeset import Cell, Column, Table

SAME = "nothing"


def earlier_table(runs: Sequence[Earlier], now: Mapping[str, Earlier], vehicle: int) -> Table:
    """One row a run that has the vehicle as a follower.

    Args:
        runs: in the order of the rows.
        now: the present run of each method.
        vehicle: its number in the file.
    """
    delta = "Δ, now minus then"
    columns = (
        Column("Earlier run"),
        *PARAMETER_COLUMNS,
        Column("Closed loop", "m", 2, GAP),
        *(replace(column, group=delta) for column in PARAMETER_COLUMNS),
        Column("Differs now in"),
    )
    rows: list[tuple[Cell, ...]] = []
    for run in runs:
        then, present = run.of_vehicle(vehicle), now.get(run.method)
        if then is None:
            continue
        value = present.of_vehicle(vehicle) if present else None
        change: list[Cell] = [None] * 3
        if value is not None:
            change = [float(x) for x in value - then]
        differs = "; ".join(differences(run, present)) or SAME if present else None
        gap = float(run.closed_loop[run.outline.vehicles[1:].index(vehicle)])
        rows.append((title(run), *map(float, then), gap, *change, differs))
    return Table("", columns, tuple(rows))


def title(run: Earlier) -> str:
    """Method, file and window in a few words."""
    outline = run.outline
    window = f"{outline.start:g}–{outline.start + outline.duration:g} s"
    left = f", without {', '.join(outline.left_out)}" if outline.left_out else ""
    case = f", Case {run.case}" if outline.followers > 1 else ""
    return f"{TITLES.get(run.method, run.method)}, {outline.source} {window}{case}{left}"
