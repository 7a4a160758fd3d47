"""Tables that are no OpenACC runs: any by a mapping, and leader-follower pairs."""

import json
import os
from pathlib import Path

import msgspec
import numpy as np
import pandas as pd
import pytest

import accpinn
from accpinn.errors import RecordingError
from accpinn.recordings import Mode, Recording
from accpinn.recordings.files import contradictions, opened, read, read_all
from accpinn.recordings.mapped import UnitContradictsHeader
from accpinn.recordings.mapping import (
    MappingRemembered,
    load_mapping,
    parse_mapping,
    remembered_mapping,
)
from accpinn.recordings.tables import ModesUnknown
from accpinn.segment.cut import cut
from tests.support.openacc_files import csv, metadata, pair, platoon, table

MAPPING = """{"time": {"column": "clock", "unit": "ms"},
 "speeds": [{"column": "v lead", "unit": "km/h", "name": "Audi (A8)"}, {"column": "v2"}],
 "gaps": [{"column": "range", "unit": "ft", "subtract": 4.5}],
 "modes": [{"vehicle": 2, "column": "engaged", "acc": ["1"], "human": ["0"]}]}"""


def foreign(frame: pd.DataFrame) -> pd.DataFrame:
    """An OpenACC frame with other names, units and origin of time."""
    return pd.DataFrame({
        "clock": (1e12 + 1000 * frame["Time"]).round(3),
        "v2": frame["Speed2"],
        "note": "a",
        "range": (frame["IVS1"] + 4.5) / 0.3048,
        "v lead": frame["Speed1"] * 3.6,
        "engaged": np.where(frame["Time"] < 110, 0, 1),
    })  # fmt: skip


@pytest.mark.parametrize("separator", [",", ";", "\t"])
def test_columns_units_and_separators(separator: str) -> None:
    frame = platoon(2, 300)
    original = read(csv(frame, metadata(("A", "B"))), "run.csv")
    decimal = "," if separator == ";" else "."
    raw = foreign(frame).to_csv(index=False, sep=separator, decimal=decimal).encode()
    recording = read(raw, "mine.csv", mapping=parse_mapping(MAPPING))
    np.testing.assert_allclose(recording.speed, original.speed, atol=2e-9)
    np.testing.assert_allclose(recording.gap, original.gap, atol=2e-9)
    np.testing.assert_allclose(recording.time, original.time, atol=1e-6)
    assert recording.is_even
    assert [vehicle.name for vehicle in recording.vehicles] == ["Audi (A8)", "Vehicle 2"]
    assert (recording.mode[0, 1], recording.mode[-1, 1]) == (Mode.HUMAN, Mode.ACC)
    shown = opened(raw, "mine.csv").layout
    assert (shown.separator, shown.decimal, len(shown.rows)) == (separator, decimal, 5)
    assert shown.names == tuple(foreign(frame).columns)


def test_a_mapping_is_remembered_on_request_and_for_the_same_columns_only(tmp_path: Path) -> None:
    frame, mappings = platoon(2, 100), tmp_path / "mappings"
    raw, mapping = foreign(frame).to_csv(index=False).encode(), parse_mapping(MAPPING)

    def reused(raw: bytes) -> bool:
        """Whether a table is read as an earlier one was."""
        try:
            return MappingRemembered() in read(raw, "next.csv", remember=True).findings
        except RecordingError:
            return False

    with pytest.raises(RecordingError, match="--mapping"):
        read(raw, "mine.csv")
    assert opened(raw, "mine.csv").is_unknown
    assert opened(b"time,lead,ego,gap\n" + b"0,1,2,3\n" * 40, "mine.csv").is_unknown
    assert not opened(csv(frame, metadata(("A", "B"))), "run.csv").is_unknown
    assert MappingRemembered() not in read(raw, "mine.csv", mapping=mapping).findings
    assert not reused(raw)
    first = read(raw, "mine.csv", mapping=mapping, remember=True)
    assert MappingRemembered() not in first.findings
    assert reused(raw)
    again = read(raw, "next.csv", remember=True)
    np.testing.assert_array_equal(again.speed, first.speed)
    assert again.mapping == mapping
    with pytest.raises(RecordingError, match="--mapping"):
        read(raw, "next.csv")
    assert not reused(foreign(frame).rename(columns={"note": "remark"}).to_csv().encode())
    with pytest.raises(RecordingError, match="cannot be opened"):
        load_mapping(mappings / "none.json")
    for path in mappings.iterdir():
        assert load_mapping(path) == mapping
        path.write_text("{")
    assert not reused(raw)


@pytest.mark.parametrize(("old", "new"), [('"km/h"', '"m/s"'), ('"ft"', '"m"')])
def test_a_mapping_that_contradicts_the_data_is_not_remembered(old: str, new: str) -> None:
    raw = foreign(platoon(2, 400)).to_csv(index=False).encode()
    wrong = parse_mapping(MAPPING.replace(old, new))
    recording = read(raw, "mine.csv", mapping=wrong, remember=True)
    assert contradictions(recording)
    assert remembered_mapping(opened(raw, "mine.csv").names) is None


def test_several_runs_in_one_table_without_a_column_of_time() -> None:
    frame = foreign(platoon(2, 200)).drop(columns="clock").assign(run=["x"] * 120 + ["y"] * 80)
    changed = msgspec.structs.replace(
        parse_mapping(MAPPING), time=None, sample_time=0.05, trajectory="run"
    )
    raw = frame.to_csv(index=False).encode()
    runs = [r for r in read_all(raw, "mine.csv", mapping=changed) if isinstance(r, Recording)]
    facts = [(run.trajectory, run.samples, run.sample_time) for run in runs]
    assert facts == [("x", 120, 0.05), ("y", 80, 0.05)]
    chosen = read(raw, "mine.csv", mapping=changed, trajectory="y")
    np.testing.assert_array_equal(chosen.speed, runs[1].speed)
    assert opened(raw, "mine.csv", mapping=changed).trajectories == (("x", 2), ("y", 2))
    with pytest.raises(RecordingError, match=r"2 trajectories; .*x, y"):
        read(raw, "mine.csv", mapping=changed)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ('"km/h"', '"furlong"', 'unit: "furlong" is not known; choose from m/s'),
        ('"v2"', '"v3"', 'no column "v3"; choose among clock'),
        ('"time"', '"tame"', "no mapping"),
        ('"unit": "ms"', '"unit": "s"', 'column clock: .*as "s"; .*name the column.s unit'),
        ('"vehicle": 2', '"vehicle": 3', "no vehicle 3"),
        (', {"column": "v2"}', "", "speeds lists 1 columns"),
        ('"unit": "ft", "subtract": 4.5', '"subtract": "4"', 'no column "4"'),
        ('"unit": "ft", "subtract": 4.5', '"subtract": []', r"gaps\[0\].subtract"),
        ('"gaps"', '"sample_time": 0.1, "gaps"', "give one of the two"),
        ('"engaged"', '"range"', "asked for as numbers and as words"),
        ('"range"', '"note"', 'row 2, column note: "a" is not a number'),
    ],
)
def test_an_invalid_mapping_is_refused_with_its_place(old: str, new: str, words: str) -> None:
    raw = foreign(platoon(2, 100)).to_csv(index=False).encode()
    with pytest.raises(RecordingError, match=words):
        read(raw, "mine.csv", mapping=parse_mapping(MAPPING.replace(old, new)))


def test_decimal_commas_are_seen_behind_rows_of_whole_numbers() -> None:
    frame = foreign(platoon(2, 300)).round(3)
    head, rows = frame.head(30), frame.tail(270)
    head = head.assign(**head.select_dtypes("number").round().astype(int))
    head["clock"] += 100 * np.arange(30) - head["clock"] + head["clock"][0]
    raw = head.to_csv(index=False, sep=";")
    raw += rows.to_csv(index=False, sep=";", decimal=",", header=False)
    recording = read(raw.encode(), "mine.csv", mapping=parse_mapping(MAPPING))
    np.testing.assert_allclose(recording.speed[30:, 1], rows["v2"])


def test_words_for_modes_are_read_in_any_spelling_and_others_are_reported() -> None:
    frame = foreign(platoon(2, 300))
    by_word = {0: "human ", 1: "acc"}
    for written in (frame["engaged"].astype(float), frame["engaged"].map(by_word)):
        raw = frame.assign(engaged=written).to_csv(index=False).encode()
        words = MAPPING.replace('["1"]', '["1", "ACC"]').replace('["0"]', '["0", "Human"]')
        recording = read(raw, "mine.csv", mapping=parse_mapping(words))
        assert recording.mode[[0, -1], 1].tolist() == [Mode.HUMAN, Mode.ACC]
        assert not recording.findings
    recording = read(raw, "mine.csv", mapping=parse_mapping(MAPPING))
    assert (recording.mode == Mode.UNKNOWN).all()
    assert recording.findings == (ModesUnknown("engaged", "1 nor 0", 300, "acc"),)


@pytest.mark.parametrize(
    ("row", "words"),
    [
        ("1;2", "row 12: the row has 2 cells where the column names ask for 6 cells; correct"),
        ("", "row 12: the row is empty where"),
        ('1;2;"a;4;5;1', "row 12: a quotation mark is opened and not closed; delete it"),
        ('1;2;"' + "a" * 200_000 + '";4;5;1', "the rows cannot be read as numbers"),
        ("1.500,0;2;a;4;5;1", 'row 12, column clock: "1.500,0" is no number'),
        ("1;2.5;a;4;5;1", 'row 12, column v2: "2.5" is not a number'),
    ],
)
def test_a_faulty_row_is_refused_with_its_place(row: str, words: str) -> None:
    lines = foreign(platoon(2, 100)).to_csv(index=False, sep=";", decimal=",").splitlines()
    raw = "\n".join([*lines[:11], row, *lines[12:], ""]).encode()
    with pytest.raises(RecordingError, match=words):
        read(raw, "mine.csv", mapping=parse_mapping(MAPPING))
    cut = "\n".join([*lines[:20], "1;2;a"]).encode()
    with pytest.raises(RecordingError, match=r"row 21: the file is cut short, .* 3 of 6 cells"):
        read(cut, "mine.csv", mapping=parse_mapping(MAPPING))


def recordings(raw: bytes) -> list[Recording]:
    runs = list(read_all(raw, "pairs.csv"))
    assert all(isinstance(run, Recording) for run in runs)
    return [run for run in runs if isinstance(run, Recording)]


def test_pairs_of_a_platoon_are_the_platoon() -> None:
    frame = platoon(4, 600)
    original = read(csv(frame), "run.csv")
    raw = table(pair(frame, 3, "c"), pair(frame, 1, "a"), pair(frame, 2, "b"))
    for chosen in (None, "a", "b", "c"):
        recording = read(raw, "pairs.csv", trajectory=chosen)
        np.testing.assert_array_equal(recording.speed, original.speed)
        np.testing.assert_array_equal(recording.gap, original.gap)
        np.testing.assert_allclose(recording.time, original.time, atol=1e-9)
    assert [vehicle.name for vehicle in recording.vehicles] == [
        "ID 101",
        "ID 102",
        "ID 103",
        "ID 104",
    ]
    assert (recording.mode[0] == [Mode.HUMAN, Mode.ACC, Mode.ACC, Mode.ACC]).all()


def test_pairs_that_begin_at_different_times_are_shifted() -> None:
    frame = platoon(4, 900)
    frame += np.random.default_rng(0).normal(0, 0.3, frame.shape).cumsum(axis=0) * 0.1
    raw = table(pair(frame, 1, "a", 150, 700), pair(frame, 2, "b", 0, 600), pair(frame, 3, "c", 90))
    [recording] = recordings(raw)
    for number, (first, last) in {1: (150, 700), 2: (0, 700), 3: (0, 900), 4: (90, 900)}.items():
        has_data = np.zeros(900, bool)
        has_data[first:last] = True
        np.testing.assert_array_equal(np.isfinite(recording.speed_of(number)), has_data)
        column = frame[f"Speed{number}"].to_numpy()[has_data]
        np.testing.assert_array_equal(recording.speed_of(number)[has_data], column)
    assert recording.time[-1] == pytest.approx(89.9)
    assert recording.samples == 900


def test_equal_identifiers_at_another_time_are_no_platoon() -> None:
    frame, later = platoon(3, 600), platoon(3, 600)
    later["Speed2"] += 1.5 * np.sin(0.11 * later["Time"])
    raw = table(pair(frame, 1, "a"), pair(later, 2, "b"))
    pairs = recordings(raw)
    assert [run.trajectory for run in pairs] == ["a", "b"]
    assert all(run.speed.shape == (600, 2) for run in pairs)
    assert len({run.sha256 for run in pairs}) == 2
    with pytest.raises(RecordingError, match=r"holds 2 platoons; .*--trajectory.*: a, b\."):
        read(raw, "pairs.csv")
    with pytest.raises(RecordingError, match='no trajectory "z"'):
        read(raw, "pairs.csv", trajectory="z")
    assert opened(raw, "pairs.csv").trajectories == (("a", 2), ("b", 2))
    assert opened(table(pair(frame, 1, "a"), pair(frame, 2, "b")), "pairs.csv").trajectories == ()
    assert not opened(raw, "pairs.csv").is_unknown


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda f: f.assign(Speed_LV=["x", *f["Speed_LV"][1:]]), 'row 2, column Speed_LV: "x"'),
        (lambda f: f.assign(Speed_FAV=300.0), "row 2, column Speed_FAV: 300 cannot"),
        (lambda f: f.assign(Spatial_Gap=np.nan), "column Spatial_Gap: all cells are empty"),
        (
            lambda f: f.assign(Time_Index=0.0),
            "row 3, column Time_Index: .*the time of the row before",
        ),
        (lambda f: pd.concat([f, f.assign(ID_LV=7), f]), "continues here"),
        (lambda f: f.iloc[:5], "only 5 rows"),
        (lambda f: f.assign(Time_Index=[*f["Time_Index"][:-1], np.inf]), "the time is missing"),
    ],
)
def test_a_faulty_table_is_refused_with_its_place(change: object, words: str) -> None:
    with pytest.raises(RecordingError, match=words):
        read(table(change(pair(platoon(2, 50), 1, "a"))), "pairs.csv")


def test_hostile_tables_are_refused_before_they_take_long() -> None:
    """A circle, speeds beyond all bounds in joined pairs, one vehicle everywhere, a run a row."""
    frame = platoon(samples=200)
    back = pair(frame, 1, "b").assign(ID_LV=102, ID_FAV=101)
    back["Speed_LV"], back["Speed_FAV"] = back["Speed_FAV"], back["Speed_LV"]
    assert len(recordings(table(pair(frame, 1, "a"), back))) == 1
    huge = pd.concat([pair(frame, 1, "a"), pair(frame, 2, "b").assign(Speed_LV=1e300)])
    with pytest.raises(RecordingError, match="cannot be a measurement"):
        read(huge.to_csv(index=False).encode(), "pairs.csv", trajectory="b")
    rows = pair(frame, 1, "a").iloc[:10].assign(ID_LV=1, ID_FAV=1)
    alike = table(*(rows.assign(Trajectory_ID=f"t{k}") for k in range(120)))
    with pytest.raises(RecordingError, match="14,400 may be one's"):
        read(alike, "pairs.csv")
    mixed = table(*(rows.iloc[:1].assign(Trajectory_ID=f"t{k}") for k in range(1100)))
    with pytest.raises(RecordingError, match="sort the rows"):
        read(mixed, "pairs.csv")


@pytest.fixture(scope="module")
def ultra_av(openacc_dir: Path) -> Path:
    folder = Path(os.environ.get("ULTRA_AV_DIR", "") or openacc_dir.parent / "ultra_av")
    if not folder.is_dir():
        pytest.skip("ULTRA_AV_DIR does not name a folder with tables of ULTra-AV")
    return folder


def test_a_table_and_openacc_file_of_one_run_are_the_same_data(
    ultra_av: Path, openacc_dir: Path
) -> None:
    of_table = read(ultra_av / "step1_Casale_8.csv")
    of_file = read(openacc_dir / "Casale" / "part8.csv")
    assert of_table.campaign == of_file.campaign == "Casale"
    segments = [cut(recording, 0, 100) for recording in (of_table, of_file)]
    assert segments[0].info.digest == segments[1].info.digest
    for method in ("least-squares", "maximum-likelihood"):
        fits = [accpinn.fit(source, duration=100, method=method) for source in (of_table, of_file)]
        np.testing.assert_allclose(*(f.parameters.values for f in fits), rtol=0, atol=1e-9)


@pytest.mark.parametrize("is_row", [False, True])
def test_a_mapping_that_contradicts_the_header_is_reported_and_not_remembered(is_row: bool) -> None:
    """Speeds and gap in feet have the slope of metres, so that the data cannot tell."""
    header = "t,lead [ft/s],ego [ft/s],gap [ft]"
    if is_row:
        header = "t,lead,ego,gap\ns,ft/s,ft/s,ft"
    frame = platoon(2, 300)[["Time", "Speed1", "Speed2", "IVS1"]]
    raw = f"{header}\n{frame.to_csv(index=False, header=False)}".encode()
    names = opened(raw, "feet.csv").names
    units = {"speed": "m/s", "gap": "m"}
    for count in (3, 0):
        mapping = parse_mapping(json.dumps({
            "time": {"column": names[0]},
            "speeds": [{"column": name, "unit": units["speed"]} for name in names[1:3]],
            "gaps": [{"column": names[3], "unit": units["gap"]}],
        }))  # fmt: skip
        recording = read(raw, "feet.csv", mapping=mapping, remember=True)
        contradicting = [f for f in recording.findings if isinstance(f, UnitContradictsHeader)]
        assert len(contradicting) == count
        window = cut(recording, 0, 20).findings
        assert [f for f in window if isinstance(f, UnitContradictsHeader)] == contradicting
        result = accpinn.fit(recording, 0, 20, method="least-squares")
        assert [f for f in result.warnings if isinstance(f, UnitContradictsHeader)] == contradicting
        assert (remembered_mapping(names) is None) == bool(count)
        units = {"speed": "ft/s", "gap": "ft"}
