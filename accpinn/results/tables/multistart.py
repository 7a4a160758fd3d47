"""Trainings from several initial values, in the manner of the paper's Table I."""

from dataclasses import replace

import numpy as np

from accpinn.inference.multistart import MultistartResult
from accpinn.results.tables.results import PARAMETER_COLUMNS, where
from accpinn.results.tables.table import Cell, Column, Table
from accpinn.segment.segment import SegmentInfo


def starts_table(segment: SegmentInfo, found: MultistartResult, follower: int) -> Table:
    """One row a training of one follower (0 for the first), and the spread in the last."""
    columns = (
        Column("Start (α, β, τ)"),
        *(replace(column, group="Learned") for column in PARAMETER_COLUMNS),
        Column("Surrogate fit", "m", 3, "MAE of the space-gap"),
        Column("Closed loop", "m", 2, "MAE of the space-gap"),
        Column("Iterations", "", 0),
        Column("Time", "s", 1),
    )
    rows: list[tuple[Cell, ...]] = []
    for trial in found.trials:
        law = trial.fit.parameters[follower]
        errors = (trial.surrogate, trial.closed_loop)
        rows.append(
            (
                ", ".join(f"{value:g}" for value in trial.initial),
                law.alpha,
                law.beta,
                law.tau,
                *(float(e.gap_mae[follower]) if e else None for e in errors),
                float(trial.fit.iterations),
                trial.fit.seconds,
            )
        )
    if len(found.trials) > 1:
        spread = [f"{v:.2f} %" if np.isfinite(v) else None for v in found.spread[follower]]
        rows.append(("Spread", *spread, None, None, None, None))
    return Table(f"{segment.labels[follower + 1]}, {where(segment)}", columns, tuple(rows))
