"""Headers of tables as engineers and their tools write them: read, offered or refused."""

from itertools import pairwise
from typing import Any

import numpy as np
import pandas as pd
import pytest

from accpinn.errors import RecordingError
from accpinn.recordings.files import contradictions, opened
from accpinn.units import GAP_UNITS, SPEED_UNITS
from tests.support.tables import Truth, drive, misread, text

TRUTH = drive()
FIVE = drive(vehicles=5)
Table = tuple[bytes, Truth]


def _stamps(pattern: str, start: str = "2024-03-25 10:07:03.2") -> list[str]:
    first = pd.Timestamp(start)
    return [
        (first + pd.Timedelta(seconds=t)).strftime(pattern)[: None if "%f" not in pattern else -3]
        for t in TRUTH.time
    ]


def _made(columns: dict[str, Any], truth: Truth = TRUTH, **how: Any) -> Table:
    return text(pd.DataFrame(columns), **how), truth


def header(names: str, order: str, separator: str = ",", **how: Any) -> Table:
    """A plain table whose names are split at bars.

    ``order`` says what each column holds: keys of `COLUMNS`, with a unit behind a bar, as
    "lead|km/h", or a factor, as "t*1000".
    """
    columns = {}
    for name, what in zip(names.split("|"), order.split(), strict=True):
        key, _, unit = what.partition("|")
        key, _, factor = key.partition("*")
        columns[name] = COLUMNS[key]
        if factor:
            columns[name] = columns[name] * float(factor)
        if unit:
            columns[name] = columns[name] / {**SPEED_UNITS, **GAP_UNITS}[unit]
    return _made(columns, sep=separator, **how)


COLUMNS: dict[str, Any] = {
    "t": TRUTH.time,
    "unix": 1.7e9 + TRUTH.time,
    "lead": TRUTH.lead,
    "ego": TRUTH.ego,
    "gap": TRUTH.gap,
    "relative": TRUTH.lead - TRUTH.ego,
    "closing": TRUTH.ego - TRUTH.lead,
    "index": np.arange(len(TRUTH.time)),
    "one": np.ones(len(TRUTH.time)),
    "zero": np.zeros(len(TRUTH.time)),
    "lat": 48.1 + 1e-6 * TRUTH.time,
    "lon": 11.5 + 2e-4 * TRUTH.time,
    "accel": np.gradient(TRUTH.ego, 0.1).round(3),
    "accel_lead": np.gradient(TRUTH.lead, 0.1).round(3),
    "thw": (TRUTH.gap / TRUTH.ego).round(3),
    "secs": 1700000000 + np.floor(TRUTH.time + 0.7),
    "nsecs": np.round(((TRUTH.time + 0.7) % 1) * 1e9),
    "setspeed": np.full(len(TRUTH.time), 30.0),
    "yaw": 0.01 * np.sin(TRUTH.time),
    "day_first": _stamps("%d.%m.%Y %H:%M:%S.%f"),
    "month_first": _stamps("%m/%d/%Y %I:%M:%S.%f"),
    "date": _stamps("%d/%m/%Y"),
    "clock": _stamps("%H:%M:%S.%f"),
    "iso": _stamps("%Y-%m-%dT%H:%M:%S.%f"),
}

CASES: dict[str, tuple[Table, str]] = {}
"""Tables with their truths, and how each is handled."""


def case(title: str, outcome: str, table: Table) -> None:
    """Add a case."""
    assert title not in CASES
    CASES[title] = table, outcome


READ, OFFERED, REFUSED = "read", "offered", "refused"
"""Read without confirmation; read by the proposal once confirmed; refused with the cause."""
KMH_NAMES = "Time [s]|Lead speed [km/h]|Ego speed [km/h]|Gap [m]"
case(
    "german",
    READ,
    header("Zeit [s]|v_Vorderfahrzeug [km/h]|v_Ego [km/h]|Abstand [m]", "t lead|km/h ego|km/h gap"),
)
case(
    "german umlauts latin-1",
    READ,
    (
        header(
            "Zeit [s]|Tempo Führungsfahrzeug [km/h]|Tempo Ego [km/h]|Abstand [m]",
            "t lead|km/h ego|km/h gap",
            separator=";",
            decimal=",",
        )[0]
        .decode()
        .encode("latin-1"),
        TRUTH,
    ),
)
case(
    "german zielobjekt",
    READ,
    header(
        "Zeit_s|Eigengeschwindigkeit_kmh|Zielgeschwindigkeit_kmh|Abstand_m",
        "t ego|km/h lead|km/h gap",
    ),
)
case(
    "french",
    READ,
    header(
        "Temps (s)|Vitesse leader (km/h)|Vitesse ego (km/h)|Distance (m)",
        "t lead|km/h ego|km/h gap",
    ),
)
case(
    "french suiveur",
    READ,
    header("temps|vitesse_meneur_ms|vitesse_suiveur_ms|distance_inter_m", "t lead ego gap"),
)
case(
    "can names",
    READ,
    header("Time_s|VehSpd_FL_kph|ACC_Dist_m|ACC_RelSpd_mps", "t ego|km/h gap relative"),
)
case(
    "ego rel semicolons",
    READ,
    header(
        "time_s|ego_speed_mps|lead_rel_dist_m|lead_rel_vel_mps", "t ego gap relative", separator=";"
    ),
)
case(
    "range and range rate",
    READ,
    header(
        "Time since start (s)|Host Speed (m/s)|Range (m)|Range Rate (m/s)", "t ego gap relative"
    ),
)
case("HostSpeed TgtSpd", READ, header("Time|HostSpeed|TgtSpd|TgtRange", "t ego lead gap"))
case(
    "host in mph",
    READ,
    header("Time(s)|HostSpeed(mph)|TargetSpeed(mph)|Range(ft)", "t ego|mph lead|mph gap|ft"),
)
case("matlab export", READ, header("time|vLead|vEgo|dRel", "t lead ego gap"))
case("comma ai", READ, header("t|vEgo|vRel|dRel|aEgo", "t ego relative gap accel"))
case(
    "matlab index column",
    READ,
    header("Var1|t_s|v_lead_mps|v_ego_mps|gap_m", "index t lead ego gap"),
)
case(
    "pandas index column",
    READ,
    header("|time|lead_speed|ego_speed|gap", "index t lead ego gap"),
)
case(
    "ros bag",
    READ,
    header(
        "header.seq|header.stamp.secs|header.stamp.nsecs|ego_speed|lead_speed|distance",
        "index secs nsecs ego lead gap",
    ),
)
case(
    "ros Time",
    READ,
    header(
        "Time|.header.stamp|.ego.twist.linear.x|.lead.twist.linear.x|.lead.distance",
        "unix unix ego lead gap",
    ),
)
case(
    "gps loggers with lat lon",
    READ,
    header(
        "UTC|Lat|Lon|Speed_lead_kmh|Speed_follower_kmh|gap_m|accel",
        "unix lat lon lead|km/h ego|km/h gap accel",
    ),
)
case(
    "dSPACE",
    REFUSED,
    header(
        "trace_x|Root/Ego/v_x [km/h]|Root/Lead/v_x [km/h]|Root/Sensor/distance [m]",
        "t ego|km/h lead|km/h gap",
    ),
)
case(
    "openpav",
    READ,
    header(
        "Trajectory_ID|Time_Index|Pos_LV|Speed_LV|Acc_LV|Pos_FAV|Speed_FAV|Acc_FAV|Space_Gap|Space_Headway|Speed_Diff|Acc_Diff",
        "one t t*24 lead accel_lead t*23 ego accel gap gap*1.2 relative accel",
    ),
)
case(
    "knots",
    READ,
    header("time_s|lead_kn|ego_kn|gap_m", "t lead|kn ego|kn gap"),
)
case(
    "speed ahead",
    READ,
    header("t [s]|speed ahead [m/s]|own speed [m/s]|clearance [m]", "t lead ego gap"),
)
case(
    "subject preceding",
    READ,
    header(
        "Time (sec)|Preceding vehicle speed (mph)|Subject speed (mph)|Following distance (ft)",
        "t lead|mph ego|mph gap|ft",
    ),
)
case(
    "front rear",
    READ,
    header(
        "timestamp_ms|front_speed_kmh|rear_speed_kmh|spacing_m", "t*1000 lead|km/h ego|km/h gap"
    ),
)
case("L and F", OFFERED, header("t|v_L|v_F|s", "t lead ego gap"))
case("v_p v_h d", OFFERED, header("t|v_p|v_h|d", "t lead ego gap"))
case("x y z names", REFUSED, header("a|b|c|d", "t lead ego gap"))
case("veh1 veh2", READ, header("Time|Veh1_Speed|Veh2_Speed|Gap12", "t lead ego gap"))
case(
    "closing speed",
    READ,
    header("time (s)|ego speed (km/h)|closing speed (km/h)|gap (m)", "t ego|km/h closing|km/h gap"),
)
case(
    "with thw and setspeed",
    READ,
    header(
        "time|lead_speed|ego_speed|set_speed|time_gap|gap|acc_active",
        "t lead ego setspeed thw gap one",
    ),
)
case(
    "two lead columns",
    READ,
    header(
        "time|lead_speed|lead_accel|ego_speed|ego_accel|gap|yaw_rate",
        "t lead accel_lead ego accel gap yaw",
    ),
)
case(
    "simulink",
    READ,
    header("time|Lead Car:1 [m/s]|Ego Car:1 [m/s]|Relative Distance:1 [m]", "t lead ego gap"),
)
case(
    "CANoe",
    READ,
    header(
        "Time[s]|EgoVehicle::VehicleSpeed[km/h]|ACC_Radar::Obj1_RelVel[m/s]|ACC_Radar::Obj1_Dist[m]",
        "t ego|km/h relative gap",
    ),
)
case(
    "long-range radar",
    READ,
    header("time|VehSpeed_kph|LRR_Obj0_dx_m|LRR_Obj0_vrel_mps", "t ego|km/h gap relative"),
)
case("time in ms named t", READ, header("t|v_lead|v_ego|gap", "t*1000 lead ego gap"))
case(
    "two clocks",
    READ,
    header("time_lead|lead_speed|time_ego|ego_speed|gap", "t lead t ego gap"),
)
case(
    "two vbox clocks",
    READ,
    header("UTC|Time|v_lead_kmh|v_ego_kmh|gap_m", "unix t lead|km/h ego|km/h gap"),
)
case("unix in ms", READ, header("epoch_ms|lead_mps|ego_mps|gap_m", "unix*1000 lead ego gap"))
case(
    "unix ns",
    READ,
    header("timestamp|lead_speed_mps|ego_speed_mps|gap_m", "unix*1e9 lead ego gap"),
)
case("capitals", READ, header("TIME|SPEED_LEAD|SPEED_EGO|GAP", "t lead ego gap"))
case(
    "space in unit",
    READ,
    header(
        "Time in s|Speed of leader in km/h|Speed of follower in km/h|Gap in m",
        "t lead|km/h ego|km/h gap",
    ),
)
case(
    "unit after comma",
    READ,
    header(
        "Time, s|Lead speed, km/h|Ego speed, km/h|Gap, m", "t lead|km/h ego|km/h gap", separator=";"
    ),
)
case(
    "slash units",
    READ,
    header("t / s|v_lead / (m/s)|v_ego / (m/s)|gap / m", "t lead ego gap"),
)
case(
    "spanish",
    READ,
    header("tiempo (s)|velocidad líder (m/s)|velocidad ego (m/s)|distancia (m)", "t lead ego gap"),
)
case(
    "italian",
    READ,
    header("tempo [s]|velocità leader [m/s]|velocità ego [m/s]|distanza [m]", "t lead ego gap"),
)
case(
    "unit m s^-1",
    READ,
    header("Time [s]|Leader speed [m s^-1]|Follower speed [m s^-1]|Gap [m]", "t lead ego gap"),
)
case(
    "unit superscript",
    READ,
    header("Time [s]|Leader speed [m·s⁻¹]|Follower speed [m·s⁻¹]|Gap [m]", "t lead ego gap"),
)
case(
    "quoted",
    READ,
    (
        text(
            pd.DataFrame(
                {
                    "Time": TRUTH.time,
                    "Lead Speed": TRUTH.lead,
                    "Ego Speed": TRUTH.ego,
                    "Gap": TRUTH.gap,
                }
            ),
            quoting=1,
        ),
        TRUTH,
    ),
)
case(
    "bom",
    READ,
    (
        b"\xef\xbb\xbf" + header("time|lead_speed_mps|ego_speed_mps|gap_m", "t lead ego gap")[0],
        TRUTH,
    ),
)
case(
    "utf16",
    READ,
    (
        header("time|lead_speed_mps|ego_speed_mps|gap_m", "t lead ego gap", separator="\t")[0]
        .decode()
        .encode("utf-16"),
        TRUTH,
    ),
)
case(
    "excel day first",
    READ,
    header(
        "Datum|v_lead_kmh|v_ego_kmh|Abstand_m",
        "day_first lead|km/h ego|km/h gap",
        separator=";",
        decimal=",",
    ),
)
case(
    "excel month first",
    READ,
    header("Date Time|lead mph|ego mph|gap ft", "month_first lead|mph ego|mph gap|ft"),
)
case(
    "date and time columns",
    READ,
    header("Date|Time|LeadSpeed_kph|EgoSpeed_kph|Gap_m", "date clock lead|km/h ego|km/h gap"),
)
case(
    "clock",
    READ,
    header("Uhrzeit|v_lead_kmh|v_ego_kmh|Abstand_m", "clock lead|km/h ego|km/h gap"),
)
case("iso", READ, header("timestamp|leader.speed|ego.speed|gap", "iso lead ego gap"))
case(
    "thousands",
    REFUSED,
    _made(
        {
            "time": TRUTH.time,
            "lead_speed_mps": TRUTH.lead,
            "ego_speed_mps": TRUTH.ego,
            "gap_mm": [f"{1000 * g:,.0f}" for g in TRUTH.gap],
        }
    ),
)
case(
    "thousands of time",
    REFUSED,
    _made(
        {
            "time_ms": [f"{1000 * g:,.0f}" for g in TRUTH.time],
            "lead_speed_mps": TRUTH.lead,
            "ego_speed_mps": TRUTH.ego,
            "gap_m": TRUTH.gap,
        }
    ),
)
case(
    "platoon by names",
    READ,
    _made(
        {
            "Time [s]": FIVE.time,
            **{
                f"{n} Speed [km/h]": FIVE.speeds[:, k] * 3.6
                for k, n in enumerate(("Audi", "BMW", "Ford", "Kia", "VW"))
            },
            **{
                f"Gap {a}-{b} [m]": FIVE.gaps[:, k]
                for k, (a, b) in enumerate(pairwise(("Audi", "BMW", "Ford", "Kia", "VW")))
            },
        },
        FIVE,
    ),
)
case(
    "platoon numbered",
    READ,
    _made(
        {
            "t": FIVE.time,
            **{f"v{k}": FIVE.speeds[:, k] for k in range(5)},
            **{f"gap{k + 1}": FIVE.gaps[:, k] for k in range(4)},
        },
        FIVE,
    ),
)
case(
    "platoon pairs of numbers",
    READ,
    _made(
        {
            "t": FIVE.time,
            **{f"v{k + 1}": FIVE.speeds[:, k] for k in range(5)},
            **{f"gap_{k + 1}{k + 2}": FIVE.gaps[:, k] for k in range(4)},
        },
        FIVE,
    ),
)
case(
    "platoon leader followers",
    READ,
    _made(
        {
            "time": FIVE.time,
            "leader_speed": FIVE.speeds[:, 0],
            **{f"follower{k}_speed": FIVE.speeds[:, k] for k in range(1, 5)},
            **{f"follower{k}_gap": FIVE.gaps[:, k - 1] for k in range(1, 5)},
        },
        FIVE,
    ),
)
case(
    "platoon out of order",
    READ,
    _made(
        {
            "time": FIVE.time,
            **{f"speed_{k}": FIVE.speeds[:, k - 1] for k in (3, 1, 5, 2, 4)},
            **{f"gap_{k}": FIVE.gaps[:, k - 2] for k in (4, 2, 5, 3)},
        },
        FIVE,
    ),
)

# Columns whose data contradict their names.
for title, order in {
    "m/s under km/h": "t lead ego gap",
    "mph under km/h": "t lead|mph ego|mph gap",
    "feet under m": "t lead|km/h ego|km/h gap|ft",
    "one speed in m/s": "t lead ego|km/h gap",
    "the other speed in m/s": "t lead|km/h ego gap",
    "equal speeds": "t lead|km/h lead|km/h gap",
    "a speed as gap": "t lead|km/h ego|km/h ego|km/h",
    "constant gap": "t lead|km/h ego|km/h setspeed",
    "exchanged": "t ego|km/h lead|km/h gap",
    "negative": "t lead|km/h ego|km/h gap*-1",
}.items():
    case(title, REFUSED, header(KMH_NAMES, order))
case(
    "difference of the other sign",
    REFUSED,
    header("time_s|ego_speed_mps|rel_vel_mps|dist_m", "t ego closing gap"),
)


@pytest.mark.parametrize("title", CASES)
def test_a_header_is_read_offered_or_refused_and_never_misread(title: str) -> None:
    (raw, truth), wanted = CASES[title]
    file = opened(raw, "t.csv")
    if wanted == READ:
        recording = file.read()
        assert misread(recording, truth) == ""
        assert not contradictions(recording)
        return
    with pytest.raises(RecordingError) as caught:
        file.read()
    assert len(str(caught.value)) <= 300
    if wanted == OFFERED:
        recording = opened(raw, "t.csv", file.proposal.mapping).read()
        assert misread(recording, truth) == ""
