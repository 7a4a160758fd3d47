"""All methods side by side: estimates with errors of each kind, and what the recording allows."""

from collections.abc import Mapping, Sequence
from typing import Any

from accpinn.comparison import Row
from accpinn.fit import Fit, Outcome
from accpinn.pinn.config import PRESETS
from accpinn.segment.outline import Described
from accpinn.tables.results import PARAMETER_COLUMNS, interval_cells, interval_columns, where
from accpinn.tables.typeset import Cell, Column, Table
from accpinn.uncertainty import Uncertainty

TITLES = {
    "pinn": "PiNN",
    "least-squares": "Least squares",
    "savitzky-golay": "Savitzky-Golay",
    "splines": "Splines",
    "simulation": "Simulation",
    "recursive": "Recursive",
    "particle": "Particle filter",
    "dual-ukf": "Dual UKF",
}
GAP = "MAE of the space-gap"


def method_name(method: str, config: Mapping[str, Any], outcome: Outcome) -> str:
    """What a fit is called beside others; a PiNN also by its preset and by what was changed."""
    if method != "pinn":
        return TITLES.get(method, method)
    name = str(config.get("preset", ""))
    usual = PRESETS[name].to_json() if name in PRESETS else {}
    said = [f"{name} preset", *(["own options"] if dict(config) != usual else [])]
    said += ["stopped"] if outcome is Outcome.STOPPED else []
    return f"{TITLES[method]} ({', '.join(said)})"


def name_of(fit: Fit) -> str:
    """The same of a fit."""
    return method_name(fit.method, fit.config, fit.outcome)


def methods_table(segment: Described, rows: Sequence[Row], follower: int) -> Table:
    """One row a method, for one follower (0 for the first)."""
    columns = (
        Column("Method"),
        *PARAMETER_COLUMNS,
        Column("Surrogate fit", "m", 3, GAP),
        Column("Closed loop", "m", 2, GAP),
        Column("Held out", "m", 2, GAP),
        Column("Unseen rest", "m", 2, GAP),
        Column("Collides at", "s", 1),
        Column("Time", "s", 2, least=True),
    )
    cells: list[tuple[Cell, ...]] = []
    for row in rows:
        law, worth = row.fit.parameters[follower], row.assessment
        errors = (worth.surrogate, worth.closed_loop, worth.held_out, worth.unseen)
        cells.append(
            (
                name_of(row.fit),
                law.alpha,
                law.beta,
                law.tau,
                *(float(e.gap_mae[follower]) if e else None for e in errors),
                float(worth.collisions[follower]),
                row.fit.seconds,
            )
        )
    label = segment.labels[follower + 1]
    return Table(f"{label}, {where(segment)}", columns, tuple(cells))


def intervals_table(segment: Described, doubt: Uncertainty) -> Table:
    """One row a follower: intervals, and how probable string stability is."""
    columns = (
        Column("Follower"),
        *interval_columns(doubt),
        Column("L2", "%", 0, "Probably stable"),
        Column("L∞", "%", 0, "Probably stable"),
    )
    rows: list[tuple[Cell, ...]] = []
    for k, label in enumerate(segment.labels[1:]):
        stable = (100 * float(doubt.probability_l2[k]), 100 * float(doubt.probability_linf[k]))
        rows.append((label, *interval_cells(doubt, k), *stable))
    return Table(f"What the recording allows, {where(segment)}", columns, tuple(rows))
