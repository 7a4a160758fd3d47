"""Results as tables in the manner of the paper's Tables I to III."""

from collections.abc import Mapping
from dataclasses import replace

from accpinn.evaluation.errors import TrackingErrors
from accpinn.inference.intervals import Uncertainty
from accpinn.methods.fit import Fit
from accpinn.model.cthp import Parameters
from accpinn.results.tables.names import name_of
from accpinn.results.tables.table import Cell, Column, Table
from accpinn.segment.quality import Quality
from accpinn.segment.segment import SegmentInfo

PARAMETER_COLUMNS = (
    Column("α", "1/s²", 4),
    Column("β", "1/s", 4),
    Column("τ", "s", 3),
)


def parameter_table(
    segment: SegmentInfo,
    fit: Fit,
    quality: Quality,
    surrogate: TrackingErrors | None,
    closed_loop: TrackingErrors | None,
    uncertainty: Uncertainty | None = None,
) -> Table:
    """One row a vehicle, leader first: parameters, mean time gap, errors of both kinds, intervals.

    The intervals have columns where ``doubt`` is known.
    """
    own, driven = "Surrogate fit, MAE", "Closed-loop simulation, MAE"
    columns = (
        Column("Vehicle"),
        *PARAMETER_COLUMNS,
        Column("Mean time gap", "s", 2),
        Column("p", "m", 3, own),
        Column("v", "m/s", 3, own),
        Column("p", "m", 2, driven),
        Column("v", "m/s", 3, driven),
        *(interval_columns(uncertainty) if uncertainty else ()),
    )
    leader_error = float(surrogate.speed_mae[0]) if surrogate else None
    rows: list[tuple[Cell, ...]] = [
        # In the simulation the leader's measured speed goes in, so it has no error there.
        (
            segment.labels[0],
            *[None] * 5,
            leader_error,
            None,
            None,
            *[None] * (3 if uncertainty else 0),
        )
    ]
    for k, law in enumerate(fit.parameters):
        rows.append(
            (
                segment.labels[k + 1],
                *_values(law),
                quality.mean_time_gap[k],
                *_errors(surrogate, k),
                *_errors(closed_loop, k),
                *(interval_cells(uncertainty, k) if uncertainty else ()),
            )
        )
    case = f", Case {fit.case}" if segment.followers > 1 else ""
    return Table(f"{name_of(fit)}, {where(segment)}{case}", columns, tuple(rows))


def comparison_table(segment: SegmentInfo, estimates: Mapping[str, Parameters]) -> Table:
    """One row a follower; for each parameter, what each method or the truth says of it."""
    columns = [Column("Vehicle")]
    columns += [
        replace(column, title=name, unit="", group=column.heading)
        for column in PARAMETER_COLUMNS
        for name in estimates
    ]
    rows: list[tuple[Cell, ...]] = []
    for k, label in enumerate(segment.labels[1:]):
        triples = [_values(laws[k]) for laws in estimates.values()]
        rows.append((label, *(triple[i] for i in range(3) for triple in triples)))
    return Table(f"Estimates side by side, {where(segment)}", tuple(columns), tuple(rows))


def quality_table(segment: SegmentInfo, quality: Quality, estimate: Fit) -> Table:
    """One row a follower: what the window tells, and the least-squares estimate from it."""
    columns = (
        Column("Follower"),
        *(replace(column, group="Least squares estimate") for column in PARAMETER_COLUMNS),
        Column("Mean time gap", "s", 2),
        Column("Car-following", "%", 0),
        Column("Δv, std.", "m/s", 2),
        Column("Condition number", "", 0),
    )
    rows: list[tuple[Cell, ...]] = []
    for k, label in enumerate(segment.labels[1:]):
        rows.append(
            (
                label,
                *_values(estimate.parameters[k]),
                quality.mean_time_gap[k],
                100 * quality.car_following[k],
                quality.relative_deviation[k],
                quality.condition[k],
            )
        )
    return Table(where(segment), columns, tuple(rows))


def interval_columns(uncertainty: Uncertainty) -> tuple[Column, ...]:
    """Columns for the intervals of α, β and τ."""
    percent = f"{100 * uncertainty.level:.0f} % interval"
    return tuple(Column(column.heading, group=percent) for column in PARAMETER_COLUMNS)


def interval_cells(uncertainty: Uncertainty, follower: int) -> tuple[str, ...]:
    """The intervals of one follower (0 for the first) in words; τ may have no upper end."""
    ends = zip(
        PARAMETER_COLUMNS, uncertainty.lower[follower], uncertainty.upper[follower], strict=True
    )
    return tuple(
        f"{column.shown(float(low))} to {column.shown(float(high))}"
        if high < float("inf")
        else f"{column.shown(float(low))} or more"
        for column, low, high in ends
    )


def where(segment: SegmentInfo) -> str:
    """The segment in a few words: file, seconds, and what does not count there."""
    window = f"{segment.source}, {segment.window}"
    left_out = segment.excluded_regimes
    return f"{window}, {', '.join(left_out)} left out" if left_out else window


def _values(law: Parameters) -> tuple[float, float, float]:
    return law.alpha, law.beta, law.tau


def _errors(errors: TrackingErrors | None, follower: int) -> tuple[Cell, Cell]:
    if errors is None:
        return None, None
    return float(errors.gap_mae[follower]), float(errors.speed_mae[follower + 1])
