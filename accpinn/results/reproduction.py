"""What was stated beside what is found now: the paper's tables and figures, and a snapshot.

Source of all printed values: Apostolakis and Ampountolas, IEEE TVT 2024, Tables I to III and
Figures 2 to 8. Verdicts and peaks follow from the printed parameters alone, so they are computed
at once; what takes a recording names its run and window.
"""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import cached_property

from accpinn.channels import MAGNITUDE
from accpinn.findings import joined
from accpinn.model.cthp import Case, Parameters
from accpinn.model.published import (
    ASTAZERO,
    ASTAZERO_ALIKE,
    CASALE,
    CASALE_STARTS,
    VICOLUNGO,
    VICOLUNGO_ALIKE,
    ParameterSet,
)
from accpinn.recordings import Recording, Window
from accpinn.results.tables import Column, Table
from accpinn.results.tables.estimates import parameter_cells
from accpinn.results.tables.stability import GAIN, PEAK, PEAK_AT
from accpinn.stability import StabilityReport, stability_report
from accpinn.study.verification import Verification

L2, LINF = "L₂", "L∞"


@dataclass(frozen=True)
class PrintedVerdicts:
    """Followers with the verdicts on their string stability as printed."""

    vehicles: ParameterSet
    l2: tuple[bool, ...]
    """(M,) YES or NO in the column L₂."""
    linf: tuple[bool, ...]
    """(M,) the same for L∞, which the paper decides by D > 0."""

    @cached_property
    def report(self) -> StabilityReport:
        """The same computed here from the printed parameters."""
        return stability_report(self.vehicles.parameters)

    @property
    def agreeing(self) -> int:
        """How many of the printed verdicts come out the same, by the paper's own criteria."""
        pairs = zip(self.report.vehicles, self.l2, self.linf, strict=True)
        return sum((v.l2.stable == l2) + (v.linf_paper.stable == linf) for v, l2, linf in pairs)

    @property
    def refuted(self) -> tuple[str, ...]:
        """Followers whose printed verdict on L∞ differs from that of the exact criterion."""
        pairs = zip(self.report.vehicles, self.linf, self.vehicles.labels, strict=True)
        return tuple(name for v, linf, name in pairs if v.linf_exact.stable != linf)


@dataclass(frozen=True)
class PrintedRun:
    """A recording of the OpenACC database, with the window and vehicles that the paper took."""

    campaign: str
    file: str
    window: Window
    vehicles: tuple[int, ...]
    case: Case = "II"

    def __str__(self) -> str:
        """The recording, window and vehicles in a line."""
        vehicles = f"vehicles {self.vehicles[0]}–{self.vehicles[-1]}"
        case = f", Case {self.case}" if len(self.vehicles) > 2 else ""
        return f"OpenACC {self.campaign}, {self.file}, {self.window}, {vehicles}{case}"

    def is_of(self, recording: Recording) -> bool:
        """Whether that recording is the one that the paper took."""
        return recording.source == self.file and recording.campaign == self.campaign


@dataclass(frozen=True)
class PrintedItem:
    """A table or a figure of the paper."""

    title: str
    subject: str
    run: PrintedRun | None = None
    """What it takes; None where it needs no recording, or its run is not known."""
    sample: str = ""
    """Stem of the synthetic sample that can stand in for the recording; empty for none."""
    verdicts: tuple[PrintedVerdicts, ...] = ()
    """Those printed in it."""
    shown: tuple[ParameterSet, ...] = ()
    """The published parameters that it can be drawn from."""

    @property
    def starts(self) -> bool:
        """Whether it is about trainings from several initial values."""
        return any(printed.vehicles is CASALE_STARTS for printed in self.verdicts)

    @property
    def outcome(self) -> str:
        """How the printed verdicts compare with those computed; empty where none are printed."""
        if not self.verdicts:
            return ""
        count = sum(2 * len(printed.vehicles) for printed in self.verdicts)
        agreeing = sum(printed.agreeing for printed in self.verdicts)
        said = f"{agreeing} of {count} printed verdicts agree by the paper's criteria."
        refuted = [name for printed in self.verdicts for name in printed.refuted]
        if refuted:
            said += (
                f" By the exact criterion {joined(refuted)} {'is' if len(refuted) == 1 else 'are'}"
                " not L∞ string stable: D > 0 is necessary, not sufficient."
            )
        return said


def _no(vehicles: ParameterSet, *linf: bool) -> PrintedVerdicts:
    """Every follower L₂ unstable, as all are that the paper prints."""
    none = (False,) * len(vehicles)
    return PrintedVerdicts(vehicles, none, linf or none)


def _row(vehicles: ParameterSet) -> PrintedVerdicts:
    """The one row that Table II has for all followers of a platoon."""
    return _no(ParameterSet(vehicles.title, ("All followers",), vehicles.parameters[:1]))


CASALE_RUN = PrintedRun("Casale", "part7.csv", Window(0.0, 300.0), (1, 2))
ASTAZERO_RUN = PrintedRun(
    "AstaZero", "ASta_040719_platoon5.csv", Window(320.0, 620.0), (1, 2, 3, 4, 5)
)
RUNS = (CASALE_RUN, ASTAZERO_RUN)
_SYNTHETIC, _ASTAZERO = "synthetic_paper_study", "synthetic_astazero_like"

ITEMS = (
    PrintedItem(
        "Table I", "Ispra-Casale, five initial values", CASALE_RUN, _SYNTHETIC,
        (_no(CASALE_STARTS),), (CASALE,),
    ),
    PrintedItem(
        "Table II", "Case I: one set of parameters for a platoon",
        replace(ASTAZERO_RUN, case="I"),
        _ASTAZERO, (_row(ASTAZERO_ALIKE), _row(VICOLUNGO_ALIKE)), (ASTAZERO_ALIKE, VICOLUNGO_ALIKE),
    ),
    PrintedItem(
        "Table III", "Case II: each follower with its own parameters", ASTAZERO_RUN, _ASTAZERO,
        (_no(ASTAZERO, False, False, False, True), _no(VICOLUNGO)), (ASTAZERO, VICOLUNGO),
    ),
    PrintedItem("Figures 2, 3a", "Synthetic study: trajectories and convergence", None, _SYNTHETIC),
    PrintedItem("Figures 3b, 4", "Ispra-Casale: convergence and trajectories", CASALE_RUN),
    PrintedItem("Figure 5", "Speed profiles of the platoons", ASTAZERO_RUN),
    PrintedItem("Figures 6, 7", "String stability along the platoon, Bode plots",
                shown=(ASTAZERO, VICOLUNGO)),
    PrintedItem("Figure 8", "Eight followers behind a sinusoid, four panels"),
)  # fmt: skip
"""In the order of the checklist; Figure 1 is a drawing of the network."""


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
    stable = ([part.stable for part in (v.l2, v.linf_paper, v.linf_exact)] for v in assessed)
    l2, paper, exact = map(_words, zip(*stable, strict=True))
    return Table.of(
        printed.vehicles.title,
        [
            (Column("Vehicle"), printed.vehicles.labels),
            *parameter_cells(printed.vehicles.parameters, "Printed"),
            *(parameter_cells(learned, "Learned here") if learned else ()),
            (Column("printed", group=L2), _words(printed.l2)),
            (Column("computed", group=L2), l2),
            (Column("printed", group=LINF), _words(printed.linf)),
            (Column("paper's criterion", group=LINF), paper),
            (Column("exact criterion", group=LINF), exact),
            (replace(GAIN, group=LINF), [v.linf_gain for v in assessed]),
            (replace(PEAK, group=MAGNITUDE.name), [v.peak.db for v in assessed]),
            (replace(PEAK_AT, group=MAGNITUDE.name), [v.peak.omega or None for v in assessed]),
        ],
    )


def _words(verdicts: Iterable[bool]) -> list[str]:
    """YES or NO, as the paper prints it."""
    return ["YES" if stable else "NO" for stable in verdicts]
