"""What the parameters would be if the law had one term more (see `identifiability.extensions`)."""

from collections.abc import Sequence

from accpinn.inference.model_adequacy import ModelForm
from accpinn.results.tables.results import PARAMETER_COLUMNS, where
from accpinn.results.tables.table import Column, Table
from accpinn.segment.segment import SegmentInfo

NAMES = {
    "as it is": "The law as it is",
    "standstill distance": "With a distance s₀ at standstill",
    "delay": "With a delay d",
}


def extensions_table(segment: SegmentInfo, found: Sequence[ModelForm], follower: int) -> Table:
    """One row a form of the law, for one follower (0 for the first)."""
    explained = "Acceleration explained"
    columns = (
        Column("Least squares over seconds"),
        *PARAMETER_COLUMNS,
        Column("s₀", "m", 1),
        Column("d", "s", 1),
        Column("here", "%", 0, explained),
        Column("unseen", "%", 0, explained),
    )
    rows = tuple(
        (
            NAMES[form.form],
            *(float(value) for value in form.parameters[follower]),
            float(form.extra[follower]) if form.form == "standstill distance" else None,
            float(form.extra[follower]) if form.form == "delay" else None,
            100 * float(form.explained[follower]),
            100 * float(form.unseen[follower]),
        )
        for form in found
    )
    return Table(f"{segment.labels[follower + 1]}, {where(segment)}", columns, rows)
