"""A drive that is proposed as a table: how wide intervals are now, and would be after it."""

from accpinn.model.registry import following_model
from accpinn.results.tables import Column, Table
from accpinn.study.next_drive import Narrowing, NextDrive

TIME_GAP = "Time gap at 100 km/h"


def drive_table(proposed: NextDrive) -> Table:
    """One row a parameter: its interval about its middle, from drives alone and together.

    Alone: of the car in that drive. Together: of its typical value, with all that is known.
    """
    rows, level = proposed.narrowing, 100 * proposed.level
    alone, together = "From the drive alone", "With all that is known"
    return Table.of(
        f"{level:g} % intervals, {proposed.name}",
        [
            (Column("Parameter"), [title_of(proposed, row) for row in rows]),
            (Column("Motorway drive", group=alone), [r.text(r.motorway_alone) for r in rows]),
            (Column("This drive", group=alone), [r.text(r.drive_alone) for r in rows]),
            (Column("Now", group=together), [row.text(row.now) for row in rows]),
            (Column("+ motorway drive", group=together), [r.text(r.motorway) for r in rows]),
            (Column("+ this drive", group=together), [row.text(row.drive) for row in rows]),
        ],
    )


def title_of(proposed: NextDrive, row: Narrowing) -> str:
    """The symbol of a parameter."""
    symbols = {p.name: p.symbol for p in following_model(proposed.model).parameters}
    return symbols.get(row.name, TIME_GAP)
