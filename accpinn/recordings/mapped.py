"""A table read by its mapping: each run as a `Recording`.

Here a row is one instant of all vehicles; trajectories.py reads tables of one row a vehicle and
instant.
"""

from functools import partial

import numpy as np
from numpy.typing import NDArray

from accpinn.channels import GAP, SPEED
from accpinn.findings import Finding, Labelled, Words
from accpinn.recordings import Mode, Recording, clocks
from accpinn.recordings.mapped_columns import measured_channel, read_mapped_columns, time_stamps
from accpinn.recordings.mapping import (
    CsvMapping,
    GapColumn,
    check_mapping,
)
from accpinn.recordings.names import ColumnName
from accpinn.recordings.sampling import merged, recording_of, shifted, without_lost_targets
from accpinn.recordings.source import SourceFile, excerpt
from accpinn.recordings.table_layout import Layout, layout_of
from accpinn.recordings.tables import MINIMUM_SAMPLES, MOST_RUNS, Columns, TableRun
from accpinn.recordings.trajectories import platoons_of
from accpinn.units import GAP_UNITS, SPEED_UNITS, FloatArray


class UnitContradictsHeader(Finding, frozen=True):
    """A column is read in another unit than its name, or the row of units, gives."""

    text = 'Column "{shown}" is read in {taken}, and the table says {named}; check the mapping.'

    column: str
    taken: str
    """The mapping's unit."""
    named: str
    """The table's."""

    def _words(self, about: Labelled) -> Words:
        return {"shown": excerpt(self.column, 60)}


def unit_contradictions(mapping: CsvMapping, layout: Layout) -> tuple[UnitContradictsHeader, ...]:
    """Findings of speeds and gaps whose units differ between the table and its mapping."""
    units = dict(zip(layout.names, layout.units, strict=False))
    read_in = [(speed.column, speed.unit, True) for speed in mapping.speeds]
    for gap in mapping.gaps:
        read_in += [(name, gap.unit, False) for name in (gap.column, gap.minus) if name]
    findings = []
    for column, taken, is_speed in dict.fromkeys(read_in):
        name = ColumnName(column, units.get(column, ""))
        named = name.speed_unit if is_speed else name.length_unit
        if named and named != taken:
            findings.append(UnitContradictsHeader(column, taken, named))
    return tuple(findings)


def runs_of(
    source_file: SourceFile,
    mapping: CsvMapping,
    layout: Layout | None = None,
    notes: tuple[Finding, ...] = (),
) -> tuple[TableRun, ...]:
    """The runs of a table, in the order of their first rows.

    Args:
        source_file: the table.
        mapping: which columns hold what.
        layout: how the table is written; found by default.
        notes: findings about the mapping, which each recording gets.

    Raises:
        RecordingError: one sentence of file, place, fault and cure.
    """
    check_mapping(mapping)
    layout = layout or layout_of(source_file)
    notes = (*notes, *unit_contradictions(mapping, layout))
    columns = read_mapped_columns(source_file, mapping, layout)
    if mapping.by:
        return platoons_of(columns, mapping, mapping.by, notes)
    runs: dict[str | None, NDArray[np.int64]] = {None: columns.rows}
    if mapping.trajectory:
        words = columns.words[mapping.trajectory]
        numbers = {name: k for k, name in enumerate(dict.fromkeys(words))}
        if len(numbers) > min(MOST_RUNS, len(words) / 2):
            fault = f"it tells {len(numbers):,} runs apart in {len(words):,} rows"
            raise columns.refusal(fault, "choose the column that names runs", mapping.trajectory)
        codes = np.array([numbers[word] for word in words])
        order = np.argsort(codes, kind="stable")
        parts = np.split(order, np.cumsum(np.bincount(codes))[:-1])
        runs = dict(zip(numbers, parts, strict=True))
    return tuple(
        TableRun(
            () if trajectory is None else (trajectory,),
            len(mapping.speeds),
            columns,
            partial(_wide, columns, mapping, rows, trajectory, notes),
        )
        for trajectory, rows in runs.items()
    )


def _wide(
    columns: Columns,
    mapping: CsvMapping,
    rows: NDArray[np.int64],
    trajectory: str | None,
    notes: tuple[Finding, ...],
) -> Recording:
    """The recording of the rows of one run."""
    if len(rows) < MINIMUM_SAMPLES:
        many = f"the run has {len(rows)} row{'s' * (len(rows) != 1)}"
        cure = f"choose another one, as a recording has at least {MINIMUM_SAMPLES}"
        raise columns.source_file.refusal(many, cure)
    columns, findings = columns[rows], [*columns.source_file.contents.findings, *notes]
    at, stamps = time_stamps(columns, mapping)
    stamps, _ = clocks.unwrapped(stamps)
    time = columns.time(at, stamps)
    recorded = [
        measured_channel(columns, SPEED, speed.column, SPEED_UNITS[speed.unit], speed.reversed)
        for speed in mapping.speeds
    ]
    speeds = [
        values + recorded[speed.relative_to - 1] if speed.relative_to else values
        for values, speed in zip(recorded, mapping.speeds, strict=True)
    ]
    gaps = [_gap(columns, gap) for gap in mapping.gaps]
    for k, speed in enumerate(speeds[1:]):
        gaps[k], lost = without_lost_targets(k + 1, time, speed, gaps[k])
        findings += [lost] if lost else []
    shifts = [speed.shift for speed in mapping.speeds] + [gap.shift for gap in mapping.gaps]
    names = [speed.column for speed in mapping.speeds] + [gap.column for gap in mapping.gaps]
    channels = np.column_stack(
        [shifted(time, s, shift) for s, shift in zip((*speeds, *gaps), shifts, strict=True)]
    )
    modes = np.full((len(columns), len(speeds)), Mode.UNKNOWN, np.int8)
    for mode in mapping.modes:
        modes[:, mode.vehicle - 1] = columns.modes(mode.column, mode.acc, mode.human, findings)
    if any(shifts):  # the ends, where a channel that was shifted has no value
        complete = np.flatnonzero(np.isfinite(channels).all(axis=1))
        if len(complete) < MINIMUM_SAMPLES:
            fault = "no instants are left at which all channels are known"
            raise columns.source_file.refusal(fault, "choose smaller shifts in the mapping")
        inside = slice(complete[0], complete[-1] + 1)
        time, channels, modes = time[inside] - time[inside][0], channels[inside], modes[inside]
    instants, channels, rates = merged(time, channels, names)
    if rates:
        findings.append(rates)
        modes = modes[np.searchsorted(time, np.clip(instants, 0, time[-1]))]
    return recording_of(
        instants, channels[:, : len(speeds)], channels[:, len(speeds) :], modes,
        refuse=lambda fault, cure, row: columns.refusal(fault, cure, at, row),
        source=columns.source_file.name + (f", trajectory {trajectory}" if trajectory else ""),
        sha256=columns.source_file.sha256(trajectory),
        trajectory=trajectory,
        names={k: excerpt(speed.name, 80) for k, speed in enumerate(mapping.speeds, 1)},
        findings=findings,
        mapping=mapping,
    )  # fmt: skip


def _gap(columns: Columns, gap: GapColumn) -> FloatArray:
    """The space-gap (N,) in m."""
    factor = GAP_UNITS[gap.unit]
    if not gap.minus:
        values = measured_channel(columns, GAP, gap.column, factor, gap.reversed)
    else:
        columns.require_some(gap.column, "choose another column")
        columns.require_some(gap.minus, "choose another column")
        values = (columns.numbers[gap.column] - columns.numbers[gap.minus]) * factor
        values = columns.sized(GAP, -values if gap.reversed else values, gap.column)
    length = gap.subtract
    return values - (columns.numbers[length] * factor if isinstance(length, str) else length)
