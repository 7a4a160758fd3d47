"""Tables of other people, whose headers are as engineers and their tools write them."""

import datetime
from collections.abc import Callable
from typing import Any

import numpy as np
import pandas as pd
import pytest

from accpinn.errors import RecordingError
from accpinn.recordings.files import contradictions, opened
from tests.support.tables import Truth, drive, misread, text

TRUTH = drive()
FIVE = drive(vehicles=5)
Table = tuple[bytes, Truth]


def _stamps(pattern: str, start: str = "2024-03-25 14:07:03.2") -> list[str]:
    first = pd.Timestamp(start)
    return [
        (first + pd.Timedelta(seconds=t)).strftime(pattern)[: None if "%f" not in pattern else -3]
        for t in TRUTH.time
    ]


def _made(columns: dict[str, Any], truth: Truth = TRUTH, **how: Any) -> Table:
    return text(pd.DataFrame(columns), **how), truth


def header(names: str, *order: str, separator: str = ",", **how: Any) -> Table:
    """A plain table whose names are split at bars; ``order`` says what each column holds.

    Each is a key of `COLUMNS`, or that with a factor as "lead*3.6".
    """
    columns = {}
    for name, what in zip(names.split("|"), order, strict=True):
        key, _, factor = what.partition("*")
        columns[name] = COLUMNS[key] * (float(factor) if factor else 1)
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
}
MPH, KMH, FT = "*2.2369363", "*3.6", "*3.2808399"

CASES: dict[str, tuple[Table, str]] = {}


def case(title: str, outcome: str, table: Table) -> None:
    CASES[title] = table, outcome


R, O, T = "read", "offered", "told"
case("german", R, header("Zeit [s]|v_Vorderfahrzeug [km/h]|v_Ego [km/h]|Abstand [m]", "t", "lead"+KMH, "ego"+KMH, "gap"))
case("german umlauts latin-1", R, (header("Zeit [s];Geschwindigkeit Führungsfahrzeug [km/h];Geschwindigkeit Ego [km/h];Abstand [m]".replace(";","|"), "t", "lead"+KMH, "ego"+KMH, "gap", separator=";", decimal=",")[0].decode().encode("latin-1"), TRUTH))
case("german zielobjekt", R, header("Zeit_s|Eigengeschwindigkeit_kmh|Zielgeschwindigkeit_kmh|Abstand_m", "t", "ego"+KMH, "lead"+KMH, "gap"))
case("french", R, header("Temps (s)|Vitesse leader (km/h)|Vitesse ego (km/h)|Distance (m)", "t", "lead"+KMH, "ego"+KMH, "gap"))
case("french suiveur", R, header("temps|vitesse_meneur_ms|vitesse_suiveur_ms|distance_inter_m", "t", "lead", "ego", "gap"))
case("can names", R, header("Time_s|VehSpd_FL_kph|ACC_Dist_m|ACC_RelSpd_mps", "t", "ego"+KMH, "gap", "relative"))
case("ego rel semicolons", R, header("time_s|ego_speed_mps|lead_rel_dist_m|lead_rel_vel_mps", "t", "ego", "gap", "relative", separator=";"))
case("range and range rate", R, header("Time since start (s)|Host Speed (m/s)|Range (m)|Range Rate (m/s)", "t", "ego", "gap", "relative"))
case("HostSpeed TgtSpd", R, header("Time|HostSpeed|TgtSpd|TgtRange", "t", "ego", "lead", "gap"))
case("host in mph", R, header("Time(s)|HostSpeed(mph)|TargetSpeed(mph)|Range(ft)", "t", "ego"+MPH, "lead"+MPH, "gap"+FT))
case("matlab export", R, header("time|vLead|vEgo|dRel", "t", "lead", "ego", "gap"))
case("comma ai", R, header("t|vEgo|vRel|dRel|aEgo", "t", "ego", "relative", "gap", "accel"))
case("matlab index column", R, header("Var1|t_s|v_lead_mps|v_ego_mps|gap_m", "index", "t", "lead", "ego", "gap"))
case("pandas index column", R, header("|time|lead_speed|ego_speed|gap", "index", "t", "lead", "ego", "gap"))
case("ros bag", R, header("header.seq|header.stamp.secs|header.stamp.nsecs|ego_speed|lead_speed|distance", "index", "secs", "nsecs", "ego", "lead", "gap"))
case("ros Time", R, header("Time|.header.stamp|.ego.twist.linear.x|.lead.twist.linear.x|.lead.distance", "unix", "unix", "ego", "lead", "gap"))
case("gps loggers with lat lon", R, header("UTC|Lat|Lon|Speed_lead_kmh|Speed_follower_kmh|gap_m|accel", "unix", "lat", "lon", "lead"+KMH, "ego"+KMH, "gap", "accel"))
case("dSPACE", R, header("trace_x|Model Root/Ego/v_x [km/h]|Model Root/Lead/v_x [km/h]|Model Root/Sensor/distance [m]", "t", "ego"+KMH, "lead"+KMH, "gap"))
case("openpav", R, header("Trajectory_ID|Time_Index|Pos_LV|Speed_LV|Acc_LV|Pos_FAV|Speed_FAV|Acc_FAV|Space_Gap|Space_Headway|Speed_Diff|Acc_Diff", "one", "t", "t*24", "lead", "accel_lead", "t*23", "ego", "accel", "gap", "gap*1.2", "relative", "accel"))
case("knots", R, header("time_s|lead_kn|ego_kn|gap_m", "t", "lead*1.9438445", "ego*1.9438445", "gap"))
case("speed ahead", R, header("t [s]|speed ahead [m/s]|own speed [m/s]|clearance [m]", "t", "lead", "ego", "gap"))
case("subject preceding", R, header("Time (sec)|Preceding vehicle speed (mph)|Subject vehicle speed (mph)|Following distance (ft)", "t", "lead"+MPH, "ego"+MPH, "gap"+FT))
case("front rear", R, header("timestamp_ms|front_speed_kmh|rear_speed_kmh|spacing_m", "t*1000", "lead"+KMH, "ego"+KMH, "gap"))
case("L and F", R, header("t|v_L|v_F|s", "t", "lead", "ego", "gap"))
case("v_p v_h d", O, header("t|v_p|v_h|d", "t", "lead", "ego", "gap"))
case("x y z names", T, header("a|b|c|d", "t", "lead", "ego", "gap"))
case("veh1 veh2", R, header("Time|Veh1_Speed|Veh2_Speed|Gap12", "t", "lead", "ego", "gap"))
case("closing speed", R, header("time (s)|ego speed (km/h)|closing speed (km/h)|gap (m)", "t", "ego"+KMH, "closing"+KMH, "gap"))
case("with thw and setspeed", R, header("time|lead_speed|ego_speed|set_speed|time_gap|gap|acc_active", "t", "lead", "ego", "setspeed", "thw", "gap", "one"))
case("two lead columns", R, header("time|lead_speed|lead_accel|ego_speed|ego_accel|gap|yaw_rate", "t", "lead", "accel_lead", "ego", "accel", "gap", "yaw"))
case("simulink", R, header("time|Lead Car:1 [m/s]|Ego Car:1 [m/s]|Relative Distance:1 [m]", "t", "lead", "ego", "gap"))
case("CANoe", R, header("Time[s]|EgoVehicle::VehicleSpeed[km/h]|ACC_Radar::Obj1_RelVel[m/s]|ACC_Radar::Obj1_Dist[m]", "t", "ego"+KMH, "relative", "gap"))
case("long-range radar", R, header("time|VehSpeed_kph|LRR_Obj0_dx_m|LRR_Obj0_vrel_mps", "t", "ego"+KMH, "gap", "relative"))
case("time in ms named t", R, header("t|v_lead|v_ego|gap", "t*1000", "lead", "ego", "gap"))
case("two clocks", R, header("time_lead|lead_speed|time_ego|ego_speed|gap", "t", "lead", "t", "ego", "gap"))
case("two vbox clocks", R, header("UTC|Time|v_lead_kmh|v_ego_kmh|gap_m", "unix", "t", "lead"+KMH, "ego"+KMH, "gap"))
case("unix in ms", R, header("epoch_ms|lead_mps|ego_mps|gap_m", "unix*1000", "lead", "ego", "gap"))
case("unix ns", R, header("timestamp|lead_speed_mps|ego_speed_mps|gap_m", "unix*1e9", "lead", "ego", "gap"))
case("capitals", R, header("TIME|SPEED_LEAD|SPEED_EGO|GAP", "t", "lead", "ego", "gap"))
case("space in unit", R, header("Time in s|Speed of leader in km/h|Speed of follower in km/h|Gap in m", "t", "lead"+KMH, "ego"+KMH, "gap"))
case("unit after comma", R, header("Time, s|Lead speed, km/h|Ego speed, km/h|Gap, m", "t", "lead"+KMH, "ego"+KMH, "gap", separator=";"))
case("slash units", R, header("t / s|v_lead / (m/s)|v_ego / (m/s)|gap / m", "t", "lead", "ego", "gap"))
case("spanish", R, header("tiempo (s)|velocidad líder (m/s)|velocidad ego (m/s)|distancia (m)", "t", "lead", "ego", "gap"))
case("italian", R, header("tempo [s]|velocità leader [m/s]|velocità ego [m/s]|distanza [m]", "t", "lead", "ego", "gap"))
case("unit m s^-1", R, header("Time [s]|Leader speed [m s^-1]|Follower speed [m s^-1]|Gap [m]", "t", "lead", "ego", "gap"))
case("unit superscript", R, header("Time [s]|Leader speed [m·s⁻¹]|Follower speed [m·s⁻¹]|Gap [m]", "t", "lead", "ego", "gap"))
case("quoted", R, (text(pd.DataFrame({"Time": TRUTH.time, "Lead Speed": TRUTH.lead, "Ego Speed": TRUTH.ego, "Gap": TRUTH.gap}), quoting=1), TRUTH))
case("bom", R, (b"\xef\xbb\xbf" + header("time|lead_speed_mps|ego_speed_mps|gap_m", "t", "lead", "ego", "gap")[0], TRUTH))
case("utf16", R, (header("time|lead_speed_mps|ego_speed_mps|gap_m", "t", "lead", "ego", "gap", separator="\t")[0].decode().encode("utf-16"), TRUTH))
case("excel day first", R, _made({"Datum": _stamps("%d.%m.%Y %H:%M:%S.%f"), "v_lead_kmh": TRUTH.lead*3.6, "v_ego_kmh": TRUTH.ego*3.6, "Abstand_m": TRUTH.gap}, sep=";", decimal=","))
case("excel month first", R, _made({"Date Time": _stamps("%m/%d/%Y %I:%M:%S.%f"), "lead mph": TRUTH.lead*2.2369363, "ego mph": TRUTH.ego*2.2369363, "gap ft": TRUTH.gap*3.2808399}))
case("date and time columns", R, _made({"Date": _stamps("%d/%m/%Y"), "Time": _stamps("%H:%M:%S.%f"), "LeadSpeed_kph": TRUTH.lead*3.6, "EgoSpeed_kph": TRUTH.ego*3.6, "Gap_m": TRUTH.gap}))
case("clock", R, _made({"Uhrzeit": _stamps("%H:%M:%S.%f"), "v_lead_kmh": TRUTH.lead*3.6, "v_ego_kmh": TRUTH.ego*3.6, "Abstand_m": TRUTH.gap}))
case("iso", R, _made({"timestamp": _stamps("%Y-%m-%dT%H:%M:%S.%f"), "leader.speed": TRUTH.lead, "ego.speed": TRUTH.ego, "gap": TRUTH.gap}))
case("thousands", T, _made({"time": TRUTH.time, "lead_speed_mps": TRUTH.lead, "ego_speed_mps": TRUTH.ego, "gap_mm": [f"{1000 * g:,.0f}" for g in TRUTH.gap]}))
case("thousands of time", T, _made({"time_ms": [f"{1000 * g:,.0f}" for g in TRUTH.time], "lead_speed_mps": TRUTH.lead, "ego_speed_mps": TRUTH.ego, "gap_m": TRUTH.gap}))
case("platoon by names", O, _made({"Time [s]": FIVE.time, **{f"{n} Speed [km/h]": FIVE.speeds[:, k]*3.6 for k, n in enumerate(("Audi", "BMW", "Ford", "Kia", "VW"))}, **{f"Gap {a}-{b} [m]": FIVE.gaps[:, k] for k, (a, b) in enumerate(zip(("Audi", "BMW", "Ford", "Kia"), ("BMW", "Ford", "Kia", "VW")))}}, FIVE))
case("platoon numbered", R, _made({"t": FIVE.time, **{f"v{k}": FIVE.speeds[:, k] for k in range(5)}, **{f"gap{k+1}": FIVE.gaps[:, k] for k in range(4)}}, FIVE))
case("platoon pairs of numbers", R, _made({"t": FIVE.time, **{f"v{k+1}": FIVE.speeds[:, k] for k in range(5)}, **{f"gap_{k+1}{k+2}": FIVE.gaps[:, k] for k in range(4)}}, FIVE))
case("platoon leader followers", R, _made({"time": FIVE.time, "leader_speed": FIVE.speeds[:, 0], **{f"follower{k}_speed": FIVE.speeds[:, k] for k in range(1, 5)}, **{f"follower{k}_gap": FIVE.gaps[:, k - 1] for k in range(1, 5)}}, FIVE))
case("platoon out of order", R, _made({"time": FIVE.time, **{f"speed_{k}": FIVE.speeds[:, k - 1] for k in (3, 1, 5, 2, 4)}, **{f"gap_{k}": FIVE.gaps[:, k - 2] for k in (4, 2, 5, 3)}}, FIVE))

N = len(TRUTH.time)
# what must be told
case("m/s under km/h header", T, header("Time [s]|Lead speed [km/h]|Ego speed [km/h]|Gap [m]", "t", "lead", "ego", "gap"))
case("km/h under m/s header", T, header("Time [s]|Lead speed [m/s]|Ego speed [m/s]|Gap [m]", "t", "lead"+KMH, "ego"+KMH, "gap"))
case("one speed in km/h", T, header("Time [s]|Lead speed [m/s]|Ego speed [m/s]|Gap [m]", "t", "lead"+KMH, "ego", "gap"))
case("mph under km/h", T, header("Time [s]|Lead speed [km/h]|Ego speed [km/h]|Gap [m]", "t", "lead"+MPH, "ego"+MPH, "gap"))
case("wrong units row", T, (b"t,v1,v2,gap\ns,km/h,km/h,m\n" + header("t|v1|v2|gap", "t", "lead", "ego", "gap")[0].split(b"\n", 1)[1], TRUTH))
case("feet under m", T, header("Time [s]|Lead speed [m/s]|Ego speed [m/s]|Gap [m]", "t", "lead", "ego", "gap"+FT))
case("equal speeds", T, header("Time [s]|Lead speed [m/s]|Ego speed [m/s]|Gap [m]", "t", "lead", "lead", "gap"))
case("gap is a speed", T, header("Time [s]|Lead speed [m/s]|Ego speed [m/s]|Gap [m]", "t", "lead", "ego", "ego"))
case("constant gap", T, header("Time [s]|Lead speed [m/s]|Ego speed [m/s]|Gap [m]", "t", "lead", "ego", "setspeed"))
for fill in (0.0, 255.0, 250.0, -1.0):
    gap = TRUTH.gap.copy(); gap[300:420] = fill
    case(f"no target {fill:g}", T, _made({"time": TRUTH.time, "lead_mps": TRUTH.lead, "ego_mps": TRUTH.ego, "gap_m": gap}))
    lost = TRUTH.lead.copy(); lost[300:420] = 0.0
    case(f"no target {fill:g} and speed 0", T, _made({"time": TRUTH.time, "lead_mps": lost, "ego_mps": TRUTH.ego, "gap_m": gap}))
swapped = header("Time [s]|Lead speed [m/s]|Ego speed [m/s]|Gap [m]", "t", "ego", "lead", "gap")
case("swapped", T, swapped)
case("negative gap", T, header("Time [s]|Lead speed [m/s]|Ego speed [m/s]|Gap [m]", "t", "lead", "ego", "gap*-1"))
case("ego + relative reversed sign", T, header("time_s|ego_speed_mps|rel_vel_mps|dist_m", "t", "ego", "closing", "gap"))


def outcome(raw: bytes, truth: Truth) -> tuple[str, str]:
    file = opened(raw, "t.csv")
    try:
        recording = file.read()
    except RecordingError as e:
        said = str(e)
        try:
            m = file.proposal.mapping
            r = opened(raw, "t.csv", m).read()
            bad = misread(r, truth)
            if not bad: return "offered", said
            return ("told", said + " || " + bad)
        except Exception as x:
            return "told", said + " || " + str(x)[:100]
    bad = misread(recording, truth)
    against = contradictions(recording)
    other = [f for f in recording.findings if type(f).__name__ not in ("ColumnsProposed",)]
    if bad:
        return ("told" if against or other else "SILENT"), bad + " | " + " ; ".join(f.sentence(recording)[:160] for f in other)
    return ("read" if not other else "read+"), " ; ".join(f.sentence(recording)[:160] for f in other)

if __name__ == "__main__":
    import sys
    bad = 0
    for title, ((raw, truth), wanted) in CASES.items():
        try:
            got, why = outcome(raw, truth)
        except Exception as x:
            got, why = "ERROR", repr(x)
        flag = "  " if got == wanted else "!!"
        if got != wanted or (len(sys.argv) > 1): print(flag, title, "|", got, "wanted", wanted, "|", why[:420])
    print(len(CASES))
