"""Closed-loop errors on the window learned from and on that of the validation, as a table."""

from accpinn.channels import GAP, SPEED
from accpinn.evaluation.closed_loop import TrackingErrors
from accpinn.evaluation.validation import Validation
from accpinn.results.tables.estimates import Filled
from accpinn.results.tables.table import Cell, Column, Table
from accpinn.segment.segment import SegmentInfo


def validation_table(info: SegmentInfo, other: SegmentInfo, found: Validation) -> Table:
    """A row a follower: MAE of space-gap and speed on both windows.

    Args:
        info: of the segment learned from.
        other: of the one validated on.
        found: the errors.
    """
    where = "" if info.source == other.source else f"{other.source}, "
    return Table.of(
        "Validation: error of the closed-loop simulation, MAE",
        [
            (Column("Follower"), info.labels[1:]),
            *_columns(f"Learned from: {info.window}", "learned", found.learned, info.followers),
            *_columns(
                f"Validation: {where}{other.window}", "validation", found.validated, info.followers
            ),
        ],
    )


def _columns(group: str, key: str, errors: TrackingErrors | None, count: int) -> list[Filled]:
    absent: list[Cell] = [None] * count
    return [
        (Column.of(GAP, group, f"{key}_mae_p_m"), errors.gap_mae if errors else absent),
        (Column.of(SPEED, group, f"{key}_mae_v_m_per_s"),
         errors.speed_mae[1:] if errors else absent),
    ]  # fmt: skip
