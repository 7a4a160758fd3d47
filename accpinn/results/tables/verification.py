"""The checks of a snapshot as one table, for page, report and command line alike."""

from accpinn.results.tables.table import Column, Table
from accpinn.study.verification import Verification


def verification_table(verification: Verification) -> Table:
    """One row a part: how it was checked, whether it agrees, and a number as stored and found."""
    checks = sorted(verification.checks, key=lambda check: check.ok)
    agrees = {True: "yes", False: "NO"}
    return Table.of(
        "Stored, and found now",
        [
            (Column("Part"), [check.title for check in checks]),
            (Column("How"), [check.state for check in checks]),
            (
                Column("Agrees"),
                [agrees[check.ok] if check.state != "not checked" else None for check in checks],
            ),
            (Column("Stored", prose=True), [check.stored or None for check in checks]),
            (Column("Found now", prose=True), [check.computed or None for check in checks]),
            (Column("Result", prose=True), [check.sentence for check in checks]),
        ],
    )
