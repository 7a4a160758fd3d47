"""A recording and a window of it as tables: vehicles, quality, regimes and what they change."""

from collections.abc import Sequence

import numpy as np

from accpinn.methods.fit import Fit
from accpinn.model.cthp import Parameters
from accpinn.recordings.recording import Recording, Vehicle, agreement
from accpinn.results.tables.estimates import (
    TITLES,
    driver_cells,
    drivers,
    parameter_cells,
    where,
)
from accpinn.results.tables.table import Cell, Column, Filled, Table, percent_cells
from accpinn.segment.quality import Quality, Regimes
from accpinn.segment.segment import SegmentInfo
from accpinn.study.comparison import COMPARED, SensitivityResult


def recording_table(recording: Recording) -> Table:
    """A row for each vehicle with data: driver modes, missing samples, agreement of its gap."""
    present = [vehicle for vehicle in recording.vehicles if vehicle.present]
    ahead = [vehicle.index - 1 for vehicle in present]
    agreements = [agreement(recording, k) if k in recording.present else None for k in ahead]
    return Table.of(
        f"{recording.source}: vehicles",
        [
            (Column("Vehicle"), [recording.label(vehicle.index) for vehicle in present]),
            (Column("ACC", "%", 0, "Driver"), [_share(vehicle, "ACC") for vehicle in present]),
            (Column("Human", "%", 0, "Driver"), [_share(vehicle, "Human") for vehicle in present]),
            (Column("Speed missing", "%", 1), [100 * v.missing_share for v in present]),
            (Column("Gap ahead: correlation with speeds", "", 2), agreements),
        ],
    )


def _share(vehicle: Vehicle, mode: str) -> Cell:
    """A mode's share of the samples with a mode, in percent; None without any."""
    modes = vehicle.modes or {}
    total = sum(modes.values())
    return 100 * modes[mode] / total if total else None


def quality_table(info: SegmentInfo, quality: Quality, estimate: Fit) -> Table:
    """One row a follower: the window's figures, and the least-squares estimate from it."""
    return Table.of(
        where(info),
        [
            (Column("Follower"), info.labels[1:]),
            *driver_cells(drivers(info)),
            *parameter_cells(estimate.parameters, "Least-squares estimate"),
            (Column("Mean time gap", "s", 2), quality.mean_time_gap),
            (Column("Car-following", "%", 0), percent_cells(quality.car_following)),
            (Column("Δv, std.", "m/s", 2), quality.relative_deviation),
            (Column("Condition number", "", 0), quality.condition),
        ],
    )


def regimes_table(info: SegmentInfo, regimes: Regimes) -> Table:
    """One row a follower: its share of instants in each regime."""
    shares = np.transpose(regimes.shares)
    filled = [
        (Column(name.capitalize(), "%", 0), percent_cells(share))
        for name, share in zip(regimes.names, shares, strict=True)
    ]
    followers = (Column("Follower"), info.labels[1:])
    return Table.of(f"Regimes, {where(info)}", [followers, *filled])


def sensitivity_table(
    info: SegmentInfo, sensitivities: Sequence[SensitivityResult], follower: int
) -> Table:
    """One row a choice of instants: what each method estimates for one follower from them."""
    of_method = {key: [row for row in sensitivities if row.method == key] for key in COMPARED}
    rows = of_method[COMPARED[0]]
    unknown = Parameters(np.nan, np.nan, np.nan)
    filled: list[Filled] = [
        (Column("Instants"), [row.choice.capitalize() for row in rows]),
        (Column("Excluded", "%", 0), percent_cells([row.share[follower] for row in rows])),
    ]
    for key, results in of_method.items():
        estimates = [r.parameters[follower] if r.parameters else unknown for r in results]
        filled += parameter_cells(Parameters.stack(estimates), TITLES[key])
    title = f"Sensitivity of the estimates: {info.labels[follower + 1]}, {where(info)}"
    return Table.of(title, filled)
