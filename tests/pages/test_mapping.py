"""The form that shows how a table was understood, asks what is open, and offers cures."""

import os
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from msgspec.structs import replace

from accpinn.recordings import Mode, Recording, files
from accpinn.recordings.inconsistency import ClocksDiffer, SignReversed, UnitsDiffer
from accpinn.recordings.mapping import remembered_mapping, write_mapping
from pages.ui.data.mapping import CHANGING, open_fields
from pages.ui.session.pending import Pending
from pages.ui.session.resources import find_recording
from tests.support import own_tables
from tests.support.apptest import Page, numbers, open_page
from tests.support.openacc_files import pair, platoon, table

pytestmark = pytest.mark.usefixtures("fresh_server")

TIME, SPEEDS, GAPS = own_tables.pair()
LEADER, FOLLOWER = SPEEDS.T


def shown(page: Page) -> Recording:
    """The recording that the form shows."""
    pending = page.workspace().pending
    assert pending is not None
    reading = pending.reading()
    assert isinstance(reading, Recording), reading
    return reading


def dropped(name: str, content: bytes, title: str = "Home") -> Page:
    """The page after a table was dropped on it."""
    page = open_page(title)
    return page.upload(name, content)


@pytest.mark.parametrize("make", [own_tables.iso_with_units, own_tables.long_format,
                                  own_tables.workbook])  # fmt: skip
def test_a_table_that_is_understood_is_one_click_from_open(make) -> None:
    page = dropped("own.table", make())
    assert page.workspace().recording is None, "it is shown first"
    assert not page.boxes("warning") + page.boxes("error")
    (figure,) = page.figures()
    drawn = numbers(figure["data"][0]["y"])
    assert abs(np.nanmean(drawn) - LEADER[TIME <= 180].mean()) < 0.1, "in m/s"
    for name in page.workspace().pending.file.names:
        assert name in page.plain()
    page.press("data_open_table")
    recording = page.workspace().recording
    assert recording is not None
    assert page.workspace().pending is None
    assert recording.duration == pytest.approx(own_tables.DURATION, abs=0.1)
    np.testing.assert_allclose(np.nanmean(recording.gap[:, 0]), GAPS.mean(), rtol=2e-3)
    assert "data_train" in page.buttons, "the page to which it turns trains at one click"


def test_cancelling_gets_the_field_for_files_back() -> None:
    page = dropped("own.csv", own_tables.plain()).press("data_cancel")
    assert page.file_uploader(key="data_upload")
    assert page.workspace().recording is None


def test_a_gap_that_nothing_tells_is_asked_for_and_nothing_else() -> None:
    gap = np.random.default_rng(0).uniform(20, 30, len(TIME))
    frame = pd.DataFrame({
        "time": TIME, "lead speed (m/s)": LEADER, "ego speed (m/s)": FOLLOWER, "y": gap,
        "z": 3 * gap,
    })  # fmt: skip
    page = dropped("own.csv", frame.to_csv(index=False).encode())
    fields = open_fields(page.workspace().pending.file.proposal)
    assert fields == ("gap_0", "gap_units")
    assert page.button(key="data_open_table").disabled
    page.choose("data_map_gap_0", "y").choose("data_map_gap_units", "ft")
    np.testing.assert_allclose(shown(page).gap[:, 0], 0.3048 * gap)


def test_a_length_is_asked_for_and_subtracted() -> None:
    way = 22 * TIME
    frame = pd.DataFrame({
        "t": TIME, "leader_v [m/s]": LEADER, "follower_v [m/s]": FOLLOWER,
        "leader_p [m]": way + GAPS[:, 0] + 4.5, "follower_p [m]": way,
    })  # fmt: skip
    page = dropped("own.csv", frame.to_csv(index=False).encode())
    assert page.button(key="data_open_table").disabled
    page.choose("data_map_length_0", 4.5).press("data_open_table")
    np.testing.assert_allclose(page.workspace().recording.gap, GAPS, atol=1e-6)


def test_frames_are_read_once_their_step_is_given() -> None:
    frame = own_tables.plain(time=np.arange(len(TIME))).replace(b"time", b"frame", 1)
    page = dropped("own.csv", frame)
    assert page.button(key="data_open_table").disabled
    page.choose("data_map_step", 0.1)
    assert shown(page).duration == pytest.approx(own_tables.DURATION)


@pytest.mark.parametrize(
    ("columns", "finding", "label"),
    [
        ({"lead_speed": FOLLOWER, "ego_speed": LEADER}, SignReversed, "Exchange the speeds"),
        ({"gap": -GAPS[:, 0]}, SignReversed, "Reverse the sign of the gap"),
        ({"lead_speed": np.interp(TIME - 1.0, TIME, LEADER)}, ClocksDiffer,
         "Shift Speed1 by \N{MINUS SIGN}1.0 s"),
    ],
)  # fmt: skip
def test_a_finding_is_cured_by_its_button(columns, finding, label) -> None:
    page = dropped("own.csv", own_tables.plain(**columns))
    before = page.figures()
    assert any(isinstance(f, finding) for f in files.contradictions(shown(page)))
    page.press(label)
    assert files.contradictions(shown(page)) == ()
    assert page.figures() != before
    assert not page.boxes("warning")
    page.press("data_open_table")
    recording = page.workspace().recording
    np.testing.assert_allclose(recording.gap[200:1200].mean(), GAPS[200:1200].mean(), rtol=0.05)


def test_units_that_contradict_are_cured_on_page_data_too() -> None:
    page = dropped("own.csv", own_tables.plain(lead_speed=3.6 * LEADER, ego_speed=3.6 * FOLLOWER))
    page.session_state[CHANGING] = True
    page.run()
    page.choose("data_map_speed_unit_0", "m/s").choose("data_map_speed_unit_1", "m/s")
    assert any(isinstance(f, UnitsDiffer) for f in files.contradictions(shown(page)))
    page.press("data_open_table")
    session = page.workspace()
    assert session.mappings == {}, "what is contradicted is not remembered"
    assert session.recording.speed[:, 0].max() > 60
    page.press("Read speeds as km/h")
    np.testing.assert_allclose(session.recording.speed, SPEEDS, atol=1e-9)
    assert len(session.mappings) == 1
    page.press("data_columns")
    assert session.pending.mapping == session.recording.mapping


def test_a_mapping_is_remembered_in_the_session_alone() -> None:
    content = own_tables.plain()
    page = dropped("own.csv", content)
    page.session_state[CHANGING] = True
    page.run()
    page.choose("data_map_name_0", "Audi A6").press("data_open_table")
    session = page.workspace()
    names = files.opened(content, "own.csv").names
    assert remembered_mapping(names) is None, "not on the server's disk"
    assert session.mappings[names].speeds[0].name == "Audi A6"
    assert Pending.of(files.opened(content), session.mappings[names]).mapping == (
        session.recording.mapping
    )
    other = dropped("next.csv", content)
    assert other.workspace().pending.mapping.speeds[0].name == ""


def test_columns_are_changed_behind_one_expander() -> None:
    frame = platoon(3, 400)
    odd = pd.DataFrame({
        "t": frame["Time"], "v1 (m/s)": frame["Speed1"], "v2 (m/s)": frame["Speed2"],
        "gap (m)": frame["IVS1"], "w": 3.6 * frame["Speed3"], "h": frame["IVS2"],
        "engaged": (frame.index >= 100).astype(int),
    })  # fmt: skip
    page = dropped("odd.csv", odd.to_csv(index=False).encode())
    assert len(page.selectbox) == 0, "nothing is open"
    page.session_state[CHANGING] = True
    page.run()
    page.choose("data_map_vehicles", 3)
    assert page.button(key="data_open_table").disabled
    page.choose("data_map_speed_2", "v2 (m/s)").choose("data_map_gap_1", "h")
    assert "v2 (m/s)" in page.boxes("error")[0], "chosen twice"
    page.choose("data_map_speed_2", "w").choose("data_map_speed_unit_2", "km/h")
    page.choose("data_map_mode_2", "").choose("data_map_mode_3", "engaged")
    page.press("data_open_table")
    recording = page.workspace().recording
    np.testing.assert_allclose(recording.speed, frame[["Speed1", "Speed2", "Speed3"]], atol=1e-9)
    assert [Mode(m) for m in recording.mode[[0, 200], 2]] == [Mode.HUMAN, Mode.ACC]


def test_a_long_table_is_mapped_by_hand() -> None:
    content = own_tables.long_format().replace(b"leader_id", b"w", 1)
    page = dropped("long.csv", content)
    page.session_state[CHANGING] = True
    page.run()
    page.choose("data_map_rows", "vehicle")
    page.choose("data_map_by_vehicle", "vehicle_id").choose("data_map_by_leader", "w")
    for key, value in (("time", "time"), ("speed_0", "speed [m/s]"), ("gap_0", "x [m]"),
                       ("minus_0", True), ("length_column_0", "length [m]")):  # fmt: skip
        page.choose(f"data_map_{key}", value)
    page.press("data_open_table")
    np.testing.assert_allclose(page.workspace().recording.gap, GAPS, atol=1e-2)


def test_a_mapping_file_takes_the_place_of_the_fields() -> None:
    content = own_tables.plain()
    page = dropped("own.csv", content)
    page.session_state[CHANGING] = True
    page.run()
    mapping = page.workspace().pending.mapping
    speeds = (replace(mapping.speeds[0], name="Audi A6"), mapping.speeds[1])

    def give(text: bytes) -> None:
        page.file_uploader(key="data_mapping_upload").upload("m.json", text, "application/json")
        page.sound()

    give(write_mapping(replace(mapping, speeds=speeds)))
    assert page.workspace().pending.mapping.speeds == speeds
    give(write_mapping(mapping).replace(b"lead_speed", b"ego_speed", 1))
    assert "m.json" in page.boxes("error")[0], "a column that is named twice"
    assert page.workspace().pending.mapping.speeds == speeds


def test_of_a_table_with_several_trajectories_one_is_chosen() -> None:
    raw = table(*(pair(platoon(2, 300) + k, 1, name) for k, name in enumerate("ab")))
    page = dropped("p.csv", raw, "Data")
    page.choose("data_trajectory", "b")
    page.press("data_open_table")
    recording = page.workspace().recording
    assert recording.trajectory == "b"
    place = Path(os.environ["ACCPINN_RECORDINGS"]) / "p.csv"
    place.parent.mkdir(parents=True)
    place.write_bytes(raw)
    again = find_recording(recording.source, recording.sha256, "b")
    assert again.digest == recording.digest, "as after a restart"


def test_runs_of_a_table_of_ones_own_are_chosen_beside_their_plot() -> None:
    frame = pd.read_csv(pd.io.common.BytesIO(own_tables.plain()))
    runs = pd.concat([frame.iloc[:400].assign(run=1), frame.iloc[:600].assign(run=2)])
    page = dropped("runs.csv", runs.to_csv(index=False).encode())
    page.choose("data_trajectory", "2").press("data_open_table")
    assert page.workspace().recording.samples == 600
