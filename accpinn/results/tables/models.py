"""Tables of models that were judged on many vehicles: one by one, and in pairs."""

from collections.abc import Iterator

import numpy as np

from accpinn.results.tables import Cell, Column, Filled, Table
from accpinn.study.judge import candidate
from accpinn.study.judging import Judgements
from accpinn.units import Quantity

MODEL = Column("Model", key="model")
UNDECIDED = "open"


def extent_of(judgements: Judgements) -> str:
    """What the judgements rest on, as "95 windows left out in turn, 10 vehicles, 8 recordings"."""
    counts = (
        (judgements.windows, "window"),
        (len(judgements.vehicles), "vehicle"),
        (judgements.recordings, "recording"),
    )
    windows, vehicles, recordings = (f"{n:,} {noun}{'s' * (n != 1)}" for n, noun in counts)
    return f"{windows} left out in turn, {vehicles}, {recordings}"


def models_table(judgements: Judgements, reference: str | None = None) -> Table:
    """A row a model, the one with the least error of the gap first.

    Errors are geometric means over a vehicle's windows, then over vehicles. The gap error beside
    the reference, by default the first model, has the ends of one standard error.

    Examples:
        >>> import accpinn
        >>> recording = accpinn.sample("motorway")
        >>> found = accpinn.judge(recording, ("cthp", "cthp-s0"), [(0, 60), (60, 120)], "1-2")
        >>> accpinn.models_table(found).to_frame().gap_rmse_m.round(2).tolist()
        [0.18, 0.93]
    """
    rows = judgements.summary(reference)
    if not rows:
        return Table.of("No follower was judged", [(MODEL, [])])
    beside = judgements.keys[0] if reference is None else reference
    others = [row.key != beside for row in rows]
    windows = judgements.windows
    verdicts = [
        None if not other else UNDECIDED if not row.is_clear else
        "better" if row.difference < 0 else "worse"
        for row, other in zip(rows, others, strict=True)
    ]  # fmt: skip
    group = f"Beside the {candidate(beside).title}"
    columns: Iterator[Filled] = iter(
        (
            (MODEL, [candidate(row.key).title for row in rows]),
            (Column("Gap RMSE", "m", 2, key="gap_rmse_m"), [row.rmse for row in rows]),
            (Column("Gap MAE", "m", 2, key="gap_mae_m"), [row.mae for row in rows]),
            (
                Column("Gap RMSE", "%", 1, group, key="beside_reference_percent"),
                [
                    percent(row.difference, row.error) if other else None
                    for row, other in zip(rows, others, strict=True)
                ],
            ),
            (Column("Verdict", group=group, key="verdict"), verdicts),
            (Column("Best in", "%", 0), [100 * row.best_in / windows for row in rows]),
            (Column("Collides in", digits=0), [float(row.collides_in) for row in rows]),
            (Column("|H| off", "dB", 1, key="gain_error_db"), [row.gain_error for row in rows]),
            (Column("Key", key="key"), [row.key for row in rows]),
        )
    )
    return Table.of(f"Models in {extent_of(judgements)}", columns)


def pairs_table(judgements: Judgements) -> Table:
    """By how much the gap error of each model exceeds that of each other, in %.

    A row's model beside a column's, with the ends of one standard error over vehicles.

    Examples:
        >>> import accpinn
        >>> recording = accpinn.sample("motorway")
        >>> found = accpinn.judge(recording, ("cthp", "cthp-s0"), [(0, 60), (60, 120)], "1-2")
        >>> accpinn.pairs_table(found).to_frame().shape
        (2, 7)
    """
    keys = [row.key for row in judgements.summary()]

    def cell(key: str, other: str) -> Cell:
        if key == other:
            return None
        mean, error, _ = judgements.difference(key, other)
        return percent(mean, error)

    return Table.of(
        "Gap RMSE of a row's model beside that of a column's, with one standard error",
        [
            (MODEL, [candidate(key).title for key in keys]),
            *(
                (Column(other, "%", 1, key=f"beside_{other}"), [cell(key, other) for key in keys])
                for other in keys
            ),
        ],
    )


def percent(mean: float, error: float) -> Quantity:
    """A mean difference of logarithms and its standard error, in percent."""
    return Quantity(*(100.0 * np.expm1([mean, mean - error, mean + error])).tolist())
