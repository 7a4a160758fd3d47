"""Cutting windows: a segment is even and complete, and its findings list all changes."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from accpinn.errors import AccpinnError, SegmentError
from accpinn.recordings import Window
from accpinn.recordings.inconsistency import Inconsistency
from accpinn.segment import BlocksMissing, Bridged, Resampled, Segment, WindowMoved, WindowShortened
from accpinn.segment.cut import (
    DECIMALS,
    chains,
    cut,
    default_vehicles,
    parse_vehicles,
    parse_windows,
)
from accpinn.segment.windows import complete_windows, disjoint_windows
from tests.support.driving import segment_of
from tests.support.openacc_files import platoon, recording


def without(block: slice, *columns: str) -> pd.DataFrame:
    """The sound platoon with a block of samples missing."""
    frame = platoon()
    frame.loc[block, list(columns)] = np.nan
    return frame


# The window


def test_both_ends_are_in_and_a_start_between_samples_moves_to_the_nearest() -> None:
    segment = cut(recording(), start=5.0, duration=20.0)
    assert (segment.window, segment.start) == (Window(5.0, 25.0), 5.0)
    assert (segment.samples, segment.sample_time, segment.time[0]) == (201, 0.1, 0.0)
    rows = platoon().round(DECIMALS).iloc[50:251]
    np.testing.assert_array_equal(segment.speeds, rows[["Speed1", "Speed2", "Speed3"]])
    np.testing.assert_array_equal(segment.gaps, rows[["IVS1", "IVS2"]])
    assert segment.findings == ()
    moved = cut(recording(), start=5.04, duration=20.0)
    assert (moved.start, moved.findings) == (5.0, (WindowMoved(asked=5.04, start=5.0),))


@pytest.mark.parametrize("duration", [40.0, 300.0, 1e308, float("inf")])
def test_a_window_past_the_end_is_shortened(duration: float) -> None:
    segment = cut(recording(), start=20.0, duration=duration)
    assert segment.window == Window(20.0, 39.9)
    shortened = WindowShortened(asked=duration, window=segment.window)
    assert segment.findings == (() if np.isinf(duration) else (shortened,))


@pytest.mark.parametrize("rate", [15, 30, 60])
def test_a_step_with_endless_digits_puts_no_window_off_its_samples(rate: int) -> None:
    frame = platoon(samples=400 * rate)
    frame["Time"] = np.arange(len(frame)) / rate
    segment = cut(recording(frame), start=90.0, duration=300.0)
    assert (segment.samples, segment.start) == (300 * rate + 1, 90.0)
    # Its gaps change as at 10 Hz, which is too fast for its speeds.
    assert all(isinstance(finding, Inconsistency) for finding in segment.findings)
    assert segment.speeds[0, 0] == round(frame["Speed1"][90 * rate], DECIMALS)


@pytest.mark.parametrize(
    ("start", "duration", "words"),
    [
        (-1.0, 20.0, "start at 0 s"),
        (float("nan"), 20.0, "start at 0 s"),
        (0.0, float("nan"), "is no number; take at least 10 s"),
        (0.0, -5.0, "at least 10 s"),
        (31.0, 20.0, "start at 29.9 s or earlier"),
    ],
)
def test_impossible_windows_are_refused(start: float, duration: float, words: str) -> None:
    with pytest.raises(SegmentError, match=words) as caught:
        cut(recording(), start=start, duration=duration)
    assert str(caught.value).startswith(recording().source)
    with pytest.raises(SegmentError, match="choose a longer one"):
        cut(recording(platoon(samples=50)))


# Uneven time


def test_uneven_steps_are_resampled_and_float_noise_is_left_alone() -> None:
    """Speeds are smooth: linear interpolation within 0.1 s errs by ω²A dt²/8 < 1 mm/s."""
    full, noisy = platoon(), platoon()
    rng = np.random.default_rng(2)
    jitter = rng.uniform(-0.03, 0.03, len(full))
    jitter[[0, 20, -1]] = 0.0
    time = full["Time"] + jitter
    uneven = full.apply(lambda column: np.interp(time, full["Time"], column))
    segment = cut(recording(uneven), start=2.0, duration=30.0)
    assert segment.window.duration == pytest.approx(30.0, abs=0.2)
    assert segment.findings == (Resampled(step=segment.sample_time),)
    true = [np.interp(segment.time + 102.0, full["Time"], full[f"Speed{k}"]) for k in (1, 2, 3)]
    np.testing.assert_allclose(segment.speeds, np.transpose(true), atol=5e-3)
    noisy["Time"] += 1e-9 * rng.normal(size=len(noisy))
    assert cut(recording(noisy), 2.0, 30.0) == cut(recording(full), 2.0, 30.0)


def test_rows_that_are_missing_are_bridged_as_empty_cells_are() -> None:
    full = platoon()
    present = np.sort(np.random.default_rng(2).choice(np.arange(1, 399), size=360, replace=False))
    lost = sorted({*range(1, 399)} - {*present.tolist()})
    segment = cut(recording(full.iloc[[0, *present, 399]]), start=2.0, duration=30.0)
    empty = full.copy()
    empty.loc[lost, [name for name in full if name != "Time"]] = np.nan
    assert segment == cut(recording(empty), start=2.0, duration=30.0)
    assert {type(finding) for finding in segment.findings} == {Bridged}
    np.testing.assert_allclose(segment.speeds, recording(full).speed[20:321], atol=0.02)


# Missing samples


def test_a_short_block_is_bridged_and_marked() -> None:
    frame = without(slice(100, 106), "Speed2", "IVS1", "IVS2")
    segment = cut(recording(frame), duration=30.0)
    block = (Window(10.0, 10.6),)
    columns = ("Speed2", "IVS1", "IVS2")
    assert segment.findings == tuple(Bridged(column, 7, block) for column in columns)
    ends = platoon()["Speed2"].to_numpy()[[99, 107]]
    np.testing.assert_allclose(segment.speeds[99:108, 1], np.linspace(*ends, 9))
    np.testing.assert_allclose(segment.speeds[:, 1], platoon()["Speed2"][:301], atol=0.1)
    marked = np.zeros((301, 5), bool)
    marked[100:107, [1, 3, 4]] = True
    np.testing.assert_array_equal(segment.missing, marked)
    assert segment.blocks_missing == ()


def test_blocks_are_bridged_up_to_the_limit() -> None:
    ten, eleven = (recording(without(slice(100, last), "Speed2")) for last in (109, 110))
    assert cut(ten, duration=30.0).findings
    with pytest.raises(SegmentError, match="too long to bridge"):
        cut(eleven, duration=30.0)


def test_a_long_block_is_refused_unless_it_may_be_missing() -> None:
    missing = recording(without(slice(150, 199), "Speed2", "IVS1", "IVS2"))
    with pytest.raises(SegmentError) as caught:
        cut(missing)
    sentence = str(caught.value)
    assert sentence.startswith("run.csv: Speed2 is missing at 15–19.9 s")
    assert "limit 1 s" in sentence
    assert "0–14.9 s, 20–39.9 s" in sentence
    for window in complete_windows(missing, (1, 2)):
        assert cut(missing, window.start, window.duration).findings == ()
        with pytest.raises(SegmentError, match="is missing"):
            cut(missing, max(window.start - 5.0, 0.0), window.duration + 5.0)
    made = cut(missing, allow_missing=True)
    block = (Window(15.0, 19.9),)
    columns = ("Speed2", "IVS1", "IVS2")
    assert made.blocks_missing == (BlocksMissing(columns, 50 / 400, block),)
    assert made.missing[150:200].tolist() == 50 * [[False, True, False, True, True]]
    assert made.missing.sum() == 3 * 50
    ends = platoon()["Speed2"].to_numpy()[[149, 200]]
    np.testing.assert_allclose(made.speeds[149:201, 1], np.linspace(*ends, 52))
    np.testing.assert_array_equal(np.isnan(made.measured_speeds), made.missing[:, :3])
    np.testing.assert_array_equal(np.isnan(made.measured_gaps), made.missing[:, 3:])
    assert not made.counts[150:200].any()
    assert made.counts.sum() == 2 * 350


def test_blocks_at_the_edges_are_not_bridged() -> None:
    frame = without(slice(0, 2), "Speed1")
    with pytest.raises(SegmentError, match=r"no earlier sample helps; complete nearby: 0\.3–39\.9"):
        cut(recording(frame))
    assert cut(recording(frame), start=0.3).samples == 397
    frame.loc[380:, "IVS2"] = np.nan
    made = cut(recording(frame), allow_missing=True)
    assert made.blocks_missing == (
        BlocksMissing(("Speed1",), 3 / 400, (Window(0.0, 0.2),)),
        BlocksMissing(("IVS2",), 20 / 400, (Window(38.0, 39.9),)),
    )
    assert set(made.speeds[:3, 0]) == {frame["Speed1"].round(DECIMALS)[3]}
    assert set(made.gaps[380:, 1]) == {frame["IVS2"].round(DECIMALS)[379]}


def test_a_resampled_instant_is_missing_where_either_neighbour_is() -> None:
    others = recording(without(slice(0, 300), "Speed3", "IVS2"))
    made = cut(others, vehicles=(1, 2), duration=20.0, allow_missing=True)
    assert (made.missing, made.findings) == (None, ())
    frame = without(slice(100, 103), "IVS1")
    frame["Time"] += [0.001 * (k % 2) for k in range(len(frame))]  # uneven, so resampled
    made = cut(recording(frame), start=2.05, duration=30.0)
    time = made.start + made.time[made.missing[:, 3]]
    assert time[0] - 9.9 > 0
    assert time[-1] - 10.4 < 0
    assert len(time) == pytest.approx(5, abs=1)


# The vehicles


@pytest.mark.parametrize(
    ("vehicles", "absent", "possible", "default"),
    [
        (7, "Speed3 Speed4 IVS2 IVS3 IVS4", ((1, 2), (5, 6, 7)), (1, 2)),
        (9, "Speed1 Speed3 IVS1 IVS2 IVS3", ((4, 5, 6, 7, 8, 9),), (4, 5, 6, 7, 8, 9)),
        (6, "Speed1 Speed4 IVS1 IVS3 IVS4", ((2, 3), (5, 6)), (2, 3)),
        (4, "IVS2", ((1, 2), (3, 4)), (1, 2)),
    ],
)
def test_possible_platoons_and_the_default(
    vehicles: int, absent: str, possible: tuple[tuple[int, ...], ...], default: tuple[int, ...]
) -> None:
    """The platoon from vehicle 1 on, or the longest, or the first of equals; as in ZalaZone."""
    holes = recording(platoon(vehicles).drop(columns=absent.split()), "ABCDEFGHI"[:vehicles])
    assert chains(holes) == possible
    assert default_vehicles(holes) == default
    last = possible[-1]
    assert cut(holes, duration=20.0, vehicles=last).names == tuple("ABCDEFGHI"[n - 1] for n in last)


@pytest.mark.parametrize(
    ("vehicles", "words"),
    [
        ((1,), "at least one follower"),
        ((), "at least one follower"),
        ((1, 3), "vehicle 3 does not follow vehicle 1"),
        ((2, 1), "vehicle 1 does not follow vehicle 2"),
        ((1, 1), "vehicle 1 does not follow vehicle 1"),
        ((3, 4), "vehicle 4 has no speed"),
        ((0, 1), "vehicle 0 has no speed"),
        ((1, 2, 3), "IVS2"),
        (range(1, 13), "11 followers are chosen and at most 10"),
    ],
)
def test_vehicles_that_are_no_platoon_are_refused(vehicles: tuple[int, ...], words: str) -> None:
    gapless = recording(without(slice(None), "IVS2"))
    with pytest.raises(SegmentError, match=words) as caught:
        cut(gapless, vehicles=vehicles)
    assert str(caught.value).endswith("possible platoons: 1-2.")
    assert cut(recording(platoon(12), "ABCDEFGHIJKL")).followers == 10
    with pytest.raises(SegmentError, match="no two consecutive vehicles"):
        cut(recording(platoon(4)[["Time", "Speed1", "Speed3", "IVS1"]]))


# The segment itself


def segment(**changes: object) -> Segment:
    made = segment_of(0.1 * np.arange(4), np.ones((4, 2)), np.full((4, 1), 5.0))
    return replace(made, **{"names": ("A", "Vehicle 2"), "source": "made.csv", **changes})


def test_a_segment_copies_its_arrays_and_describes_itself() -> None:
    speeds = np.ones((4, 2))
    made = segment(speeds=speeds)
    speeds[0, 0] = 9.0
    assert made.speeds[0, 0] == 1.0
    with pytest.raises(ValueError, match="read-only"):
        made.speeds[0, 0] = 9.0
    assert (made.followers, made.samples, made.sample_time) == (1, 4, 0.1)
    assert made.window == Window(0.0, 0.3)
    assert [str(Window(*ends)) for ends in ((32.9, 33.4), (7.5, 7.5))] == ["32.9–33.4 s", "7.5 s"]
    assert made.labels == (made.label(1), made.label(2)) == ("1 A", "Vehicle 2")


DIGEST = "e8de3445f671857c163f7cf7fe72550161734dcda6c3f36cd2732be8af2671b6"
"""Another one would make cached results invalid."""


def test_the_digest_follows_content_only() -> None:
    same = segment(names=("X", "Y"), source="other.csv", findings=(Resampled(0.1),)).info.digest
    assert segment().info.digest == same == DIGEST
    other = [
        segment(start=1.0),
        segment(vehicles=(2, 3)),
        segment(time=0.2 * np.arange(4)),
        segment(speeds=np.full((4, 2), 1 + 1e-15)),
        segment(gaps=np.full((4, 1), 5.1)),
        segment(missing=np.eye(4, 3, dtype=bool)),
        segment(missing=np.eye(4, 3, 1, dtype=bool)),
        *(segment(mask=np.eye(4, 1, -k, dtype=bool)) for k in (0, 1)),
    ]
    digests = {made.info.digest for made in other} | {same}
    assert len(digests) == 10
    assert segment(missing=np.zeros((4, 3), bool)).info.digest == same
    assert all(len(digest) == 64 for digest in digests)


@pytest.mark.parametrize(
    "changes",
    [
        {"time": np.zeros(1)},
        {"speeds": np.ones((3, 2))},
        {"gaps": np.ones((4, 2))},
        {"mask": np.ones((4, 2), bool)},
        {"missing": np.ones((4, 2), bool)},
        {"gaps": np.full((4, 1), np.nan)},
        {"speeds": np.full((4, 2), np.inf)},
        {"names": ("A",)},
        {"vehicles": (1,), "names": ("A",)},
    ],
)
def test_a_segment_of_unusable_arrays_is_refused(changes: dict[str, object]) -> None:
    with pytest.raises(SegmentError, match=r"made\.csv"):
        segment(**changes)


HOLES = recording(without(slice(120, 170), "Speed2", "IVS1", "IVS2"))
ANY = st.floats(allow_nan=True, allow_infinity=True)


@settings(max_examples=150)
@given(
    st.one_of(ANY, st.floats(0, 40)),
    st.one_of(ANY, st.floats(0, 60)),
    st.one_of(st.none(), st.lists(st.integers(-1, 5), max_size=4)),
    st.booleans(),
)
def test_any_choice_gives_a_segment_or_a_sentence(
    start: float, duration: float, vehicles: list[int] | None, missing: bool
) -> None:
    try:
        made = cut(HOLES, start, duration, vehicles, missing)
    except AccpinnError as error:
        text = str(error)
    else:
        assert 9.9 <= made.window.duration <= duration + 1e-6
        assert made.window.end <= HOLES.duration + 1e-6
        np.testing.assert_allclose(np.diff(made.time), 0.1, atol=1e-9)
        return
    assert text.endswith(".")
    assert "\n" not in text


# Several windows


def test_disjoint_windows_are_complete_and_do_not_overlap() -> None:
    whole = disjoint_windows(recording(), 12.0)
    assert whole == (Window(0.0, 12.0), Window(12.0, 24.0), Window(24.0, 36.0))
    holed = recording(without(slice(130, 160), "Speed2"))
    windows = disjoint_windows(holed, 11.0)
    assert windows == (Window(0.0, 11.0), Window(16.1, 27.1), Window(27.1, 38.1))
    assert all(cut(holed, w.start, w.duration).window == w for w in windows)
    assert disjoint_windows(holed, 30.0) == ()
    with pytest.raises(SegmentError, match="take at least 10 s"):
        disjoint_windows(holed, 9.0)


@pytest.mark.parametrize(
    ("parse", "text", "expected"),
    [
        (parse_vehicles, "1-5", (1, 2, 3, 4, 5)),
        (parse_vehicles, "1,2 2", (1, 2, 2)),
        (parse_vehicles, " 2 - 4 , 5", (2, 3, 4, 5)),
        (parse_vehicles, "3-1", (3, 2, 1)),
        *((parse_vehicles, text, "1-5")
          for text in ("", "a", "1-", "1--2", "1;2", "-1", "1-9999", "1,,2", "1.5")),
        (parse_windows, "0-300,600-900", (Window(0.0, 300.0), Window(600.0, 900.0))),
        (parse_windows, " 12.5 - 40 ", (Window(12.5, 40.0),)),
        *((parse_windows, text, "0-300,600-900|ends before it starts")
          for text in ("", "-", "0", "0-", "-5-10", "0-1,", "a-b", "300-0", "5-5")),
    ],
)  # fmt: skip
def test_vehicles_and_windows_may_be_written(
    parse: Callable[[str], object], text: str, expected: tuple[object, ...] | str
) -> None:
    if isinstance(expected, tuple):
        assert parse(text) == expected
    else:
        with pytest.raises(SegmentError, match=expected):
            parse(text)
