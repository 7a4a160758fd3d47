"""OpenACC files made for a test: a small sound platoon, bent into whatever the test needs."""

import io
from collections.abc import Sequence

import numpy as np
import pandas as pd

from accpinn.recordings import Recording
from accpinn.recordings.openacc import read

STEP = 0.1


def platoon(vehicles: int = 3, samples: int = 400, first_time: float = 100.0) -> pd.DataFrame:
    """Columns Time, Speed<i>, IVS<i>: gaps are the exact integrals of the speed differences."""
    time = STEP * np.arange(samples)
    columns: dict[str, np.ndarray] = {"Time": np.round(first_time + time, 6)}
    ahead, travelled_ahead = None, None
    for number in range(1, vehicles + 1):
        omega, phase = 0.3, 0.4 * number
        speed = 20 + 2 * np.sin(omega * time - phase)
        travelled = 20 * time - 2 / omega * np.cos(omega * time - phase)
        columns[f"Speed{number}"] = speed
        if ahead is not None:
            columns[f"IVS{number - 1}"] = 30 + travelled_ahead - travelled
        ahead, travelled_ahead = speed, travelled
    return pd.DataFrame(columns)


def metadata(
    names: Sequence[str] = ("Alpha", "Beta", "Gamma"),
    day: str = "26,2,2019",
    number: str | None = None,
    acc: str = "1",
    distance: str = "min",
) -> list[str]:
    """The five rows above the column names."""
    return [
        f"Date,{day}",
        ",".join(["Vehicle_order", *names]),
        f"Number_of_vehicles,{len(names) if number is None else number}",
        f"ACC,{acc}",
        f"Distance_setting,{distance}",
    ]


def csv(frame: pd.DataFrame, rows: Sequence[str] | None = None, end: str = "\r\n") -> bytes:
    """The bytes of a file: metadata rows, column names, numbers."""
    above = metadata() if rows is None else list(rows)
    body = io.StringIO()
    frame.to_csv(body, index=False, lineterminator=end)
    return (end.join([*above, ""]) + body.getvalue()).encode()


def recording(
    frame: pd.DataFrame | None = None, names: Sequence[str] = "ABC", **facts: str
) -> Recording:
    """A platoon of vehicles with these names, read; ``facts`` as in `metadata`."""
    made = platoon(len(names)) if frame is None else frame
    return read(csv(made, metadata(names, **facts)), "run.csv")


def pair(
    frame: pd.DataFrame, ahead: int, name: str, first: int = 0, last: int | None = None
) -> pd.DataFrame:
    """Vehicles ``ahead`` and ``ahead`` + 1 of an OpenACC frame as a pair over some samples."""
    rows = frame.iloc[first:last]
    return pd.DataFrame(
        {
            "Trajectory_ID": name,
            "Time_Index": np.round(0.1 * np.arange(len(rows)), 6),
            "ID_LV": 100 + ahead,
            "Type_LV": 0 if ahead == 1 else 1,
            "Extra": "x",
            "Speed_LV": rows[f"Speed{ahead}"].to_numpy(),
            "ID_FAV": 101 + ahead,
            "Speed_FAV": rows[f"Speed{ahead + 1}"].to_numpy(),
            "Spatial_Gap": rows[f"IVS{ahead}"].to_numpy(),
        }
    )


def table(*pairs: pd.DataFrame) -> bytes:
    """The bytes of a table of pairs."""
    return pd.concat(pairs).to_csv(index=False).encode()
