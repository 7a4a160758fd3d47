"""Every form of time gives its seconds exactly, is recognised as itself, and refuses garbage."""

import datetime
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from accpinn.recordings.clocks import FORMS, NANOSECONDS, TimeUnreadable, seconds, unwrapped
from accpinn.recordings.time_forms import recognised

DAY_MS = 86_400_000


def hhmmss(ms: int) -> str:
    h, m, s = ms // 3_600_000 % 24, ms // 60_000 % 60, ms // 1000 % 60
    return f"{h:02d}{m:02d}{s:02d}.{ms % 1000:03d}"


def clock(ms: int) -> str:
    text = hhmmss(ms)
    return f"{text[:2]}:{text[2:4]}:{text[4:]}"


def half_day_clock(ms: int) -> str:
    hour = ms // 3_600_000 % 24
    return f"{hour % 12 or 12}{clock(ms)[2:]} {'PM' if hour >= 12 else 'AM'}"


def moment(ms: int, pattern: str) -> str:
    instant = datetime.datetime(1970, 1, 1) + datetime.timedelta(milliseconds=ms)
    return instant.strftime(pattern) + f".{ms % 1000:03d}"


WRITTEN: dict[str, tuple[str, Callable[[int], str]]] = {
    "s": ("s", lambda ms: f"{ms // 1000}.{ms % 1000:03d}"),
    "ms": ("ms", str),
    "µs": ("µs", lambda ms: f"{ms}000"),
    "us": ("us", lambda ms: f"{ms}000.0"),
    "ns": ("ns", lambda ms: f"{ms}000000"),
    "ISO 8601": ("datetime", lambda ms: moment(ms, "%Y-%m-%dT%H:%M:%S") + "Z"),
    "ISO with zone": ("datetime", lambda ms: moment(ms, "%Y-%m-%d %H:%M:%S") + "-07:00"),
    "basic ISO": ("datetime", lambda ms: moment(ms, "%Y%m%dT%H%M%S") + "+0200"),
    "day first": ("datetime", lambda ms: moment(ms, "%d.%m.%Y %H:%M:%S")),
    "month first": ("datetime", lambda ms: moment(ms, "%m/%d/%Y %H:%M:%S")),
    "short year": ("datetime", lambda ms: moment(ms, "%d/%m/%y %H:%M:%S")),
    "named month": ("datetime", lambda ms: moment(ms, "%d-%b-%Y %H:%M:%S")),
}
"""Forms that hold the date: the form, and how an instant in ms since 1970 is written."""
CLOCKS: dict[str, tuple[str, Callable[[int], str]]] = {
    "clock": ("clock", clock),
    "half day": ("clock", half_day_clock),
    "comma": ("clock", lambda ms: clock(ms).replace(".", ",")),
    "hhmmss": ("hhmmss", hhmmss),
    "hhmmss without zeros": ("hhmmss", lambda ms: str(float(hhmmss(ms)))),
}
"""Forms that begin anew at midnight."""

starts = st.integers(946_684_800_000, 2_000_000_000_000)  # 2000 to 2033
rates = st.integers(1, 50)


def stamps(start: int, rate: int, samples: int = 40) -> list[int]:
    """Instants in whole ms, as loggers truncate them."""
    return [start + k * 1000 // rate for k in range(samples)]


def since_first(instants: list[int]) -> np.ndarray:
    return (np.array(instants) - instants[0]) / 1000


@pytest.mark.parametrize("kind", WRITTEN)
@given(start=starts, rate=rates)
@settings(max_examples=25, deadline=None)
def test_instants_come_back_exactly(kind: str, start: int, rate: int) -> None:
    form, written = WRITTEN[kind]
    instants = stamps(start, rate)
    time = seconds([written(ms) for ms in instants], form)
    np.testing.assert_allclose(time, since_first(instants), rtol=0, atol=1e-9)


@pytest.mark.parametrize("kind", CLOCKS)
@given(before=st.integers(0, 30_000), rate=st.integers(2, 50))
@settings(max_examples=25, deadline=None)
def test_a_clock_goes_on_across_midnight(kind: str, before: int, rate: int) -> None:
    form, written = CLOCKS[kind]
    instants = stamps(DAY_MS - 1 - before, rate, 200)
    time, wraps = unwrapped(seconds([written(ms) for ms in instants], form))
    np.testing.assert_allclose(time, since_first(instants), rtol=0, atol=1e-9)
    crossing = [k for k, ms in enumerate(instants) if ms >= DAY_MS][:1]
    assert list(wraps) == crossing


@given(start=starts, rate=st.integers(2, 50))
@settings(max_examples=6, deadline=None)
def test_date_and_clock_in_two_columns(start: int, rate: int) -> None:
    start = start // DAY_MS * DAY_MS + DAY_MS - 1500
    instants = stamps(start, rate, 200)
    pairs = [(clock, "clock"), (hhmmss, "hhmmss"), (lambda ms: str(ms % DAY_MS), "ms")]
    for pattern in ("%Y-%m-%d", "%Y%m%d", "%d.%m.%Y", "%d%m%y", "%Y-%m-%dT00:00:00"):
        dates = [moment(ms, pattern)[:-4] for ms in instants]
        for written, form in pairs:
            time = seconds([written(ms) for ms in instants], form, dates=dates)
            np.testing.assert_allclose(time, since_first(instants), rtol=0, atol=1e-9)


@given(before=st.integers(0, 5_000), rate=st.integers(2, 50))
@settings(max_examples=25, deadline=None)
def test_seconds_of_the_gps_week_go_on(before: int, rate: int) -> None:
    instants = stamps(7 * DAY_MS - 1 - before, rate, 400)
    cells = [f"{ms % (7 * DAY_MS) / 1000:.3f}" for ms in instants]
    time, wraps = unwrapped(seconds(cells, "s"))
    np.testing.assert_allclose(time, since_first(instants), rtol=0, atol=1e-9)
    assert len(wraps) == 1


def test_any_other_fall_is_left_alone() -> None:
    for fall in (10.0, 3600.0, 43_200.0, 86_300.0, 86_410.0, 604_000.0):
        time = np.concatenate([np.arange(20) / 10, np.arange(20) / 10 - fall])
        same, wraps = unwrapped(time)
        assert wraps == ()
        np.testing.assert_array_equal(same, time)
    missing = np.array([86_399.8, np.nan, 86_399.9, np.nan, 0.0, 0.1])
    time, wraps = unwrapped(missing)
    assert wraps == (4,)
    np.testing.assert_array_equal(np.isnan(time), np.isnan(missing))
    assert time[5] == 86_400.1


def test_two_midnights_are_two_wraps() -> None:
    time = np.arange(0, 2 * 86_400 + 100, 5.0)
    again, wraps = unwrapped(time % 86_400)
    assert len(wraps) == 2
    np.testing.assert_array_equal(again, time)


def test_nanoseconds_zones_and_missing_cells() -> None:
    cells = [
        "NaN",
        "2022-01-13 10:09:10.131900072-07:00",
        "",
        "2022-01-13 18:09:10.332799911+01:00",
    ]
    time = seconds(cells, "datetime")
    assert np.isnan(time[[0, 2]]).all()
    assert time[1] == 0
    assert time[3] == 0.200899839
    assert seconds(["01:00.5", "75:10,25"], "clock")[1] == 74 * 60 + 9.75
    assert seconds(["30:00:00", "30:00:01.5"], "clock")[1] == 1.5
    assert seconds(["11:59 AM", "12:01 PM"], "clock")[1] == 120
    assert seconds(["0,5", "NULL", "1,25"], "s", ",")[2] == 0.75
    assert seconds(["45455.5", "45455.500001157"], "d")[1] == pytest.approx(0.0999648, abs=1e-9)


def test_arrays_are_read_by_the_digits_they_show() -> None:
    assert seconds(np.array([1.7e9, 1.7e9 + 0.066]), "s")[1] == 0.066
    assert seconds(np.array([0.1, 0.3], dtype=np.float32), "s")[1] == 0.2
    assert seconds(np.array([5, 7]), "min")[1] == 120
    instants = pd.to_datetime(["2024-06-12 12:35:10.066000001", "NaT", "2024-06-12 12:35:10.133"])
    time = seconds(instants.to_numpy(), "datetime")
    assert np.isnan(time[1])
    assert time[2] == 0.066999999


# The order of day and month


def test_the_whole_column_decides_the_order() -> None:
    assert seconds(["12/06/2024 23:59:59.9", "13/06/2024 00:00:00.1"], "datetime")[1] == 0.2
    assert seconds(["06/12/2024 23:59:59.9", "06/13/2024 00:00:00.1"], "datetime")[1] == 0.2
    # Both are dates in either order; from a day to the next they go in one.
    assert seconds(["11/06/2024 23:59:59.9", "12/06/2024 00:00:00.1"], "datetime")[1] == 0.2
    assert seconds(["06/11/2024 23:59:59.9", "06/12/2024 00:00:00.1"], "datetime")[1] == 0.2
    assert seconds(["12.06.2024 12:35:10,1", "12.06.2024 12:35:10,2"], "datetime")[1] == 0.1


@pytest.mark.parametrize(
    ("cells", "index"),
    [
        (["01/02/2024 10:00", "01/02/2024 10:01", "04/03/2024 10:00"], 2),
        (["13/06/2024 10:00", "06/14/2024 10:00"], 1),
        (["2024-06-12 10:00Z", "2024-06-12 10:01"], 1),
        (["2024-06-12 10:00", "12/06/2024 10:00"], 1),
        (["30/02/2024 10:00"], 0),
    ],
)
def test_dates_of_two_meanings_are_refused(cells: list[str], index: int) -> None:
    with pytest.raises(TimeUnreadable) as caught:
        seconds(cells, "datetime")
    assert (caught.value.index, caught.value.cell) == (index, cells[index])


# Garbage

SOUND = {"datetime": "2024-06-12 12:35:10", "clock": "12:35:10.5", "hhmmss": "123510.5"}
GARBAGE = [
    "fast",
    "1_0",
    "1e999999999",
    "12:60:00",
    "2024-13-01 10:00",
    "١٢",
    "0x10",
    "1.2.3",
    "12;5",
]


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("garbage", GARBAGE)
def test_every_form_names_the_first_cell_it_cannot_read(form: str, garbage: str) -> None:
    cells = [SOUND.get(form, "12.5"), "", "NaN", garbage, "worse"]
    with pytest.raises(TimeUnreadable) as caught:
        seconds(cells, form)
    assert (caught.value.index, caught.value.cell) == (3, garbage)
    assert not caught.value.is_date


@pytest.mark.parametrize("cell", ["246010", "126010", "123460", "-123510", "240000"])
def test_hhmmss_that_no_clock_shows_is_refused(cell: str) -> None:
    with pytest.raises(TimeUnreadable):
        seconds(["123510", cell], "hhmmss")


def test_a_wrong_date_is_named_as_a_date() -> None:
    for date in ("soon", "2024-06-12T10:00:00"):
        with pytest.raises(TimeUnreadable) as caught:
            seconds(["10:00:00", "10:00:01"], "clock", dates=["2024-06-12", date])
        assert caught.value.is_date
        assert caught.value.index == 1


@given(st.lists(st.text(max_size=20), min_size=1, max_size=5), st.sampled_from(FORMS))
@settings(max_examples=100, deadline=None)
def test_any_text_is_read_or_refused(cells: list[str], form: str) -> None:
    unread = None
    try:
        time = seconds(cells, form)
    except TimeUnreadable as fault:
        unread = (fault.index, fault.cell)
    if unread is None:
        assert time.shape == (len(cells),)
    else:
        assert cells[unread[0]].strip() == unread[1]
    recognised("time", cells)


# Recognition


def column(step: float, samples: int = 200, first: float = 0.0, digits: int = 10) -> list[str]:
    return [f"{first + k * step:.{digits}g}" for k in range(samples)]


@pytest.mark.parametrize("kind", WRITTEN)
@given(start=starts, rate=rates)
@settings(max_examples=10, deadline=None)
def test_instants_are_recognised(kind: str, start: int, rate: int) -> None:
    form, written = WRITTEN[kind]
    if rate == 1:
        rate = 2
    start = max(start, 1_010_000_000_000)
    start -= start % DAY_MS - 36_000_000  # in the morning
    for name in ("Timestamp", "column 3", "B"):
        time_form = recognised(name, [written(ms) for ms in stamps(start, rate)])
        assert time_form is not None
        assert NANOSECONDS.get(time_form.form, time_form.form) == NANOSECONDS.get(form, form)
        assert time_form.by_values


@pytest.mark.parametrize("kind", CLOCKS)
@given(start=st.integers(0, DAY_MS), rate=rates)
@settings(max_examples=8, deadline=None)
def test_clocks_are_recognised(kind: str, start: int, rate: int) -> None:
    form, written = CLOCKS[kind]
    instants = stamps(start, rate, 130 * rate)  # two full minutes
    time_form = recognised("t", [written(ms) for ms in instants][:5000])
    assert time_form is not None
    assert (time_form.form, time_form.by_values) == (form, True)


@given(start=st.integers(0, 239_999_000), rate=st.integers(2, 50), samples=st.integers(20, 3000))
@settings(max_examples=40, deadline=None)
def test_seconds_are_never_a_clock(start: int, rate: int, samples: int) -> None:
    cells = [f"{ms / 1000:.3f}" for ms in stamps(start, rate, samples)]
    time_form = recognised("t", cells)
    assert time_form is not None
    assert (time_form.form, time_form.supported) == ("s", True)


def test_within_a_minute_the_name_decides_whether_it_is_a_clock() -> None:
    cells = column(0.1, 300, 123_510)
    assert recognised("t", cells).form == "s"  # type: ignore[union-attr]
    for name in ("UTC", "nmea_time", "time (hhmmss.ss)"):
        time_form = recognised(name, cells)
        assert time_form is not None
        assert (time_form.form, time_form.by_name) == ("hhmmss", True)


@pytest.mark.parametrize(
    ("name", "step", "form"),
    [
        ("Time (min)", 0.1 / 60, "min"),
        ("time_ms", 20, "ms"),
        ("t [s]", 0.02, "s"),
        ("Timestamp(us)", 66_667, "µs"),
        ("timestamp_ns", 1e8, "ns"),
        ("TIME [h]", 0.1 / 3600, "h"),
        ("Zeit [s]", 0.1, "s"),
        ("Seconds since start", 0.1, "s"),
        ("elapsedTimeMs", 100, "ms"),
        ("Time (s)", 1, "s"),
        ("time [msec]", 1000, "ms"),
        ("t_d", 0.1 / 86_400, "d"),
        ("sec", 0.1, "s"),
    ],
)
def test_the_name_gives_the_unit(name: str, step: float, form: str) -> None:
    time_form = recognised(name, column(step, digits=16))
    assert time_form is not None
    assert (time_form.form, time_form.by_name) == (form, True)


@pytest.mark.parametrize(
    ("step", "first", "form"),
    [
        (0.1, 0, "s"),
        (1 / 15, 0, "s"),
        (0.02, 5_000, "s"),
        (0.5, 86_300, "s"),
        (100, 0, "ms"),
        (66, 1e6, "ms"),
        (1e5, 0, "µs"),
        (0.1, 1.7e9, "s"),
        (100, 1.7e12, "ms"),
        (1e5, 1.7e15, "µs"),
        (0.1 / 86_400, 45_455.5, "d"),
    ],
)
def test_the_steps_or_the_size_give_the_unit(step: float, first: float, form: str) -> None:
    time_form = recognised("local_time", column(step, 200, first, 17))
    assert time_form is not None
    assert (time_form.form, time_form.supported) == (form, True)


@pytest.mark.parametrize("step", [1, 1000, 0.1 / 60, 0.1 / 3600, 1 / 120])
def test_several_possible_units_are_not_decided(step: float) -> None:
    time_form = recognised("Time", column(step))
    assert time_form is not None
    assert not time_form.supported
    assert time_form.reason.count("steps of") >= 2


def test_a_name_that_the_steps_contradict_decides_nothing() -> None:
    time_form = recognised("time_ms", column(0.1))
    assert time_form is not None
    assert not time_form.supported
    assert "ms" in time_form.reason


@pytest.mark.parametrize(
    ("name", "cells"),
    [
        ("Time_Headway", column(0.1)),
        ("time gap [s]", column(0.1)),
        ("thw", column(0.1)),
        ("TTC", column(0.1)),
        ("lap time", [clock(ms) for ms in stamps(0, 10)]),
        ("speed [m/s]", column(0.1)),
        ("v_ms", column(0.1)),
        ("dist_per_sec", column(0.1)),
        ("s", column(2.5)),
        ("Total_Frames", ["437"] * 100),
        ("time", ["3.5"] * 100),
        ("time", column(-0.1)),
        ("timestamp", ["2024-06-12T12:35:10Z"] * 100),
        ("date", ["2024-06-12"] * 100),
        ("date", ["20240612"] * 100),
        ("time", []),
        ("time", ["a", "b"]),
        ("position", column(2.5, first=100)),
        ("column 2", column(1)),
        ("id", [str(k % 5) for k in range(100)]),
    ],
)
def test_what_is_no_clock_is_not_recognised(name: str, cells: list[str]) -> None:
    assert recognised(name, cells) is None


def test_frames_are_counted_from_a_frame_column() -> None:
    counter = [str(k) for k in range(100)]
    for name in ("frame", "Frame_ID", "frame number"):
        time_form = recognised(name, counter)
        assert time_form is not None
        assert (time_form.form, time_form.by_name) == ("frame", True)
    assert recognised("id", counter) is None
    long = [str(k) for vehicle in range(5) for k in range(10 * vehicle, 10 * vehicle + 40)]
    assert recognised("Frame_ID", long).form == "frame"  # type: ignore[union-attr]


def test_a_long_table_repeats_its_times() -> None:
    by_instant = [f"{k // 5 / 10}" for k in range(500)]
    by_vehicle = [f"{k / 10}" for _ in range(5) for k in range(100)]
    for cells in (by_instant, by_vehicle):
        time_form = recognised("time", cells)
        assert time_form is not None
        assert (time_form.form, time_form.supported) == ("s", True)


def test_an_open_order_of_day_and_month_is_reported() -> None:
    cells = ["01/02/2024 10:00:00", "01/02/2024 10:00:01", "04/03/2024 10:00:00"]
    time_form = recognised("time", cells)
    assert time_form is not None
    assert (time_form.form, time_form.supported) == ("datetime", False)


def test_a_column_without_a_name_is_time_if_its_steps_are_even() -> None:
    time_form = recognised("column 1", column(0.1))
    assert time_form is not None
    assert (time_form.form, time_form.by_name, time_form.by_values) == ("s", False, True)
    assert recognised("column 1", [f"{k / 10 + (k % 3) / 50}" for k in range(99)]) is None


def test_only_the_time_of_an_openacc_run_is_recognised(openacc_dir: Path) -> None:
    runs = 0
    for path in sorted(openacc_dir.glob("*/*.csv"))[::15]:
        rows = [line.split(",") for line in path.read_text("latin-1").splitlines()]
        header = next((k for k, row in enumerate(rows) if row[0] == "Time"), None)
        if header is None:
            continue
        columns = zip(
            *(row for row in rows[header + 1 :] if len(row) == len(rows[header])), strict=True
        )
        forms = {
            name: recognised(name, cells) for name, cells in zip(rows[header], columns, strict=True)
        }
        times = {name: form.form for name, form in forms.items() if form and form.supported}
        assert times == {"Time": "s"}, path.name
        runs += 1
    assert runs
