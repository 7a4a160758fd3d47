"""Kinds of tables: each is read as its truth, or refused with the contradiction.

Each test makes its table from a simulated pair whose truth is known.
"""

import gzip
import io
from typing import Any, TypeVar

import numpy as np
import pandas as pd
import pytest

from accpinn.errors import RecordingError
from accpinn.findings import Finding
from accpinn.recordings import Mode, Recording, Window
from accpinn.recordings.cures import Exchange, Reverse, Shift
from accpinn.recordings.files import ColumnsProposed, contradictions, opened, read
from accpinn.recordings.inconsistency import (
    ClocksDiffer,
    ColumnsCopied,
    GapComputed,
    GapJumps,
    SignReversed,
    UnitsDiffer,
)
from accpinn.recordings.mapping import (
    CsvMapping,
    GapColumn,
    SpeedColumn,
    TimeColumn,
    cured,
    cures_of,
)
from accpinn.recordings.openacc import MetadataMissing
from accpinn.recordings.sampling import RatesMerged, RowsMissing, TargetLost
from accpinn.segment.windows import complete_windows
from accpinn.units import GAP_UNITS, SPEED_UNITS
from tests.support.openacc_files import pair, platoon, table
from tests.support.tables import STEADY, Truth, drive, frame, misread, text

F = TypeVar("F", bound=Finding)
LONGEST_SENTENCE = 300
LENGTH = 4.5
PLAIN = CsvMapping((SpeedColumn("v1"), SpeedColumn("v2")), (GapColumn("gap"),), TimeColumn("t"))


def only_finding(kind: type[F], recording: Recording) -> F:
    """The one finding of a kind."""
    [finding] = [finding for finding in recording.findings if isinstance(finding, kind)]
    return finding


def sound(raw: bytes, truth: Truth, *notes: type[Finding], **how: Any) -> Recording:
    """The recording of a table, which is right and has no findings but ``notes``."""
    recording = read(raw, "t.csv", **how)
    assert misread(recording, truth) == ""
    kinds = {type(finding) for finding in recording.findings}
    assert kinds <= {ColumnsProposed, *notes}
    assert set(notes) <= kinds
    return recording


def refusal(raw: bytes, **how: Any) -> str:
    """The sentence with which a table is refused; it offers a mapping."""
    with pytest.raises(RecordingError) as caught:
        read(raw, "t.csv", **how)
    assert len(str(caught.value)) <= LONGEST_SENTENCE
    return str(caught.value)


def changed(truth: Truth, **columns: Any) -> bytes:
    """A plain table with some of its columns replaced."""
    return text(frame(truth).assign(**columns))


# Other vehicles, clocks and time


def test_another_vehicle_cuts_in_and_out() -> None:
    truth = drive()
    gap = truth.gap + np.where((truth.time > 30) & (truth.time <= 60), -10.0, 0.0)
    recording = read(changed(truth, gap=gap), "t.csv")
    jumps = only_finding(GapJumps, recording)
    assert jumps.times == pytest.approx((30.1, 60.1), abs=0.11)
    assert jumps.sizes == pytest.approx((-10.0, 10.0), abs=0.5)
    ends = [window.end for window in complete_windows(recording, (1, 2))]
    assert any(29.0 < end <= 30.1 for end in ends)
    assert any(59.0 < end <= 60.1 for end in ends)


def test_iso_times_at_15_hz_with_a_zone() -> None:
    truth = drive(step=1 / 15)
    stamps = pd.Timestamp("2024-06-12T12:35:10") + pd.to_timedelta(truth.time, unit="s")
    written = [f"{stamp.isoformat(timespec='milliseconds')}Z" for stamp in stamps]
    recording = sound(changed(truth, t=written), truth)
    assert recording.duration == pytest.approx(truth.time[-1], abs=0.01)


@pytest.mark.parametrize("pattern", ["%H:%M:%S.%f", "%H%M%S.%f", "%d.%m.%Y %H:%M:%S.%f"])
def test_clocks_across_full_minutes(pattern: str) -> None:
    truth = drive()
    stamps = pd.Timestamp("2024-06-25 12:58:40") + pd.to_timedelta(truth.time, unit="s")
    sound(changed(truth, t=[stamp.strftime(pattern)[:-4] for stamp in stamps]), truth)


def test_date_and_time_in_two_columns() -> None:
    truth = drive()
    stamps = pd.Timestamp("2024-06-25 23:59:30") + pd.to_timedelta(truth.time, unit="s")
    apart = frame(truth, ("Time", "lead_speed", "ego_speed", "gap"))
    apart["Time"] = [stamp.strftime("%H:%M:%S.%f")[:-4] for stamp in stamps]
    apart.insert(0, "Date", [stamp.strftime("%Y-%m-%d") for stamp in stamps])
    mapping = sound(text(apart), truth).mapping
    assert mapping is not None
    assert mapping.time == TimeColumn("Time", "clock", "Date")


@pytest.mark.parametrize("period", [86_400, 604_800])
def test_a_clock_falls_at_midnight_and_at_the_end_of_the_week(period: int) -> None:
    truth = drive()
    sound(changed(truth, t=((truth.time + period - 30) % period).round(3)), truth)


def test_even_steps_are_no_default_beside_a_column_of_time() -> None:
    truth = drive()
    raw = changed(truth, t=[f"{k} o'clock" for k in range(len(truth.time))])
    proposal = opened(raw, "t.csv").proposal
    assert proposal.mapping.sample_time is None
    assert not proposal.is_supported
    refusal(raw)


@pytest.mark.parametrize(("late", "shift"), [(1.0, -1.0), (-0.5, 0.5)])
def test_the_clock_of_a_logger_differs(late: float, shift: float) -> None:
    truth = drive(seconds=120)
    raw = changed(truth, v1=np.interp(truth.time - late, truth.time, truth.lead).round(4))
    recording = read(raw, "t.csv", mapping=PLAIN)
    clocks = only_finding(ClocksDiffer, recording)
    assert clocks.seconds == pytest.approx(late, abs=0.05)
    cure = next(
        c for c in clocks.cures if isinstance(c, Shift) and (c.channel, c.vehicle) == ("Speed", 1)
    )
    assert cure.seconds == pytest.approx(shift, abs=0.05)
    after = read(raw, "t.csv", mapping=cured(PLAIN, cure))
    assert not contradictions(after)
    assert "1.0 s" in refusal(raw) or "0.5 s" in refusal(raw)


# Units, roles and signs


@pytest.mark.parametrize(
    ("names", "speed", "gap", "how"),
    [
        (("Time [s]", "v lead [ft/s]", "v ego [ft/s]", "gap [ft]"), "ft/s", "ft", {"mean": 10.0}),
        (("Time [s]", "Speed leader (km/h)", "Speed ego (km/h)", "Gap [m]"), "km/h", "m", STEADY),
        (("time", "preceding_mph", "subject_mph", "gap_ft"), "mph", "ft", STEADY),
        (("time_s", "front_speed_kn", "own_speed_kn", "gap_m"), "kn", "m", {}),
    ],
)  # fmt: skip
def test_units_and_roles_in_names(
    names: tuple[str, ...], speed: str, gap: str, how: dict[str, Any]
) -> None:
    truth = drive(**how)
    written = frame(truth, names)
    written[[*names[1:3]]] /= SPEED_UNITS[speed]
    written[names[3]] /= GAP_UNITS[gap]
    steady = len(set(how) & {"swing"})
    recording = read(text(written.round(4)), "t.csv")
    assert misread(recording, truth) == ""
    assert not contradictions(recording)
    assert len(recording.findings) == 1 + steady  # of a steady drive, that its leader hardly moves


@pytest.mark.parametrize(("name", "factor"), [("Time (min)", 1 / 60), ("time_ms", 1000.0)])
def test_units_of_time_in_names(name: str, factor: float) -> None:
    truth = drive()
    names = (name, "lead_speed", "ego_speed", "gap")
    sound(text(frame(truth, names).assign(**{name: (truth.time * factor).round(8)})), truth)


def test_frames_ask_for_their_rate() -> None:
    truth = drive()
    names = ("frame", "lead_mps", "ego_mps", "gap_m")
    raw = text(frame(truth, names).assign(frame=np.arange(len(truth.time))))
    proposal = opened(raw, "t.csv").proposal
    assert len(proposal.undecided) == 1
    assert proposal.mapping.time == TimeColumn("frame", "frame")
    assert "frame" in refusal(raw)
    sound(raw, truth, mapping=proposal.mapping)


def test_mph_read_as_kmh_lists_units_that_fit() -> None:
    truth = drive()
    raw = changed(truth, v1=truth.lead / SPEED_UNITS["mph"], v2=truth.ego / SPEED_UNITS["mph"])
    speeds = tuple(SpeedColumn(name, "km/h") for name in ("v1", "v2"))
    mapping = CsvMapping(speeds, PLAIN.gaps, PLAIN.time)
    differ = only_finding(UnitsDiffer, read(raw, "t.csv", mapping=mapping))
    assert differ.slope == pytest.approx(1.609, rel=0.03)
    assert ("speed", "km/h", "mph") in differ.misread
    cure = cures_of(differ, mapping)[0]
    assert not contradictions(read(raw, "t.csv", mapping=cured(mapping, cure)))


@pytest.mark.parametrize("place", ["header", "row"])
def test_a_header_that_contradicts_the_data_is_reported(place: str) -> None:
    truth = drive()
    names = (
        ("t", "v1 [km/h]", "v2 [km/h]", "gap") if place == "header" else ("t", "v1", "v2", "gap")
    )
    lines = text(frame(truth, names)).decode().splitlines(keepends=True)
    if place == "row":
        lines.insert(1, "s,km/h,km/h,m\n")
    raw = "".join(lines).encode()
    assert "3.6" in refusal(raw)
    recording = read(raw, "t.csv", mapping=opened(raw, "t.csv").proposal.mapping)
    assert only_finding(UnitsDiffer, recording).slope == pytest.approx(3.6, rel=0.03)


def test_a_gap_that_is_a_running_sum_of_speeds() -> None:
    truth = drive()
    difference = truth.lead - truth.ego
    computed = 30 + np.concatenate([[0], np.cumsum((difference[1:] + difference[:-1]) / 2 * 0.1)])
    assert only_finding(GapComputed, read(changed(truth, gap=computed.round(4)), "t.csv"))
    assert not contradictions(read(changed(truth, gap=computed.round(4)), "t.csv"))


@pytest.mark.parametrize("is_negative", [False, True])
def test_columns_are_exchanged_or_the_sign_is_reversed(is_negative: bool) -> None:
    truth = drive()
    raw = changed(truth, v1=truth.ego, v2=truth.lead)
    if is_negative:
        raw = changed(truth, gap=-truth.gap)
    sign = only_finding(SignReversed, read(raw, "t.csv", mapping=PLAIN))
    assert sign.cures == (Reverse(1) if is_negative else Exchange(1),)
    assert misread(read(raw, "t.csv", mapping=cured(PLAIN, sign.cures[0])), truth) == ""
    assert "sign" in refusal(raw) if is_negative else "exchange" in refusal(raw)


def test_two_errors_of_sign_that_agree_are_refused() -> None:
    truth = drive()
    raw = changed(truth, v1=truth.ego, v2=truth.lead, gap=-truth.gap)
    assert "negative" in refusal(raw)


@pytest.mark.parametrize("twice", ["v1", "v2", "gap", "t"])
def test_a_column_has_one_role(twice: str) -> None:
    speeds = tuple(SpeedColumn(name if name != "v1" else twice) for name in ("v1", "v2"))
    mapping = CsvMapping(speeds, PLAIN.gaps, PLAIN.time)
    if twice == "v1":
        mapping = CsvMapping(PLAIN.speeds, (GapColumn("v1"),), PLAIN.time)
    sentence = refusal(changed(drive()), mapping=mapping)
    assert f'"{twice}" is named twice' in sentence


@pytest.mark.parametrize(
    ("columns", "copied"),
    [
        ({"v2": "lead"}, ("Speed1", "Speed2")),
        ({"gap": "ego"}, ("Speed2", "IVS1")),
        ({"gap": "lead"}, ("Speed1", "IVS1")),
    ],
)
@pytest.mark.parametrize("how", [{}, {"swing": 0.6, "mean": 14.0}])
def test_a_channel_that_was_logged_twice(
    columns: dict[str, str], copied: tuple[str, str], how: dict[str, Any]
) -> None:
    truth = drive(**how)
    raw = changed(truth, **{name: getattr(truth, of) for name, of in columns.items()})
    refusal(raw)
    finding = only_finding(ColumnsCopied, read(raw, "t.csv", mapping=PLAIN))
    assert (finding.first, finding.second) == copied
    # Also where one of the copies is in another unit.
    name = next(iter(columns))
    scaled = changed(truth, **{name: (getattr(truth, columns[name]) * 3.6).round(3)})
    finding = only_finding(ColumnsCopied, read(scaled, "t.csv", mapping=PLAIN))
    assert (finding.first, finding.second) == copied


# Rows and cells


def test_rows_of_several_rates_are_merged_and_reported() -> None:
    truth = drive()
    full = frame(truth)
    rows = []
    for k, name in enumerate(("v1", "v2", "gap")):
        part = full[["t", name]].copy()
        part["t"] = (part["t"] + 0.013 * k).round(3)
        rows.append(part)
    sparse = pd.concat(rows).sort_values("t")[["t", "v1", "v2", "gap"]]
    merged = only_finding(RatesMerged, sound(text(sparse), truth, RatesMerged))
    assert merged.slowest == pytest.approx(0.1)
    full.loc[full.index[1::2], "gap"] = np.nan
    merged = only_finding(RatesMerged, sound(text(full), truth, RatesMerged))
    assert (merged.fastest, merged.slowest) == pytest.approx((0.1, 0.2))


def test_rows_that_are_missing_count_as_empty_cells() -> None:
    truth = drive()
    rows = frame(truth).drop(index=[*range(200, 260), 700])
    recording = read(text(rows), "t.csv")
    assert misread(recording, truth) == ""
    missing = only_finding(RowsMissing, recording)
    assert (missing.rows, missing.windows) == (61, (Window(20.0, 25.9), Window(70.0, 70.0)))
    assert np.isnan(recording.speed[200:260]).all()


@pytest.mark.parametrize("value", [0.0, -1.0, 250.0, 255.0])
def test_the_value_of_a_lost_target_counts_as_missing(value: float) -> None:
    truth = drive()
    gap = truth.gap.copy()
    gap[300:420], gap[600:650] = value, value
    recording = read(changed(truth, gap=gap), "t.csv")
    assert misread(recording, truth) == ""
    lost = only_finding(TargetLost, recording)
    assert (lost.value, lost.samples) == (value, 170)
    assert lost.windows == (Window(30.0, 41.9), Window(60.0, 64.9))
    assert np.isnan(recording.gap[300:420]).all()


def test_values_of_a_frozen_sensor_are_kept() -> None:
    truth = drive()
    gap = truth.gap.copy()
    gap[300:320] = gap[299]
    recording = read(changed(truth, gap=gap), "t.csv")
    np.testing.assert_allclose(recording.gap_behind(1), gap)


@pytest.mark.parametrize("word", ["NULL", "None", "-", "#N/A", "NaN", "Inf", "n/a", "", "?"])
def test_words_for_missing_values(word: str) -> None:
    truth = drive()
    cells = [word if k in (40, 41, 300) else f"{v}" for k, v in enumerate(truth.lead)]
    recording = read(changed(truth, v1=cells), "t.csv")
    assert np.flatnonzero(np.isnan(recording.speed_of(1))).tolist() == [40, 41, 300]
    assert misread(recording, truth) == ""


# How a table is written


def lines_of(truth: Truth) -> list[str]:
    """The rows of a plain table."""
    return text(frame(truth)).decode().splitlines()


WRITINGS = {
    "trailing comma": lambda lines: [lines[0], *(f"{row}," for row in lines[1:])],
    "white space": lambda lines: [row.replace(",", "  ") for row in lines],
    "tabs": lambda lines: [row.replace(",", "\t") for row in lines],
    "metadata as wide as the table": lambda lines: ["Vehicle,A,B,ACC", "Date,1,a,b", *lines],
    "units row": lambda lines: [lines[0], "s,m/s,m/s,m", *lines[1:]],
    "header again": lambda lines: [*lines[:300], lines[0], *lines[300:]],
    "comments": lambda lines: ["# by a logger", *lines[:50], "# lap 2", *lines[50:]],
    "names in a comment": lambda lines: [f"# {lines[0]}", *lines[1:]],
    "doubled line ends": lambda lines: [row + "\n" for row in lines],
    "index": lambda lines: [f",{lines[0]}", *(f"{k},{row}" for k, row in enumerate(lines[1:]))],
}  # fmt: skip


@pytest.mark.parametrize("kind", WRITINGS)
def test_a_table_is_read_however_it_is_written(kind: str) -> None:
    truth = drive()
    sound("\n".join([*WRITINGS[kind](lines_of(truth)), ""]).encode(), truth)


def test_without_a_header_columns_are_numbered_and_one_question_is_left() -> None:
    truth = drive()
    raw = "\n".join([*lines_of(truth)[1:], ""]).encode()
    proposal = opened(raw, "t.csv").proposal
    assert [choice.column for choice in proposal.choices] == [f"column {k}" for k in (1, 2, 3, 4)]
    assert all(choice.cells for choice in proposal.choices)
    assert len(proposal.undecided) == 1
    refusal(raw)
    sound(raw, truth, mapping=proposal.mapping)


def test_an_openacc_table_without_its_metadata() -> None:
    truth = drive(vehicles=3)
    columns = {"Time": truth.time + 1}
    columns |= {f"Speed{k + 1}": truth.speeds[:, k] for k in range(3)}
    columns |= {f"IVS{k + 1}": truth.gaps[:, k] for k in range(2)}
    recording = sound(text(pd.DataFrame(columns)), truth, MetadataMissing)
    assert (recording.mode == Mode.UNKNOWN).all()
    assert recording.acc_flag is None


def packed(kind: str, table: pd.DataFrame) -> tuple[bytes, str]:
    """A table in a container, and its file's name."""
    content = io.BytesIO()
    if kind == "xlsx":
        table.to_excel(content, index=False)
    elif kind == "parquet":
        table.to_parquet(content)
    else:
        content.write(gzip.compress(text(table)))
    return content.getvalue(), f"t.{kind}"


@pytest.mark.parametrize("kind", ["xlsx", "parquet", "csv.gz"])
def test_containers(kind: str) -> None:
    truth = drive()
    recording = read(*packed(kind, frame(truth, ("time", "lead_mps", "ego_mps", "gap_m"))))
    assert misread(recording, truth) == ""
    assert not contradictions(recording)


# Long formats, positions and relative speeds


def long(truth: Truth) -> pd.DataFrame:
    """A row a vehicle and instant, ordered by vehicle."""
    positions, count = truth.positions(LENGTH), truth.speeds.shape[1]
    return pd.concat([
        pd.DataFrame({
            "vehicle_id": 10 + k, "time": truth.time, "leader_id": 9 + k if k else -1,
            "length": LENGTH, "position": positions[:, k].round(4), "speed": truth.speeds[:, k],
            "lane": 2, "gap": truth.gaps[:, k - 1] if k else np.nan,
        })
        for k in range(count)
    ])  # fmt: skip


@pytest.mark.parametrize(
    "without",
    [["lane", "gap"], ["leader_id", "gap"], ["lane", "position", "length"]],
    ids=["ids and positions", "lane and positions", "ids and gaps"],
)
@pytest.mark.parametrize("is_by_time", [False, True])
def test_a_row_a_vehicle_and_instant(without: list[str], is_by_time: bool) -> None:
    truth = drive(vehicles=3)
    rows = long(truth).drop(columns=without)
    rows = rows.rename(columns={"speed": "speed_mps", "gap": "gap_m"})
    if is_by_time:
        rows = rows.sort_values(["time", "vehicle_id"])
    sound(text(rows), truth)


def fcd(truth: Truth) -> bytes:
    """The export of floating car data that SUMO writes."""
    positions, steps = truth.positions(LENGTH), []
    for k, time in enumerate(truth.time):
        vehicles = "".join(
            f'<vehicle id="f{v}" x="{positions[k, v]:.3f}" speed="{truth.speeds[k, v]:.4f}"'
            f' lane="e_0" leaderID="{f"f{v - 1}" if v else ""}"'
            f' leaderGap="{truth.gaps[k, v - 1] if v else -1:.4f}"/>'
            for v in range(truth.speeds.shape[1])
        )
        steps.append(f'<timestep time="{time:.2f}">{vehicles}</timestep>')
    return f"<fcd-export>{''.join(steps)}</fcd-export>".encode()


def ngsim(truth: Truth) -> bytes:
    rows = long(truth)
    return text(
        pd.DataFrame({
            "Vehicle_ID": rows["vehicle_id"], "Frame_ID": (rows["time"] * 10).round().astype(int),
            "Global_Time": (1.1e12 + 1000 * rows["time"]).round(), "Local_X": 12.0,
            "Local_Y": rows["position"] / 0.3048, "v_Length": LENGTH / 0.3048,
            "v_Vel": rows["speed"] / 0.3048, "Lane_ID": 2, "Preceding": rows["leader_id"].clip(0),
        })
    )  # fmt: skip


def high_d(truth: Truth) -> bytes:
    rows = long(truth)
    return text(
        pd.DataFrame({
            "frame": (rows["time"] / 0.04).round().astype(int) + 1, "id": rows["vehicle_id"],
            "x": rows["position"], "y": 8.0, "width": LENGTH, "height": 2.0,
            "xVelocity": rows["speed"], "yVelocity": 0.0, "dhw": rows["gap"].fillna(0),
            "thw": 1.0, "precedingId": rows["leader_id"].clip(0), "laneId": 2,
        })
    )  # fmt: skip


@pytest.mark.parametrize(("make", "step"), [(fcd, 0.1), (ngsim, 0.1), (high_d, 0.04)])
def test_published_layouts(make: Any, step: float) -> None:
    truth = drive(vehicles=3, step=step, seconds=60.0)
    recording = read(make(truth), "t.csv")
    assert misread(recording, truth) == ""
    assert not contradictions(recording)


def test_positions_in_place_of_gaps_need_a_length_alone() -> None:
    truth = drive()
    positions = truth.positions(LENGTH).round(4)
    names = ("time", "leader_v", "follower_v")
    columns = dict(zip(names, (truth.time, truth.lead, truth.ego), strict=True))
    columns |= {"leader_p": positions[:, 0], "follower_p": positions[:, 1]}
    raw = text(pd.DataFrame(columns))
    proposal = opened(raw, "t.csv").proposal
    assert len(proposal.undecided) == 1
    assert "length" in refusal(raw)
    gap = GapColumn("leader_p", subtract=LENGTH, minus="follower_p")
    assert proposal.mapping.gaps[0].minus == gap.minus
    mapping = CsvMapping(proposal.mapping.speeds, (gap,), proposal.mapping.time)
    sound(raw, truth, mapping=mapping)
    sound(text(pd.DataFrame(columns | {"leader_length": LENGTH})), truth)


@pytest.mark.parametrize("is_closing", [False, True])
def test_a_speed_ahead_as_a_difference(is_closing: bool) -> None:
    truth = drive()
    relative = truth.ego - truth.lead if is_closing else truth.lead - truth.ego
    name = "closing_speed_mps" if is_closing else "relative_speed_mps"
    columns = {
        "time": truth.time,
        "ego_speed_mps": truth.ego,
        name: relative.round(4),
        "gap_m": truth.gap,
    }
    sound(text(pd.DataFrame(columns)), truth)


# Public headers


def test_headers_of_cacc_and_central_ohio() -> None:
    truth = drive()
    cacc = pd.DataFrame({
        "time": truth.time, "speed_0": truth.lead, "speed_1": truth.ego, "gap_1": truth.gap,
        "engaged_1": 1,
    })  # fmt: skip
    assert sound(text(cacc), truth).vehicles[1].modes == {"ACC": len(truth.time), "Human": 0}
    positions = truth.positions(LENGTH)
    ohio = pd.DataFrame({
        "ID": 1, "Time": truth.time, "pos_x_av_f": positions[:, 0], "speed_av": truth.lead,
        "acc_av": 0.1, "pos_x_sv_f": positions[:, 1], "speed_sv": truth.ego, "acc_sv": 0.0,
        "closest_distance_longitudinal (gap)": truth.gap, "distance_av (headway)": truth.gap + 5,
        "lane_id_av": 2, "lane_id_sv": 2,
    })  # fmt: skip
    sound(text(ohio), truth)


def test_types_of_leaders_in_tables_of_pairs() -> None:
    """The authors of ULTra-AV write 1 for an automated vehicle and 0 for a human driver."""
    rows = pair(platoon(2), 1, "a")
    modes = [read(table(rows.assign(Type_LV=kind)), "t.csv").vehicles[0].modes for kind in (0, 1)]
    assert modes == [{"ACC": 0, "Human": 400}, {"ACC": 400, "Human": 0}]


# No false findings


def test_sound_cars_have_no_findings() -> None:
    """80 cars in 20 platoons on rough roads, at 10 and 20 Hz, in all traffic."""
    for seed in range(20):
        rng = np.random.default_rng(seed)
        truth = drive(
            1000 + seed, 60.0, float(rng.uniform(8, 30)), float(rng.uniform(1.0, 3.0)), 5,
            float(rng.choice([0.05, 0.1, 0.1, 0.1])), float(rng.choice([0.0, 0.02, 0.05])),
        )  # fmt: skip
        columns = {"Time [s]": truth.time}
        columns |= {f"Speed {k + 1} [m/s]": truth.speeds[:, k] for k in range(5)}
        columns |= {f"Gap {k + 2} [m]": truth.gaps[:, k] for k in range(4)}
        recording = read(text(pd.DataFrame(columns)), "t.csv")
        assert misread(recording, truth, 0.02) == ""
        assert [finding.sentence(recording) for finding in recording.findings[1:]] == []
