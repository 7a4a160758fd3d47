"""Mappings of public data sets of trajectories, which their column names identify.

Units that the names do not give are those of the documentation:

    NGSIM    Next Generation Simulation (Federal Highway Administration): feet and feet/s, time in
             ms, positions of the front's middle along the road (`Local_Y`)
    highD    Krajewski et al., 21st IEEE ITSC, 2018: frames at 25 Hz, m and m/s, `dhw` from bumper
             to bumper
    SUMO     floating car data of Eclipse SUMO, as XML or as its tools write csv; `leaderGap` from
             bumper to bumper
"""

from collections.abc import Sequence

from accpinn.recordings.mapping import (
    ByVehicle,
    CsvMapping,
    GapColumn,
    SpeedColumn,
    TimeColumn,
)

LAYOUTS: dict[str, CsvMapping] = {
    "NGSIM": CsvMapping(
        (SpeedColumn("v_Vel", "ft/s"),),
        (GapColumn("Local_Y", "ft", "v_Length", minus="Local_Y"),),
        TimeColumn("Global_Time", "ms"),
        by=ByVehicle("Vehicle_ID", "Preceding"),
    ),
    "highD": CsvMapping(
        (SpeedColumn("xVelocity"),),
        (GapColumn("dhw"),),
        TimeColumn("frame", "frame"),
        sample_time=0.04,
        by=ByVehicle("id", "precedingId"),
    ),
    "SUMO's floating car data": CsvMapping(
        (SpeedColumn("speed"),),
        (GapColumn("leaderGap"),),
        TimeColumn("time"),
        by=ByVehicle("id", "leaderID"),
    ),
    "SUMO's floating car data as csv": CsvMapping(
        (SpeedColumn("vehicle_speed"),),
        (GapColumn("vehicle_leaderGap"),),
        TimeColumn("timestep_time"),
        by=ByVehicle("vehicle_id", "vehicle_leaderID"),
    ),
}
"""The mapping of each data set by its name."""


def published_layout(names: Sequence[str]) -> tuple[str, CsvMapping] | None:
    """The data set whose columns a table has, and its mapping; None for any other table."""
    for title, mapping in LAYOUTS.items():
        speed, gap, time, by = mapping.speeds[0], mapping.gaps[0], mapping.time, mapping.by
        columns = {speed.column, gap.column, gap.subtract if isinstance(gap.subtract, str) else ""}
        columns |= {time.column} if time else set()
        columns |= {by.vehicle, by.leader} if by else set()
        if columns - {""} <= set(names):
            return title, mapping
    return None
