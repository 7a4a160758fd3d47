"""The paper's tables and figures, printed beside recomputed and learned.

Source of all printed values: Apostolakis and Ampountolas, IEEE TVT 2024, Tables I to III and
Figures 2 to 8. Verdicts and peaks follow from the printed parameters alone, so they are computed
at once; what takes a recording names its run, windows and preset.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property

import numpy as np

from accpinn.channels import MAGNITUDE, PARAMETERS
from accpinn.errors import RecordingError
from accpinn.findings import joined
from accpinn.methods.pinn.config import PAPER_PRESETS, PRESETS, QUICK, STARTS, PresetName
from accpinn.methods.registry import PRESET_METHOD
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
from accpinn.recordings.openacc import catalogue
from accpinn.results.tables import Cell, Column, Filled, Table
from accpinn.results.tables.estimates import parameter_cells
from accpinn.results.tables.stability import GAIN, PEAK, PEAK_AT
from accpinn.stability import StabilityReport, stability_report
from accpinn.stability.criteria import response
from accpinn.study import Analysis
from accpinn.study.comparison import starts
from accpinn.study.result import Result
from accpinn.study.verification import Verification
from accpinn.units import FloatArray, RadiansPerSecond

TOLERANCE = 0.15
"""Relative difference up to which a learned parameter agrees with the printed one. The preset fast
is within 2 % in Tables I and II, and in Table III within 6 % (α), 12 % (β) and 1 % (τ)."""
TICK, MINUS = "✓", "−"
L2, LINF = "L₂", "L∞"
PRINTED, RECOMPUTED, LEARNED, DEVIATION = "Printed", "Recomputed", "Learned", "Deviation"
TEXT_PEAK, TEXT_PEAK_AT = 1.2, 0.25
"""The paper's text on its Bode plots: "the largest amplitude (about 1.2 dB) for both campaigns
occurs at ω = 0.25 rad/s"."""
MARGINAL, MARGINAL_AT = 3, 0.25
"""Index of the AstaZero follower that the caption of the Bode plots calls marginally string stable,
and the frequency in rad/s there."""
PANEL_FOLLOWERS = 8
"""Equal followers behind the leader in each of the paper's four panels."""


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
    """A recording of the OpenACC database, with the paper's windows, vehicles and Case."""

    campaign: str
    file: str
    windows: tuple[Window, ...]
    vehicles: tuple[int, ...]
    case: Case = "II"
    preset: PresetName = QUICK
    """The preset that finds the printed parameters in seconds."""

    def __str__(self) -> str:
        """The recording, windows and vehicles in a line."""
        vehicles = f"vehicles {self.vehicles[0]}–{self.vehicles[-1]}"
        case = f", Case {self.case}" if len(self.vehicles) > 2 else ""
        windows = joined([*map(str, self.windows)])
        return f"OpenACC {self.campaign}, {self.file}, {windows}, {vehicles}{case}"

    def is_of(self, recording: Recording) -> bool:
        """Whether that recording is the one that the paper took."""
        return recording.source == self.file and recording.campaign == self.campaign

    def is_published(self, recording: Recording) -> bool:
        """Whether it is that run also by its content, where the publisher's checksum is known."""
        sums = {run.sha256 for run in catalogue() if (run.campaign, run.file) == self.place}
        return self.is_of(recording) and (sums <= {None} or recording.sha256 in sums)

    @property
    def place(self) -> tuple[str, str]:
        """Campaign and file, by which the catalogue has it."""
        return self.campaign, self.file

    def analysis(self, recording: Recording) -> Analysis:
        """The analysis whose estimate stands beside the printed values."""
        return Analysis.of(
            recording,
            self.windows,
            self.vehicles,
            case=self.case,
            model=PAPER,
            method=PRESET_METHOD.key,
            settings=PRESETS[self.preset],
        )


@dataclass(frozen=True)
class Panel:
    """One of the paper's four panels: eight times one AstaZero vehicle behind a sinusoid."""

    letter: str
    vehicle: int
    """Index of the AstaZero follower."""
    frequency: RadiansPerSecond
    printed: str
    """The printed verdict of its caption."""

    def gain(self, parameters: Parameters) -> float:
        """Amplitude of the last follower's speed over the leader's, once the transient is over.

        The AstaZero followers' parameters are (M,).
        """
        gain = np.abs(response(parameters[[self.vehicle]], np.array([self.frequency])))
        return float(gain[0, 0] ** PANEL_FOLLOWERS)


PANELS = (
    Panel("a", 2, 0.25, "unstable"),
    Panel("c", 2, 0.3, "unstable"),
    Panel("b", 3, 0.25, "marginal"),
    Panel("d", 3, 0.3, "stable"),
)
"""Row by row, two a row."""


@dataclass(frozen=True)
class Comparison:
    """An item of the paper in a row: each part in few words, empty where nothing is known of it."""

    printed: str
    recomputed: str
    """From the printed parameters."""
    learned: str = ""
    """From the recording."""
    deviation: str = ""
    """Deviation of the learned values from the printed or else the recomputed ones."""


@dataclass(frozen=True)
class PrintedItem:
    """A table or a figure of the paper."""

    title: str
    subject: str
    run: PrintedRun | None = None
    """Its recording, window and vehicles; None where it needs none, or they are not known."""
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
    def trainings(self) -> int:
        """How many trainings give the rows printed first."""
        return len(STARTS) if self.starts else 1

    def analyses(self, recording: Recording) -> tuple[Analysis, ...]:
        """The questions that give its rows; several where it has several initial values.

        Raises:
            RecordingError: where the recording is another one.
        """
        if self.run is None:
            return ()
        if not self.run.is_published(recording):
            raise RecordingError(
                f"{recording.source}: this is not the run {self.run.campaign}/{self.run.file} of"
                f" the OpenACC database, which {self.title} takes; download it on page Data."
            )
        analysis = self.run.analysis(recording)
        return tuple(starts(analysis)) if self.starts else (analysis,)

    def learned(self, results: Sequence[Result]) -> Parameters | None:
        """The estimate for the rows printed first; None where no result is of its data.

        It is (M,), or one set for all rows, as long as not each row has a result of its own.
        """
        estimates = [result.parameters for result in results if item_of(result) is self]
        if not estimates:
            return None
        count = len(self.verdicts[0].vehicles)
        if self.starts and len(estimates) == count:
            return Parameters.of(np.concatenate([estimate.everything for estimate in estimates]))
        return rows_of(estimates[-1], count)

    def compared(self, learned: Parameters | None) -> Comparison:
        """The first rows beside their estimates: ranges of α, β and τ."""
        printed = self.verdicts[0]
        count = sum(2 * len(part.vehicles) for part in self.verdicts)
        agreeing = sum(part.agreeing for part in self.verdicts)
        recomputed = f"{agreeing} of {count} verdicts"
        if refuted := [name for part in self.verdicts for name in part.refuted]:
            recomputed += f"; {joined(refuted)} exactly L∞ unstable"
        if learned is None:
            return Comparison(_ranges(printed.vehicles.parameters), recomputed)
        return Comparison(
            _ranges(printed.vehicles.parameters),
            recomputed,
            _ranges(learned),
            _largest_deviations(printed, learned),
        )


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
        "Table I", "Ispra-Casale: five initial values", CASALE_RUN, _SYNTHETIC,
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
    PrintedItem("Figures 6, 7", "Bode plots: string stability along the platoon",
                shown=(ASTAZERO, VICOLUNGO)),
    PrintedItem("Figure 8", "Four panels: eight followers behind a sinusoid"),
)  # fmt: skip
"""In the order of the checklist; Figure 1 is a drawing of the network."""


BODE, EIGHT = ITEMS[-2:]
"""The Bode plots, and the four panels."""


def item_of(result: Result) -> PrintedItem | None:
    """The table of the paper whose data, model and method a result has."""
    analysis = result.analysis
    took = (result.facts.get("campaign"), result.info.source, analysis.windows, analysis.vehicles)
    if analysis.spec.model != PAPER or analysis.settings.get("preset") not in PAPER_PRESETS:
        return None
    for item in ITEMS:
        run = item.run
        if not (item.verdicts and run):
            continue
        is_case = analysis.case == run.case or len(run.vehicles) == 2
        if is_case and took == (run.campaign, run.file, run.windows, run.vehicles):
            return item
    return None


def rows_of(learned: Parameters, count: int) -> Parameters:
    """The estimate for so many rows of a table; one set for all where it has more rows."""
    return learned[: count if len(learned) >= count else 1]


def verdict(learned: Mapping[PrintedItem, Parameters | None]) -> str:
    """How far the paper's tables are reproduced, in a line; parameters by table, None before."""
    printed = [part for item in learned for part in item.verdicts]
    agreeing, count = sum(p.agreeing for p in printed), sum(2 * len(p.vehicles) for p in printed)
    pairs = [(item.verdicts[0], row) for item, row in learned.items() if row is not None]
    if not pairs:
        given = f"The printed parameters give {agreeing} of the {count} printed verdicts."
        return f"None of {len(learned)} tables learned from its recording yet. {given}"
    off = max(float(np.abs(deviations(*pair)).max()) for pair in pairs)
    what = "all tables" if len(pairs) == len(learned) else f"{len(pairs)} of {len(learned)} tables"
    tick = f"{TICK} " if off <= TOLERANCE and len(pairs) == len(learned) else ""
    return f"{tick}Learned: {what} within {100 * off:.0f} %. {agreeing} of {count} verdicts agree."


def compared_peaks(learned: Parameters | None) -> Comparison:
    """The largest peak of the Bode magnitude: as the text has it, by Table III, and as learned.

    The AstaZero followers' learned parameters are (M,).
    """
    tables = [_largest_peak(vehicles) for vehicles in (ASTAZERO, VICOLUNGO)]
    (gain, at, name), (other, other_at, other_name) = tables
    printed = f"{TEXT_PEAK:g} dB at {TEXT_PEAK_AT:g} rad/s (text)"
    recomputed = f"{gain:.2f} dB at {at:.3f} ({name}), {other:.2f} at {other_at:.3f} ({other_name})"
    if learned is None:
        return Comparison(printed, recomputed)
    peak, peak_at, peak_name = _largest_peak(replace(ASTAZERO, parameters=learned))
    return Comparison(
        printed,
        recomputed,
        f"{peak:.2f} dB at {peak_at:.3f} ({peak_name})",
        f"{peak - gain:+.2f} dB".replace("-", MINUS),
    )


def compared_panels(learned: Parameters | None) -> Comparison:
    """The four panels: printed verdicts, and the amplitude of the eighth follower in m/s.

    The AstaZero followers' learned parameters are (M,). The leader's amplitude is 1 m/s.
    """
    ordered = sorted(PANELS, key=lambda panel: panel.letter)

    def listed(values: Iterable[str]) -> str:
        pairs = zip(ordered, values, strict=True)
        return ", ".join(f"{panel.letter} {value}" for panel, value in pairs)

    def gains(parameters: Parameters) -> FloatArray:
        return np.array([panel.gain(parameters) for panel in ordered])

    def amplitudes(values: FloatArray) -> str:
        return f"{listed(f'{gain:.2f}' for gain in values)} m/s"

    printed, table = listed(panel.printed for panel in ordered), gains(ASTAZERO.parameters)
    if learned is None:
        return Comparison(printed, amplitudes(table))
    off = 100 * (gains(learned) / table - 1)
    away = listed(f"{value:+.0f}".replace("-", MINUS) for value in off) + " %"
    return Comparison(printed, amplitudes(table), amplitudes(gains(learned)), away)


def _largest_peak(vehicles: ParameterSet) -> tuple[float, RadiansPerSecond, str]:
    """The largest Bode magnitude in dB, its frequency and its vehicle."""
    rows = stability_report(vehicles.parameters).vehicles
    k = max(range(len(rows)), key=lambda k: rows[k].peak.gain)
    return rows[k].peak.db, rows[k].peak.omega, vehicles.labels[k]


def _ranges(parameters: Parameters) -> str:
    """The smallest and the largest α, β and τ."""
    ends = (
        dict.fromkeys(f"{end:#.3g}" for end in (column.min(), column.max()))
        for column in parameters.values.T
    )
    return ", ".join(map("–".join, ends))


@cache
def inconsistencies() -> tuple[str, ...]:
    """Where text and verdicts of the paper contradict its Table III, by the parameters there."""
    peaks = []
    refuted = [name for item in ITEMS for part in item.verdicts for name in part.refuted]
    for campaign, printed in (("AstaZero", ASTAZERO), ("Ispra-Vicolungo", VICOLUNGO)):
        peak, omega, name = _largest_peak(printed)
        peaks.append(f"{peak:.2f} dB at {omega:.3f} rad/s for {campaign} ({name})")
    gain = _decibels(ASTAZERO.parameters[MARGINAL], MARGINAL_AT)
    return (
        f"The paper's text gives {TEXT_PEAK:g} dB at {TEXT_PEAK_AT:g} rad/s as the largest"
        f" amplitude of both campaigns. By its Table III it is {joined(peaks)}.",
        f"The caption of its Bode plots calls vehicle {MARGINAL + 1} of AstaZero"
        f" ({ASTAZERO.labels[MARGINAL]}) marginally string stable at {MARGINAL_AT:g} rad/s. By its"
        f" Table III the gain there is {gain:.2f} dB.",
        f"Table III has {joined(refuted)} as L∞ string stable, by D > 0. That is necessary, not"
        " sufficient: by the exact criterion it is not.",
    )


def _decibels(vehicle: Parameters, omega: RadiansPerSecond) -> float:
    """|H| of one vehicle at a frequency, in dB."""
    return float(20 * np.log10(np.abs(response(vehicle[None], np.array([omega]))[0, 0])))


def beside_printed(result: Result) -> tuple[PrintedItem, Table, str] | None:
    """The table of the paper whose data and method a result has, filled, and how far it is off."""
    item = item_of(result)
    if item is None:
        return None
    printed = item.verdicts[0]
    learned = result.parameters[: len(printed.vehicles)]
    return item, reproduction_table(printed, learned), learned_line(printed, learned)


def deviations(printed: PrintedVerdicts, learned: Parameters) -> FloatArray:
    """(M, 3) relative difference of learned α, β and τ from the printed ones.

    One learned set stands for all rows, as where the paper prints several starts of one training.
    """
    return np.asarray(learned.values / printed.vehicles.parameters.values - 1)


def learned_line(printed: PrintedVerdicts, learned: Parameters) -> str:
    """The largest deviation of each parameter; a tick goes before where all are in `TOLERANCE`."""
    off = joined([f"{symbol} {value:.0f} %" for symbol, value in _furthest(printed, learned)])
    return f"{_tick(printed, learned)}learned; deviation at most {off}"


def _largest_deviations(printed: PrintedVerdicts, learned: Parameters) -> str:
    """The same, as short as a cell is."""
    off = ", ".join(f"{value:.0f}" for _, value in _furthest(printed, learned))
    return f"{_tick(printed, learned)}{off} %"


def _furthest(printed: PrintedVerdicts, learned: Parameters) -> list[tuple[str, float]]:
    """Each parameter's symbol and largest deviation in percent."""
    most = 100 * np.abs(deviations(printed, learned)).max(axis=0)
    return [(quantity.symbol, float(v)) for quantity, v in zip(PARAMETERS, most, strict=True)]


def _tick(printed: PrintedVerdicts, learned: Parameters) -> str:
    most = np.abs(deviations(printed, learned)).max()
    return f"{TICK} " if most <= TOLERANCE else ""


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
    """One row a follower: printed, recomputed and learned values.

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
