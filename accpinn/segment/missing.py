"""Missing samples: short blocks are bridged and named, longer ones refused."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from accpinn.channels import GAP, SPEED
from accpinn.errors import SegmentError
from accpinn.mask import Run, runs
from accpinn.recordings.recording import Recording
from accpinn.segment.segment import Window
from accpinn.segment.vehicles import check_vehicles
from accpinn.units import FloatArray, Seconds

BRIDGE: Seconds = 1.0
"""Missing blocks up to this long are bridged by a straight line, as the database's makers did."""
MINIMUM_DURATION: Seconds = 10.0
"""A shorter window says too little about three parameters."""
WINDOWS_LISTED = 3

_SLACK: Seconds = 1e-6


@dataclass(frozen=True, eq=False)
class VehicleChannels:
    """The channels of consecutive vehicles over a whole recording, short blocks bridged."""

    recording: Recording
    vehicles: tuple[int, ...]
    columns: tuple[str, ...]
    """(2M+1,) their names in the file: speeds, leader first, then gaps."""
    values: FloatArray
    """(N, 2M+1) in m/s and m; NaN where a block could not be bridged."""
    bridged: tuple[tuple[str, Run], ...]
    """The bridged blocks of each column."""
    bridge: Seconds

    def bridge_notes(self, rows: Run) -> list[str]:
        """One sentence a column that has bridged samples among ``rows``."""
        notes = []
        for column in self.columns:
            blocks = [
                block
                for name, block in self.bridged
                if name == column and block.last >= rows.first and block.first <= rows.last
            ]
            count = sum(len(block) for block in blocks)
            if count:
                samples = "1 sample" if count == 1 else f"{count} samples"
                where = ", ".join(str(interval(self.recording, block)) for block in blocks)
                notes.append(f"Bridged {samples} of {column} at {where}.")
        return notes


def platoon_data(
    recording: Recording, vehicles: tuple[int, ...], bridge: Seconds
) -> VehicleChannels:
    """Speeds and gaps of the vehicles, blocks of up to ``bridge`` seconds filled linearly."""
    if not (math.isfinite(bridge) and bridge >= 0):
        raise SegmentError(f"The limit for bridging cannot be {bridge:g} s; give 0 s or more.")
    columns = [SPEED.of(number) for number in vehicles] + [GAP.of(n) for n in vehicles[:-1]]
    raw = [recording.speed_of(n) for n in vehicles] + [
        recording.gap_behind(n) for n in vehicles[:-1]
    ]
    values = np.column_stack(raw)
    bridged = []
    for column, series in zip(columns, values.T, strict=True):
        for block in runs(np.isnan(series)):
            if _is_bridgeable(recording, block, bridge):
                inside, ends = slice(block.first, block.last + 1), [block.first - 1, block.last + 1]
                series[inside] = np.interp(
                    recording.time[inside], recording.time[ends], series[ends]
                )
                bridged.append((column, block))
    return VehicleChannels(recording, vehicles, tuple(columns), values, tuple(bridged), bridge)


def complete_windows(
    recording: Recording,
    vehicles: Sequence[int],
    minimum: Seconds = MINIMUM_DURATION,
    bridge: Seconds = BRIDGE,
) -> tuple[Window, ...]:
    """The intervals of at least ``minimum`` seconds in which nothing is missing once bridged."""
    platoon = platoon_data(recording, check_vehicles(recording, vehicles), bridge)
    return _complete(platoon, minimum)


def refuse_missing(platoon: VehicleChannels, rows: Run) -> None:
    """Raise if samples among ``rows`` are missing, and name the nearest complete windows."""
    absent = np.isnan(platoon.values[rows.first : rows.last + 1])
    if not absent.any():
        return
    column = int(absent.any(axis=0).argmax())
    inside = max(runs(absent[:, column]), key=len)
    block = Run(inside.first + rows.first, inside.last + rows.first)
    recording = platoon.recording
    middle = float(recording.time[(rows.first + rows.last) // 2])
    nearest = sorted(
        _complete(platoon, MINIMUM_DURATION),
        key=lambda window: max(window.start - middle, middle - window.end, 0.0),
    )
    listed = sorted(nearest[:WINDOWS_LISTED], key=lambda window: window.start)
    where = ", ".join(str(window) for window in listed)
    raise SegmentError(
        f"{recording.source}: {platoon.columns[column]} is missing at"
        f" {interval(recording, block)}, {_why(platoon, block)};"
        f" {f'complete nearby: {where}' if where else 'choose other vehicles'}."
    )


def interval(recording: Recording, rows: Run) -> Window:
    """The time that a run of samples covers."""
    first, last = (round(float(recording.time[at]), 6) for at in (rows.first, rows.last))
    return Window(first, last)


def _complete(platoon: VehicleChannels, minimum: Seconds) -> tuple[Window, ...]:
    complete = runs(np.isfinite(platoon.values).all(axis=1))
    windows = (interval(platoon.recording, run) for run in complete)
    return tuple(window for window in windows if window.duration >= minimum - _SLACK)


def _is_bridgeable(recording: Recording, block: Run, bridge: Seconds) -> bool:
    """Short enough, with a known sample on either side."""
    enclosed = block.first > 0 and block.last < recording.samples - 1
    length = interval(recording, block).duration + recording.sample_time
    return enclosed and length <= bridge + _SLACK


def _why(platoon: VehicleChannels, block: Run) -> str:
    if block.first == 0:
        return "where no earlier sample helps"
    if block.last == platoon.recording.samples - 1:
        return "where no later sample helps"
    return f"too long to bridge (limit {platoon.bridge:g} s)"
