"""The vehicles of a recording as a table: who drives, what is missing, which gaps are sound."""

from accpinn.recordings.recording import Recording, Vehicle, agreement
from accpinn.results.tables.table import Cell, Column, Table


def recording_table(recording: Recording) -> Table:
    """A row for each vehicle with data: driver modes, missing samples, agreement of its gap."""
    present = [vehicle for vehicle in recording.vehicles if vehicle.present]
    return Table.of(
        f"{recording.source}: vehicles",
        [
            (Column("Vehicle"), [recording.label(vehicle.index) for vehicle in present]),
            (Column("ACC", "%", 0, "Driver"), [_share(vehicle, "ACC") for vehicle in present]),
            (Column("Human", "%", 0, "Driver"), [_share(vehicle, "Human") for vehicle in present]),
            (Column("Speed missing", "%", 1), [100 * v.missing_share for v in present]),
            (Column("Gap ahead: correlation with speeds", "", 2), _agreements(recording, present)),
        ],
    )


def _share(vehicle: Vehicle, mode: str) -> Cell:
    """Of the samples with a mode, in percent; None without any."""
    modes = vehicle.modes or {}
    total = sum(modes.values())
    return 100 * modes[mode] / total if total else None


def _agreements(recording: Recording, present: list[Vehicle]) -> list[Cell]:
    numbers = recording.present
    return [
        agreement(recording, vehicle.index - 1) if vehicle.index - 1 in numbers else None
        for vehicle in present
    ]
