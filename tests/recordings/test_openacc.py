"""The loader: one test per oddity of the database, one sentence per unusable file."""

import os
from datetime import date
from pathlib import Path
from typing import TypeVar

import numpy as np
import pytest

from accpinn import recordings as data
from accpinn.errors import RecordingError
from accpinn.findings import Finding
from accpinn.recordings import Mode, Recording, Window, openacc, sampling, source
from accpinn.recordings.inconsistency import (
    GapContradictsSpeeds,
    GapJumps,
    Inconsistency,
    UnitsDiffer,
)
from accpinn.recordings.increments import agreement
from accpinn.recordings.openacc import Run, catalogue, read
from accpinn.recordings.tables import ModesUnknown
from accpinn.segment.cut import cut
from accpinn.segment.windows import left_out, plan
from tests.support.openacc_files import csv, metadata, platoon

F = TypeVar("F", bound=Finding)


def only_finding(kind: type[F], recording: Recording) -> F:
    """The one finding of a kind."""
    [finding] = [finding for finding in recording.findings if isinstance(finding, kind)]
    return finding


def refusal(raw: bytes, name: str = "run.csv") -> str:
    """The sentence with which a file is refused."""
    with pytest.raises(RecordingError) as caught:
        read(raw, name)
    sentence = str(caught.value)
    assert sentence.startswith(name)
    assert sentence.endswith(".")
    assert "\n" not in sentence
    return sentence


# A sound file


def test_values_arrive_exactly(tmp_path: Path) -> None:
    frame = platoon()
    path = tmp_path / "run.csv"
    path.write_bytes(csv(frame))
    recording = read(path)
    np.testing.assert_array_equal(recording.speed, frame[["Speed1", "Speed2", "Speed3"]])
    np.testing.assert_array_equal(recording.gap, frame[["IVS1", "IVS2"]])
    assert (recording.source, recording.date) == ("run.csv", date(2019, 2, 26))
    assert (recording.acc_flag, recording.distance_setting) == (1, "min")
    assert [recording.label(number) for number in (1, 2, 3)] == ["1 Alpha", "2 Beta", "3 Gamma"]
    assert (recording.time[0], recording.sample_time, recording.duration) == (0.0, 0.1, 39.9)
    assert recording.findings == ()
    for values in (recording.time, recording.speed, recording.gap, recording.mode):
        with pytest.raises(ValueError, match="read-only"):
            values[0] = 0


# The oddities, numbered as in the notes on the database


def test_1_metadata_rows_are_padded_and_a_last_name_is_empty() -> None:
    """Vicolungo pads every row to the table's width; ZalaZone ends its names with a comma."""
    rows = metadata(("Alpha", "Beta", "Gamma", ""), number="3")
    padded = [row + "," * extra for row, extra in zip(rows, (4, 0, 9, 1, 30), strict=True)]
    recording = read(csv(platoon(), padded), "run.csv")
    assert [v.name for v in recording.vehicles] == ["Alpha", "Beta", "Gamma"]
    assert (recording.acc_flag, recording.distance_setting) == (1, "min")
    assert recording.findings == ()


@pytest.mark.parametrize(
    ("cell", "flag", "setting"),
    [("0", 0, "min"), (" 1 ", 1, "second"), ("2", 2, "SL"), ("", None, ""), ("1.0", 1, "M")],
)
def test_2_flag_and_distance_setting_vary(cell: str, flag: int | None, setting: str) -> None:
    """The flag may be mixed or blank; the distance setting is kept as written."""
    recording = read(csv(platoon(), metadata(acc=cell, distance=setting)), "run.csv")
    assert (recording.acc_flag, recording.distance_setting) == (flag, setting or None)
    assert recording.findings == ()


def test_3_only_driver_columns_give_modes_and_these_change() -> None:
    """Vehicle 1 is driven by hand in runs with ACC=1, and some vehicles have no Driver column."""
    frame = platoon()
    frame["Driver1"] = "Human"
    frame["Driver3"] = ["ACC"] * 150 + ["Human"] * 240 + [""] * 8 + ["Robot", "acc "]
    recording = read(csv(frame, metadata(acc="1")), "run.csv")
    driven = [vehicle.modes for vehicle in recording.vehicles]
    assert driven == [{"ACC": 0, "Human": 400}, None, {"ACC": 151, "Human": 240}]
    assert recording.mode[[149, 150, 390], 2].tolist() == [Mode.ACC, Mode.HUMAN, Mode.UNKNOWN]
    assert (recording.mode[:, 1] == Mode.UNKNOWN).all()
    assert recording.findings == (ModesUnknown("Driver3", "ACC nor Human", 1, "Robot"),)


def test_4_columns_are_chosen_by_name_in_any_order() -> None:
    """AstaZero has Driver before IVS, Casale's first vehicle lacks Alt, ZalaZone has degrees."""
    frame = platoon()
    plain = read(csv(frame), "run.csv")
    frame["Lat1"], frame["Lon1"], frame["Driver2"] = 46.88, 16.84, "ACC"
    order = ["Time", "Driver2", "IVS2", "Lon1", "Lat1", "Speed3", "Speed1", "IVS1", "Speed2"]
    shuffled = read(csv(frame[order]), "run.csv")
    np.testing.assert_array_equal(shuffled.speed, plain.speed)
    np.testing.assert_array_equal(shuffled.gap, plain.gap)
    assert shuffled.findings == ()


def test_5_columns_of_absent_vehicles_leave_holes() -> None:
    """A ZalaZone run names nine vehicles and has Speed 2, 4-9 with IVS 4-8."""
    frame = platoon(9).drop(columns=["Speed1", "Speed3", "IVS1", "IVS2", "IVS3"])
    names = tuple("ABCDEFGHI")
    recording = read(csv(frame, metadata(names)), "run.csv")
    assert recording.present == (2, 4, 5, 6, 7, 8, 9)
    assert recording.vehicles[2].missing_share == 1.0
    assert np.isnan(recording.speed_of(3)).all()
    np.testing.assert_array_equal(recording.gap_behind(4), frame["IVS4"])
    assert np.isnan(recording.gap[:, :3]).all()
    assert only_finding(openacc.NamesWithoutData, recording).vehicles == (1, 3)


@pytest.mark.parametrize(
    ("vehicles", "names", "stated", "present", "finding"),
    [
        (6, "ABCDEFGHIJK", "6", 6, openacc.VehicleCountMismatch(stated=6, named=11, recorded=6)),
        (3, "A", "3", 3, openacc.VehiclesWithoutName(vehicles=(2, 3))),
        (4, "ABC", None, 3, openacc.GapsUnused(gaps=(3,))),
    ],
    ids=["eleven names for six vehicles", "too few names", "a gap beside an absent vehicle"],
)
def test_5_names_and_columns_disagree(
    vehicles: int, names: str, stated: str | None, present: int, finding: Finding
) -> None:
    frame = platoon(vehicles).drop(columns=[f"Speed{n}" for n in range(present + 1, vehicles + 1)])
    recording = read(csv(frame, metadata(tuple(names), number=stated)), "run.csv")
    assert recording.present == tuple(range(1, present + 1))
    assert len(recording.vehicles) == max(len(names), present)
    assert finding in recording.findings
    assert recording.label(2) == ("2 B" if len(names) > 1 else "Vehicle 2")


@pytest.mark.parametrize(
    ("last", "columns", "values", "finding"),
    [
        (149, ["Speed2", "IVS1", "IVS2"], np.nan,
         data.SamplesMissing("Speed", 2, share=0.125, windows=(Window(10.0, 14.9),))),
        (103, ["IVS2"], np.nan,
         data.SamplesMissing("IVS", 2, share=0.01, windows=(Window(10.0, 10.3),))),
        (101, ["Speed3", "IVS2"], -0.018,
         data.ValuesOutOfRange("Speed", 3, 2, extreme=-0.018, share=0.005)),
        (101, ["IVS1"], -2.5, data.ValuesOutOfRange("IVS", 1, 2, extreme=-2.5, share=0.005)),
        (101, ["Speed2"], 72.0, data.ValuesOutOfRange("Speed", 2, 2, extreme=72.0, share=0.005)),
        (125, ["Speed2"], 20.0, data.ValuesFrozen("Speed", 2, 25, (Window(10.0, 12.5),))),
    ],
    ids=["missing with the gaps beside it", "a gap missing alone", "negative Doppler speeds",
         "negative gaps", "kilometres per hour", "frozen"],
)  # fmt: skip
def test_6_and_8_blocks_that_are_reported_and_kept(
    last: int, columns: list[str], values: float, finding: Finding
) -> None:
    frame = platoon()
    frame.loc[100:last, columns] = values
    recording = read(csv(frame), "run.csv")
    assert finding in recording.findings
    column = {"S": recording.speed, "I": recording.gap}[columns[0][0]][:, int(columns[0][-1]) - 1]
    np.testing.assert_array_equal(column[100 : last + 1], values)
    if np.isnan(values):
        assert recording.findings == (finding,)
        assert recording.vehicles[1].missing == (50 if columns[0] == "Speed2" else 0)


def test_6_the_longest_blocks_are_listed_and_a_standing_vehicle_is_not_frozen() -> None:
    frame = platoon()
    frame.loc[200:300, ["Speed1", "Speed2", "Speed3"]] = 0.0
    for first, last in ((10, 10), (50, 53), (90, 91), (130, 136), (170, 170)):
        frame.loc[first:last, "Speed3"] = np.nan
    recording = read(csv(frame), "run.csv")
    missing = only_finding(data.SamplesMissing, recording)
    assert len(missing.windows) == 5
    places = "5–5.3 s, 9–9.1 s, 13–13.6 s and in 2 shorter blocks."
    assert missing.sentence(recording).endswith(places)
    assert not any(isinstance(finding, data.ValuesFrozen) for finding in recording.findings)
    coarse = platoon().iloc[::10]
    coarse.iloc[5:7, coarse.columns.get_loc("Speed2")] = 20.0
    recording = read(csv(coarse), "run.csv")
    assert not any(isinstance(finding, data.ValuesFrozen) for finding in recording.findings)


@pytest.mark.parametrize("first", [1.0, 58067.1, 208970.3, 1.6e9])
def test_7_time_may_start_anywhere(first: float) -> None:
    """At 2e5 s single precision steps by 0.016 s: time must stay in double precision."""
    recording = read(csv(platoon(first_time=first)), "run.csv")
    np.testing.assert_allclose(recording.time, 0.1 * np.arange(400), atol=1e-6)
    assert recording.sample_time == 0.1
    assert recording.is_even


def contradicts(recording: Recording, start: float, vehicles: tuple[int, ...]) -> bool:
    """Whether the gap of a pair is said to contradict its speeds in 12 s from a start on."""
    findings = cut(recording, start, 12.0, vehicles).findings
    return any(isinstance(finding, Inconsistency) for finding in findings)


@pytest.mark.parametrize(
    ("column", "factor", "slope"),
    [("Speed", 3.6, 0.278), ("Speed", 2.237, 0.447), ("IVS", 3.281, 3.281)],
)
def test_units_that_differ_are_seen_by_how_fast_the_gap_changes(
    column: str, factor: float, slope: float
) -> None:
    frame = platoon(2)
    frame[[name for name in frame if name.startswith(column)]] *= factor
    recording = read(csv(frame, metadata("AB")), "run.csv")
    first = only_finding(UnitsDiffer, recording)
    assert first.vehicle == 1
    assert first.slope == pytest.approx(slope, rel=0.02)
    unit = {3.6: "km/h", 2.237: "mph", 3.281: "ft"}[factor]
    assert unit in (first.cures[0].speed, first.cures[0].gap)
    assert first in cut(recording, 0.0, 12.0, (1, 2)).findings
    assert not plan(recording, 30.0)
    kinds = {type(finding) for finding in left_out(recording, ())}
    above = {data.ValuesOutOfRange} if factor == 3.6 else set()
    assert kinds == {UnitsDiffer} | above


def test_9_a_gap_that_contradicts_the_speeds() -> None:
    frame = platoon()
    rng = np.random.default_rng(1)
    frame["IVS2"] = 30 + np.cumsum(rng.normal(0, 0.1, len(frame)))
    recording = read(csv(frame), "run.csv")
    assert agreement(recording.pair(1)) == pytest.approx(1.0, abs=1e-3)
    assert abs(agreement(recording.pair(2))) < 0.5
    contradiction = only_finding(GapContradictsSpeeds, recording)
    assert contradiction.vehicle == 2
    assert contradiction.correlation == pytest.approx(agreement(recording.pair(2)), abs=0.1)
    # It goes with the windows of the vehicle in which it is so, and a batch leaves them out.
    assert contradicts(recording, 0.0, (2, 3))
    assert not contradicts(recording, 0.0, (1, 2))
    followers = {number for place in plan(recording, 30.0) for number in place.vehicles[1:]}
    assert 3 not in followers >= {2}
    frame.loc[:129, "IVS2"] = platoon()["IVS2"][:130]
    partly = read(csv(frame), "run.csv")
    assert [contradicts(partly, start, (2, 3)) for start in (0.0, 20.0)] == [False, True]
    gap = frame["IVS1"].copy()
    frame.loc[100, "IVS1"] = 650.0  # as a radar has it without a target: no other unit
    spiked = read(csv(frame), "run.csv")
    large = only_finding(data.ValuesOutOfRange, spiked)
    assert (large.followers, large.is_in_another_unit) == ((2,), False)
    frame["IVS1"] = gap
    # Vehicles at rest to each other are not judged.
    frame["Speed3"] = frame["Speed2"]
    assert agreement(read(csv(frame), "run.csv").pair(2)) is None


def test_10_names_keep_their_spelling_in_any_encoding() -> None:
    """Spelling and white space differ between header and specification: nothing is matched."""
    rows = metadata(("Citroën", "Audi (A8)", "Peugeot  (5008 GT Line)"))
    for encoding in ("utf-8", "cp1252"):
        recording = read(csv(platoon(), rows).decode().encode(encoding), "run.csv")
        names = [v.name for v in recording.vehicles]
        assert names == ["Citroën", "Audi (A8)", "Peugeot (5008 GT Line)"]


@pytest.mark.parametrize("end", ["\r\n", "\n", "\r"])
@pytest.mark.parametrize("bom", [b"", b"\xef\xbb\xbf"])
@pytest.mark.parametrize("tail", [b"", b"\r\n\r\n", b"   \n"])
def test_12_line_ends_and_marks_of_re_saved_copies(end: str, bom: bytes, tail: bytes) -> None:
    plain = read(csv(platoon()), "run.csv")
    copy = read(bom + csv(platoon(), end=end) + tail, "run.csv")
    np.testing.assert_array_equal(copy.speed, plain.speed)
    assert copy.date == plain.date
    assert copy.findings == ()


def test_12_cells_may_be_quoted_and_rows_padded_to_one_width() -> None:
    frame, rows = platoon().assign(Driver2="ACC"), metadata(tuple("ABCDEFGHIJK"), number="3")
    plain = csv(frame, rows)
    lines = plain.splitlines()
    width = max(line.count(b",") for line in lines)
    padded = b"\n".join(line + b"," * (width - line.count(b",")) for line in lines) + b"\n"
    quoted = [b",".join(b'"%s"' % cell for cell in row.split(b",")) for row in lines]
    expected = read(plain, "run.csv")
    for copy in (padded, b"\r\n".join([*quoted, b""])):
        recording = read(copy, "run.csv")
        assert recording.vehicles[1].modes == {"ACC": 400, "Human": 0}
        for name in ("time", "speed", "gap", "mode"):
            np.testing.assert_array_equal(getattr(recording, name), getattr(expected, name))


# Where a file comes from


@pytest.mark.parametrize(
    ("folder", "name", "campaign"),
    [
        ("Casale", "part7.csv", "Casale"),
        ("jrc low speed", "part7.csv", "JRC low speed"),
        ("upload", "part7.csv", None),
        ("upload", "ASta_040719_platoon5.csv", "AstaZero"),
        ("Casale", "mine.csv", None),
    ],
)
def test_campaign_is_certain_or_none(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, folder: str, name: str, campaign: str | None
) -> None:
    path = tmp_path / folder / name
    path.parent.mkdir()
    path.write_bytes(csv(platoon()))
    recording = read(path)
    assert recording.campaign == campaign
    published = (Run("Vicolungo", "other.csv", recording.sha256),)
    monkeypatch.setattr(openacc, "catalogue", lambda: published)
    assert read(path).campaign == "Vicolungo", "a published file may have any name"


@pytest.mark.parametrize(
    ("rows", "finding"),
    [
        (metadata(acc="7"), openacc.MetadataUnreadable(key="ACC", content="7")),
        (metadata(acc="yes"), openacc.MetadataUnreadable(key="ACC", content="yes")),
        (metadata(day="31,2,2019"), openacc.MetadataUnreadable(key="Date", content="31, 2, 2019")),
        (metadata()[:4], openacc.MetadataMissing(keys=("Distance_setting",))),
        (metadata(number="5"), openacc.VehicleCountMismatch(stated=5, named=3, recorded=3)),
    ],
)
def test_odd_metadata_are_reported_and_ignored(rows: list[str], finding: Finding) -> None:
    still = platoon()
    still["Speed1"] = 20 + 0.001 * still["Speed1"]
    unmoved = only_finding(data.LittleLeaderMotion, read(csv(still, rows), "run.csv"))
    assert unmoved.deviation == pytest.approx(still["Speed1"].std(), rel=0.01)
    assert openacc.LineEndMissing() in read(SOUND.rstrip(), "run.csv").findings
    recording = read(csv(platoon(), rows), "run.csv")
    assert recording.findings == (finding,)
    assert (recording.date, recording.acc_flag, recording.distance_setting).count(None) == (
        not isinstance(finding, openacc.VehicleCountMismatch)
    )


# What is refused, and how


SOUND = csv(platoon())
LINES = SOUND.split(b"\r\n")


def with_cell(row: int, column: int, text: bytes) -> bytes:
    """The sound file with one cell replaced; row as in the file, column from 0."""
    lines = list(LINES)
    cells = lines[row - 1].split(b",")
    cells[column] = text
    lines[row - 1] = b",".join(cells)
    return b"\r\n".join(lines)


@pytest.mark.parametrize(
    ("raw", "words"),
    [
        (b"Time,Speed,Engine Speed,Gear\n0,10,2000,3\n", ["choose the CSV file of a run"]),
        (b" \r\n\r\n", ["empty"]),
        (b"\xef\xbb\xbf", ["empty"]),
        (SOUND[:-30], ["row 406", "cut short", "5 of 6 cells"]),
        (SOUND[:5000] + b"\0" * 3000, ["row 56", "NUL", "download"]),
        (bytes(range(256)) * 40, ["binary"]),
        (b"PK\x03\x04" + bytes(100), ["Excel", "save the sheet as CSV"]),
        (b"\x89PNG\r\n\x1a\n" + bytes(100), ["PNG"]),
        (b"\x1f\x8b\x08" + bytes(100), ["gzip", "unpack"]),
        (SOUND[:4000] + b"\x07" + SOUND[4000:], ["row 45", "control characters"]),
        (b"<!DOCTYPE html><html>404 Not Found</html>", ["web page"]),
        (SOUND.replace(b",", b";"), ["row 1", "semicolons", "commas"]),
        (b"a,b,c\n1,2,3\n", ["row 1", '"a"', "Vehicle_order"]),
        (b"\r\n".join(LINES[:5]), ["Time"]),
        (b"\r\n".join(LINES[:5] + LINES[6:]), ["row 6", '"100.0"', "Time"]),
        (b"\r\n".join([LINES[0], *LINES]), ["row 2", '"Date"', "second time"]),
        (SOUND.replace(b"IVS", b"Gap"), ["row 6", "IVS1"]),
        (SOUND.replace(b"Speed", b"V"), ["row 6", "Speed1"]),
        (SOUND.replace(b"Speed2", b"Speed1"), ["row 6", '"Speed1"', "columns 2 and 3"]),
        (with_cell(57, 2, b"fast"), ["row 57", "column Speed2", '"fast"']),
        (with_cell(57, 2, b"1_0"), ["row 57", "column Speed2", '"1_0"']),
        (with_cell(57, 3, b"+"), ["row 57", "column IVS1", '"+"']),
        (with_cell(57, 3, "\u00b5\u2028".encode()), ["row 57", "column IVS1"]),
        (with_cell(57, 2, b"1e300"), ["row 57", "column Speed2", "1e+300"]),
        (with_cell(57, 2, b"-201"), ["row 57", "column Speed2", "at most 200 m/s"]),
        (with_cell(57, 3, b"10001"), ["row 57", "column IVS1", "at most 10,000 m"]),
        (with_cell(57, 0, b""), ["row 57", "column Time", "missing"]),
        (with_cell(57, 0, b"103.0"), ["row 57", "column Time", "does not increase"]),
        (with_cell(7, 0, b"-3600"), ["row 8", "column Time", "pauses for 3700.1 s"]),
        (with_cell(57, 2, b"1,2"), ["row 57", "7 cells", "6"]),
        (with_cell(57, 2, b'"1'), ["row 57", "quotation mark"]),
        (b"\r\n".join([*LINES[:10], b"", *LINES[10:]]), ["row 11", "is empty"]),
        (b"\r\n".join(LINES[:6] + LINES[7:12] + [b""]), ["only 5 rows", "10"]),
        (b"\r\n".join(LINES[:6]), ["only 0 rows", "10"]),
        (csv(platoon().assign(Time=1e-6 * np.arange(400))), ["Time", "apart"]),
        (csv(platoon().assign(IVS1=np.nan, IVS2=np.nan)), ["space-gap columns are empty"]),
        (csv(platoon(), metadata(["x"] * 500)), ["500 vehicles", "99"]),
    ],
)
def test_an_unusable_file_is_refused_in_one_sentence(raw: bytes, words: list[str]) -> None:
    sentence = refusal(raw)
    for word in words:
        assert word in sentence
    assert "this table accompanies" in refusal(b"A,B\n1,2\n", "ASta_veh_specifications.csv")


def test_a_file_over_the_limit_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(source, "LIMIT_BYTES", 1000)
    assert "0.0 MB" in refusal(SOUND)
    (tmp_path / "run.csv").write_bytes(SOUND)
    with pytest.raises(RecordingError, match=r"limit is 0\.0 MB"):
        read(tmp_path / "run.csv")


def test_a_path_without_a_file_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "closed.csv").write_bytes(SOUND)

    def refuse(_: Path) -> bytes:  # permissions do not bind the tests' user everywhere
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(Path, "read_bytes", refuse)
    os.mkfifo(tmp_path / "pipe.csv")
    for path, words in {
        tmp_path: "folder",
        tmp_path / "nowhere.csv": r"nowhere\.csv: there is no such file",
        "nul\0byte.csv": "no such file",
        "": "name an OpenACC CSV file",
        tmp_path / "pipe.csv": r"pipe\.csv: this is not an ordinary file",
        tmp_path / "closed.csv": r"closed\.csv: .*permission denied",
    }.items():
        with pytest.raises(RecordingError, match=words):
            read(path)


@pytest.mark.parametrize("name", ["x" * 10_000, "a\x9bb", "\u202eabc", "tab\tbed"])
def test_names_of_vehicles_and_files_are_short_and_printable(name: str) -> None:
    recording = read(csv(platoon(), metadata((name, "Beta", "Gamma"))), "run.csv")
    shortened = recording.vehicles[0].name
    assert shortened.isprintable()
    assert 1 < len(shortened) <= 80
    with pytest.raises(RecordingError, match=r"^a b \[31m\.csv: "):
        read(b"", "a\nb\x1b[31m.csv")


def test_a_table_without_its_metadata_is_read_with_unknown_drivers() -> None:
    recording = read(b"\r\n".join(LINES[5:]), "run.csv")
    np.testing.assert_array_equal(recording.speed, read(SOUND, "run.csv").speed)
    assert (recording.mode == Mode.UNKNOWN).all()
    missing = only_finding(openacc.MetadataMissing, recording)
    assert set(missing.keys) == {row.split(",")[0] for row in metadata()}


def test_rows_that_are_missing_count_as_empty_cells() -> None:
    recording = read(b"\r\n".join([*LINES[:56], *LINES[76:]]), "run.csv")
    plain = read(SOUND, "run.csv")
    missing = only_finding(sampling.RowsMissing, recording)
    assert (missing.rows, missing.windows) == (20, (Window(5.0, 6.9),))
    has_data = ~np.isnan(recording.speed_of(1))
    assert np.flatnonzero(~has_data).tolist() == list(range(50, 70))
    np.testing.assert_array_equal(recording.speed[has_data], plain.speed[has_data])
    np.testing.assert_allclose(recording.time, plain.time, atol=1e-9)


@pytest.mark.parametrize(
    "cell", ["", " ", "NaN", "nan", " NA", "N/A", "null", '""', "-", "inf", "#N/A", "None"]
)
def test_an_empty_cell_may_be_written_in_several_ways(cell: str) -> None:
    recording = read(with_cell(57, 2, cell.encode()), "run.csv")
    assert np.flatnonzero(np.isnan(recording.speed_of(2))).tolist() == [50]


# The real recordings


RUNS = {
    "AstaZero/ASta_040719_platoon5.csv": ("AstaZero", 12470, (1, 2, 3, 4, 5)),
    "Casale/part7.csv": ("Casale", 15230, (1, 2)),
    "Casale/part8.csv": ("Casale", 1001, (1, 2)),
    "Vicolungo/JRC-VC_260219_part3.csv": ("Vicolungo", 1455, (1, 2, 3, 4, 5)),
    "Cherasco/JRC-Cher_300818_rec1_part2.csv": ("Cherasco", 1448, (1, 2)),
    "JRC low speed/part12.csv": ("JRC low speed", 3766, (1, 2, 3)),
    "ZalaZone/handling_part10.csv": ("ZalaZone", 2500, (2, 4, 5, 6, 7, 8, 9)),
}


JUMPS = {
    ("Cher-JRC_240918_rec1_part2.csv", 1): (677, 9),
    ("Cher-JRC_240918_rec1_part2.csv", 2): (677, -9),
    ("Cher-JRC_240918_rec2_part1.csv", 1): (102, -6),
    ("JRC-Cher_300818_rec1_part1_highway.csv", 1): (339, 15),
    ("JRC-VC_260219_part3.csv", 4): (5, -63),
}
"""Time in s and size in m of all jumps in real recordings, as where a receiver corrects itself."""


def test_every_file_of_the_folder_loads_or_is_refused(openacc_dir: Path) -> None:
    """None of those that load has an inconsistency but five jumps."""
    loaded, refused = {}, []
    published = {run.key: run.sha256 for run in catalogue()}
    for path in filter(Path.is_file, openacc_dir.rglob("*")):
        try:
            loaded[path.relative_to(openacc_dir).as_posix()] = read(path)
        except RecordingError as error:
            refused.append(str(error))
            assert refused[-1].startswith(path.name)
    for file, facts in RUNS.items():
        recording = loaded[file]
        assert (recording.campaign, recording.samples, recording.present) == facts
        assert (recording.is_even, recording.sample_time) == (True, 0.1)
        assert published[file] in (None, recording.sha256)
    assert not {name for name in loaded if name.startswith("corrupt/")}
    for words in ("row 570: NUL bytes", "the file is empty"):
        assert any(words in sentence for sentence in refused)
    jumps = {}
    for file, recording in loaded.items():
        for finding in recording.findings:
            if isinstance(finding, Inconsistency):
                assert isinstance(finding, GapJumps)
                ((instant, size),) = zip(finding.times, finding.sizes, strict=True)
                jumps[Path(file).name, finding.vehicle] = round(instant), round(size)
    assert jumps == JUMPS
