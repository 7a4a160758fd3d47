"""What was stated beside what is found now: the paper's tables and figures, and a snapshot.

Source of all printed values: Apostolakis and Ampountolas, IEEE TVT 2024, Tables I to III and
Figures 2 to 8. Verdicts and peaks follow from the printed parameters alone, so they are computed
at once; what takes a recording names its run, windows and preset.
"""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import cache, cached_property

import numpy as np

from accpinn.channels import MAGNITUDE, PARAMETERS
from accpinn.findings import joined
from accpinn.methods.pinn.config import PRESETS
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
from accpinn.model.registry import PAPER
from accpinn.recordings import Recording, Window
from accpinn.results.tables import Cell, Column, Filled, Table
from accpinn.results.tables.estimates import parameter_cells
from accpinn.results.tables.stability import GAIN, PEAK, PEAK_AT
from accpinn.stability import StabilityReport, stability_report
from accpinn.stability.criteria import response
from accpinn.study import Analysis
from accpinn.study.result import Result
from accpinn.study.verification import Verification
from accpinn.units import FloatArray, RadiansPerSecond

TOLERANCE = 0.15
"""Relative difference up to which a learned parameter agrees with the printed one. The preset fast
is within 2 % in Tables I and II, and in Table III within 6 % (α), 12 % (β) and 1 % (τ)."""
TICK = "✓"
L2, LINF = "L₂", "L∞"
PRINTED, RECOMPUTED, LEARNED, DEVIATION = "Printed", "Recomputed", "Learned", "Deviation"
TEXT_PEAK, TEXT_PEAK_AT = 1.2, 0.25
"""The paper's text on its Bode plots: "the largest amplitude (about 1.2 dB) for both campaigns
occurs at ω = 0.25 rad/s"."""
MARGINAL, MARGINAL_AT = 3, 0.25
"""Index of the AstaZero follower that the caption of the Bode plots calls marginally string stable,
and the frequency in rad/s there."""


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
    """A recording of the OpenACC database, and what the paper took of it."""

    campaign: str
    file: str
    windows: tuple[Window, ...]
    vehicles: tuple[int, ...]
    case: Case = "II"
    preset: str = "fast"
    """The PiNN's preset that finds what the paper prints, in seconds."""

    def __str__(self) -> str:
        """The recording, windows and vehicles in a line."""
        vehicles = f"vehicles {self.vehicles[0]}–{self.vehicles[-1]}"
        case = f", Case {self.case}" if len(self.vehicles) > 2 else ""
        windows = joined([*map(str, self.windows)])
        return f"OpenACC {self.campaign}, {self.file}, {windows}, {vehicles}{case}"

    def is_of(self, recording: Recording) -> bool:
        """Whether that recording is the one that the paper took."""
        return recording.source == self.file and recording.campaign == self.campaign

    def analysis(self, recording: Recording) -> Analysis:
        """The question whose estimate stands beside what is printed."""
        return Analysis.of(
            recording,
            self.windows,
            self.vehicles,
            case=self.case,
            model=PAPER,
            method="pinn",
            settings=PRESETS[self.preset],
        )


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


CASALE_RUN = PrintedRun("Casale", "part7.csv", (Window(0.0, 300.0),), (1, 2))
ASTAZERO_RUN = PrintedRun(
    "AstaZero", "ASta_040719_platoon5.csv", (Window(320.0, 620.0),), (1, 2, 3, 4, 5)
)
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


@cache
def inconsistencies() -> tuple[str, ...]:
    """Where the paper's text contradicts its own Table III, by the parameters printed there."""
    peaks = []
    for campaign, printed in (("AstaZero", ASTAZERO), ("Ispra-Vicolungo", VICOLUNGO)):
        vehicles = stability_report(printed.parameters).vehicles
        k = max(range(len(vehicles)), key=lambda k: vehicles[k].peak.gain)
        peak = vehicles[k].peak
        peaks.append(
            f"{peak.db:.2f} dB at {peak.omega:.3f} rad/s for {campaign} ({printed.labels[k]})"
        )
    gain = _decibels(ASTAZERO.parameters[MARGINAL], MARGINAL_AT)
    return (
        f"The paper's text gives {TEXT_PEAK:g} dB at {TEXT_PEAK_AT:g} rad/s as the largest"
        f" amplitude of both campaigns. By its Table III it is {joined(peaks)}.",
        f"The caption of its Bode plots calls vehicle {MARGINAL + 1} of AstaZero"
        f" ({ASTAZERO.labels[MARGINAL]}) marginally string stable at {MARGINAL_AT:g} rad/s. By its"
        f" Table III the gain there is {gain:.2f} dB.",
    )


def _decibels(vehicle: Parameters, omega: RadiansPerSecond) -> float:
    """|H| of one vehicle at a frequency, in dB."""
    return float(20 * np.log10(np.abs(response(vehicle[None], np.array([omega]))[0, 0])))


def beside_printed(result: Result) -> tuple[PrintedItem, Table, str] | None:
    """The table of the paper whose data and method a result has, filled, and how far it is off."""
    asked = result.analysis
    took = (result.facts.get("campaign"), result.info.source, asked.windows, asked.vehicles)
    made = asked.spec.model, asked.settings.get("preset")
    for item in ITEMS:
        run = item.run
        if not (item.verdicts and run) or made not in ((PAPER, run.preset), (PAPER, "paper")):
            continue
        is_case = asked.case == run.case or len(run.vehicles) == 2
        if is_case and took == (run.campaign, run.file, run.windows, run.vehicles):
            printed = item.verdicts[0]
            learned = result.parameters[: len(printed.vehicles)]
            return item, reproduction_table(printed, learned), learned_line(printed, learned)
    return None


def deviations(printed: PrintedVerdicts, learned: Parameters) -> FloatArray:
    """(M, 3) relative difference of learned α, β and τ from the printed ones.

    One learned set stands for all rows, as where the paper prints several starts of one training.
    """
    return np.asarray(learned.values / printed.vehicles.parameters.values - 1)


def learned_line(printed: PrintedVerdicts, learned: Parameters) -> str:
    """The largest deviation of each parameter; a tick goes before where all are in `TOLERANCE`."""
    most = 100 * np.abs(deviations(printed, learned)).max(axis=0)
    off = joined([f"{q.symbol} {value:.0f} %" for q, value in zip(PARAMETERS, most, strict=True)])
    tick = f"{TICK} " if (most <= 100 * TOLERANCE).all() else ""
    return f"{tick}learned; deviation at most {off}"


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
    """A row a follower: what is printed, what follows from it, and what is learned here.

    Learned parameters are (M,), or one set for all rows. A row has a tick where each parameter lies
    within `TOLERANCE` of the printed one.
    """
    assessed, vehicles = printed.report.vehicles, printed.vehicles
    stable = ([part.stable for part in (v.l2, v.linf_paper, v.linf_exact)] for v in assessed)
    l2, paper, exact = map(_words, zip(*stable, strict=True))
    filled: list[Filled] = [
        (Column("Vehicle"), vehicles.labels),
        *parameter_cells(vehicles.parameters, PRINTED),
        (Column(L2, group=PRINTED), _words(printed.l2)),
        (Column(LINF, group=PRINTED), _words(printed.linf)),
        (Column(L2, group=RECOMPUTED), l2),
        (Column(f"{LINF}, paper's criterion", group=RECOMPUTED), paper),
        (Column(f"{LINF}, exact", group=RECOMPUTED), exact),
        (replace(GAIN, group=RECOMPUTED), [v.linf_gain for v in assessed]),
        (replace(PEAK, title=MAGNITUDE.name, group=RECOMPUTED), [v.peak.db for v in assessed]),
        (replace(PEAK_AT, group=RECOMPUTED), [v.peak.omega or None for v in assessed]),
    ]
    if learned is None:
        return Table.of(vehicles.title, filled)
    away = deviations(printed, learned)
    rows = np.broadcast_to(learned.everything, (len(vehicles), learned.everything.shape[-1]))
    filled += parameter_cells(Parameters.of(rows), LEARNED)
    for quantity, column in zip(PARAMETERS, 100 * away.T, strict=True):
        filled.append((Column(quantity.symbol, "%", 0, DEVIATION), column))
    ticks: list[Cell] = [TICK if max(abs(row)) <= TOLERANCE else None for row in away]
    filled.append((Column("Agrees", group=DEVIATION), ticks))
    caption = f"{vehicles.title}; {TICK}: each parameter within {100 * TOLERANCE:.0f} %"
    return Table.of(caption, filled)


def _words(verdicts: Iterable[bool]) -> list[str]:
    """YES or NO, as the paper prints it."""
    return ["YES" if stable else "NO" for stable in verdicts]
