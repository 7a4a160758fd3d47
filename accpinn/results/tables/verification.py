"""What was stated beside what is computed now: checks of a snapshot, and tables of the paper."""

from collections.abc import Iterable
from dataclasses import replace

from accpinn.channels import MAGNITUDE
from accpinn.model.cthp import Parameters
from accpinn.results.reproduction import PrintedVerdicts
from accpinn.results.tables.estimates import parameter_cells
from accpinn.results.tables.stability import GAIN, PEAK, PEAK_AT, answer
from accpinn.results.tables.table import Column, Table
from accpinn.study.verification import Verification

L2, LINF = "L₂", "L∞"


def verification_table(verification: Verification) -> Table:
    """One row a part: how it was checked, whether it agrees, and the first difference."""
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
            (Column("Result", prose=True), [check.sentence for check in checks]),
        ],
    )


def reproduction_table(printed: PrintedVerdicts, learned: Parameters | None = None) -> Table:
    """A row a follower: printed parameters and verdicts, and what follows from the parameters.

    Parameters (M,) that were learned here from the same data stand beside the printed ones.
    """
    assessed = printed.report.vehicles
    return Table.of(
        printed.vehicles.title,
        [
            (Column("Vehicle"), printed.vehicles.labels),
            *parameter_cells(printed.vehicles.parameters, "Printed"),
            *(parameter_cells(learned, "Learned here") if learned else ()),
            (Column("printed", group=L2), _words(printed.l2)),
            (Column("computed", group=L2), [answer(v.l2) for v in assessed]),
            (Column("printed", group=LINF), _words(printed.linf)),
            (Column("paper's criterion", group=LINF), [answer(v.linf_paper) for v in assessed]),
            (Column("exact criterion", group=LINF), [answer(v.linf_exact) for v in assessed]),
            (replace(GAIN, group=LINF), [v.linf_gain for v in assessed]),
            (replace(PEAK, group=MAGNITUDE.name), [v.peak.db for v in assessed]),
            (replace(PEAK_AT, group=MAGNITUDE.name), [v.peak.omega or None for v in assessed]),
        ],
    )


def _words(verdicts: Iterable[bool]) -> list[str]:
    return ["YES" if stable else "NO" for stable in verdicts]
