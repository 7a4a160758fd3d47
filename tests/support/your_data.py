"""The tables of docs/your-data.md, made of one simulated drive, and what each must be read as."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pandas as pd

from accpinn.model.cthp import Parameters, simulate
from accpinn.units import SPEED_UNITS

SAMPLES, STEP, LENGTH = 1200, 0.1, 4.5
_TIME = STEP * np.arange(SAMPLES)
_LEADER = 20 + 3 * np.sin(0.25 * _TIME) + 1.5 * np.sin(0.11 * _TIME)
_DRIVEN = simulate(
    Parameters(alpha=[0.08], beta=[0.3], tau=[1.2]),
    _TIME,
    _LEADER,
    np.array([20.0]),
    np.array([26.0]),
)
TRUE = pd.DataFrame({
    "t": _TIME.round(3), "lead": _DRIVEN.speeds[:, 0].round(3),
    "ego": _DRIVEN.speeds[:, 1].round(3), "gap": _DRIVEN.gaps[:, 0].round(3),
})  # fmt: skip
"""Time in s, both speeds in m/s, space-gap in m."""
_MEANS = (TRUE["ego"] + TRUE["ego"].shift(fill_value=TRUE["ego"][0])) / 2
_WAY = pd.DataFrame({"ego": (_MEANS * STEP).cumsum() - _MEANS[0] * STEP})
_WAY["lead"] = _WAY["ego"] + TRUE["gap"] + LENGTH


@dataclass(frozen=True)
class Kind:
    """A kind of table, as the page has it."""

    title: str
    about: str
    """What to know of it, in a sentence or two."""
    made: Callable[[], str]
    """The file's text."""
    is_read: bool = True
    """Whether it is read without a mapping."""
    subtract: float = 0.0
    """What the space-gap still contains of the vehicle ahead, in m."""


def _csv(frame: pd.DataFrame, **options: object) -> str:
    return frame.to_csv(index=False, lineterminator="\n", **options)  # type: ignore[call-overload]


def _named() -> str:
    return _csv(TRUE.rename(columns={"lead": "v_lead", "ego": "v_ego"}))


def _units() -> str:
    return _csv(pd.DataFrame({
        "Time [s]": TRUE["t"],
        "Speed leader [mph]": (TRUE["lead"] / SPEED_UNITS["mph"]).round(3),
        "Speed ego [mph]": (TRUE["ego"] / SPEED_UNITS["mph"]).round(3),
        "Gap [ft]": (TRUE["gap"] / 0.3048).round(3),
    }))  # fmt: skip


def _units_row() -> str:
    header, rows = _named().split("\n", 1)
    return f"{header}\ns,m/s,m/s,m\n{rows}"


def _iso() -> str:
    stamps = pd.Timestamp("2024-06-12T23:59:30Z") + pd.to_timedelta(TRUE["t"], "s")
    text = stamps.dt.strftime("%Y-%m-%dT%H:%M:%S.%f").str[:-3] + "Z"
    return _csv(pd.DataFrame({
        "UTC time": text, "lead (km/h)": (TRUE["lead"] * 3.6).round(3),
        "ego (km/h)": (TRUE["ego"] * 3.6).round(3), "distance [m]": TRUE["gap"],
    }))  # fmt: skip


def _german() -> str:
    frame = TRUE.rename(columns={
        "t": "Zeit [s]", "lead": "Geschwindigkeit lead [m/s]",
        "ego": "Geschwindigkeit ego [m/s]", "gap": "Abstand [m]",
    })  # fmt: skip
    return _csv(frame, sep=";", decimal=",")


def _relative() -> str:
    return _csv(pd.DataFrame({
        "time_ms": (TRUE["t"] * 1000).round().astype(int), "ego_speed_mps": TRUE["ego"],
        "range_m": TRUE["gap"], "range_rate_mps": (TRUE["lead"] - TRUE["ego"]).round(3),
    }))  # fmt: skip


def _positions() -> str:
    return _csv(pd.DataFrame({
        "time": TRUE["t"], "follower_v": TRUE["ego"], "follower_p": _WAY["ego"].round(3),
        "leader_v": TRUE["lead"], "leader_p": _WAY["lead"].round(3),
    }))  # fmt: skip


def _rates() -> str:
    rows = []
    for position, (name, late) in enumerate({"lead": 0.0, "ego": 0.013, "gap": 0.031}.items()):
        at = TRUE["t"] + late
        for t, value in zip(at, np.interp(at, TRUE["t"], TRUE[name]), strict=True):
            cells = ["", "", ""]
            cells[position] = f"{value:.3f}"
            rows.append((t, f"{t:.3f},{','.join(cells)}"))
    return "\n".join(["t,v1,v2,gap", *(row for _, row in sorted(rows)), ""])


def _no_names() -> str:
    frame = TRUE[["t", "ego", "lead", "gap"]].assign(last=0.0)
    return frame.to_csv(index=False, header=False, lineterminator="\n")


def _rows_of(vehicle: str, ahead: str, number: int, other: int) -> pd.DataFrame:
    return pd.DataFrame({
        "segment_id": 1, "local_veh_id": number, "length": LENGTH, "local_time": TRUE["t"],
        "follower_id": 0, "leader_id": 3, "filter_pos": _WAY[vehicle].round(3),
        "filter_speed": TRUE[vehicle],
    })  # fmt: skip


def _waymo() -> str:
    return _csv(pd.concat([_rows_of("ego", "lead", 0, 3), _rows_of("lead", "", 3, 0)]))


def _ngsim() -> str:
    def rows(vehicle: str, number: int, ahead: int) -> pd.DataFrame:
        return pd.DataFrame({
            "Vehicle_ID": number, "Frame_ID": np.arange(1, SAMPLES + 1),
            "Global_Time": 1113433135300 + (100 * np.arange(SAMPLES)),
            "Local_Y": (_WAY[vehicle] / 0.3048).round(3), "v_Length": round(LENGTH / 0.3048, 4),
            "v_Vel": (TRUE[vehicle] / 0.3048).round(3), "Lane_ID": 2, "Preceding": ahead,
        })  # fmt: skip

    return _csv(pd.concat([rows("ego", 12, 11), rows("lead", 11, 0)]))


def _highd() -> str:
    at = np.arange(0, 1200 * STEP, 0.04)
    known = {name: np.interp(at, TRUE["t"], TRUE[name]) for name in ("lead", "ego", "gap")}

    def rows(vehicle: str, number: int, ahead: int) -> pd.DataFrame:
        return pd.DataFrame({
            "frame": np.arange(1, len(at) + 1), "id": number, "x": 0.0,
            "xVelocity": -known[vehicle].round(4),
            "dhw": known["gap"].round(4) if ahead else 0.0, "precedingId": ahead, "laneId": 2,
        })  # fmt: skip

    return _csv(pd.concat([rows("ego", 5, 4), rows("lead", 4, 0)]))


def _sumo() -> str:
    steps = []
    for t, lead, ego, gap in TRUE.itertuples(index=False):
        steps.append(
            f'  <timestep time="{t:.2f}">\n'
            f'    <vehicle id="a" speed="{lead:.3f}" lane="e_0" leaderID="" leaderGap="-1.00"/>\n'
            f'    <vehicle id="b" speed="{ego:.3f}" lane="e_0" leaderID="a"'
            f' leaderGap="{gap:.3f}"/>\n  </timestep>'
        )
    return "\n".join(['<?xml version="1.0"?>', "<fcd-export>", *steps, "</fcd-export>", ""])


def _ohio() -> str:
    return _csv(pd.DataFrame({
        "ID": 1, "Time": TRUE["t"], "pos_x_av_f": _WAY["ego"].round(3), "speed_av": TRUE["ego"],
        "acc_av": 0.1, "pos_x_sv_f": _WAY["lead"].round(3), "speed_sv": TRUE["lead"], "acc_sv": 0.2,
        "closest_distance_longitudinal (gap)": TRUE["gap"],
        "distance_av (headway)": (TRUE["gap"] + LENGTH).round(3),
    }))  # fmt: skip


def _openacc() -> str:
    return _csv(
        TRUE.rename(columns={"t": "Time", "lead": "Speed1", "ego": "Speed2", "gap": "IVS1"})
    )


def _pairs() -> str:
    return _csv(pd.DataFrame({
        "Trajectory_ID": 0, "Time_Index": TRUE["t"], "ID_LV": 27, "Type_LV": 0,
        "Speed_LV": TRUE["lead"], "ID_FAV": 10, "Speed_FAV": TRUE["ego"],
        "Spatial_Gap": TRUE["gap"],
    }))  # fmt: skip


KINDS = (
    Kind(
        "Columns named as usual",
        "Units that nobody names are found from the data: the gap must"
        " change as the speeds demand.",
        _named,
    ),
    Kind("Units in the header", "In brackets, in parentheses or behind an underscore.", _units),
    Kind(
        "A row of units",
        "Below the names; also metadata above them, comments, a repeated header,"
        " a comma at the end of each row.",
        _units_row,
    ),
    Kind(
        "Date and time",
        "ISO 8601 and other dates with a time, clocks as 12:35:10.1 or HHMMSS.SS,"
        " Unix time; midnight and the end of the GPS week are passed.",
        _iso,
    ),
    Kind("Decimal commas", "With semicolons, tabs or white space between cells.", _german),
    Kind("Relative speed", "The speed ahead is the own one plus the range rate.", _relative),
    Kind(
        "Positions",
        "The gap is the position ahead minus the own one, minus the length of the"
        " vehicle ahead, which you are asked for where no column has it.",
        _positions,
        is_read=False,
        subtract=LENGTH,
    ),
    Kind(
        "Signals in rows of their own",
        "As a bus logger writes them; all are put on the clock of the slowest.",
        _rates,
    ),
    Kind(
        "No column names",
        'Columns are called "column 1", "column 2"; which of them are'
        " speeds and gap follows from the data, and you confirm it.",
        _no_names,
        is_read=False,
    ),
)
"""Kinds of tables."""

SETS = (
    Kind(
        "OpenACC",
        "The runs of the Joint Research Centre; also without their five rows of metadata.",
        _openacc,
    ),
    Kind(
        "ULTra-AV and OpenPAV",
        "Unified tables of leader-follower pairs; pairs of one platoon are"
        " joined. `Type_LV` is 1 for an automated leader and 0 for a human one.",
        _pairs,
    ),
    Kind(
        "Vanderbilt",
        "No column names: time, own speed, speed ahead, gap.",
        _no_names,
        is_read=False,
    ),
    Kind("CATS", "Speeds and positions of both cars.", _positions, is_read=False, subtract=LENGTH),
    Kind("Central Ohio", "Who is ahead follows from the positions.", _ohio),
    Kind(
        "Waymo, car-following pairs",
        "A row a vehicle and instant, with the leader's identifier.",
        _waymo,
    ),
    Kind(
        "NGSIM",
        "In feet; the gap is the difference of `Local_Y` less the length of the vehicle ahead.",
        _ngsim,
    ),
    Kind(
        "highD",
        "Frames at 25 Hz; `dhw` is the gap, also of cars that drive in the other direction.",
        _highd,
    ),
    Kind(
        "SUMO",
        "Floating car data as XML, gzipped or not, with"
        " `--fcd-output.max-leader-distance`, which adds leader and gap.",
        _sumo,
    ),
)
"""Public data sets, by their published layouts."""
